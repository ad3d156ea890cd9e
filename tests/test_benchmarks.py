"""The benchmarks give rows of one shape, whatever they measure; how fast anything is, no test asks."""

import json

import numpy as np
import pytest

from benchmarks import __main__ as command
from benchmarks import slider
from benchmarks.timing import Growth, draw_growth, row

KEYS = ["name", "ours_s", "other", "other_s", "ratio", "note"]


@pytest.mark.slow
def test_rows_have_exactly_the_keys_and_the_ratio_is_that_of_the_times(capsys):
    command.main(["imports", "fitting", "--json"])
    rows = json.loads(capsys.readouterr().out)
    assert len(rows) == 3
    for each in rows:
        assert list(each) == KEYS
        assert each["ours_s"] > 0
        assert each["ratio"] == pytest.approx(each["other_s"] / each["ours_s"])


def test_an_unknown_subject_is_refused_with_those_that_there_are(capsys):
    with pytest.raises(SystemExit) as caught:
        command.main(["fitting", "nix"])
    assert caught.value.code == 2
    assert f"there is no benchmark nix; use some of {', '.join(command.SUBJECTS)}" in capsys.readouterr().err


@pytest.mark.slow
def test_every_subject_has_rows_and_some_have_growths():
    from importlib import import_module

    for subject in command.SUBJECTS:
        assert hasattr(import_module(f"benchmarks.{subject}"), "rows"), subject
    growing = {s for s in command.SUBJECTS if hasattr(import_module(f"benchmarks.{s}"), "growths")}
    assert growing == set(command.GROWING)


def test_without_chromium_the_row_says_so(monkeypatch):
    monkeypatch.setattr(slider, "find_chromium", lambda: None)
    (found,) = slider.rows()
    assert found.ratio is None
    assert found.text().endswith("skipped: Chromium is absent")


def test_a_subject_that_fails_leaves_the_others_their_rows():
    failed, fine = command.collect(["timing", "imports"])  # timing has no rows
    assert failed.ratio is None
    assert "failed: AttributeError" in failed.note
    assert fine.ratio > 0


def test_a_row_reads_as_text():
    assert row("fit", 0.5, "SciPy", 2.0, "one thread").text() == (
        "fit\n    4.00 x: crfbench 0.5000 s, SciPy 2.0000 s\n    one thread"
    )


def test_growth_is_drawn_with_a_guide_of_slope_one(tmp_path, monkeypatch):
    import matplotlib.pyplot as plt

    kept = []
    monkeypatch.setattr(plt, "close", kept.append)
    growth = Growth("curves", ("a", "b"), (10, 1000), np.array([[1.0, 2.0], [50.0, 9.0]]))
    draw_growth([growth], tmp_path / "new" / "t.svg")
    (ax,) = kept[0].axes
    *_, guide = ax.get_lines()
    slopes = np.diff(np.log(guide.get_ydata())) / np.diff(np.log(guide.get_xdata()))
    assert slopes == pytest.approx(1.0)
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert (tmp_path / "new" / "t.svg").read_text(encoding="utf-8").startswith("<?xml")
