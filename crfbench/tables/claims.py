"""Every figure that the paper reports and every claim of it, beside ours, with a verdict by a stated rule."""

from collections.abc import Iterator
from decimal import Decimal

import pandas as pd

from crfbench.paper import (
    CALIBRATION,
    CALIBRATION_COLUMNS,
    FITTING,
    SIGNIFICANT_RMSE,
    STABILITY,
    STATEMENTS,
    scientific,
    verdict,
)
from crfbench.tables.calibration import bootstrap_bounds
from crfbench.tables.evidence import Evidence, load_evidence
from crfbench.tables.statements import CHECKS

COLUMNS = ("claim", "where", "paper", "ours", "spread", "how", "verdict", "why")
#: What each verdict means.
RULES = {
    "reproduced": "our figure lies within one unit of the paper's last printed digit, or the paper's lies within the "
    "spread of ours (in Table 3, 95 % of a bootstrap over the cameras); there, also when the two are no more than "
    f"{SIGNIFICANT_RMSE} apart, which the paper calls not significant; counts are equal",
    "differs": "our figure comes from the same data and, as far as it is described, by the same procedure, and none of "
    "that is so",
    "holds": "a statement in words, of which our figures say the same",
    "does not hold": "a statement in words, of which our figures, or the paper's own, say otherwise",
    "undecided": "a statement in words, of which our figures say both: their ranges overlap, or it depends on the "
    "measure",
    "not comparable": "the paper's figure depends on its computer, or cannot be recomputed from what is published",
}
_STATISTICS = {
    "mean": "mean RMSE",
    "median": "median RMSE",
    "sd": "s.d. of the RMSE",
    "max": "largest RMSE",
    "p95": "95th percentile of the RMSE",
    "seconds": "seconds for all cameras",
}
_WHY_FITTING = {
    "SLR": "Our mean squared error is {mse}: the paper's figure has the size of an MSE, not of an RMSE.",
    "EMoR": "Projection on the published components: data, metric and model are the paper's.",
    "below": "Ours are the best fits there are, so no parameters give the paper's smaller figure as a mean RMSE.",
    "above": "Ours are the best fits there are; parameters with the paper's larger figure are not the optimal ones.",
}


def claims_table(evidence: Evidence | None = None) -> pd.DataFrame:
    """Hold every figure and claim of the paper against ours.

    Parameters
    ----------
    evidence : Evidence, optional
        Our tables; by default those that are shipped, so that neither DoRF nor a network is needed.

    Returns
    -------
    DataFrame
        One row a claim, all text: ``claim``; ``where``, its section or table; ``paper``, as printed, empty for claims
        in words; ``ours``; ``spread`` of ours over seeds, folds or bootstrap; ``how``, the function that computes ours;
        ``verdict``, by `RULES`; ``why``, in a sentence.
    """
    known = evidence or load_evidence()
    rows = [*_statements(known), *_fitting(known), *_stability(known), *_calibration(known)]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def verdict_counts(claims: pd.DataFrame) -> pd.DataFrame:
    """Count the verdicts of each part of the paper: its text and its three tables by verdict, with a row of totals."""
    parts = claims["where"].where(claims["where"].str.fullmatch(r"Table \d"), "text").rename("part")
    order = ["text", "Table 1", "Table 2", "Table 3"]
    counts = pd.crosstab(parts, claims["verdict"]).reindex(index=order, columns=list(RULES), fill_value=0)
    counts.loc["all"] = counts.sum()
    return counts


def _statements(evidence: Evidence) -> Iterator[tuple[str, ...]]:
    for key, statement in STATEMENTS.items():
        found = CHECKS[key](evidence)
        printed = (statement.claim, statement.where, statement.figure)
        yield (*printed, found.ours, found.spread, found.how, found.verdict, found.why)


def _fitting(evidence: Evidence) -> Iterator[tuple[str, ...]]:
    rows = evidence.fitting.query("direction == 'forward' and split == 'in-sample'").set_index(["model", "n_params"])
    seeds = evidence.forward_trainings["mean_rmse"]
    spread = {"SLR": f"{scientific(seeds.min())} to {scientific(seeds.max())} ({len(seeds)} seeds)"}
    for (model, k), printed in FITTING.items():
        row = rows.loc["SLR-ldl" if model == "SLR" else model, k]
        kind = model if model in _WHY_FITTING else "below" if float(printed) < row["mean_rmse"] else "above"
        why = _WHY_FITTING[kind].format(mse=scientific(row["mean_mse"]))
        claim = f"mean RMSE of {model}, {k} parameter{'s' * (k > 1)}"
        judged = verdict(row["mean_rmse"], printed)
        how = "crfbench.tables.fitting.fitting_table"
        yield claim, "Table 1", printed, scientific(row["mean_rmse"]), spread.get(model, ""), how, judged, why


def _stability(evidence: Evidence) -> Iterator[tuple[str, ...]]:
    for model, printed in STABILITY.items():
        values = evidence.stability.query("model == @model")["total_variance"]
        agrees = values.min() <= printed <= values.max()
        judged = "reproduced" if agrees else verdict(values.mean(), f"{printed:.2f}")
        why = "The paper does not name its patches; ours are stated, and ten random starts leave much to chance."
        spread = f"{values.min():.2f} to {values.max():.2f} ({len(values)} seeds)"
        how = "crfbench.tables.evidence.stability_by_seed"
        claim = f"total variance of {model}"
        yield claim, "Table 2", f"{printed:.2f}", f"{values.mean():.2f}", spread, how, judged, why


def _calibration(evidence: Evidence) -> Iterator[tuple[str, ...]]:
    table = evidence.calibration.set_index(["model", "constraint", "n_params"])
    for key, printed in CALIBRATION.items():
        name = " ".join(filter(None, key[:2]))
        bounds = bootstrap_bounds(evidence.cameras[" ".join(map(str, filter(None, key)))].to_numpy())
        for column, figure in zip(CALIBRATION_COLUMNS, printed, strict=True):
            claim = f"{_STATISTICS[column]}, {name}, d={key[2]}"
            yield _calibration_cell(claim, column, figure, table.loc[key], bounds)


def _calibration_cell(
    claim: str, column: str, figure: float, row: "pd.Series[float]", bounds: dict[str, tuple[float, float]]
) -> tuple[str, ...]:
    how = "crfbench.tables.calibration.calibration_table"
    if column == "seconds":
        why = "Another computer and another program; the ratios of seconds are judged among the statements."
        return claim, "Table 3", f"{figure}", f"{row[column]:.1f}", "", how, "not comparable", why
    # Decimals, since 0.062 - 0.057 is more than 0.005 in binary.
    apart = abs(Decimal(f"{figure:.3f}") - Decimal(f"{row[column]:.3f}"))
    near = apart <= Decimal(str(SIGNIFICANT_RMSE))
    low, high = bounds[column]
    inside = low <= figure <= high
    spread = f"{low:.3f} to {high:.3f} (bootstrap)"
    why = f"The two are {apart} apart, {'inside' if inside else 'outside'} the bounds of ours."
    judged = "reproduced" if near or inside else "differs"
    return claim, "Table 3", f"{figure:.3f}", f"{row[column]:.3f}", spread, how, judged, why
