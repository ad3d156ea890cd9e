"""Calibrating and merging exposure series without a chart: crfbench beside OpenCV, same photographs, one thread each.

Where colour-hdri is installed (``pip install --no-deps colour-hdri``), it stands beside us too.

Every series has another OpenCRF response, a random scene of 3.5 decades and five noisy exposures of 8 bits, one stop
apart. RMSE is that of the inverse response over the levels that occur, with the one scale that fits each method best.
The radiance error is the median relative error over all pixels that some exposure shows unclipped, again with the best
scale for each channel. OpenCV gets the full images. RMSE and errors are the claim as much as the times.
"""

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import Growth, Row, median_seconds, row, seconds_of
from crfbench.camera.merging import merge_series
from crfbench.camera.series import calibrate_series
from crfbench.camera.synthetic import ExposureSeries, render_series
from crfbench.curves import GRID, Array, evaluate, repair
from crfbench.datasets import load_opencrf
from crfbench.models import load_model

_LEVELS = np.arange(1, 254)  # what is neither black nor saturated
_MODELS = ("Kernel-8", "PPISP-4", "SLR-monotone-1", "SLR-monotone-3", "EMoR-4")  # the first is the command line's
_OPENCV: dict[str, tuple[Any, Any]] = {
    "Debevec": (cv2.createCalibrateDebevec, cv2.createMergeDebevec),
    "Robertson": (cv2.createCalibrateRobertson, cv2.createMergeRobertson),
}
_PICTURES = (2, 6, 20, 60, 200)


class Found(NamedTuple):
    """Inverse response at `_LEVELS` (c, 253), its 90 % band where there is one, radiance (h, w, 3), and seconds."""

    response: Array
    band: tuple[Array, Array] | None
    radiance: NDArray[np.floating]
    seconds: tuple[float, float]


def ours(name: str, series: ExposureSeries) -> Found:
    """Calibrate and merge with one of our models."""
    calibrate_s, found = seconds_of(partial(calibrate_series, series.images, series.stops, load_model(name)))
    merge_s, merged = seconds_of(partial(merge_series, series.images, series.stops, found))
    low, high = (evaluate(curves, _LEVELS / 255) for curves in found.bands[0.9])
    response = evaluate(repair(found.curves), _LEVELS / 255)
    return Found(response, (low, high), merged.radiance, (calibrate_s, merge_s))


def opencv(name: str, series: ExposureSeries) -> Found:
    """Calibrate and merge with OpenCV; it counts channels from blue, which makes no difference here."""
    calibrate, merge = _OPENCV[name]
    times = (2.0**series.stops).astype(np.float32)
    calibrate_s, response = seconds_of(lambda: calibrate().process(series.images, times))
    merge_s, radiance = seconds_of(lambda: merge().process(series.images, times, response))
    return Found(response[_LEVELS, 0].T.astype(np.float64), None, radiance, (calibrate_s, merge_s))


def colour_hdri(series: ExposureSeries) -> Found:
    """Calibrate and merge with colour-hdri, by Debevec's method too, as its documentation shows."""
    from colour_hdri import (
        Image,
        ImageStack,
        Metadata,
        camera_response_functions_Debevec1997,
        image_stack_to_HDRI,
    )

    stack = ImageStack()
    for image, stop in zip(series.images, series.stops, strict=True):
        taken = Metadata(f_number=np.float64(1.0), exposure_time=np.float64(2.0**stop), iso=np.float64(100.0))
        stack.append(Image(data=image / 255, metadata=taken))
    calibrate_s, response = seconds_of(partial(camera_response_functions_Debevec1997, stack))
    merge_s, radiance = seconds_of(partial(image_stack_to_HDRI, stack, camera_response_functions=response))
    return Found(np.asarray(response[_LEVELS].T, np.float64), None, radiance, (calibrate_s, merge_s))


def growths() -> list[Growth]:
    """Time the calibration of more and more pictures of 480 x 320, from -2 to 2 stops."""
    cv2.setNumThreads(1)
    seconds, model, curve = [], load_model(_MODELS[0]), load_opencrf().curves[0]
    for n in _PICTURES:
        series = render_series(curve, 0, stops=np.linspace(-2.0, 2.0, n).tolist())
        times = (2.0**series.stops).astype(np.float32)
        calibrations = (
            partial(calibrate_series, series.images, series.stops, model),
            partial(cv2.createCalibrateDebevec().process, series.images, times),
        )
        seconds.append([median_seconds(run, 3) for run in calibrations])
    return [Growth("pictures", ("crfbench", "OpenCV Debevec"), _PICTURES, np.array(seconds))]


def outcome(found: Found, series: ExposureSeries, response: Array) -> list[float]:
    """Return RMSE, radiance error, share of the levels at which the band holds the truth, and the seconds of both."""
    truth = np.interp(_LEVELS / 255, response, GRID)
    seen = np.isin(_LEVELS, np.stack(series.images))
    low, high = found.band or (np.nan, np.nan)
    covered = np.mean((truth >= low) & (truth <= high))
    errors = [scaled_rmse(curve[seen], truth[seen]) for curve in found.response]
    return [float(np.mean(errors)), radiance_error(found.radiance, series), float(covered), *found.seconds]


def scaled_rmse(curve: Array, truth: Array) -> float:
    """Return the RMSE with the scale that fits best."""
    scale = (curve * truth).sum() / (curve**2).sum()
    return float(np.sqrt(np.mean((scale * curve - truth) ** 2)))


def radiance_error(radiance: NDArray[np.floating], series: ExposureSeries) -> float:
    """Return the median relative error over all measured pixels and channels, scaled channel by channel."""
    images = np.stack(series.images)
    measured = ((images > 0) & (images < 254)).any(axis=0)
    ratio = np.where(measured, radiance / series.radiance, np.nan)
    return float(np.nanmedian(np.abs(ratio / np.nanmedian(ratio, axis=(0, 1)) - 1.0)))


def rows(count: int = 5, size: tuple[int, int] = (480, 320)) -> list[Row]:
    """Calibrate each series with each of our models and with OpenCV's two, and compare each with each."""
    cv2.setNumThreads(1)
    curves = load_opencrf().curves
    curves = curves[np.linspace(0, len(curves) - 1, count).astype(int)]
    series = [render_series(curve, seed, size=size) for seed, curve in enumerate(curves)]
    ours(_MODELS[0], series[0])  # the first call loads and imports
    others: dict[str, Callable[[ExposureSeries], Found]] = {f"OpenCV {name}": partial(opencv, name) for name in _OPENCV}
    others |= {"colour-hdri Debevec": colour_hdri} if find_spec("colour_hdri") else {}
    runs = others | {name: partial(ours, name) for name in _MODELS}
    means = {
        name: np.mean([outcome(run(one), one, curve) for one, curve in zip(series, curves, strict=True)], axis=0)
        for name, run in runs.items()
    }
    return [_row(name, other, means, size) for name in _MODELS for other in others]


def _row(name: str, other: str, means: dict[str, Array], size: tuple[int, int]) -> Row:
    mine, theirs = means[name], means[other]
    note = (
        f"RMSE {mine[0]:.4f} against {theirs[0]:.4f}, radiance error {mine[1]:.2%} against {theirs[1]:.2%}, merging "
        f"{mine[4]:.3f} s against {theirs[4]:.3f} s; our 90 % band holds {mine[2]:.0%}; one thread each"
    )
    what = f"calibrate 5 exposures of {size[0]} x {size[1]} without a chart, {name}"
    return row(what, float(mine[3]), other, float(theirs[3]), note)
