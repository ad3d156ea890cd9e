"""How well charts are found and cameras calibrated, on rendered photographs whose truth is known; no speed is claimed.

Every scene has a random OpenCRF response, view, background, light and noise. The patch error is the mean absolute
difference between the measured patches and the response at their true irradiance, in JPEG units (0 to 255).
"""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from benchmarks.timing import Row, noted
from crfbench import camera
from crfbench.camera.measuring import find_chart, measure_chart
from crfbench.curves import Array, evaluate
from crfbench.datasets import load_opencrf
from crfbench.errors import InputError
from crfbench.metrics import rmse
from tests.support.photographs import write_pair
from tests.support.scenes import Scene, render_chart

#: How far the colour of the light (natural logarithm of a factor) and the exposure range.
_SETTINGS = {
    "balanced light": (0.1, (0.6, 1.0)),
    "any light": (0.4, (0.3, 1.1)),
    "dark, any light": (0.4, (0.02, 0.1)),
}
_EXPOSURES = (0.15, 0.35, 0.7, 1.2)


def rows(scenes: int = 40, cameras: int = 10) -> list[Row]:
    """Find charts in every kind of light, then calibrate cameras from files."""
    return [*(_charts(name, scenes) for name in _SETTINGS), *_cameras(cameras)]


def _charts(name: str, count: int) -> Row:
    errors, theirs = [], 0
    for curve, scene in _scenes(*_SETTINGS[name], count):
        errors.append(patch_error(curve, scene))
        detector = cv2.mcc.CCheckerDetector.create()
        detector.setColorChartType(cv2.mcc.MCC24)
        theirs += bool(detector.process(scene.jpeg[..., ::-1].copy(), 1))
    found = np.array(errors)[np.isfinite(errors)]
    shares = f"{len(found) / count:.0%} found, OpenCV's detector alone {theirs / count:.0%}"
    return noted(f"find a chart, {name}", f"{shares} of {count}; patch error {_spread(found, '.2f')}")


def _scenes(light: float, exposures: tuple[float, float], count: int) -> Iterator[tuple[Array, Scene]]:
    """Yield responses and scenes."""
    rng = np.random.default_rng(0)
    curves = load_opencrf().curves
    for seed in range(count):
        curve = curves[rng.integers(len(curves))]
        red, green, blue = np.exp(rng.uniform(-light, light, 3)).tolist()
        exposure, turn = float(rng.uniform(*exposures)), float(rng.uniform(0, 360))
        scene = render_chart(curve, seed, size=(640, 480), exposure=exposure, illuminant=(red, green, blue), turn=turn)
        yield curve, scene


def patch_error(curve: Array, scene: Scene) -> float:
    """Return the mean absolute error of the patches in JPEG units, NaN if no chart is found."""
    image = scene.jpeg / 255.0
    try:
        corners, _ = find_chart(image)
        means = measure_chart(image, corners).means
    except InputError:
        return float("nan")
    true = evaluate(curve, scene.irradiance.ravel()).reshape(means.shape)
    return float(255 * np.abs(means - true).mean())


def _cameras(count: int) -> list[Row]:
    """Calibrate with RAW files, and from the JPEGs alone, where the chart's published colours stand in for the RAW."""
    errors: dict[str, list[float]] = {"RAW and JPEG": [], "JPEG alone": []}
    with TemporaryDirectory() as folder:
        for curve, place in _photographs(count, Path(folder)):
            found = camera.calibrate(place), camera.calibrate(sorted(place.glob("*.jpg")))
            for values, each in zip(errors.values(), found, strict=True):
                values.append(float(rmse(each.passport.in_direction("forward")[0], curve)))
    return [
        noted(f"calibrate a camera from files, {name}", f"RMSE of the response {_spread(np.array(values), '.4f')}")
        for name, values in errors.items()
    ]


def _photographs(count: int, folder: Path) -> Iterator[tuple[Array, Path]]:
    """Yield responses and folders with photographs."""
    rng = np.random.default_rng(0)
    curves = load_opencrf().curves
    for number in range(count):
        curve = curves[rng.integers(len(curves))]
        light = np.exp(rng.uniform(-0.1, 0.1, 3)).tolist()
        for i, exposure in enumerate(_EXPOSURES):
            seed, turn = 4 * number + i, float(rng.uniform(0, 360))
            scene = render_chart(curve, seed, size=(480, 360), exposure=exposure, illuminant=tuple(light), turn=turn)
            write_pair(folder / str(number), f"photograph {i}", scene, exposure_time=exposure / 100)
        yield curve, folder / str(number)


def _spread(values: Array, form: str) -> str:
    median, p95, largest = np.percentile(values, [50, 95, 100])
    return f"median {median:{form}}, 95 % {p95:{form}}, largest {largest:{form}}"
