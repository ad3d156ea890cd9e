"""Every model side by side: how it fits, whether its curves are responses, how it calibrates, what it costs."""

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd

from crfbench.calibration import calibrate
from crfbench.curves import GRID, Array
from crfbench.datasets import load_patches
from crfbench.datasets.middlebury import N_PATCHES, patch_arrays
from crfbench.models import MODELS, SLR, EMoR, ResponseModel
from crfbench.models.weights import shipped_weights
from crfbench.tables.calibration import THREE_GREYS, camera_rmse, chart_observations, coverage, table_model
from crfbench.tables.recorded import load_recorded

#: Column by column, what it holds; all of inverse responses, the direction that calibration uses.
MEANING = {
    "model": "the model, with the constraint its weights were trained with",
    "n_params": "parameters of one curve",
    "learned": "numbers that the decoder learned from training curves, the same for every curve",
    "in_sample_rmse": "mean RMSE of the best fits to the 201 inverse responses of DoRF",
    "held_out_rmse": "the same for curves of films and cameras not learned from (five grouped folds)",
    "nonmonotone": "share of those fits that fall somewhere (in sample)",
    "out_of_range": "share of those fits that leave 0 to 1 (in sample)",
    "steepest_slope": "steepest of all 28 inverse responses calibrated from 24 patches, in irradiance per brightness: "
    "one 8-bit level there changes irradiance by this over 255",
    "calibration_3": "mean RMSE over 14 cameras on the illumination not calibrated on, method map, three grey patches",
    "calibration_24": "the same with all 24 patches",
    "coverage": "share of held-out RAW inside the 90 % band, method posterior, 24 patches",
    "fit_ms": "milliseconds a fit of one DoRF curve took when this was recorded",
}
COLUMNS = tuple(MEANING)
_N_DORF = 201


def leaderboard() -> pd.DataFrame:
    """Return the recorded leaderboard: one row a model, with the columns of `MEANING`.

    Figures that a model cannot have, such as those in sample of one that learned from another set, are missing.
    """
    return load_recorded("leaderboard")[0][list(COLUMNS)]


def measured_leaderboard(rows: Sequence[tuple[str, str, int]] | None = None) -> pd.DataFrame:
    """Calibrate with every model and set the recorded fits of DoRF beside it; some minutes for all models.

    Parameters
    ----------
    rows : sequence of (model, constraint, number of parameters), optional
        By default every model that is tabulated and every shipped SLR.
    """
    fits = load_recorded("fitting_dorf")[0].query("direction == 'inverse'").set_index(["model", "n_params", "split"])
    every = list(_every_row()) if rows is None else rows
    return pd.DataFrame([_row(row, fits) for row in every], columns=list(COLUMNS))


def steepest_slope(curves: Array) -> float:
    """Return the largest rise between neighbouring samples of curves (n, 1024), per unit of their input."""
    return float(np.diff(curves, axis=-1).max() / (GRID[1] - GRID[0]))


def _every_row() -> Iterator[tuple[str, str, int]]:
    yield from ((kind.name, "", k) for kind, counts in MODELS.items() for k in counts)
    for name in shipped_weights():
        constraint, k, direction = name.rsplit("-", 2)
        if direction == "inverse":
            yield "SLR", constraint, int(k)


def _row(row: tuple[str, str, int], fits: pd.DataFrame) -> dict[str, object]:
    family, constraint, k = row
    model = table_model(row)
    return {
        "model": " ".join(filter(None, (family, constraint))),
        "n_params": k,
        "learned": _learned(model),
        **_fit_figures("EMoR-PCA" if family == EMoR.name else "-".join(filter(None, (family, constraint))), k, fits),
        **_calibration_figures(model),
    }


def _fit_figures(name: str, k: int, fits: pd.DataFrame) -> dict[str, float]:
    nothing = pd.Series(np.nan, index=fits.columns)
    inside, outside = (
        fits.loc[name, k, split] if (name, k, split) in fits.index else nothing
        for split in ("in-sample", "grouped-5fold")
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
