"""Linearising images: crfbench's lookup beside NumPy's np.interp, same image, same curve, one thread each.

The limit is what memory allows: the time to read the image and to write as many zeros as there are results.
"""

from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import Growth, Row, median_seconds, row
from crfbench import linearise
from crfbench.curves import GRID, Array

_MEGAPIXELS = (1, 10, 100)
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
    image = _noise(dtype, shape, megapixels)
    curves = _CURVES if shape else _CURVES[:1]
    ours = median_seconds(partial(linearise, image, curves), repeats)
    other = median_seconds(partial(interpolate, image, curves), 1)
    limit = median_seconds(lambda: (image.max(), np.full(image.shape, 0, np.float32)), repeats)
    name = f"linearise {megapixels} Mpx, {np.dtype(dtype).name}, {'colour' if shape else 'grey'}"
    note = f"one thread each; {megapixels / ours:.0f} Mpx/s, {limit / ours:.0%} of what memory allows"
    return row(name, ours, "np.interp", other, note)


def _noise(dtype: type[np.integer], shape: tuple[int, ...], megapixels: int) -> NDArray[np.integer]:
    size = (1000, 1000 * megapixels, *shape)
    return np.random.default_rng(0).integers(np.iinfo(dtype).max, size=size, dtype=dtype, endpoint=True)


def growths() -> list[Growth]:
    """Time colour images of 8 bits, larger and larger."""
    cv2.setNumThreads(1)
    images = [_noise(np.uint8, (3,), megapixels) for megapixels in _MEGAPIXELS]
    seconds = [
        [median_seconds(partial(run, image, _CURVES), 3) for run in (linearise, interpolate)] for image in images
    ]
    return [Growth("megapixels", ("crfbench", "np.interp"), _MEGAPIXELS, np.array(seconds))]
