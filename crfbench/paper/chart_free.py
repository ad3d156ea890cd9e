"""Calibration from exposure steps alone, with no reference, beside OpenCV's two calibrators on the same pixels."""

import time
from collections.abc import Callable
from functools import partial

import numpy as np
import pandas as pd

from crfbench.calibration import Observations, calibrate
from crfbench.curves import GRID, Array, evaluate, repair
from crfbench.datasets import load_patches
from crfbench.datasets.middlebury import EXPOSURES, PatchArrays, patch_arrays
from crfbench.metrics import nonmonotone, rmse
from crfbench.models import load_model
from crfbench.paper.calibration import ROWS, chart_observations

COLUMNS = (
    "model", "method", "mean", "median", "max", "below_debevec", "below_robertson", "below_both", "monotone", "failed",
    "seconds",
)  # fmt: skip
#: One stop from each photograph to the next.
STEPS: Array = np.arange(len(EXPOSURES), dtype=float)

_LEVELS = 256
_SIDE = 8  # pixels of a patch in the pictures made for OpenCV, along each side


def chart_free_table(method: str = "posterior") -> pd.DataFrame:
    """Calibrate 14 cameras from four exposures of 24 unknown patches, each illumination by itself.

    Returns
    -------
    DataFrame
        With the columns of `COLUMNS`, one row a model, then OpenCV's. RMSE is against RAW of the other illumination
        with the one scale that fits best, since exposures alone tell no scale; means over both illuminations of a
        camera. ``below_...`` count the cameras with an RMSE at or below OpenCV's, one that failed counting as beaten;
        ``monotone`` is the share of monotone curves, ``failed`` that of calibrations without a finite result.
        Ours are the nearest monotone curves to what the model decodes. OpenCV gets red, green and blue of all patches
        as grey pixels, which serves it better than intensities do, and its results are interpolated between the levels
        that occur.
    """
    chart = patch_arrays(load_patches())
    _, jpeg, raw = chart_observations(chart)
    found = [(name, method, *_timed(partial(chart_free_curves, chart, name, method))) for name in ROWS]
    rivals = {name: _timed(partial(opencv_curves, chart, name)) for name in ("Debevec", "Robertson")}
    found += [(f"OpenCV {name}", "opencv", *timed) for name, timed in rivals.items()]
    theirs = {name: _camera_rmse(curves, jpeg, raw) for name, (curves, _) in rivals.items()}
    rows = [
        {
            "model": name,
            "method": how,
            **_beside_opencv(_camera_rmse(curves, jpeg, raw), theirs),
            **_validity(curves),
            "seconds": seconds,
        }
        for name, how, curves, seconds in found
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def chart_free_curves(chart: PatchArrays, model: str, method: str = "posterior") -> Array:
    """Return the inverse responses (28, 1024) of every camera and illumination, from exposure steps alone."""
    rgb = chart.jpeg.reshape(-1, *chart.jpeg.shape[2:])
    clipped = chart.clipped.reshape(-1, *chart.clipped.shape[2:])
    observations = Observations.from_rgb(rgb, None, exposures=STEPS, clipped=clipped)
    return repair(calibrate(load_model(model), observations, method).curves)


def opencv_curves(chart: PatchArrays, name: str) -> Array:
    """Return what OpenCV makes of the same patches, on the grid, shape (28, 1024); NaN where it fails.

    Parameters
    ----------
    chart : PatchArrays
    name : {"Debevec", "Robertson"}
        Debevec and Malik 1997, doi:10.1145/258734.258884; Robertson, Borman and Stevenson 2003,
        doi:10.1117/1.1557695.
    """
    levels = np.rint(chart.jpeg.reshape(-1, len(EXPOSURES), chart.jpeg[0, 0, 0].size) * (_LEVELS - 1)).astype(np.uint8)
    return np.array([_opencv_curve(pictures, name) for pictures in levels])


def _opencv_curve(levels: np.ndarray, name: str) -> Array:
    """Calibrate one camera from levels (e, pixels)."""
    import cv2

    pictures = [cv2.merge([np.kron(row.reshape(6, -1), np.ones((_SIDE, _SIDE), np.uint8))] * 3) for row in levels]
    calibrator = cv2.createCalibrateDebevec() if name == "Debevec" else cv2.createCalibrateRobertson()
    response = calibrator.process(pictures, (2.0**STEPS).astype(np.float32))[:, 0, 0]
    told = np.isfinite(response) & (response > 0)
    if name == "Robertson":  # it keeps its first guess for levels that never occur
        told[np.setdiff1d(np.arange(_LEVELS), levels)] = False
    if told.sum() < 2:
        return np.full(GRID.shape, np.nan)
    at = np.flatnonzero(told) / (_LEVELS - 1)
    return np.asarray(np.interp(GRID, np.append(0.0, at), np.append(0.0, response[told])))


def _timed(run: Callable[[], Array]) -> tuple[Array, float]:
    began = time.perf_counter()
    curves = run()
    return curves, time.perf_counter() - began


def _camera_rmse(curves: Array, jpeg: Array, raw: Array) -> Array:
    """Return the RMSE of each camera, both illuminations averaged; NaN where both failed."""
    decoded = evaluate(curves, jpeg)
    scale = (decoded * raw).sum(axis=1) / (decoded**2).sum(axis=1)
    both = rmse(scale[:, None] * decoded, raw).reshape(-1, 2)
    known = np.isfinite(both)
    return np.where(known, both, 0.0).sum(axis=1) / np.where(known.any(axis=1), known.sum(axis=1), np.nan)


def _beside_opencv(cameras: Array, rivals: dict[str, Array]) -> dict[str, float]:
    debevec, robertson = ((cameras <= rival) | np.isnan(rival) for rival in rivals.values())
    return {
        "mean": float(np.nanmean(cameras)),
        "median": float(np.nanmedian(cameras)),
        "max": float(np.nanmax(cameras)),
        "below_debevec": int(debevec.sum()),
        "below_robertson": int(robertson.sum()),
        "below_both": int((debevec & robertson).sum()),
    }


def _validity(curves: Array) -> dict[str, float]:
    finite = np.isfinite(curves).all(axis=1)
    return {"monotone": float(1.0 - nonmonotone(curves[finite]).mean()), "failed": float(1.0 - finite.mean())}
