"""What every step takes: aligned images of one size and depth, and an exposure for each."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.checks import as_numbers
from crfbench.curves import Array
from crfbench.errors import InputError

Image = NDArray[Any]

#: Number of levels of the depths that photographs come in.
LEVELS = {np.dtype(np.uint8): 2**8, np.dtype(np.uint16): 2**16}

_STOPS = 60.0  # between least and greatest exposure; more is no series of one camera


def as_series(images: Sequence[ArrayLike]) -> list[Image]:
    """Return images as arrays (h, w, c) with c = 1 or 3, all alike.

    Raises
    ------
    InputError
        For fewer than two images, and images of another kind or of different size or depth.
    """
    arrays = [np.atleast_3d(np.asarray(image)) for image in images]
    if len(arrays) < 2:
        raise InputError(f"the series has {len(arrays)} images; use two or more of one scene at different exposures")
    first = arrays[0]
    if first.dtype not in LEVELS or first.ndim != 3 or first.shape[2] not in (1, 3) or not first.size:
        raise InputError(f"image 0 is {first.dtype} of shape {first.shape}; use uint8 or uint16, (h, w) or (h, w, 3)")
    for i, array in enumerate(arrays):
        if (array.shape, array.dtype) != (first.shape, first.dtype):
            kinds = f"image 0 is {first.dtype} {first.shape}, image {i} {array.dtype} {array.shape}"
            raise InputError(f"{kinds}; use images of one size and depth, aligned with each other")
    return arrays


def as_stops(exposures: ArrayLike | None, n: int) -> Array:
    """Return the exposures of `n` images in stops.

    Raises
    ------
    InputError
        Where they are missing, as many as not fit, not finite, all equal, or too far apart for stops.
    """
    if exposures is None:
        raise InputError(f"exposures are missing; use {n} numbers in stops, the base-2 logarithm of exposure")
    stops = as_numbers("exposures", exposures)
    if stops.shape != (n,) or not np.isfinite(stops).all():
        raise InputError(f"exposures={stops.tolist()} do not fit {n} images; use one finite number of stops an image")
    if not 0 < np.ptp(stops) <= _STOPS:
        raise InputError(
            f"exposures={stops.tolist()} span {np.ptp(stops):g} stops; use unequal ones, {_STOPS:g} stops apart or less"
        )
    return stops
