"""Calibrating and merging exposure series without a chart: crfbench beside OpenCV, same photographs, one thread each.

Run it with: python -m crfbench.bench.series. Every series has another OpenCRF response, a random scene of 3.5 decades
and five noisy exposures of 8 bits, one stop apart. RMSE is that of the inverse response over the levels that occur,
with the one scale that fits each method best. The radiance error is the median relative error over all pixels that
some exposure shows unclipped, again with the best scale for each channel. OpenCV gets the full images. RMSE and errors,
and their ratios to the best of OpenCV, are the claim; the seconds are of this machine and this minute.
"""

import argparse
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from crfbench.bench.timing import Row, row
from crfbench.calibration import Calibration
from crfbench.curves import GRID, Array, evaluate, repair
from crfbench.datasets import load_opencrf
from crfbench.models import load_model
from crfbench.series import calibrate_series, merge_series
from crfbench.synthetic import ExposureSeries, render_series

_LEVELS = np.arange(1, 254)  # what is neither black nor saturated
_MODELS = (("SLR-monotone", 1), ("SLR-monotone", 3), ("EMoR", 4), ("PPISP", 4))
_OPENCV: dict[str, tuple[Any, Any]] = {
    "Debevec": (cv2.createCalibrateDebevec, cv2.createMergeDebevec),
    "Robertson": (cv2.createCalibrateRobertson, cv2.createMergeRobertson),
}


class Outcome(NamedTuple):
    """Of one series; coverage is the share of levels at which the 90 % band holds the truth, NaN without a band."""

    rmse: float
    radiance: float
    coverage: float
    calibrate_seconds: float
    merge_seconds: float


class Found(NamedTuple):
    """Inverse response at `_LEVELS` (c, 253), radiance (h, w, 3), the 90 % band, and seconds."""

    response: Array
    radiance: NDArray[np.floating]
    band: tuple[Array, Array] | None
    seconds: tuple[float, float]


def ours(name: str, n_params: int, series: ExposureSeries) -> Found:
    """Calibrate and merge with one of our models."""
    began = time.perf_counter()
    found: Calibration = calibrate_series(series.images, series.stops, load_model(name, n_params))
    middle = time.perf_counter()
    radiance = merge_series(series.images, series.stops, found).radiance
    seconds = middle - began, time.perf_counter() - middle
    low, high = (evaluate(curves, _LEVELS / 255) for curves in found.bands[0.9])
    return Found(evaluate(repair(found.curves), _LEVELS / 255), radiance, (low, high), seconds)


def opencv(name: str, series: ExposureSeries) -> Found:
    """Calibrate and merge with OpenCV; it counts channels from blue, which makes no difference here."""
    calibrate, merge = _OPENCV[name]
    times = (2.0**series.stops).astype(np.float32)
    began = time.perf_counter()
    response = calibrate().process(series.images, times)
    middle = time.perf_counter()
    radiance = merge().process(series.images, times, response)
    seconds = middle - began, time.perf_counter() - middle
    return Found(response[_LEVELS, 0].T.astype(np.float64), radiance, None, seconds)


def outcome(run: Callable[[ExposureSeries], Found], series: ExposureSeries, response: Array) -> Outcome:
    """Compare what a method found with the truth."""
    found = run(series)
    truth = np.interp(_LEVELS / 255, response, GRID)
    seen = np.isin(_LEVELS, np.stack(series.images))
    covered = float("nan")
    if found.band is not None:
        covered = float(((truth >= found.band[0]) & (truth <= found.band[1])).mean())
    errors = [scaled_rmse(curve[seen], truth[seen]) for curve in found.response]
    return Outcome(float(np.mean(errors)), radiance_error(found.radiance, series), covered, *found.seconds)


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


def rendered(count: int, size: tuple[int, int]) -> list[tuple[ExposureSeries, Array]]:
    """Return series and their responses, the same for every method."""
    cv2.setNumThreads(1)
    curves = load_opencrf().curves
    curves = curves[np.linspace(0, len(curves) - 1, count).astype(int)]
    return [(render_series(curve, seed, size=size), curve) for seed, curve in enumerate(curves)]


def rows(count: int = 5, size: tuple[int, int] = (480, 320)) -> list[Row]:
    """Time calibration without a chart with PPISP, the default of the command line, beside OpenCV's two."""
    made = rendered(count, size)
    ours("PPISP", 4, made[0][0])  # the first call loads and imports
    mine = _means(partial(ours, "PPISP", 4), made)
    return [_row(name, mine, _means(partial(opencv, name), made), count, size) for name in _OPENCV]


def _means(run: Callable[[ExposureSeries], Found], made: list[tuple[ExposureSeries, Array]]) -> Array:
    return np.mean([outcome(run, one, curve) for one, curve in made], axis=0)


def _row(name: str, mine: Array, theirs: Array, count: int, size: tuple[int, int]) -> Row:
    note = f"mean of {count} series; RMSE {mine[0]:.4f} against {theirs[0]:.4f}; ours gives a band too; one thread each"
    what = f"calibrate 5 exposures of {size[0]} x {size[1]} without a chart, PPISP(4)"
    return row(what, float(mine[3]), f"OpenCV {name}", float(theirs[3]), note)


def main() -> None:
    """Print one line a method."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--series", type=int, default=20)
    parser.add_argument("--size", type=int, nargs=2, default=(480, 320))
    options = parser.parse_args()
    made = rendered(options.series, tuple(options.size))
    methods = {f"OpenCV {name}": partial(opencv, name) for name in _OPENCV}
    methods |= {f"{name} {k}": partial(ours, name, k) for name, k in _MODELS}
    found = {name: np.array([outcome(run, one, curve) for one, curve in made]) for name, run in methods.items()}
    best = np.min([found[f"OpenCV {name}"].mean(axis=0)[:2] for name in _OPENCV], axis=0)
    print(f"{len(made)} series of {options.size[0]} x {options.size[1]}; means over series, ratios to OpenCV's best")
    columns = ("RMSE", "median", "max", "ratio", "better", "radiance", "ratio", "coverage", "calib. s", "merge s")
    print(f"{'':<17}" + "".join(f"{column:>10}" for column in columns))
    least = np.min([found[f"OpenCV {name}"][:, 0] for name in _OPENCV], axis=0)
    for name, each in found.items():
        rmse, radiance, coverage, *seconds = each.mean(axis=0)
        print(f"{name:<17}{rmse:>10.4f}{np.median(each[:, 0]):>10.4f}{each[:, 0].max():>10.4f}", end="")
        print(f"{rmse / best[0]:>10.2f}{(each[:, 0] < least).mean():>10.0%}{radiance:>10.2%}", end="")
        print(f"{radiance / best[1]:>10.2f}{coverage:>10.2f}" + "".join(f"{each:>10.3f}" for each in seconds))


if __name__ == "__main__":
    main()
