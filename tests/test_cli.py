import json
import os
import subprocess
import sys
from functools import partial

import pytest
from typer.testing import CliRunner

import crfbench
from crfbench import cli, lab, results
from crfbench.tables import stability
from crfbench.tables.fitting import COLUMNS


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Run the command line in a process of its own, without the real data and with an empty cache."""
    env = {k: v for k, v in os.environ.items() if k != "CRFBENCH_DATA"}
    env["XDG_CACHE_HOME"] = str(tmp_path_factory.mktemp("cache"))
    command = [sys.executable, "-m", "crfbench.cli"]
    return lambda *args: subprocess.run([*command, *args], capture_output=True, text=True, check=False, env=env)


@pytest.fixture(scope="module")
def fitting_json(run):
    return run("table", "fitting", "--json")


def test_json_rows_have_exactly_the_keys(fitting_json):
    assert fitting_json.returncode == 0
    rows = json.loads(fitting_json.stdout)
    assert all(tuple(row) == COLUMNS for row in rows)
    assert {row["split"] for row in rows} == {"in-sample", "grouped-5fold", "other-set"}
    assert {row["direction"] for row in rows} == {"forward", "inverse"}


def test_without_dorf_the_recorded_table_stands_beside(run):
    done = run("table", "fitting", "--direction", "forward")
    assert done.returncode == 0
    assert "opencrf, computed now" in done.stdout
    assert "dorf, recorded with crfbench" in done.stdout
    assert "inverse" not in done.stdout
    assert done.stdout.count("reproduced") >= 4


@pytest.mark.parametrize("width", [20, 80])
def test_in_a_narrow_terminal_every_part_of_a_table_names_its_rows(monkeypatch, width):
    wide, narrow = [], []
    for lines, columns in ((wide, 500), (narrow, width)):
        monkeypatch.setenv("COLUMNS", str(columns))
        lines.extend(CliRunner().invoke(cli.app, ["table", "latents"]).stdout.splitlines())
    whole = next(line.split() for line in wide if "encoder_mse" in line and "model" in line)
    heads = [line.split() for line in narrow if line.split() and set(line.split()) <= {*whole[4:], "\\"}]
    assert [name for head in heads for name in head if name != "\\"] == whole[4:]
    assert sum(line.split() == whole[:4] for line in narrow) == len(heads) > 1
    names = ["SLR-ldl", "1", "inverse", "ldl"]
    (row,) = [line.split()[4:] for line in wide if line.split()[:4] == names]
    assert [value for line in narrow if line.split()[:4] == names for value in line.split()[4:]] == row
    assert width < 80 or max(map(len, narrow)) <= width


def test_data_lists_every_set(run):
    done = run("data", "--json")
    rows = {row["key"]: row for row in json.loads(done.stdout)}
    assert set(rows) == {"opencrf", "dorf", "emor", "middlebury"}
    assert rows["opencrf"]["present"] == "shipped"
    assert rows["dorf"]["present"] == "absent"
    assert "crfbench fetch dorf" in run("data").stdout


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["table", "fitting", "--data", "dorf"], "run 'crfbench fetch dorf'"),
        (["table", "fitting", "--data", "nonsense"], "which='nonsense' is not known; use one of auto, dorf, opencrf"),
        (["table", "fitting", "--direction", "up"], "direction='up' is not known"),
        (["fetch", "nonsense"], "nonsense"),
        (["train"], "no model is named; use --all or some of: baseline-1-forward"),
        (["train", "LDL"], "'LDL' is no shipped model"),
        (["tables", "--out", os.devnull], f"{os.devnull} cannot be used: "),
        (["report", "--out", "."], ". cannot be used: "),
        (["search", "--seed", "-1"], "seed=-1 does not fit; use a whole number from 0"),
    ],
)
def test_mistakes_are_one_sentence_and_status_2(run, args, words):
    done = run(*args)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("crfbench: ")
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_wrong_option_is_status_2(run):
    assert run("table", "fitting", "--nonsense").returncode == 2
    assert run("nonsense").returncode == 2


def test_options_of_lab_go_to_jupyterlab(monkeypatch, tmp_path):
    seen = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(lab, "open_lab", lambda folder, options: seen.append((folder.name, options)))
    for args in (["lab", "--no-browser"], ["lab", "mine", "--port", "9999"], ["lab", "--port", "9999"]):
        assert CliRunner().invoke(cli.app, args).exit_code == 0
    assert seen == [
        ("crfbench-notebooks", ["--no-browser"]),
        ("mine", ["--port", "9999"]),
        ("crfbench-notebooks", ["--port", "9999"]),
    ]


def test_what_is_shipped_need_not_be_fetched(run):
    assert run("fetch", "opencrf").stdout == "opencrf is shipped with crfbench; there is nothing to fetch\n"


def test_version(run):
    assert run("--version").stdout.strip() == crfbench.__version__


def test_tables_writes_every_table_and_figure(tmp_path, monkeypatch):
    monkeypatch.delenv("CRFBENCH_DATA", raising=False)
    # Fewer of the same rows: each of them has a test of its own.
    few = (("SLR", "ldl", 1), ("EMoR", "", 3))
    monkeypatch.setattr(results, "calibration_table", partial(results.calibration_table, rows=few))
    monkeypatch.setattr(stability, "ROWS", stability.ROWS[:1])
    monkeypatch.setattr(results, "stability_table", partial(results.stability_table, random_subsets=1))
    result = CliRunner().invoke(cli.app, ["tables", "--out", str(tmp_path / "new folder")])
    assert result.exit_code == 0, result.output
    written = {path.name for path in (tmp_path / "new folder").iterdir()}
    assert {path.rsplit("/", 1)[-1] for path in result.output.split("\n") if path} == written
    assert {"latents.csv", "latents.json", "latent_epochs.pdf", "search.pdf"} <= written
    assert {"claims.csv", "leaderboard.json"} <= written
    for stem in ("curves_opencrf", "patches", "comparison", "fitting_opencrf", "fitting_dorf", "validity_dorf"):
        assert {f"{stem}.png", f"{stem}.pdf"} <= written
    assert {"fitting_dorf.json", "fitting_opencrf.csv", "stability.csv", "chart_free.json"} <= written
    assert {"calibration_3_map.csv", "calibration_24_posterior.json", "calibration_coverage.pdf"} <= written
    assert json.loads((tmp_path / "new folder" / "fitting_dorf.json").read_text())[0]["model"] == "Gamma"
