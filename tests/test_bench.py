"""The benchmarks give rows of one shape, whatever they measure; how fast anything is, no test asks."""

import json

import pytest
from typer.testing import CliRunner

from crfbench import cli
from crfbench.bench import collecting, slider
from crfbench.bench.collecting import SUBJECTS, collect
from crfbench.bench.growth import Growth, plot
from crfbench.errors import InputError

KEYS = ["name", "ours_s", "other", "other_s", "ratio", "note"]


@pytest.mark.parametrize("subject", ["imports", "fitting"])
def test_rows_have_exactly_the_keys_and_the_ratio_is_that_of_the_times(subject):
    done = CliRunner().invoke(cli.app, ["bench", "--only", subject, "--json"])
    assert done.exit_code == 0
    rows = json.loads(done.stdout)
    assert rows
    for row in rows:
        assert list(row) == KEYS
        assert row["ours_s"] > 0
        assert row["ratio"] == pytest.approx(row["other_s"] / row["ours_s"])


def test_an_unknown_subject_is_refused_with_those_that_there_are():
    with pytest.raises(InputError, match=f"only='nix' is no benchmark; use one of {', '.join(SUBJECTS)}"):
        next(collect("nix"))


def test_without_chromium_the_row_says_so(monkeypatch):
    monkeypatch.setattr(slider, "find_chromium", lambda: None)
    (row,) = slider.rows()
    assert row.ratio is None
    assert row.note == "skipped: Chromium is absent"


def test_a_subject_that_fails_leaves_the_others_their_rows(monkeypatch):
    monkeypatch.setattr(collecting, "SUBJECTS", ("growth", "imports"))  # growth has no rows
    failed, fine = collect()
    assert failed.ratio is None
    assert "status 1" in failed.note
    assert fine.ratio > 0


def test_growth_is_drawn_with_a_guide_of_slope_one(tmp_path, monkeypatch):
    import matplotlib.pyplot as plt
    import numpy as np

    kept = []
    monkeypatch.setattr(plt, "close", kept.append)
    plot([Growth("curves", ("a", "b"), (10, 1000), np.array([[1.0, 2.0], [50.0, 9.0]]))], tmp_path / "new" / "t.svg")
    (ax,) = kept[0].axes
    *_, guide = ax.get_lines()
    slopes = np.diff(np.log(guide.get_ydata())) / np.diff(np.log(guide.get_xdata()))
    assert slopes == pytest.approx(1.0)
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert (tmp_path / "new" / "t.svg").read_text(encoding="utf-8").startswith("<?xml")
