"""The claims table: complete, by its stated rules, and with verdicts that turn when the evidence does."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pandas as pd
import pytest
from scipy.stats import bootstrap

from crfbench.history import History
from crfbench.metrics import summarise
from crfbench.paper import CALIBRATION, FITTING, SIGNIFICANT_RMSE, STABILITY, STATEMENTS, scientific
from crfbench.tables import claims as module
from crfbench.tables.claims import RULES, claims_table, verdict_counts
from crfbench.tables.evidence import (
    Evidence,
    latent_course,
    load_evidence,
    near_copy_counts,
    stability_by_seed,
    trainings_by_seed,
)
from crfbench.tables.findings import does_not_follow, holds
from crfbench.tables.recorded import load_recorded
from crfbench.tables.statements import CHECKS
from crfbench.tables.statements.calibration import papers_impossible_spreads, speed_ratio
from crfbench.tables.statements.fitting import emor_energy
from crfbench.tables.statements.training import printed_variance, smoothness_loss

LDL = ("SLR", "ldl", 1)


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    return load_evidence()


@pytest.fixture(scope="module")
def claims(evidence: Evidence) -> pd.DataFrame:
    return claims_table(evidence)


def verdict_of(table: pd.DataFrame, claim: str) -> str:
    return table.set_index("claim")["verdict"][claim]


def test_every_figure_and_statement_has_a_row(claims):
    counts = claims["where"].value_counts()
    assert counts["Table 1"] == len(FITTING)
    assert counts["Table 2"] == len(STABILITY)
    assert counts["Table 3"] == sum(map(len, CALIBRATION.values()))
    assert len(claims) == len(FITTING) + len(STABILITY) + 6 * len(CALIBRATION) + len(STATEMENTS)
    assert claims["claim"].is_unique
    assert set(claims["verdict"]) == set(RULES)


def test_every_row_is_text_and_says_why(claims):
    assert claims.map(lambda cell: isinstance(cell, str)).all(axis=None)
    assert (claims[["claim", "where", "ours", "why"]] != "").all(axis=None)
    assert claims["why"].str.endswith(".").all()
    assert not claims.map(lambda cell: "nan" in cell.split()).any(axis=None)


def test_ours_come_from_functions_that_exist(claims):
    for name in claims["how"].unique():
        parent, function = name.rsplit(".", 1)
        assert callable(getattr(import_module(parent), function)), name


def test_words_and_figures_have_their_own_verdicts(claims):
    worded = claims[claims["verdict"].isin(["holds", "does not hold", "undecided"])]
    tables = claims[claims["where"].str.startswith("Table")]
    assert not set(worded.index) & set(tables.index)


def test_counts_add_up(claims):
    counts = verdict_counts(claims)
    assert counts.loc["all"].sum() == len(claims)
    assert (counts.iloc[:-1].sum() == counts.loc["all"]).all()
    assert counts.loc["Table 1"].to_dict() == {
        "reproduced": 4, "differs": 10, "holds": 0, "does not hold": 0, "undecided": 0, "not comparable": 0,
    }  # fmt: skip


def test_cells_of_table_3_follow_the_rule(claims, evidence):
    table = evidence.calibration.set_index(["model", "constraint", "n_params"])
    for (model, constraint, k), figures in CALIBRATION.items():
        name = " ".join(filter(None, (model, constraint)))
        row = table.loc[model, constraint, k]
        near = abs(round(row["mean"], 3) - figures[0]) <= SIGNIFICANT_RMSE + 1e-9
        expected = "reproduced" if near or row["low"] <= figures[0] <= row["high"] else "differs"
        assert verdict_of(claims, f"mean RMSE, {name}, d={k}") == expected
        assert verdict_of(claims, f"seconds for all cameras, {name}, d={k}") == "not comparable"
        errors = evidence.cameras[" ".join(map(str, filter(None, (model, constraint, k))))]
        assert summarise(errors) == pytest.approx({key: row[key] for key in summarise(errors)}, abs=1e-6)
        resampled = bootstrap((errors,), np.max, method="percentile", n_resamples=2000, rng=1).confidence_interval
        near = abs(round(row["max"], 3) - figures[3]) <= SIGNIFICANT_RMSE + 1e-9
        inside = resampled.low <= figures[3] <= resampled.high
        expected = "reproduced" if near or inside else "differs"
        assert verdict_of(claims, f"largest RMSE, {name}, d={k}") == expected


def test_means_of_table_3_agree_with_the_tables_own_verdict(claims, evidence):
    ours = claims[claims["claim"].str.startswith("mean RMSE, ")]["verdict"].tolist()
    assert ours == evidence.calibration["verdict"][: len(CALIBRATION)].tolist()


@pytest.mark.parametrize(
    ("key", "column", "change", "expected"),
    [
        ("ten_folds", "mean_rmse", 0.01, "holds"),
        ("one_figure", "mean_rmse", 1.0, "differs"),
    ],
)
def test_statements_on_fits_turn_with_the_evidence(evidence, key, column, change, expected):
    fitting = evidence.fitting.copy()
    fitting.loc[fitting["model"] == "SLR-ldl", column] *= change
    assert CHECKS[key](replace(evidence, fitting=fitting)).verdict == expected


def test_statements_on_calibration_turn_with_the_evidence(evidence):
    table = evidence.calibration.copy()
    ldl = (table["model"] == "SLR") & (table["constraint"] == "ldl") & (table["n_params"] == 1)
    table.loc[ldl, ["mean", "seconds"]] /= 100
    table.loc[~ldl, ["difference_low", "difference_high"]] = 0.013, 0.014
    better = replace(evidence, calibration=table.copy())
    for key in ("almost_twice", "half_the_time", "faster_than_gamma", "significant"):
        assert CHECKS[key](evidence).verdict == "does not hold"
        assert CHECKS[key](better).verdict == "holds", key
    table.loc[~ldl, ["difference_low", "difference_high"]] = -0.014, -0.013
    worse = replace(evidence, calibration=table)
    for key in ("most_accurate", "ldl_helps"):
        found = [CHECKS[key](known).verdict for known in (evidence, better, worse)]
        assert found == ["undecided", "holds", "does not hold"]
    assert CHECKS["auc_trades"](evidence).verdict == "undecided"
    assert CHECKS["auc_trades"](better).verdict == "does not hold"  # AUC is the slower one there


def test_other_statements_turn_with_the_evidence(evidence):
    stability = evidence.stability.assign(
        total_variance=np.where(evidence.stability["model"] == "SLR", 0.0, evidence.stability["total_variance"])
    )
    assert CHECKS["most_stable"](evidence).verdict == "undecided"
    assert CHECKS["most_stable"](replace(evidence, stability=stability)).verdict == "holds"
    stability["total_variance"] = -stability["total_variance"]
    assert CHECKS["most_stable"](replace(evidence, stability=stability)).verdict == "does not hold"
    trainings = evidence.trainings.copy()
    trainings.loc[trainings["constraint"] == "ldl", ["kl", "ks", "settled"]] = 1.0, 0.0, np.nan
    trainings.loc[trainings["constraint"] == "aae", "swing"] = 2.0
    other = replace(evidence, trainings=trainings)
    for key, before, after in (
        ("ldl_accurate", "holds", "does not hold"),
        ("ldl_best", "undecided", "undecided"),
        ("ldl_rapid", "holds", "does not hold"),
        ("aae_unstable", "undecided", "holds"),
    ):
        assert (CHECKS[key](evidence).verdict, CHECKS[key](other).verdict) == (before, after)
    for kl, ks, expected in ((0.0, 0.0, "holds"), (0.0, 1.0, "undecided"), (1.0, 1.0, "does not hold")):
        trainings.loc[trainings["constraint"] == "ldl", ["kl", "ks"]] = kl, ks
        assert CHECKS["ldl_best"](other).verdict == expected
    assert CHECKS["classical_models"](evidence).verdict == "undecided"
    assert CHECKS["camera_count"](replace(evidence, patches=evidence.patches.iloc[:10])).verdict == "differs"
    search = evidence.search.assign(seconds=61.0)
    assert CHECKS["candidate_time"](replace(evidence, search=search)).verdict == "does not hold"


def test_stability_reproduces_when_its_seeds_hold_the_figure(evidence):
    stability = evidence.stability.copy()
    stability.loc[stability["model"] == "EMoR", "total_variance"] = [3.0, 4.0, 5.0]
    table = claims_table(replace(evidence, stability=stability))
    assert verdict_of(table, "total variance of EMoR") == "reproduced"
    assert verdict_of(claims_table(evidence), "total variance of EMoR") == "differs"


def test_no_fourteen_values_have_the_printed_statistics():
    assert [row.split(":")[0] for row in papers_impossible_spreads()] == ["SLR ldl d=1"]
    mean, _, sd, largest, *_ = CALIBRATION[LDL]
    rng = np.random.default_rng(0)
    most = 0.0
    for at_zero in range(14):  # the widest spreads have values at both ends and one between
        values = np.array([0.0] * at_zero + [largest] * (13 - at_zero) + [0.0])
        values[-1] = 14 * mean - values.sum()
        if 0 <= values[-1] <= largest:
            most = max(most, values.std(ddof=1))
    drawn = rng.uniform(0, largest, size=(1000, 14))
    drawn = drawn[abs(drawn.mean(axis=1) - mean) < 0.0005]
    assert drawn.std(axis=1, ddof=1).max() < most < sd - 0.0005


def test_energy_grows_with_the_components(evidence):
    assert emor_energy(evidence.fitting, 1) < emor_energy(evidence.fitting, 2) < emor_energy(evidence.fitting, 3) < 100


@pytest.mark.dorf
def test_energy_of_dorf(dorf_curves, evidence):
    curves = dorf_curves.curves
    values = np.linalg.svd(curves - curves.mean(axis=0), compute_uv=False) ** 2
    for k in (1, 2, 3):
        np.testing.assert_allclose(emor_energy(evidence.fitting, k), 100 * values[:k].sum() / values.sum(), atol=0.1)


@pytest.mark.dorf
def test_near_copies_of_dorf(dorf_curves, evidence):
    counts = near_copy_counts()
    assert counts.iloc[0].to_dict() == evidence.copies.iloc[0].to_dict()
    distance = np.sqrt(((dorf_curves.curves[:, None] - dorf_curves.curves[None]) ** 2).mean(axis=-1))
    np.fill_diagonal(distance, np.inf)
    assert (distance.min(axis=1) < 0.01).sum() == counts["not_alone"].item()


def test_losses_and_estimates_of_the_paper():
    assert printed_variance(50) == pytest.approx(49, rel=0.02)
    straight = np.linspace(0, 1, 1024)
    assert smoothness_loss(straight) == pytest.approx(1023**-0.5)
    assert smoothness_loss(straight**2) > smoothness_loss(straight)


def test_speed_is_a_ratio_to_slr(evidence):
    table = evidence.calibration.set_index(["model", "constraint", "n_params"])["seconds"]
    gamma = ("Gamma", "", 1)
    assert speed_ratio(evidence.calibration, [gamma]) == table[gamma] / table[LDL]


def test_recorded_stability_is_what_the_function_gives(evidence):
    ours = stability_by_seed([1]).set_index("model")
    recorded = evidence.stability.query("seed == 1").set_index("model")
    np.testing.assert_allclose(ours["total_variance"], recorded["total_variance"], rtol=0.05)
    np.testing.assert_allclose(ours["mean_rmse"], recorded["mean_rmse"], rtol=0.05)


def test_the_shipped_weights_are_one_of_the_trainings_that_span_their_row(evidence):
    ours = evidence.fitting.query("model == 'SLR-ldl' and n_params == 1 and direction == 'forward'")
    first = evidence.forward_trainings.set_index("seed").loc[0, "mean_rmse"]
    assert ours.query("split == 'in-sample'")["mean_rmse"].item() == pytest.approx(first, rel=1e-4)
    assert evidence.forward_trainings["mean_rmse"].min() < first < evidence.forward_trainings["mean_rmse"].max()


@pytest.mark.dorf
def test_recorded_trainings_are_what_the_function_gives(dorf_curves, evidence):
    ours = trainings_by_seed(["ldl"], [2]).iloc[0]
    recorded = evidence.trainings.query("constraint == 'ldl' and seed == 2").iloc[0]
    for column in ("mean", "sd", "ks"):
        assert ours[column] == pytest.approx(recorded[column], abs=0.02)
    assert ours["mean_rmse"] == pytest.approx(recorded["mean_rmse"], rel=0.05)
    assert ours["kl"] < 1e-3


@pytest.mark.parametrize(
    ("spreads", "settled", "swing"),
    [([1.0] * 9, 0, 0.0), ([3.0] * 4 + [1.0] * 5, 4, 2.0), ([3.0] * 9, np.nan, 0.0), ([1.0] * 6 + [1.1] * 3, 0, 0.1)],
)
def test_when_latents_settle_and_how_they_swing(spreads, settled, swing):
    latents = np.multiply.outer(np.array(spreads), [-1.0, 1.0])[..., None]
    history = History("ldl", np.arange(9), {}, latents, np.zeros((9, 9, 65)))
    found = latent_course(history)
    np.testing.assert_equal(found["settled"], settled)
    assert found["swing"] == pytest.approx(swing)


def test_findings_are_whole_sentences_with_figures(evidence):
    for points in (does_not_follow(evidence), holds(evidence)):
        assert len({point.title for point in points}) == len(points) >= 5
        assert all(point.text.endswith(".") and "nan" not in point.text for point in points)
    assert any("142 of the 201" in point.text for point in does_not_follow(evidence))


def test_what_holds_is_so(evidence):
    rows = evidence.fitting.query("direction == 'forward' and split == 'in-sample' and n_params == 1")
    ours = rows.set_index("model")["mean_rmse"]
    others = ours[~ours.index.str.startswith("SLR")]
    assert ours["SLR-ldl"] < others.min()


def test_evidence_needs_no_data(monkeypatch):
    monkeypatch.delenv("CRFBENCH_DATA", raising=False)
    assert len(module.claims_table()) > 100
    assert load_recorded("dorf_copies")[1]["command"] == "python scripts/record_report.py"


@pytest.mark.parametrize(
    ("value", "text"), [(0.036, "3.60E-2"), (0.000557, "5.57E-4"), (3.4, "3.40E0"), (0.0999999, "1.00E-1")]
)
def test_numbers_are_written_as_the_paper_writes_them(value, text):
    assert scientific(value) == text
