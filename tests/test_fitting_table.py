import json

import numpy as np
import pandas as pd
import pytest

from crfbench.datasets import load_opencrf
from crfbench.datasets.responses import grouped_folds
from crfbench.errors import FormatError, MissingDataError
from crfbench.metrics import rmse
from crfbench.models import EMoR
from crfbench.paper.fitting import COLUMNS, display_table, fitting_table, papers_rising_rows
from crfbench.paper.results import BAR, load_recorded, record, to_rows

KEYS = {"model", "n_params", "direction", "split"}
FIGURES = ["mean_rmse", "median_rmse", "p95_rmse", "max_rmse", "mean_mse"]


@pytest.fixture(scope="module")
def opencrf():
    """Return a fifth of OpenCRF, of all its families; the slow test below fits the whole of DoRF."""
    return load_opencrf().select(range(0, 151, 5))


@pytest.fixture(scope="module")
def table(opencrf):
    return fitting_table(opencrf)


def one(table, **wanted):
    rows = table[np.logical_and.reduce([table[key] == value for key, value in wanted.items()])]
    assert len(rows) == 1
    return rows.iloc[0]


def test_rows_are_complete_and_unique(table):
    assert tuple(table.columns) == COLUMNS
    assert not table.duplicated(subset=list(KEYS)).any()
    classical = table[~table["model"].str.startswith(("SLR", "EMoR-published"))]
    assert len(classical) == 15 * 2 * 2
    slr = table[table["model"].str.startswith("SLR")]
    assert set(slr.loc[slr["split"] == "in-sample", "model"]) == {
        "SLR-open-1",
        "SLR-open-1-forward",
    }  # the others learned from DoRF
    assert {"SLR-ldl-1", "SLR-monotone-3-forward", "SLR-vae-1"} <= set(slr.loc[slr["split"] == "other-set", "model"])
    assert (table["verdict"] == "not comparable").all()  # the paper fitted DoRF, not OpenCRF
    assert table["paper"].isna().all()


def test_figures_are_those_of_the_definition(table, opencrf):
    row = one(table, model="EMoR-2", split="in-sample")
    curves = opencrf.in_direction("inverse")
    centred = curves - curves.mean(axis=0)
    values, vectors = np.linalg.eigh(centred.T @ centred)
    residual = centred - centred @ vectors[:, -2:] @ vectors[:, -2:].T
    expected = np.sqrt((residual**2).mean(axis=1))
    assert row["mean_rmse"] == pytest.approx(expected.mean(), rel=1e-6)
    assert row["max_rmse"] == pytest.approx(expected.max(), rel=1e-6)
    assert row["mean_mse"] == pytest.approx((expected**2).mean(), rel=1e-6)
    assert values[-1] >= values[0]


def test_held_out_rows_never_see_the_unit_they_are_tested_on(table, opencrf):
    folds = grouped_folds(opencrf.units)
    decoded = np.empty_like(opencrf.curves)
    for fold in range(5):
        assert not set(np.array(opencrf.units)[folds == fold]) & set(np.array(opencrf.units)[folds != fold])
        model = EMoR.from_curves(opencrf.curves[folds != fold], 3, "forward")
        decoded[folds == fold] = model.decode(model.fit(opencrf.curves[folds == fold]))
    row = one(table, model="EMoR-3-forward", split="grouped-5fold")
    assert row["mean_rmse"] == pytest.approx(rmse(decoded, opencrf.curves).mean(), rel=1e-9)


def test_what_learns_is_worse_held_out_and_what_does_not_is_the_same(table):
    wide = table.pivot_table(index="model", columns="split", values="mean_rmse").dropna()
    learns = wide.index.str.startswith("EMoR")
    assert (wide["grouped-5fold"] > wide["in-sample"])[learns].all()
    assert (wide["grouped-5fold"] == wide["in-sample"])[~learns].all()


def test_directions_can_be_chosen_and_the_time_left_is_told(opencrf, monkeypatch, capfd):
    monkeypatch.setitem(BAR, "delay", 0)
    few = opencrf.select(range(0, len(opencrf), 2))
    assert set(fitting_table(few, ["inverse"], progress=True)["direction"]) == {"inverse"}
    assert " left]" in capfd.readouterr().err


def test_display_is_rounded_and_without_times(table):
    shown = display_table(table, "forward", "in-sample")
    assert "seconds" not in shown
    assert shown.loc[0, "mean_rmse"] == f"{one(table, model='Gamma-1-forward', split='in-sample')['mean_rmse']:.2e}"


def test_papers_rising_rows_are_the_ones_in_its_table():
    assert papers_rising_rows() == [
        "Polynomial: 8.79E-3 with 1, 2.36E-2 with 2 parameters",
        "Polynomial: 2.36E-2 with 2, 2.50E-2 with 3 parameters",
        "Polynomial: 2.50E-2 with 3, 2.90E-2 with 4 parameters",
        "GGCM: 6.65E-3 with 1, 7.55E-3 with 2 parameters",
    ]


@pytest.mark.slow
@pytest.mark.dorf
def test_recorded_equals_recomputed_and_emor_is_the_papers(dorf_curves, emor_files):
    now = fitting_table(dorf_curves)
    recorded, provenance = load_recorded("fitting_dorf")
    both = now.merge(recorded, on=sorted(KEYS), suffixes=("", "_recorded"))
    assert len(both) == len(now) == len(recorded)
    for name in FIGURES:
        assert np.allclose(both[name], both[f"{name}_recorded"], rtol=5e-4), name
    for name in ("nonmonotone", "out_of_range"):
        assert np.allclose(both[name], both[f"{name}_recorded"], atol=1.01 / len(dorf_curves)), name
    assert (both["verdict"] == both["verdict_recorded"]).all()
    assert provenance["sha256 of 201_CRF_data.mat"].startswith("45d7b646")
    emor = now[now["model"].str.startswith("EMoR-published") & (now["direction"] == "forward")].sort_values("n_params")
    assert [f"{value:.2e}" for value in emor["mean_rmse"]] == ["3.60e-02", "1.24e-02", "5.71e-03", "3.21e-03"]
    assert (emor["verdict"] == "reproduced").all()


def test_recorded_tables_round_trip(tmp_path, table):
    path = record(table, "again", {"crfbench": "0"}, tmp_path)
    back, provenance = load_recorded("again", tmp_path)
    assert provenance == {"crfbench": "0"}
    assert to_rows(back) == to_rows(table)
    assert set(json.loads(path.read_text())["rows"][0]) == set(COLUMNS)
    assert [p.name for p in tmp_path.iterdir()] == ["again.json"]


@pytest.mark.parametrize("content", ["", "{}", '{"rows": 3, "provenance": {}}', "[1]", '{"rows": ['])
def test_damaged_records_are_refused(tmp_path, content):
    (tmp_path / "bad.json").write_text(content)
    with pytest.raises(FormatError, match=r"bad\.json is not a valid recorded table"):
        load_recorded("bad", tmp_path)


def test_unknown_records_name_those_there_are():
    with pytest.raises(MissingDataError, match=r"'nothing'; there are:.*fitting_dorf"):
        load_recorded("nothing")


def test_missing_values_become_none():
    assert to_rows(pd.DataFrame({"a": [1.5, np.nan]})) == [{"a": 1.5}, {"a": None}]
