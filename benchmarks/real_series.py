"""Real exposure series, one photograph predicted from the others: crfbench beside OpenCV, the same merge for all.

A folder a series lies in ``series`` of $CRFBENCH_DATA: its pictures, and exposures.txt with one time a picture in the
order of their names. One exposure is left out, the others are calibrated and merged with a hat of weights, and the
picture left out is predicted; the RMSE is over values 5 to 250, in counts of 255. Only the curves differ.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import Row, noted, row, seconds_of
from crfbench.camera.reading import read_image
from crfbench.camera.series import calibrate_series
from crfbench.curves import Array, evaluate
from crfbench.datasets import registry

Pictures = list[NDArray[np.uint8]]

_LEVELS = np.arange(256)
_HAT = np.where((_LEVELS >= 2) & (_LEVELS <= 253), np.minimum(_LEVELS, 255 - _LEVELS), 0).astype(float)
_OPENCV: dict[str, Any] = {"Debevec": cv2.createCalibrateDebevec, "Robertson": cv2.createCalibrateRobertson}
_TIMES_ERROR = 0.05  # stops; times as cameras name them
_METHODS = ("crfbench", *_OPENCV)


class Series(NamedTuple):
    """The pictures of a series and log2 of their times."""

    name: str
    images: Pictures
    stops: Array


def rows() -> list[Row]:
    """Predict what was left out of every series that lies there, with every calibrator."""
    folder = registry.find("series")
    if folder is None:
        return [noted("real exposure series", "skipped: no folder 'series' in $CRFBENCH_DATA")]
    cv2.setNumThreads(1)
    found = {one.name: {name: _held_out(name, one) for name in _METHODS} for one in _read(folder)}
    errors = np.array([[each[name][0] for name in _METHODS] for each in found.values()])
    return [*(_row(name, each) for name, each in found.items()), noted(f"{len(found)} series", _summary(errors))]


def left_out(n: int) -> list[int]:
    """Return which of n exposures are left out, one at a time: all of a few, else three inside."""
    return list(range(n)) if n <= 4 else sorted({*np.linspace(1, n - 2, 3).astype(int).tolist()})


def predicted(curves: Array, series: Series, left: int) -> Array:
    """Return predicted less seen values of one picture, by curves (3, 256) and the hat-weighted mean of the others."""
    target = series.images[left]
    off = []
    for c, curve in enumerate(np.maximum.accumulate(np.maximum(curves, 1e-9), axis=1)):
        seen = [(image[..., c], stop) for i, (image, stop) in enumerate(zip(*series[1:], strict=True)) if i != left]
        weight = np.sum([_HAT[v] for v, _ in seen], axis=0)
        light = np.sum([_HAT[v] * curve[v] / 2.0**stop for v, stop in seen], axis=0)
        told = (weight > 0) & (target[..., c] >= 5) & (target[..., c] <= 250)
        at = np.log(light[told] / weight[told] * 2.0 ** series.stops[left])
        off.append(np.interp(at, np.log(curve + 1e-12 * _LEVELS), _LEVELS) - target[..., c][told])
    return np.concatenate(off)


def _held_out(method: str, series: Series) -> tuple[float, float]:
    """Return the RMSE over the pictures left out, and the seconds of all calibrations."""
    total, off = 0.0, []
    for left in left_out(len(series.images)):
        kept = [i for i in range(len(series.images)) if i != left]
        images = [series.images[i] for i in kept]
        seconds, curves = seconds_of(partial(_curves, method, images, series.stops[kept]))
        total += seconds
        off.append(predicted(curves, series, left))
    every = np.concatenate(off)
    told = every[np.isfinite(every)]
    return float(np.sqrt(np.mean(told**2))) if told.size else np.nan, total


def _curves(method: str, images: Pictures, stops: Array) -> Array:
    """Return inverse responses (3, 256) by one of `_METHODS`; OpenCV may give NaN."""
    if method in _OPENCV:
        return _OPENCV[method]().process(images, (2.0**stops).astype(np.float32))[:, 0].T.astype(np.float64)
    return evaluate(calibrate_series(images, stops, exposure_error=_TIMES_ERROR).curves, _LEVELS / 255)


def _read(folder: Path) -> Iterator[Series]:
    for path in sorted(p.parent for p in folder.glob("*/exposures.txt")):
        times = (path / "exposures.txt").read_text(encoding="utf-8").replace(",", " ").split()
        pictures = [np.rint(255 * read_image(png)).astype(np.uint8) for png in sorted(path.glob("*.png"))]
        yield Series(path.name, pictures, np.log2(np.array(times, dtype=float)))


def _row(name: str, found: dict[str, tuple[float, float]]) -> Row:
    (ours, seconds), (debevec, theirs), (robertson, _) = found.values()
    note = f"RMSE {ours:.2f} of 255; Debevec {debevec:.2f}, Robertson {robertson:.2f}"
    return row(f"predict what was left out of series {name}", seconds, "OpenCV Debevec", theirs, note)


def _summary(errors: Array) -> str:
    """Describe errors (series, methods), NaN where a method gave nothing."""
    ours, others = errors[:, 0], errors[:, 1:]
    best = np.fmin.reduce(others, axis=1)
    medians = ", ".join(f"{m} {v:.2f}" for m, v in zip(_METHODS, np.nanmedian(errors, axis=0), strict=True))
    better = " and ".join(f"{int((ours < o).sum())} times {m}" for m, o in zip(_METHODS[1:], others.T, strict=True))
    worst = np.nanmax(ours / best)
    return f"median RMSE {medians} of 255; ours better than {better}; at worst {worst:.2f} times the better of both"
