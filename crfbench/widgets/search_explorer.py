"""An architecture search to look around in: accuracy against complexity, M to drag, every candidate named."""

from typing import Any

import anywidget
import numpy as np
import pandas as pd
import traitlets
from numpy.typing import ArrayLike

from crfbench.checks import as_numbers, check_count
from crfbench.errors import InputError
from crfbench.search.result import architecture, mark_choice, pareto_front
from crfbench.search.space import Hidden
from crfbench.widgets.assets import join


class SearchExplorer(anywidget.AnyWidget):
    """Accuracy against complexity of every candidate; dragging M moves the choice.

    Pointing at a candidate, or choosing it from the list, names it and shows its figures. The page needs no Python for
    any of this, so it works in an exported notebook too.

    Parameters
    ----------
    table : DataFrame
        Of `crfbench.search.naive_search`, or a recorded one.
    m : int
        Of how many most accurate candidates the least complex is chosen.
    spread : array_like, shape (n,), optional
        Half the height of each candidate's bar, in units of MSE; by default the standard deviation over the folds.

    Raises
    ------
    InputError
        For a table or a spread that does not fit, and for an `m` that is not from 1 to the number of candidates.

    Examples
    --------
    >>> from crfbench.tables.recorded import load_recorded
    >>> explorer = SearchExplorer(load_recorded("search_dorf")[0])
    >>> explorer.m = 1
    >>> explorer.focus = explorer.chosen
    """

    _esm = join("controls.js", "plot.js", "search_explorer.js")
    _css = join("widgets.css")
    #: One entry a candidate, most accurate first; set once.
    _candidates: traitlets.List = traitlets.List().tag(sync=True)
    _m = traitlets.Int().tag(sync=True)
    #: Row of the candidate that is named.
    _row = traitlets.Int().tag(sync=True)

    def __init__(self, table: pd.DataFrame, m: int = 10, spread: ArrayLike | None = None) -> None:
        super().__init__()
        self._table = _check_table(table).sort_values("rank").reset_index(drop=True)
        bars = as_numbers("spread", table["mse_sd"] if spread is None else spread)
        if bars.shape != (len(table),):
            raise InputError(f"spread of shape {bars.shape} does not fit {len(table)} candidates; use one a candidate")
        self._candidates = _rows(self._table, bars[np.argsort(table["rank"].to_numpy())])
        self.m = m
        self.focus = self.chosen

    def __repr__(self) -> str:
        return f"SearchExplorer({len(self._table)} candidates, m={self.m}, chosen={self.chosen})"

    @property
    def m(self) -> int:
        """Of how many most accurate candidates the least complex is chosen."""
        return self._m

    @m.setter
    def m(self, m: int) -> None:
        n = len(self._table)
        self._m = check_count("m", m, most=n)

    @property
    def chosen(self) -> Hidden:
        """The choice for the present `m`."""
        table = mark_choice(self._table, self.m)
        return architecture(table[table["chosen"]].iloc[0])

    @property
    def focus(self) -> Hidden:
        """The candidate that is named."""
        return architecture(self._table.iloc[self._row])

    @focus.setter
    def focus(self, hidden: Hidden) -> None:
        rows = [row for row, candidate in enumerate(self._candidates) if tuple(candidate["hidden"]) == tuple(hidden)]
        if not rows:
            raise InputError(f"focus={hidden!r} is no candidate; use one of the table, such as {self.chosen}")
        self._row = rows[0]


def _check_table(table: pd.DataFrame) -> pd.DataFrame:
    needed = ("h1", "h2", "h3", "mse", "mse_sd", "rmse", "complexity", "rank", "epochs")
    missing = [name for name in needed if name not in table]
    if missing or not len(table):
        raise InputError(f"the table has {len(table)} rows and lacks {missing or 'nothing'}; use one of naive_search")
    return table


def _rows(table: pd.DataFrame, bars: np.ndarray) -> list[dict[str, Any]]:
    front = set(pareto_front(table).index)
    return [
        {
            "hidden": list(architecture(row)),
            "mse": float(row["mse"]),
            "bar": float(bar),
            "rmse": float(row["rmse"]),
            "complexity": int(row["complexity"]),
            "front": position in front,
        }
        for (position, row), bar in zip(table.iterrows(), bars, strict=True)
    ]
