"""Linearising images: crfbench's lookup beside NumPy's np.interp, same image, same curve, one thread each.

Run it with: python -m crfbench.bench.linearise. The ratio is the claim; the rates are of this machine and this minute.
"""

import argparse
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from crfbench.bench.timing import Row, median_seconds, row
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


def rows(megapixels: int = 4, repeats: int = 3) -> list[Row]:
    """Time grey and colour, 8 and 16 bits."""
    cv2.setNumThreads(1)
    return [_image(dtype, shape, megapixels, repeats) for dtype in (np.uint8, np.uint16) for shape in ((), (3,))]


def _image(dtype: type[np.integer], shape: tuple[int, ...], megapixels: int, repeats: int) -> Row:
    size = (1000, 1000 * megapixels, *shape)
    image = np.random.default_rng(0).integers(np.iinfo(dtype).max, size=size, dtype=dtype, endpoint=True)
    curves = _CURVES if shape else _CURVES[:1]
    ours = median_seconds(partial(linearise, image, curves), repeats)
    other = median_seconds(partial(interpolate, image, curves), 1)
    name = f"linearise {megapixels} Mpx, {np.dtype(dtype).name}, {'colour' if shape else 'grey'}"
    return row(name, ours, "np.interp", other, "one thread each")


def main() -> None:
    """Print megapixels a second and the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megapixels", type=int, default=12)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    for name, ours, other, other_s, ratio, _ in rows(options.megapixels, options.repeats):
        if ours and other_s:
            rates = f"{options.megapixels / ours:6.0f} Mpx/s   {other} {options.megapixels / other_s:6.1f} Mpx/s"
            print(f"{name:<36}{rates}   {ratio:6.1f} x")


if __name__ == "__main__":
    main()
