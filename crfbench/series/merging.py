"""Merge an exposure series to one linear image: the mean of what each photograph says, by how well it knows it.

Inverse-variance weights, as in Robertson, Borman and Stevenson 2003, "Estimation-theoretic approach to dynamic range
enhancement using multiple exposures", doi:10.1117/1.1557695, with the uncertainty of the curve itself added.
"""

from collections.abc import Iterator, Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.calibration import Calibration
from crfbench.calibration.observations import SATURATED
from crfbench.curves import GRID, Array, as_valid_curves, evaluate, repair
from crfbench.errors import InputError
from crfbench.passport import Passport
from crfbench.series.checks import LEVELS, Image, as_series, as_stops

_LEVEL = 0.9  # of the band that is taken from a calibration
_PART = 2**18  # pixels that are merged at once
_LEAST = 1e-9  # irradiance, and share of it that is uncertain; keeps divisions finite


class Merged(NamedTuple):
    """A linear image.

    Parameters
    ----------
    radiance : ndarray of float32, shape (h, w, 3) or (h, w)
        In units of what fills full scale at 0 stops.
    weight : ndarray of float32, shape (h, w)
        1 / variance of the natural logarithm of the radiance, of the channel that is known least; 0 where all
        exposures of a channel are clipped.
    """

    radiance: NDArray[np.float32]
    weight: NDArray[np.float32]


class _Tables(NamedTuple):
    """For each level and channel: weight, weight times irradiance, and what a clipped pixel has at least, (l, 1, c)."""

    weight: NDArray[np.float32]
    weighted: NDArray[np.float32]
    bound: NDArray[np.float32]


def merge_series(
    images: Sequence[ArrayLike],
    exposures: ArrayLike,
    response: Calibration | Passport | ArrayLike,
    *,
    noise: float = 0.01,
) -> Merged:
    """Merge aligned photographs of one static scene.

    Parameters
    ----------
    images : sequence of array_like, each of shape (h, w) or (h, w, 3)
        8 or 16 bits.
    exposures : array_like, shape (e,)
        In stops.
    response : Calibration, Passport, or array_like of shape (1024,), (1, 1024) or (3, 1024)
        Curves by themselves are inverse responses. One serves all channels. A band, where there is one, tells where
        the curve is little known.
    noise : float
        Standard deviation of the brightness of one pixel, in units of the full range.

    Returns
    -------
    Merged
        Pixels at 0 or from 254/255 of full scale weigh nothing. Where a channel is clipped in all exposures, its
        radiance is the nearest end of what could be measured: 0, or what just saturates the least exposure.

    Raises
    ------
    InputError
        For images, exposures or curves that do not fit, and a noise that is not above 0.

    Examples
    --------
    >>> from crfbench.curves import GRID
    >>> dark, light = np.uint8([[51, 102]]), np.uint8([[204, 255]])
    >>> print(merge_series([dark, light], [0, 2], GRID).radiance.round(3))
    [[0.2 0.4]]
    """
    arrays = as_series(images)
    light = 2.0 ** as_stops(exposures, len(arrays))
    if not 0 < noise < 1:
        raise InputError(f"noise={noise!r} does not fit; use a number between 0 and 1, such as 0.01")
    tables = _tables(*_curves(response, arrays[0].shape[2]), LEVELS[arrays[0].dtype], noise)
    radiance = np.empty(arrays[0].shape, dtype=np.float32)
    weight = np.empty(arrays[0].shape[:2], dtype=np.float32)
    for rows in _parts(*arrays[0].shape[:2]):
        radiance[rows], weight[rows] = _merged([array[rows] for array in arrays], light, tables)
    shape = np.shape(images[0])
    return Merged(radiance.reshape(shape), weight)


def _curves(response: Calibration | Passport | ArrayLike, channels: int) -> tuple[Array, Array]:
    """Return inverse responses and their relative standard deviation, each of shape (1 or c, 1024)."""
    band: tuple[Array | None, Array | None, float | None] = (None, None, None)
    if isinstance(response, Calibration):
        curves = repair(response.curves)
        if response.bands:
            band = (*response.bands[_LEVEL], _LEVEL)
    elif isinstance(response, Passport):
        curves = response.in_direction("inverse")
        if response.direction == "inverse":
            band = (response.low, response.high, response.level)
    else:
        curves = as_valid_curves(response)
    if len(curves) not in (1, channels):
        raise InputError(f"{len(curves)} curves do not fit images of {channels} channels; use 1 or {channels}")
    low, high, level = band
    if low is None or high is None or level is None:
        return curves, np.zeros_like(curves)
    wide = 2.0 * NormalDist().inv_cdf(0.5 + level / 2)
    return curves, (high - low) / (wide * np.maximum(curves, _LEAST))


def _tables(curves: Array, deviation: Array, levels: int, noise: float) -> _Tables:
    """Tabulate what every level says.

    With g the inverse response and s the relative deviation of its band, the logarithm of an irradiance has the
    variance s^2 + (noise g' / g)^2. It is relative, so that the weight does not depend on the radiance itself.
    """
    brightness = np.linspace(0.0, 1.0, levels)
    g = evaluate(curves, brightness)
    steepness = evaluate(np.gradient(curves, GRID, axis=1), brightness) / np.maximum(g, _LEAST)
    variance = evaluate(deviation, brightness) ** 2 + (noise * steepness) ** 2
    measured = (brightness > 0.0) & (brightness < SATURATED)
    weight = np.where(measured, 1.0 / np.maximum(variance, _LEAST), 0.0)
    bound = np.where(measured, 0.0, g)
    return _Tables(*(table.T[:, None].astype(np.float32) for table in (weight, weight * g, bound)))


def _parts(height: int, width: int) -> Iterator[slice]:
    """Split an image into rows of about `_PART` pixels."""
    size = max(1, _PART // width)
    return (slice(first, first + size) for first in range(0, height, size))


def _merged(images: Sequence[Image], light: Array, tables: _Tables) -> tuple[Array, Array]:
    """Merge some rows of all images, (h, w, c) each, to radiance (h, w, c) and weight (h, w)."""
    total, weighted, bound = np.zeros((3, *images[0].shape), dtype=np.float32)
    for image, exposure in zip(images, light, strict=True):
        weight, times, least = (_look_up(image, table) for table in tables)
        total += weight
        weighted += times / np.float32(exposure)
        np.maximum(bound, least / np.float32(exposure), out=bound)
    radiance = np.where(total > 0, weighted / np.where(total > 0, total, 1), bound)
    return radiance, total.min(axis=2)


def _look_up(image: Image, table: NDArray[np.float32]) -> NDArray[np.float32]:
    import cv2

    return np.asarray(cv2.LUT(np.ascontiguousarray(image), table), dtype=np.float32).reshape(image.shape)
