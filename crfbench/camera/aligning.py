"""Reduce photographs, find by how much those of a series from the hand are off each other, and shift them."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from crfbench.curves import Array

_WIDEST = 1024  # pixels along the longer side of the pictures that are compared
_SURE = 0.3  # of the peak of phase correlation, which is 1 for the same picture and near 0 for another


Pixels = TypeVar("Pixels", bound=NDArray[Any])


def reduced(pixels: Pixels, longest: int) -> Pixels:
    """Reduce an image (h, w) or (h, w, c) so that its longer side has no more than that many pixels."""
    import cv2

    scale = min(1.0, longest / max(pixels.shape[:2]))
    size = [max(2, round(scale * length)) for length in pixels.shape[1::-1]]
    return cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)  # type: ignore[return-value]


def equalised(array: NDArray[Any]) -> NDArray[np.uint8]:
    """Reduce the green channel of an image (h, w, c) of 8 or 16 bits to what no response and no exposure changes."""
    import cv2

    plane = array[..., array.shape[2] // 2]
    levels = np.ascontiguousarray(plane >> 8 if plane.dtype == np.uint16 else plane).astype(np.uint8)
    return np.asarray(cv2.equalizeHist(reduced(levels, _WIDEST)), dtype=np.uint8)


def find_shifts(pictures: Sequence[NDArray[np.uint8]], stops: Array, shape: tuple[int, ...]) -> NDArray[np.intp]:
    """Say by how many whole columns and rows to shift each photograph to where they all show the same.

    Each is compared with that of the next exposure, by phase correlation (Kuglin and Hines 1975). Where two do not
    correlate, they count as aligned. Takes the `pictures` from `equalised`, exposures (e,), of which the photograph of
    the middle one stays where it is, and the shape of the photographs; returns shape (e, 2).
    """
    order = np.argsort(stops, kind="stable")
    scale = max(shape[:2]) / max(pictures[0].shape)
    steps = [scale * _shift(pictures[early], pictures[late]) for early, late in pairwise(order)]
    along = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    shifts, middle = np.empty(along.shape, dtype=np.intp), order[len(order) // 2]
    shifts[order] = np.rint(along[len(order) // 2] - along)
    for shift, picture in zip(shifts, pictures, strict=True):
        if shift.any() and not _nearer(pictures[middle], picture, shift / scale):
            shift[:] = 0  # small errors of the steps have added up, or something large has moved
    return shifts


def _nearer(still: NDArray[np.uint8], picture: NDArray[np.uint8], shift: Array) -> bool:
    """Say whether a shifted picture is more like the one that stays than it is without."""
    import cv2

    edge = int(np.ceil(np.abs(shift).max()))
    inside = (slice(edge, -edge),) * 2
    moved = cv2.warpAffine(picture, np.column_stack([np.eye(2), shift]), picture.shape[::-1])
    off = [np.abs(np.subtract(still[inside], each[inside], dtype=np.int16)).sum() for each in (picture, moved)]
    return bool(off[1] < off[0])


def shifted(array: NDArray[Any], columns: int, rows: int) -> NDArray[Any]:
    """Shift the content of an image (h, w) or (h, w, c) right and down; what comes in from outside is 0."""
    moved = np.zeros_like(array)
    height, width = array.shape[:2]
    to, source = (
        tuple(slice(max(sign * n, 0), length + min(sign * n, 0)) for n, length in ((rows, height), (columns, width)))
        for sign in (1, -1)
    )
    moved[to] = array[source]
    return moved


def _shift(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> Array:
    """Return by how many columns and rows the second picture is off the first, 0 where that is not sure."""
    import cv2

    window = cv2.createHanningWindow(first.shape[::-1], cv2.CV_32F)
    # Of a transform of odd length OpenCV takes the middle half a pixel off.
    more = [2 * cv2.getOptimalDFTSize((length + 1) // 2) - length for length in first.shape]
    seen = [np.pad(picture * window, [(0, n) for n in more]) for picture in (first, second)]
    found, sure = cv2.phaseCorrelate(*seen)
    return np.array(found if sure > _SURE else (0.0, 0.0))
