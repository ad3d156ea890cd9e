"""Lay the photographs of an exposure series from the hand over each other."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.camera.series import Image, as_series, as_stops
from crfbench.curves import Array

_WIDEST = 1024  # pixels along the longer side of the pictures that are compared
_SURE = 0.3  # of the peak of phase correlation, which is 1 for the same picture and near 0 for another


def align_series(images: Sequence[ArrayLike], exposures: ArrayLike) -> tuple[list[Image], Array]:
    """Shift the photographs of a series by whole pixels to where they show the same.

    Each is compared with that of the next exposure by phase correlation of the green channel, equalised, which no
    response and no exposure changes (Kuglin and Hines 1975). Where two do not correlate, nothing is shifted.

    Parameters
    ----------
    images, exposures
        As in `crfbench.camera.sample_series`.

    Returns
    -------
    images : list of ndarray
        Of the same shapes, 0 where a photograph shows nothing.
    shifts : ndarray, shape (e, 2)
        By how many columns and rows the content of each was off the one of middle exposure.
    """
    arrays = as_series(images)
    order = np.argsort(as_stops(exposures, len(arrays)), kind="stable")
    pictures = [_equalised(array) for array in arrays]
    scale = max(1.0, max(arrays[0].shape[:2]) / _WIDEST)
    steps = [scale * _shift(pictures[early], pictures[late]) for early, late in pairwise(order)]
    along = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    shifts = np.empty_like(along)
    shifts[order] = np.rint(along - along[len(order) // 2])
    return [_moved_by(array, *(-shift).astype(int)) for array, shift in zip(arrays, shifts, strict=True)], shifts


def _equalised(array: Image) -> NDArray[np.float32]:
    import cv2

    plane = array[..., array.shape[2] // 2]
    levels = np.ascontiguousarray(plane >> 8 if plane.dtype == np.uint16 else plane).astype(np.uint8)
    scale = min(1.0, _WIDEST / max(levels.shape))
    small = cv2.resize(levels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1.0 else levels
    return np.asarray(cv2.equalizeHist(small), dtype=np.float32)


def _shift(first: NDArray[np.float32], second: NDArray[np.float32]) -> Array:
    """Return by how many columns and rows the second picture is off the first, 0 where that is not sure."""
    import cv2

    window = cv2.createHanningWindow(first.shape[::-1], cv2.CV_32F)
    found, sure = cv2.phaseCorrelate(first, second, window)
    return np.array(found if sure > _SURE else (0.0, 0.0))


def _moved_by(array: Image, columns: int, rows: int) -> Image:
    moved = np.zeros_like(array)
    height, width = array.shape[:2]
    to, source = (
        tuple(slice(max(sign * n, 0), length + min(sign * n, 0)) for n, length in ((rows, height), (columns, width)))
        for sign in (1, -1)
    )
    moved[to] = array[source]
    return moved
