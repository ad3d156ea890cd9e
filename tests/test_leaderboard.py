"""The leaderboard against the functions it gathers."""

import numpy as np
import pandas as pd
import pytest
from record_report import measured_leaderboard, steepest_slope

from crfbench.curves import GRID
from crfbench.models.registry import MODELS, pretrained_models
from crfbench.paper.calibration import calibration_table
from crfbench.paper.results import LEADERBOARD, leaderboard, load_recorded

ROWS = ("SLR-ldl-1", "EMoR-3")


@pytest.fixture(scope="module")
def measured() -> pd.DataFrame:
    return measured_leaderboard(ROWS)


def test_every_model_is_there_once():
    board = leaderboard()
    assert tuple(board.columns) == tuple(LEADERBOARD)
    assert len(board) == sum(map(len, MODELS.values())) + len(pretrained_models("inverse"))
    assert board["model"].is_unique


def test_the_record_is_what_the_function_gives(measured):
    recorded = leaderboard().set_index("model")
    for row in measured.to_dict("records"):
        kept = recorded.loc[row["model"]]
        for name in list(LEADERBOARD)[1:]:
            np.testing.assert_allclose(row[name], kept[name], rtol=0.02, err_msg=f"{row['model']} {name}")


def test_calibration_is_that_of_the_calibration_table(measured):
    for patches in ("3", "24"):
        for column, allow in (("calibration", True), ("alone", False)):
            table = calibration_table(patches, "map", rows=ROWS, discrepancy=allow)
            np.testing.assert_allclose(measured[f"{column}_{patches}"], table["mean"][: len(ROWS)])
    bands = calibration_table("24", "posterior", rows=ROWS)
    np.testing.assert_allclose(measured["coverage"], bands["coverage"][: len(ROWS)])


def test_fits_are_those_of_the_fitting_table(measured):
    fits = load_recorded("fitting_dorf")[0].query("model == 'EMoR-3'")
    fits = fits.set_index("split")["mean_rmse"]
    assert measured["in_sample_rmse"][1] == fits["in-sample"]
    assert measured["held_out_rmse"][1] == fits["grouped-5fold"]


def test_learned_numbers_are_counted():
    board = leaderboard().set_index("model")["learned"]
    assert board["Gamma-1"] == 0
    assert board["EMoR-2"] == 3 * 1024
    assert board["SLR-ldl-1"] == (1 * 20 + 20) + (20 * 50 + 50) + (50 * 1024 + 1024)


def test_models_of_other_data_have_no_figures_in_sample():
    board = leaderboard().set_index("model")
    assert np.isnan(board.loc["SLR-open-1", "in_sample_rmse"])
    assert np.isfinite(board.loc["SLR-open-1", "calibration_3"])


def test_steepest_slope_is_the_derivative():
    assert steepest_slope(np.stack([GRID, GRID**3])) == pytest.approx(3, rel=0.01)
    assert steepest_slope(GRID[None] * 0.5) == pytest.approx(0.5)
