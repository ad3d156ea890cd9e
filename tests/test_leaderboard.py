"""The leaderboard against the functions it gathers, and the widget that sorts it."""

import numpy as np
import pandas as pd
import pytest

from crfbench.curves import GRID
from crfbench.errors import InputError
from crfbench.models import MODELS
from crfbench.models.weights import shipped_weights
from crfbench.tables.calibration import calibration_table
from crfbench.tables.leaderboard import COLUMNS, leaderboard, measured_leaderboard, steepest_slope
from crfbench.tables.recorded import load_recorded
from crfbench.widgets import SortableTable

ROWS = (("SLR", "ldl", 1), ("EMoR", "", 3))


@pytest.fixture(scope="module")
def measured() -> pd.DataFrame:
    return measured_leaderboard(ROWS)


def test_every_model_is_there_once():
    board = leaderboard()
    assert tuple(board.columns) == COLUMNS
    inverse = [name for name in shipped_weights() if name.endswith("inverse")]
    assert len(board) == sum(map(len, MODELS.values())) + len(inverse)
    assert not board.duplicated(["model", "n_params"]).any()


def test_the_record_is_what_the_function_gives(measured):
    recorded = leaderboard().set_index(["model", "n_params"])
    for row in measured.to_dict("records"):
        kept = recorded.loc[row["model"], row["n_params"]]
        for name in COLUMNS[2:]:
            np.testing.assert_allclose(row[name], kept[name], rtol=0.02, err_msg=f"{row['model']} {name}")


def test_calibration_is_that_of_the_calibration_table(measured):
    for patches, column in (("3", "calibration_3"), ("24", "calibration_24")):
        table = calibration_table(patches, "map", rows=ROWS)
        np.testing.assert_allclose(measured[column], table["mean"][: len(ROWS)])
    bands = calibration_table("24", "posterior", rows=ROWS)
    np.testing.assert_allclose(measured["coverage"], bands["coverage"][: len(ROWS)])


def test_fits_are_those_of_the_fitting_table(measured):
    fits = load_recorded("fitting_dorf")[0].query("direction == 'inverse' and model == 'EMoR-PCA' and n_params == 3")
    fits = fits.set_index("split")["mean_rmse"]
    assert measured["in_sample_rmse"][1] == fits["in-sample"]
    assert measured["held_out_rmse"][1] == fits["grouped-5fold"]


def test_learned_numbers_are_counted():
    board = leaderboard().set_index(["model", "n_params"])["learned"]
    assert board["Gamma", 1] == 0
    assert board["EMoR", 2] == 3 * 1024
    assert board["SLR ldl", 1] == (1 * 20 + 20) + (20 * 50 + 50) + (50 * 1024 + 1024)


def test_models_of_other_data_have_no_figures_in_sample():
    board = leaderboard().set_index("model")
    assert np.isnan(board.loc["SLR open", "in_sample_rmse"])
    assert np.isfinite(board.loc["SLR open", "calibration_3"])


def test_steepest_slope_is_the_derivative():
    assert steepest_slope(np.stack([GRID, GRID**3])) == pytest.approx(3, rel=0.01)
    assert steepest_slope(GRID[None] * 0.5) == pytest.approx(0.5)


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
def test_what_does_not_fit_is_named(frame, arguments, words):
    with pytest.raises(InputError, match=words):
        SortableTable(frame, "Two", **arguments)
