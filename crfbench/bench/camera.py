"""From files to a response, end to end: synthetic cameras of random OpenCRF responses, four photographs each.

Run it with: python -m crfbench.bench.camera. Every photograph has its own random view, background and noise. Counted
are the photographs whose chart is found, and the RMSE of the response against the true one, with RAW files and from
the JPEGs alone (then the published colours of the chart stand in for the RAW). Shares and errors are the claim.
"""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from crfbench.camera import calibrate_chart
from crfbench.curves import Array
from crfbench.datasets import load_opencrf
from crfbench.metrics import rmse
from crfbench.synthetic import render_chart, write_pair

_EXPOSURES = (0.15, 0.35, 0.7, 1.2)
_SIZE = (480, 360)


def cameras(count: int, folder: Path) -> Iterator[tuple[Array, Path]]:
    """Yield responses and folders with photographs."""
    rng = np.random.default_rng(0)
    curves = load_opencrf().curves
    for number in range(count):
        curve = curves[rng.integers(len(curves))]
        light = np.exp(rng.uniform(-0.1, 0.1, 3)).tolist()
        place = folder / str(number)
        for i, exposure in enumerate(_EXPOSURES):
            seed, turn = 4 * number + i, float(rng.uniform(0, 360))
            scene = render_chart(curve, seed, size=_SIZE, exposure=exposure, illuminant=tuple(light), turn=turn)
            write_pair(place, f"photograph {i}", scene, exposure_time=exposure / 100)
        yield curve, place


def main() -> None:
    """Print one line for each source of irradiance."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cameras", type=int, default=50)
    options = parser.parse_args()
    errors: dict[str, list[float]] = {"RAW and JPEG": [], "JPEG alone": []}
    found, seconds = 0, 0.0
    with TemporaryDirectory() as folder:
        for curve, place in cameras(options.cameras, Path(folder)):
            began = time.perf_counter()
            both = calibrate_chart(place)
            seconds += time.perf_counter() - began
            found += len(both.photographs)
            alone = calibrate_chart(sorted(place.glob("*.jpg")))
            for name, result in zip(errors, (both, alone), strict=True):
                errors[name].append(float(rmse(result.passport.in_direction("forward")[0], curve)))
    photographs = options.cameras * len(_EXPOSURES)
    print(
        f"{found} of {photographs} charts found; {seconds / options.cameras:.2f} s a camera of {len(_EXPOSURES)} pairs"
    )
    print(f"{'response RMSE':<16}{'mean':>9}{'median':>9}{'p95':>9}{'max':>9}{'up to 0.02':>12}")
    for name, values in errors.items():
        row = np.array([np.mean(values), *np.percentile(values, [50, 95, 100])])
        print(f"{name:<16}" + "".join(f"{value:9.4f}" for value in row) + f"{np.mean(np.array(values) <= 0.02):>12.0%}")


if __name__ == "__main__":
    main()
