"""Finding a colour chart in rendered photographs: share found, patch error and time, beside OpenCV's detector alone.

Run it with: python -m crfbench.bench.charts. Every scene has a random OpenCRF response, view, background, light and
noise. The patch error is the mean absolute difference between the measured patches and the response at their true
irradiance, in JPEG units (0 to 255), over the patches of one photograph. Shares and errors are the claim; the seconds
are of this machine and this minute.
"""

import argparse
import time
from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np

from crfbench.charts import find_chart, measure_chart
from crfbench.curves import Array, evaluate
from crfbench.datasets import load_opencrf
from crfbench.errors import InputError
from crfbench.synthetic import Scene, render_chart


class Setting(NamedTuple):
    """How far the colour of the light (natural logarithm of a factor) and the exposure range."""

    name: str
    light: float
    exposures: tuple[float, float]


class Outcome(NamedTuple):
    """One photograph; the error is NaN where no chart was found."""

    error: float
    seconds: float
    opencv_found: bool
    opencv_seconds: float


_SETTINGS = (
    Setting("balanced light", 0.1, (0.6, 1.0)),
    Setting("any light", 0.4, (0.3, 1.1)),
    Setting("dark, any light", 0.4, (0.02, 0.1)),
)


def scenes(setting: Setting, count: int, size: tuple[int, int]) -> Iterator[tuple[Array, Scene]]:
    """Yield responses and scenes."""
    rng = np.random.default_rng(0)
    curves = load_opencrf().curves
    for seed in range(count):
        curve = curves[rng.integers(len(curves))]
        red, green, blue = np.exp(rng.uniform(-setting.light, setting.light, 3)).tolist()
        exposure, turn = float(rng.uniform(*setting.exposures)), float(rng.uniform(0, 360))
        yield curve, render_chart(curve, seed, size=size, exposure=exposure, illuminant=(red, green, blue), turn=turn)


def outcome(curve: Array, scene: Scene) -> Outcome:
    """Find and measure the chart of one scene, then let the detector alone find it."""
    start = time.perf_counter()
    error = patch_error(curve, scene)
    middle = time.perf_counter()
    detector = cv2.mcc.CCheckerDetector.create()
    detector.setColorChartType(cv2.mcc.MCC24)
    found = detector.process(scene.jpeg[..., ::-1].copy(), 1)
    return Outcome(error, middle - start, bool(found), time.perf_counter() - middle)


def patch_error(curve: Array, scene: Scene) -> float:
    """Return the mean absolute error of the patches in JPEG units, NaN if no chart is found."""
    image = scene.jpeg / 255.0
    try:
        means = measure_chart(image, find_chart(image).corners).means
    except InputError:
        return float("nan")
    true = evaluate(curve, scene.irradiance.ravel()).reshape(means.shape)
    return float(255 * np.abs(means - true).mean())


def main() -> None:
    """Print one line a setting."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=100, help="of each setting")
    parser.add_argument("--size", type=int, nargs=2, default=(640, 480))
    options = parser.parse_args()
    print(
        f"{options.scenes} scenes a setting, of {options.size[0]} x {options.size[1]}; patch error in JPEG units of 255"
    )
    print(f"{'':<16}{'found':>8}{'median':>8}{'p95':>8}{'max':>8}{'seconds':>9}{'OpenCV found':>14}{'seconds':>9}")
    for setting in _SETTINGS:
        rows = np.array([outcome(*scene) for scene in scenes(setting, options.scenes, tuple(options.size))])
        errors = rows[:, 0][np.isfinite(rows[:, 0])]
        median, p95, largest = np.percentile(errors, [50, 95, 100])
        _, seconds, opencv, opencv_seconds = rows.mean(axis=0)
        share = len(errors) / len(rows)
        print(f"{setting.name:<16}{share:>8.1%}{median:>8.2f}{p95:>8.2f}{largest:>8.2f}{seconds:>9.2f}", end="")
        print(f"{opencv:>14.1%}{opencv_seconds:>9.2f}")


if __name__ == "__main__":
    main()
