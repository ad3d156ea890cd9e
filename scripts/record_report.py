"""Record what the report shows and takes minutes: leaderboard, stability and trainings by seed, near-copies in DoRF.

Run: python scripts/record_report.py (DoRF must be present), after record_tables.py.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

import crfbench
from crfbench.calibration import calibrate
from crfbench.curves import GRID, Array
from crfbench.datasets import load_patches
from crfbench.datasets.middlebury import N_PATCHES, THREE_GREYS, patch_arrays
from crfbench.models import SLR, EMoR, ResponseModel, load_model
from crfbench.models.registry import bundled_models
from crfbench.paper.calibration import camera_rmse, camera_rmse_table, chart_observations, coverage
from crfbench.paper.printed import CALIBRATION
from crfbench.paper.results import LEADERBOARD, load_recorded, near_copy_counts, record, trainings_by_seed
from crfbench.paper.stability import stability_by_seed

_N_DORF = 201


def main() -> None:
    provenance = {"crfbench": crfbench.__version__, "command": "python scripts/record_report.py"}
    print(record(near_copy_counts(), "dorf_copies", provenance).name)
    print(record(stability_by_seed(), "stability_paper", provenance).name)
    print(record(trainings_by_seed(), "slr_trainings_dorf", provenance).name)
    forward = trainings_by_seed(["ldl"], direction="forward")
    print(record(forward, "slr_forward_trainings_dorf", provenance).name)
    cameras = camera_rmse_table("3", "paper", rows=list(CALIBRATION))[list(CALIBRATION)].reset_index()
    print(record(cameras, "calibration_paper_cameras", provenance).name)
    print(record(measured_leaderboard(), "leaderboard", provenance).name)


def measured_leaderboard(rows: Sequence[str] | None = None) -> pd.DataFrame:
    """Calibrate with every model and set the recorded fits of DoRF beside it; some minutes for all models.

    Parameters
    ----------
    rows : sequence of str, optional
        Names of inverse models; by default all that are bundled.
    """
    fits = load_recorded("fitting_dorf")[0].set_index(["model", "split"])
    if rows is None:
        rows = [str(key) for key in bundled_models() if key.direction == "inverse"]
    return pd.DataFrame([_row(name, fits) for name in rows], columns=list(LEADERBOARD))


def steepest_slope(curves: Array) -> float:
    """Return the largest rise between neighbouring samples of curves (n, 1024), per unit of their input."""
    return float(np.diff(curves, axis=-1).max() / (GRID[1] - GRID[0]))


def _row(name: str, fits: pd.DataFrame) -> dict[str, object]:
    model = load_model(name)
    return {
        "model": name,
        "n_params": model.n_params,
        "learned": _learned(model),
        **_fit_figures(name, fits),
        **_calibration_figures(model),
    }


def _fit_figures(name: str, fits: pd.DataFrame) -> dict[str, float]:
    nothing = pd.Series(np.nan, index=fits.columns)
    inside, outside = (
        fits.loc[name, split] if (name, split) in fits.index else nothing for split in ("in-sample", "grouped-5fold")
    )
    return {
        "in_sample_rmse": inside["mean_rmse"],
        "held_out_rmse": outside["mean_rmse"],
        "nonmonotone": inside["nonmonotone"],
        "out_of_range": inside["out_of_range"],
        "fit_ms": 1000 * inside["seconds"] / _N_DORF,
    }


def _calibration_figures(model: ResponseModel) -> dict[str, float]:
    observations, jpeg, raw = chart_observations(patch_arrays(load_patches()))
    three = calibrate(model, observations.take(np.array(THREE_GREYS) - 1), "map")
    every = calibrate(model, observations.take(np.arange(N_PATCHES)), "map")
    bands = calibrate(model, observations.take(np.arange(N_PATCHES)), "posterior")
    return {
        "steepest_slope": steepest_slope(every.curves),
        "calibration_3": float(camera_rmse(three, jpeg, raw).mean()),
        "calibration_24": float(camera_rmse(every, jpeg, raw).mean()),
        "coverage": coverage(bands, observations, jpeg, raw),
    }


def _learned(model: ResponseModel) -> int:
    """Count the numbers that turn parameters into a curve and were learned."""
    if isinstance(model, SLR):
        return sum(weights.size for name, weights in model.weights_.items() if name.startswith("decoder"))
    return int(model.mean_.size + model.components_.size) if isinstance(model, EMoR) else 0


if __name__ == "__main__":
    main()
