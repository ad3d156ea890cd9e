"""What a search found, as a table, and the choice from it."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from crfbench.checks import check_count
from crfbench.search.outcome import Outcome
from crfbench.search.space import Hidden, complexity

COLUMNS = (
    "h1", "h2", "h3", "mse", "mse_sd", "rmse", "complexity", "seconds", "rank", "chosen", "epochs",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The results of all candidates, and the choice.

    Parameters
    ----------
    table : DataFrame
        One row a candidate, most accurate first, with the columns of `COLUMNS`: neurons of the hidden layers (0 for
        none), mean MSE of the held-out curves, its standard deviation over the folds, their mean RMSE, weights and
        biases of the encoder, seconds of computing, rank by accuracy, whether it is the choice, epochs of training.
        Candidates that were trained for longer rank first: the others were given up before.
    m : int
        Of how many most accurate candidates the least complex was chosen.
    """

    table: pd.DataFrame
    m: int

    @property
    def chosen(self) -> Hidden:
        """The chosen architecture."""
        return architecture(self.table[self.table["chosen"]].iloc[0])

    @property
    def pareto(self) -> pd.DataFrame:
        """The candidates that no other beats in both accuracy and complexity, least complex first."""
        return pareto_front(self.table)

    def choose(self, m: int) -> "SearchResult":
        """Return the same results with the choice for another M."""
        return SearchResult(mark_choice(self.table, m), m)


def architecture(row: pd.Series) -> Hidden:
    """Return the hidden layers that a row of the table describes, for example (50, 20)."""
    return tuple(int(row[name]) for name in ("h1", "h2", "h3") if row[name])


def check_m(m: int) -> None:
    """Raise `InputError` unless `m` candidates can be chosen from."""
    check_count("m", m)


def tabulate(outcomes: Iterable[Outcome]) -> pd.DataFrame:
    """Return the table of a search, without a choice: of each candidate its longest training, most accurate first."""
    longest: dict[Hidden, Outcome] = {}
    for outcome in sorted(outcomes, key=lambda outcome: outcome.epochs):
        longest[outcome.hidden] = outcome
    rows = [_row(outcome) for outcome in longest.values()]
    table = pd.DataFrame(rows).sort_values(["epochs", "mse", "complexity"], ascending=[False, True, True])
    table["rank"] = np.arange(1, len(table) + 1)
    return table.assign(chosen=False).reset_index(drop=True)[list(COLUMNS)]


def mark_choice(table: pd.DataFrame, m: int) -> pd.DataFrame:
    """Return the table with the choice marked: the least complex of the `m` most accurate candidates."""
    check_m(m)
    return table.assign(chosen=table.index == table.nsmallest(m, "rank")["complexity"].idxmin())


def pareto_front(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows, of the longest training, that no other beats in both accuracy and complexity."""
    rows = table[table["epochs"] == table["epochs"].max()].sort_values(["complexity", "mse"])
    return rows[rows["mse"] < rows["mse"].cummin().shift(fill_value=np.inf)]


def _row(outcome: Outcome) -> dict[str, float]:
    layers = dict(zip(("h1", "h2", "h3"), (*outcome.hidden, 0, 0), strict=False))
    return {
        **layers,
        "mse": float(np.mean(outcome.mse)),
        "mse_sd": float(np.std(outcome.mse)),
        "rmse": float(np.mean(outcome.rmse)),
        "complexity": complexity(outcome.hidden),
        "seconds": outcome.seconds,
        "epochs": outcome.epochs,
    }
