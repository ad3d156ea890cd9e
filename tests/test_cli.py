"""The command line; most of it runs in this process, and one test starts a process as a user does."""

import json
import os
import subprocess
import sys
from functools import partial

import pytest

import crfbench
from crfbench import camera, cli, lab
from crfbench.models import ModelKey, load_model
from crfbench.paper import calibration, figures, fitting, stability
from crfbench.paper.fitting import COLUMNS
from crfbench.paper.results import load_recorded
from crfbench.paper.verdicts import CALIBRATION, CALIBRATION_COLUMNS
from tests.support.command import run_command


@pytest.fixture
def recorded_fits(monkeypatch):
    """Let the command print rows that were recorded: fitting them all takes a minute and has tests of its own."""
    table = load_recorded("fitting_dorf")[0]
    monkeypatch.setattr(
        fitting, "fitting_table", lambda responses, directions, progress: table[table["direction"].isin(directions)]
    )


def test_the_command_works_as_a_process():
    for command in (["-m", "crfbench"], ["-c", "from crfbench.cli import main; main()"]):
        done = subprocess.run([sys.executable, *command, "--version"], capture_output=True, text=True, check=True)
        assert done.stdout.strip() == crfbench.__version__
    done = subprocess.run([sys.executable, "-m", "crfbench", "train"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("crfbench: no model is named")


def test_json_rows_have_exactly_the_keys(recorded_fits):
    done = run_command("table", "fitting", "--json")
    assert done.returncode == 0
    rows = json.loads(done.stdout)
    assert all(tuple(row) == COLUMNS for row in rows)
    assert {row["split"] for row in rows} == {"in-sample", "grouped-5fold", "other-set"}
    assert {row["direction"] for row in rows} == {"forward", "inverse"}


def test_without_dorf_the_recorded_table_stands_beside(recorded_fits):
    done = run_command("table", "fitting", "--direction", "forward")
    assert done.returncode == 0
    assert "opencrf, computed now" in done.stdout
    assert "dorf, recorded with crfbench" in done.stdout
    assert "inverse" not in done.stdout
    assert done.stdout.count("reproduced") >= 4


@pytest.mark.parametrize("which", ["latents", "fitting"])
def test_a_table_fits_80_columns_and_wide_has_them_all(recorded_fits, which):
    short, whole = (run_command("table", which, *more).stdout.splitlines() for more in ((), ("--wide",)))
    assert max(map(len, short)) <= 80
    names, every = (next(line.split() for line in lines if "model" in line.split()) for lines in (short, whole))
    assert names[0] == "model"
    assert set(names) < set(every)
    row, full = (next(line.split() for line in lines if "SLR-ldl-1-forward" in line) for lines in (short, whole))
    assert len(row) == len(names)
    assert len(full) == len(every)


def test_the_papers_method_gives_table_3_with_all_its_rows_and_columns(monkeypatch):
    recorded = load_recorded("calibration_paper")[0].query("patches == 3 or patches == '3'")
    monkeypatch.setattr(calibration, "calibration_table", lambda *_, **__: recorded)
    lines = run_command("table", "calibration", "--method", "paper").stdout.splitlines()
    assert max(map(len, lines)) <= 80
    heading = next(line.split() for line in lines if line.startswith("model "))
    assert heading == ["model", *CALIBRATION_COLUMNS, "paper_mean", "verdict"]
    assert [line.split()[0] for line in lines if line.startswith(tuple(CALIBRATION))] == list(CALIBRATION)


def test_numbers_of_a_column_are_aligned_and_none_is_lost(capsys):
    import pandas as pd

    from crfbench.cli import _print_tables

    table = pd.DataFrame({"model": list("abc"), "like": [0.25, 0.5, None], "far": [1e-7, 1.0, 0.0], "zero": [0.0] * 3})
    table["wide"] = [0.0348, 38.6, None]
    _print_tables({"title": table}, as_json=False, columns=("model", "like", "wide", "far"))
    lines = capsys.readouterr().out.splitlines()
    assert [line.split() for line in lines[1:5]] == [
        ["model", "like", "wide", "far"], ["a", "0.250", "0.0348", "1.00E-7"], ["b", "0.500", "38.6000", "1.00E0"],
        ["c", "-", "-", "0.00E0"],
    ]  # fmt: skip


def test_a_terminal_has_colours_and_a_pipe_or_no_color_none(monkeypatch, capsys):
    import pandas as pd

    from crfbench.cli import _print_tables

    def printed(**variables):
        for name in ("NO_COLOR", "FORCE_COLOR"):
            monkeypatch.delenv(name, raising=False)
        for name, value in variables.items():
            monkeypatch.setenv(name, value)
        _print_tables({"title": pd.DataFrame({"model": ["a", "b"], "verdict": ["holds", "differs"]})}, as_json=False)
        return capsys.readouterr().out

    monkeypatch.setenv("TERM", "xterm")
    assert "\x1b[32mholds" in printed(FORCE_COLOR="1")
    assert "\x1b[3" not in printed(FORCE_COLOR="1", NO_COLOR="1") + printed()
    assert [line.split() for line in printed().splitlines()[1:4]] == [
        ["model", "verdict"],
        ["a", "holds"],
        ["b", "differs"],
    ]


def test_the_numbers_of_one_table_of_the_paper_are_printed_at_once():
    done = run_command("paper", "Table 2")
    assert max(map(len, done.stdout.splitlines())) <= 80
    assert {"0.66", "1.63", "8.11", "3.87"} <= set(done.stdout.split())
    assert {row["where"] for row in json.loads(run_command("paper", "4.5", "--json").stdout)} == {"4.5", "4.5, Table 3"}
    wrong = run_command("paper", "Table 9")
    assert wrong.returncode == 2
    assert "use 'Table 1'" in wrong.stderr


def test_the_map_fits_80_columns_and_says_all_when_wide_or_json():
    short, wide = (run_command("paper", *more).stdout for more in ((), ("--wide",)))
    assert max(map(len, short.splitlines())) <= 80
    rows = json.loads(run_command("paper", "--json").stdout)
    for row in rows:
        assert " ".join(row["verdict"].split()[:2]) in short
        assert all(text in wide for text in row.values())
    assert set(rows[0]) == {"item", "what", "function", "cell", "command", "recorded", "figure", "judged", "verdict"}


def test_help_lists_commands_by_use_and_h_asks_for_it():
    shown = run_command("-h").stdout
    assert shown == run_command("--help").stdout
    names = [
        "calibrate",
        "linearise",
        "convert",
        "lab",
        "paper",
        "tables",
        "report",
        "search",
        "table",
        "data",
        "fetch",
    ]
    places = [shown.index(f"│ {name} ") for name in names]
    assert places == sorted(places)
    assert "--patches" in run_command("table", "calibration", "-h").stdout


def test_a_shell_can_complete(monkeypatch):
    monkeypatch.setenv("_CRFBENCH_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "crfbench ta")
    monkeypatch.setenv("COMP_CWORD", "1")
    done = subprocess.run(
        [sys.executable, "-c", "import sys; sys.argv[0] = 'crfbench'; from crfbench.cli import main; main()"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == ["tables", "table"]


def test_data_lists_every_set():
    rows = {row["key"]: row for row in json.loads(run_command("data", "--json").stdout)}
    assert set(rows) == {"opencrf", "dorf", "emor", "middlebury"}
    assert rows["opencrf"]["present"] == "bundled"
    assert rows["dorf"]["present"] == "absent"
    assert "crfbench fetch dorf" in run_command("data").stdout


def test_options_are_named_but_not_within_models_and_calls():
    said = cli._with_options("direction='up' of Bend(n_params=1, direction='inverse') with white_level=3")
    assert said == "--direction 'up' of Bend(n_params=1, direction='inverse') with --white-level 3"


def test_what_is_there_already_is_told_before_the_work(tmp_path):
    (tmp_path / "passport.json").touch()
    done = run_command("calibrate", str(tmp_path / "none"), "--out", str(tmp_path))
    assert (done.returncode, done.stdout) == (2, "")
    assert "passport.json exists already" in done.stderr


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["table", "fitting", "--data", "dorf"], "run 'crfbench fetch dorf'"),
        (["table", "fitting", "--data", "nonsense"], "--data 'nonsense' is not known; use one of auto, dorf, opencrf"),
        (["table", "fitting", "--direction", "up"], "--direction 'up' is not known; use one of forward, inverse, both"),
        (["table", "chart-free", "--method", "lm"], "--method 'lm' is not known; use one of map, posterior"),
        (["fetch", "nonsense"], "WHICH 'nonsense' is not known"),
        (["calibrate", camera.EXAMPLE_FOLDER, "--white-level", "3"], "--white-level 3 is out of range"),
        (["train"], "no model is named; use --all or some of: SLR-baseline-1"),
        (["train", "LDL"], "'LDL' is not a valid name of a model; use one such as 'SLR-ldl-1'"),
        (["calibrate", ".", "--model", "SLR-none-1"], "no model 'SLR-none-1' is bundled; use one of SLR-"),
        (["tables", "--out", os.devnull], f"{os.devnull} cannot be used: "),
        (["report", "--out", "."], ". cannot be used: "),
        (["search", "--seed", "-1"], "--seed -1 is out of range; use a whole number from 0"),
    ],
)
def test_mistakes_are_one_sentence_and_status_2(args, words):
    done = run_command(*args)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("crfbench: ")
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_wrong_option_is_status_2():
    assert run_command("table", "fitting", "--nonsense").returncode == 2
    assert run_command("nonsense").returncode == 2


def test_without_pytorch_the_sentence_says_how_to_get_it(monkeypatch):
    for name in [
        name for name in sys.modules if name.split(".")[:2] in (["crfbench", "training"], ["crfbench", "search"])
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    done = run_command("train", "--all")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.endswith("pip install torch\n")


@pytest.mark.parametrize(
    ("former", "current"),
    [
        *cli.FORMER_NAMES.items(),
        ("ldl-1-inverse", "SLR-ldl-1"),
        ("open-1-forward", "SLR-open-1-forward"),
        ("monotone-3-inverse", "SLR-monotone-3"),
    ],
)
def test_a_former_name_of_a_model_works_with_a_hint(capsys, former, current):
    assert cli._current_name(former) == current
    hint = capsys.readouterr().err
    assert hint.count("\n") == 1
    assert f"{former} is called {current} now" in hint
    assert str(ModelKey.parse(current)) == current
    assert cli._current_name(current) == current
    assert capsys.readouterr().err == ""


def test_calibrate_takes_a_former_name(monkeypatch, tmp_path):
    asked = []

    def calibrate(source, chart, exposures, model, created, **options):
        asked.append((source, chart, exposures, load_model(model).n_params, created[:2]))
        raise KeyboardInterrupt

    monkeypatch.setattr(camera, "calibrate", calibrate)
    done = run_command("calibrate", tmp_path, "--model", "slr", "--exposures", "1,2.5", "--chart", "none")
    assert asked == [([tmp_path], "none", "1,2.5", 3, "20")]
    assert "slr is called SLR-ldl-3 now" in done.stderr


def test_options_of_lab_go_to_jupyterlab(monkeypatch, tmp_path):
    seen = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(lab, "open_lab", lambda folder, options: seen.append((folder.name, options)))
    for args in (["lab", "--no-browser"], ["lab", "mine", "--port", "9999"], ["lab", "--port", "9999"]):
        assert run_command(*args).returncode == 0
    assert seen == [
        ("crfbench-notebooks", ["--no-browser"]),
        ("mine", ["--port", "9999"]),
        ("crfbench-notebooks", ["--port", "9999"]),
    ]


def test_what_is_bundled_need_not_be_fetched():
    assert run_command("fetch", "opencrf").stdout == "opencrf is bundled with crfbench; there is nothing to fetch\n"


@pytest.mark.slow
def test_tables_writes_every_table_and_figure(tmp_path, monkeypatch):
    # Fewer of the same rows: each of them has a test of its own.
    few = (ModelKey("SLR", "ldl", 1), ModelKey("EMoR", "", 3))
    monkeypatch.setattr(figures, "calibration_table", partial(figures.calibration_table, rows=few))
    monkeypatch.setattr(calibration, "ROWS", few)
    stable = partial(figures.stability_table, rows=stability.ROWS[:1], triples=1)
    monkeypatch.setattr(figures, "stability_table", stable)
    monkeypatch.setattr(figures, "fitting_tables", partial(figures.fitting_tables, directions=("forward",)))
    shown = {name: figures.PAPER_FIGURES[name] for name in ("figure_2", "table_2", "algorithm_1")}
    monkeypatch.setattr(figures, "PAPER_FIGURES", shown)
    done = run_command("tables", "--out", tmp_path / "new folder")
    assert done.returncode == 0, done.stderr
    written = {path.name for path in (tmp_path / "new folder").iterdir()}
    assert {path.rsplit("/", 1)[-1] for path in done.stdout.split("\n") if path} == written
    assert {"latents.csv", "latents.json", "algorithm_1.pdf"} <= written
    assert {"claims.csv", "leaderboard.json"} <= written
    for stem in (
        "curves_opencrf",
        "figure_2",
        "table_2",
        "comparison",
        "fitting_opencrf",
        "fitting_dorf",
        "validity_dorf",
    ):
        assert {f"{stem}.png", f"{stem}.pdf"} <= written
    assert {"fitting_dorf.json", "fitting_opencrf.csv", "stability.csv", "chart_free.json"} <= written
    assert {"calibration_3_map.csv", "calibration_24_posterior.json", "calibration_coverage.pdf"} <= written
    assert json.loads((tmp_path / "new folder" / "fitting_dorf.json").read_text())[0]["model"].startswith("Gamma")
