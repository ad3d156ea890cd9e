"""A table to sort by any of its columns, by mouse or keyboard."""

from collections.abc import Mapping
from typing import Any

import pandas as pd
import traitlets

from crfbench.errors import InputError
from crfbench.widgets.assets import StoredWidget, bundle, join, table

_MISSING = "–"


class SortableTable(StoredWidget):
    """A table whose column headers are buttons; the page sorts by itself, so it works where no Python runs.

    Numbers sort by value, not as text; missing ones come last either way.

    Parameters
    ----------
    frame : DataFrame
        Its first column names the rows.
    caption : str
        What the table shows.
    labels : mapping, optional
        Headings by column; default the column's name.
    notes : mapping, optional
        What a column means, in a sentence, by column; listed under the table.
    formats : mapping, optional
        How numbers are written, by column, as in ``{"rmse": "{:.4f}"}``.

    Examples
    --------
    >>> frame = pd.DataFrame({"model": ["Gamma", "EMoR"], "rmse": [0.0421, 0.0049]})
    >>> SortableTable(frame, "Fits", formats={"rmse": "{:.2e}"})
    SortableTable('Fits', 2 rows)
    """

    _esm = bundle("sortable_table.js")
    _css = join("widgets.css", "sortable_table.css")
    _table = traitlets.Dict().tag(sync=True)

    def __init__(
        self,
        frame: pd.DataFrame,
        caption: str,
        labels: Mapping[str, str] | None = None,
        notes: Mapping[str, str] | None = None,
        formats: Mapping[str, str] | None = None,
    ) -> None:
        labels, notes, formats = labels or {}, notes or {}, formats or {}
        unknown = sorted({*labels, *notes, *formats} - set(frame.columns))
        if unknown or frame.empty:
            have = ", ".join(map(str, frame.columns))
            raise InputError(f"the frame has {len(frame)} rows and no column {unknown}; use a filled one, of {have}")
        columns = [
            {
                "label": str(labels.get(name, name)),
                "note": str(notes.get(name, "")),
                "numeric": pd.api.types.is_numeric_dtype(frame[name]),
            }
            for name in frame
        ]
        cells = [[_cell(value, formats.get(name, "{}")) for value in frame[name]] for name in frame]
        rows = [list(row) for row in zip(*cells, strict=True)]
        super().__init__(_table={"caption": caption, "columns": columns, "rows": rows})

    def _still(self) -> dict[str, str]:
        labels = [column["label"] for column in self._table["columns"]]
        return table(self._table["caption"], [labels, *([cell["text"] for cell in row] for row in self._table["rows"])])

    def __repr__(self) -> str:
        return f"SortableTable({self._table['caption']!r}, {len(self._table['rows'])} rows)"


def _cell(value: Any, form: str) -> dict[str, Any]:
    """Return what is written and what it sorts by, None where there is nothing."""
    if pd.isna(value):
        return {"text": _MISSING, "value": None}
    plain = value.item() if hasattr(value, "item") else value  # JSON knows no numbers of NumPy
    return {"text": form.format(plain), "value": plain}
