"""An architecture search to look around in: accuracy against complexity, M to drag, every candidate named."""

from collections.abc import Iterable

import numpy as np
import pandas as pd
import traitlets
from numpy.typing import ArrayLike

from crfbench.checks import as_numbers, check_count
from crfbench.errors import InputError
from crfbench.search.result import SearchResult, architecture, mark_choice, pareto_front
from crfbench.search.space import Hidden
from crfbench.widgets.assets import SyncedTrait, bundle, join
from crfbench.widgets.page import LivingWidget

_SENT = ("hidden", "mse", "bar", "rmse", "complexity", "front")  # to the page, of each candidate


class SearchExplorer(LivingWidget):
    """Accuracy against complexity of every candidate; dragging M moves the choice.

    Pointing at a candidate, or choosing it from the list, names it and shows its figures. Play and Step walk through
    the lines of the paper's Algorithm 1, candidates in the order of the grid. The page needs no Python for any of this,
    so it works in an exported notebook too. `m` and `focus` are traits: read them, set them, `observe` them, or `link`
    them to another widget.

    Parameters
    ----------
    table : DataFrame
        Of `crfbench.search.search_architectures`, or a recorded one.
    m : int
        Of how many most accurate candidates the least complex is chosen.
    spread : array_like, shape (n,), optional
        Half the height of each candidate's bar, in units of MSE; by default the standard deviation over the folds.

    Examples
    --------
    >>> from crfbench.paper import load_recorded
    >>> explorer = SearchExplorer(load_recorded("search_dorf")[0])
    >>> explorer.m = 1
    >>> explorer.focus = explorer.chosen
    """

    _title = "Architecture search"
    _esm = bundle("search_explorer.js")
    _css = join("widgets.css")
    #: One entry a candidate, most accurate first; set once.
    _candidates: traitlets.List = traitlets.List().tag(sync=True)

    def __init__(self, table: pd.DataFrame, m: int = 10, spread: ArrayLike | None = None) -> None:
        self._table = _check_table(table).sort_values("rank").reset_index(drop=True)
        self._names = [architecture(row) for _, row in self._table.iterrows()]
        bars = as_numbers("spread", table["mse_sd"] if spread is None else spread)
        if bars.shape != (len(table),):
            raise InputError(f"spread has the wrong shape {bars.shape}; use one number a candidate, ({len(table)},)")
        front = self._table.index.isin(pareto_front(self._table).index)
        # The page gets the candidates by rank; `spread` comes in the order of the caller's table.
        bars = bars[np.argsort(table["rank"].to_numpy())]
        candidates = self._table.assign(hidden=self._names, bar=bars, front=front)[list(_SENT)].to_dict("records")
        super().__init__(_candidates=candidates, m=m, focus=self._names[0])
        self.focus = self.chosen  # known only once `m` is

    def __repr__(self) -> str:
        return f"SearchExplorer({len(self._table)} candidates, m={self.m}, chosen={self.chosen})"

    @SyncedTrait
    def m(self, m: object) -> int:
        """Of how many most accurate candidates the least complex is chosen."""
        return check_count("m", m, most=len(self._names))

    @SyncedTrait
    def focus(self, hidden: object) -> Hidden:
        """Which candidate is named, for example (50, 20)."""
        wanted = tuple(hidden) if isinstance(hidden, Iterable) else hidden
        if wanted not in self._names:
            raise InputError(f"focus={hidden!r} is not a candidate; use one of the table, such as {self.chosen}")
        return self._names[self._names.index(wanted)]

    @property
    def chosen(self) -> Hidden:
        """The choice for the present `m`."""
        return SearchResult(mark_choice(self._table, self.m)).chosen


def _check_table(table: pd.DataFrame) -> pd.DataFrame:
    needed = ("h1", "h2", "h3", "mse", "mse_sd", "rmse", "complexity", "rank", "epochs")
    missing = [name for name in needed if name not in table]
    if missing or table.empty:
        raise InputError(f"the table has {len(table)} rows, without {missing}; use the table of search_architectures")
    return table
