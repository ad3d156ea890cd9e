"""What the paper prints in its tables, the rules by which it is judged, and `claim`, which registers a check.

Zhao, Ferguson, Zhou and Rafferty, "Representing Camera Response Function by a Single Latent Variable and Fully
Connected Neural Network" (2022). What its text says stands in `crfbench.paper.claims`.
"""

from collections.abc import Callable, Iterable
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from crfbench.paper.results import PaperResults

_HERE = Path(__file__).parent
#: Table 1, "DoRF curves fitting": mean RMSE as the paper calls it, of responses. Kept as text, for the digits printed
#: are part of the figure. SLR's constraint is not stated; LDL is the one that the paper recommends.
FITTING: dict[str, str] = pd.read_csv(_HERE / "table_1.csv", index_col="model", dtype=str)["mean_rmse"].to_dict()
#: Table 2, "Stability": total variance between inverse responses from 3, 6, 12 and 24 patches (Canon PowerShot G9).
STABILITY: dict[str, float] = {"SLR-ldl-1": 0.66, "Polynomial-3": 1.63, "GGCM-3": 8.11, "EMoR-3": 3.87}
_TABLE_3 = pd.read_csv(_HERE / "table_3.csv", index_col="model")
CALIBRATION_COLUMNS = tuple(_TABLE_3)
#: Table 3, "Camera radiometric calibration", of inverse responses.
CALIBRATION: dict[str, tuple[float, ...]] = {str(name): tuple(row) for name, row in _TABLE_3.T.items()}
SIGNIFICANT_RMSE = 0.005

#: "Slightly worse" is a ratio below the first, "1" a number within the second of 1.
SLIGHTLY, NEAR_ONE = 1.5, 0.1
_VERDICTS = pd.read_csv(_HERE / "verdicts.csv", index_col="verdict")
#: What each verdict means; then a sign and a class that tell it without colour, and its colour on a terminal.
RULES: dict[str, str] = {
    name: rule.format(significant=SIGNIFICANT_RMSE, slightly=SLIGHTLY, near=NEAR_ONE)
    for name, rule in _VERDICTS["rule"].items()
}
MARKS: dict[str, list[str]] = _VERDICTS[["sign", "look"]].T.to_dict("list")
COLOURS: dict[str, str] = _VERDICTS["colour"].to_dict()


class Claim(NamedTuple):
    """A claim of the paper beside what we find: one row of the claims table, all text."""

    claim: str = ""  # what the paper says, in our words
    where: str = ""
    paper: str = ""  # the figure as printed; empty where it gives none
    ours: str = ""
    spread: str = ""  # what ours ranges over seeds, folds or bootstrap; empty where there is none
    how: str = ""  # the function that computes ours
    verdict: str = ""  # by `RULES`
    why: str = ""
    group: str = ""  # what it is counted once with: the claim that it repeats, or the row of its table


Check = Callable[[PaperResults], Claim]
#: The checks of everything that the paper says outside the cells of its tables, in the order of their registration.
CHECKS: list[Check] = []


def claim(where: str, text: str, how: str, printed: str = "", group: str = "") -> Callable[[Check], Check]:
    """Register the function below as the check of a claim: the section, what it says in our words, and what is printed.

    The function gets our results and returns a `Claim` with what was found: ours, why, verdict and perhaps spread. The
    rest is filled in from here; `how` names the function that computes our figure. Without a verdict ours must equal
    the printed figure, as counts do. What the paper says in several places has one `group`, or else it is its own.

    ::

        @claim("4.1", "cameras taken from Middlebury", how="crfbench.load_patches", printed="14")
        def camera_count(results: PaperResults) -> Claim:
            return Claim(ours=str(results.patches["camera"].nunique()), why="Counted in the patch table.")
    """

    def register(check: Check) -> Check:
        def judged(results: PaperResults) -> Claim:
            found = check(results)
            verdict = found.verdict or ("reproduced" if found.ours == printed else "differs")
            return found._replace(claim=text, where=where, paper=printed, how=how, verdict=verdict, group=group or text)

        judged.__doc__ = text
        CHECKS.append(judged)
        return judged

    return register


def in_words(holds: bool | None) -> str:
    """Return the verdict on a statement in words: it holds, does not hold, or (None) our figures say both."""
    return "undecided" if holds is None else "holds" if holds else "does not hold"


def is_least(own: tuple[float, float], rivals: Iterable[tuple[float, float]]) -> bool | None:
    """Say whether a figure, given as the range (low, high) that it has, lies below all others; None where it may."""
    others = list(rivals)
    if all(own[1] < low for low, _ in others):
        return True
    return False if any(high < own[0] for _, high in others) else None


def scientific(value: float, digits: int = 2) -> str:
    """Write a number as the paper does, for example 3.60E-2."""
    mantissa, exponent = f"{value:.{digits}E}".split("E")
    return f"{mantissa}E{int(exponent)}"


def verdict(ours: float, printed: str | None, spread: tuple[float, float] = (np.nan, np.nan), near: float = 0.0) -> str:
    """Judge a figure by the digits the paper printed.

    "reproduced" when ours, rounded to as many digits, is within one unit of the last printed digit, or no more than
    `near` away, or when the printed figure lies in the `spread` (low, high) of ours; else "differs". "not comparable"
    where nothing is printed.
    """
    if printed is None:
        return "not comparable"
    figure = Decimal(printed)  # not a float: 0.062 - 0.057 is more than 0.005 in binary
    unit = Decimal(1).scaleb(int(figure.as_tuple().exponent))
    apart = abs(Decimal(repr(float(ours))).quantize(unit) - figure)
    inside = spread[0] <= float(figure) <= spread[1]
    return "reproduced" if inside or apart <= max(unit, Decimal(str(near))) else "differs"
