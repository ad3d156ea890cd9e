"""The rows of a table as dots: a legend that lights the dots of an entry, and names under the hand."""

import pandas as pd
import traitlets

from crfbench.checks import as_finite
from crfbench.errors import InputError
from crfbench.widgets.assets import bundle, join
from crfbench.widgets.page import LivingWidget


class DotPlot(LivingWidget):
    """Dots to zoom and point at, by mouse, finger or keyboard; the page needs no Python.

    Parameters
    ----------
    table : DataFrame
        A dot for each row. Names of columns are those of the axes, so they say the unit.
    x, y : str
        Columns of finite numbers.
    by, name : str
        Columns of what the legend lists, and of what a dot is called.
    log : bool
        Whether the y axis is logarithmic.
    """

    _esm = bundle("dot_plot.js")
    _css = join("widgets.css")
    _dots = traitlets.Dict().tag(sync=True)

    def __init__(self, table: pd.DataFrame, x: str, y: str, by: str, name: str, log: bool = False) -> None:
        if missing := {x, y, by, name} - set(table):
            raise InputError(f"the table has no column {sorted(missing)}; use some of {list(map(str, table))}")
        if table.empty:
            raise InputError("the table has 0 rows; use one or more")
        for column in (x, y):
            as_finite(column, table[column])
        groups = {str(group): rows for group, rows in table.groupby(by)}
        columns = {"x": x, "y": y, "names": name}
        dots = [{"label": group} | {to: list(rows[of]) for to, of in columns.items()} for group, rows in groups.items()]
        super().__init__(_dots={"xLabel": x, "yLabel": y, "log": log, "groups": dots})
        self._title = y

    def __repr__(self) -> str:
        groups = self._dots["groups"]
        return f"DotPlot({sum(len(group['x']) for group in groups)} dots, {len(groups)} groups)"
