"""Linearising images: crfbench's lookup beside NumPy's np.interp, same image, same curve, one thread each.

Run it with: make bench. The ratio is the claim; the rates are of this machine and this minute.
"""

import argparse
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from timing import median_seconds

from crfbench.curves import GRID, Array
from crfbench.passport import linearise

_CURVES = np.array([GRID**gamma for gamma in (2.0, 2.2, 2.4)])


def interpolate(image: NDArray[np.integer], curves: Array) -> NDArray[np.float32]:
    """Linearise as one would without a table."""
    white = np.iinfo(image.dtype).max
    planes = np.moveaxis(np.atleast_3d(image), 2, 0)
    return np.stack(
        [np.interp(plane / white, GRID, g).astype(np.float32) for plane, g in zip(planes, curves, strict=True)], axis=2
    )


def main() -> None:
    """Print megapixels a second and the ratio for grey and colour, 8 and 16 bits."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megapixels", type=int, default=12)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rng = np.random.default_rng(0)
    for dtype in (np.uint8, np.uint16):
        for kind, shape in (("grey", ()), ("colour", (3,))):
            size = (1000, 1000 * options.megapixels, *shape)
            image = rng.integers(np.iinfo(dtype).max, size=size, dtype=dtype, endpoint=True)
            curves = _CURVES if shape else _CURVES[:1]
            ours = median_seconds(partial(linearise, image, curves), options.repeats)
            other = median_seconds(partial(interpolate, image, curves), 1)
            rates = (
                f"crfbench {options.megapixels / ours:6.0f} Mpx/s   np.interp {options.megapixels / other:6.1f} Mpx/s"
            )
            print(f"{np.dtype(dtype).name:<7}{kind:<7}{rates}   {other / ours:6.1f} x")


if __name__ == "__main__":
    main()
