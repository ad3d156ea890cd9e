"""Merge an exposure series to one linear image, and write linear images for other programs.

The mean of what each photograph says, by how well it knows it: inverse-variance weights, as in Robertson, Borman and
Stevenson 2003, "Estimation-theoretic approach to dynamic range enhancement using multiple exposures",
doi:10.1117/1.1557695, with the uncertainty of the curve itself added.
"""

import errno
import os
from collections.abc import Iterable, Sequence
from functools import partial
from itertools import zip_longest
from pathlib import Path
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.calibration import Calibration
from crfbench.calibration.observations import SATURATED
from crfbench.camera.passport import Passport, look_up
from crfbench.camera.series import Image, as_images, as_stops
from crfbench.checks import check_number
from crfbench.curves import GRID, Array, as_valid_curves, evaluate, repair
from crfbench.errors import InputError
from crfbench.files import write_new

# Standard deviation of one pixel: of its brightness, and of its irradiance, in units of full scale.
_NOISE, _READ = 0.01, 0.002
_NEAR_WHITE, _FAINT = 0.026, 1e-9  # brightness below white, and the weight of what is brighter
_LEVEL = 0.9  # of the band that is taken from a calibration
_PART = 2**16  # pixels that are merged at once: they fit into the cache, and need little memory
_LEAST = 1e-9  # irradiance, and share of it that is uncertain; keeps divisions finite
_SUFFIXES = (".exr", ".tif", ".tiff", ".hdr")


class Merged(NamedTuple):
    """A linear image."""

    radiance: NDArray[np.float32]  # shape (h, w, 3) or (h, w); in units of what fills full scale at 0 stops
    # shape (h, w); 1 / variance of the natural logarithm of the radiance, of the channel that is known least; 0 where
    # all exposures of a channel are clipped
    weight: NDArray[np.float32]


def merge_series(
    images: Iterable[ArrayLike],
    exposures: ArrayLike,
    response: Calibration | Passport | ArrayLike,
    white: float = SATURATED,
) -> Merged:
    """Merge aligned photographs of one static scene.

    Parameters
    ----------
    images : iterable of array_like, each of shape (h, w) or (h, w, 3)
        8 or 16 bits. Taken one by one, so that an iterator need not hold them all.
    exposures : array_like, shape (e,)
        In stops.
    response : Calibration, Passport, or array_like of shape (1024,), (1, 1024) or (3, 1024)
        Curves by themselves are inverse responses. One serves all channels. A band, where there is one, tells where
        the curve is little known.
    white : float
        Brightness from which on pixels are saturated, from 0.1 to 254/255.

    Returns
    -------
    Merged
        Pixels at 0 or at white weigh nothing, those below their own noise nothing but in the longest exposure, and
        those near white next to nothing but in the shortest. Where a channel is clipped in all exposures,
        its radiance is the nearest end of what could be measured: 0, or what just saturates the least exposure.

    Examples
    --------
    >>> from crfbench.curves import GRID
    >>> dark, light = np.uint8([[51, 102]]), np.uint8([[204, 255]])
    >>> print(merge_series([dark, light], [0, 2], GRID).radiance.round(3))
    [[0.2 0.4]]
    """
    check_number("white", white, 0.1, SATURATED)
    light = 2.0 ** as_stops(exposures, len(images) if isinstance(images, Sequence) else np.size(exposures))
    total: NDArray[np.float32] = np.empty(0, dtype=np.float32)
    weighted = total
    for image, exposure in zip_longest(as_images(images), light):
        if image is None or exposure is None:
            raise InputError(f"more or fewer images than {len(light)} exposures; use one exposure for each")
        if not total.size:
            # Not as parts of one array, which would stay as long as one of them.
            total, weighted = (np.zeros(image.shape, dtype=np.float32) for _ in range(2))
            tables = _tables(*_curves(response, image.shape[2]), np.iinfo(image.dtype).max + 1, white)
            step = max(1, _PART // image.shape[1])
            parts = [slice(first, first + step) for first in range(0, len(image), step)]
            scratch = np.empty((2, *total[:step].shape), dtype=np.float32)  # new ones would cost more than the rest
        known = _at_exposure(tables, exposure, light, white)
        for rows in parts:
            _add(image[rows], known, total[rows], weighted[rows], scratch)
    least = np.empty(total.shape[:2], dtype=np.float32)
    for rows in parts:
        _finish(total[rows], weighted[rows], np.float32(light.max()), least[rows])
    return Merged(weighted if weighted.shape[2] == 3 else weighted[..., 0], least)


def _curves(response: Calibration | Passport | ArrayLike, channels: int) -> tuple[Array, Array]:
    """Return inverse responses and their relative standard deviation, each of shape (1 or c, 1024)."""
    low, high, level = None, None, None
    if isinstance(response, Calibration):
        curves = repair(response.curves)
        if response.bands:
            low, high, level = *response.bands[_LEVEL], _LEVEL
    elif isinstance(response, Passport):
        curves = response.in_direction("inverse")
        if response.direction == "inverse":
            low, high, level = response.low, response.high, response.level
    else:
        curves = as_valid_curves(response)
    if len(curves) not in (1, channels):
        raise InputError(f"{len(curves)} curves do not match images of {channels} channels; use 1 or {channels}")
    if low is None or high is None or level is None:
        return curves, np.zeros_like(curves)
    wide = 2.0 * NormalDist().inv_cdf(0.5 + level / 2)
    return curves, (high - low) / (wide * np.maximum(curves, _LEAST))


def _tables(curves: Array, deviation: Array, levels: int, white: float) -> list[NDArray[np.float32]]:
    """Tabulate what every level says: weight, weight times irradiance, and what a clipped pixel has at least.

    Each table has the shape (levels, 1, c). With g the inverse response and s the relative deviation of its band, the
    irradiance has the variance (s g)^2 + (noise g')^2 + (read noise)^2. It is that of the irradiance, not of its
    logarithm: what noise makes brighter than it is must not count for more.
    """
    brightness = np.linspace(0.0, 1.0, levels)
    g, slope = evaluate(curves, brightness), evaluate(np.gradient(curves, GRID, axis=1), brightness)
    variance = (evaluate(deviation, brightness) * g) ** 2 + (_NOISE * slope) ** 2 + _READ**2
    measured = (brightness > 0.0) & (brightness < white)
    # Lossy files leave white uneven; none of it is more than a level above.
    bound = np.where(measured, 0.0, np.minimum(g, evaluate(curves, np.array([white + 1 / 255]))))
    weight = np.where(measured, 1.0 / variance, 0.0)
    # In the order of memory that OpenCV looks up fast.
    return [np.ascontiguousarray(table.T[:, None], dtype=np.float32) for table in (weight, weight * g, bound)]


def _at_exposure(
    tables: list[NDArray[np.float32]], exposure: float, light: Array, white: float
) -> list[NDArray[np.float32]]:
    """Return the tables of one of several exposures, in units of the longest one."""
    weight, times, bound = tables
    clear = np.ones_like(weight)
    if exposure < light.max():  # a level below its own noise may be stray light, which a short exposure makes large
        clear[times**2 < weight] = 0.0
    if exposure > light.min():  # one near white may be what spills over from a saturated neighbour
        clear[int((white - _NEAR_WHITE) * len(clear)) :] *= _FAINT
    part = np.float32(exposure / light.max())
    return [weight * part**2 * clear, times * part * clear, bound / part]


def _add(
    image: Image,
    tables: Sequence[NDArray[np.float32]],
    total: NDArray[np.float32],
    weighted: NDArray[np.float32],
    scratch: NDArray[np.float32],
) -> None:
    """Add what some rows of a photograph say; where nothing is measured yet, `weighted` holds the nearest end."""
    weight, times = (look_up(image, table, out[: len(image)]) for table, out in zip(tables[:2], scratch, strict=True))
    if (open_ended := total == 0).any():
        np.maximum(weighted, look_up(image, tables[2]), out=weighted, where=open_ended)
        weighted[open_ended & (weight > 0)] = 0
    total += weight
    weighted += times


def _finish(
    total: NDArray[np.float32], weighted: NDArray[np.float32], longest: np.float32, least: NDArray[np.float32]
) -> None:
    """Turn the sums of some rows into radiance, and into the least weight of its logarithm."""
    np.divide(weighted, total, out=weighted, where=total > 0)
    total *= weighted
    total *= weighted
    weighted /= longest
    least[:] = total[..., 0]
    for other in np.moveaxis(total, 2, 0)[1:]:  # much faster than min(axis=2)
        np.minimum(least, other, out=least)


def write_hdr(path: str | Path, radiance: ArrayLike, overwrite: bool = False) -> None:
    """Write a linear image, complete or not at all.

    Parameters
    ----------
    path : path
        ``.exr`` and ``.tif`` or ``.tiff``, not compressed, keep every float32 exactly; ``.hdr`` (Radiance) keeps
        8 bits and a common exponent.
    radiance : array_like, shape (h, w, 3) or (h, w)
        Red, green and blue, or grey; finite, not negative.
    overwrite : bool
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _SUFFIXES:
        raise InputError(f"the name {path} tells no format; let it end in one of {', '.join(_SUFFIXES)}")
    pixels = np.asarray(radiance)
    if pixels.shape[2:] not in ((), (3,)) or pixels.ndim < 2 or not pixels.size or pixels.dtype.kind not in "fiu":
        raise InputError(f"the image is {pixels.dtype} of shape {pixels.shape}; use numbers of shape (h, w, 3)")
    pixels = np.ascontiguousarray(pixels, dtype=np.float32)
    if not np.isfinite(pixels).all() or pixels.min() < 0:
        raise InputError("the image holds values that are negative or not finite in float32; use radiances from 0")
    write = {".exr": _write_exr, ".hdr": _write_hdr}.get(suffix, _write_tiff)
    write_new(path, partial(write, pixels), overwrite)


def _write_exr(pixels: NDArray[np.float32], path: Path) -> None:
    """Write floats as they are: to compress them takes five times as long, and leaves four fifths of the bytes."""
    import OpenEXR

    header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
    try:
        OpenEXR.File(header, {"RGB" if pixels.ndim == 3 else "Y": pixels}).write(str(path))
    except RuntimeError as error:  # the disk is full, say
        raise OSError(errno.EIO, str(error)) from None


def _write_tiff(pixels: NDArray[np.float32], path: Path) -> None:
    import tifffile

    tifffile.imwrite(path, pixels, photometric="rgb" if pixels.ndim == 3 else "minisblack", metadata=None)


def _write_hdr(pixels: NDArray[np.float32], path: Path) -> None:
    """Write three channels, as the format wants; not by the path, which OpenCV cannot use on all systems."""
    import cv2

    done, content = cv2.imencode(".hdr", pixels[..., ::-1] if pixels.ndim == 3 else np.dstack([pixels] * 3))
    if not done or content is None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    path.write_bytes(content.tobytes())
