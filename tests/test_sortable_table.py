"""The Python side of SortableTable; tests/test_browser drives it in a report, tests/js its order."""

import numpy as np
import pandas as pd
import pytest

from crfbench.errors import InputError
from crfbench.widgets import SortableTable

FRAME = pd.DataFrame({"model": ["b", "a"], "n": [2, 10], "rmse": [np.nan, 0.25]})


def test_cells_have_text_and_value():
    table = SortableTable(FRAME, "Two", {"n": "parameters"}, {"rmse": "its size"}, {"rmse": "{:.3f}"})._table
    assert [column["label"] for column in table["columns"]] == ["model", "parameters", "rmse"]
    assert [column["numeric"] for column in table["columns"]] == [False, True, True]
    assert table["columns"][2]["note"] == "its size"
    assert table["rows"][1] == [
        {"text": "a", "value": "a"}, {"text": "10", "value": 10}, {"text": "0.250", "value": 0.25},
    ]  # fmt: skip
    assert table["rows"][0][2] == {"text": "–", "value": None}


def test_the_front_end_needs_nothing_from_elsewhere():
    assert "import " not in SortableTable._esm
    assert "http" not in SortableTable._esm + SortableTable._css


@pytest.mark.parametrize(
    ("frame", "arguments", "words"),
    [
        (FRAME.iloc[:0], {}, "0 rows"),
        (FRAME, {"labels": {"nothing": "x"}}, r"no column \['nothing'\]; use a filled one, of model, n, rmse"),
        (FRAME, {"formats": {"nothing": "{}"}}, "nothing"),
    ],
)
def test_what_is_not_valid_is_named(frame, arguments, words):
    with pytest.raises(InputError, match=words):
        SortableTable(frame, "Two", **arguments)
