"""Vignetting, the fall of light toward the corners, from an exposure series of an evenly lit surface.

The response of such a series needs no word of it, since each place is compared with itself. With the inverse response g
known, brightness b at the distance r from the middle of photograph e, of an exposure c_e that need not be known, says

    log g(b) = c_e + log V(r),   log V(r) = a_1 r^2 + a_2 r^4 + a_3 r^6,   r = 1 in the corners

which is linear in a, as in Kim and Pollefeys 2008, "Robust radiometric calibration and vignetting correction",
doi:10.1109/TPAMI.2007.70732.
"""

from collections.abc import Iterable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from crfbench.calibration.observations import SATURATED
from crfbench.camera.passport import linearise, squared_radius
from crfbench.camera.series import Image
from crfbench.curves import Array
from crfbench.errors import InputError

_SIDE = 60  # places along the longer side of a photograph
_TERMS = 3  # of the polynomial
_DARKEST = 0.02  # brightness; below, stray light counts as much as the scene
_FEW, _WHOLE, _LEAST = 100, 1 - 1e-3, 1e-9
_ROUNDS, _FAR = 10, 2.0  # of weighing; residuals in units of their median, from where on they count less
_UNEVEN = 0.05  # of log irradiance: where quarters or places differ by more, it is no evenly lit surface


def find_vignetting(images: Iterable[Image], curves: Array, white: float = SATURATED) -> tuple[Array, float]:
    """Find the vignetting of the lens that took photographs of an evenly lit surface.

    Parameters
    ----------
    images : iterable of ndarray, shape (h, w) or (h, w, c)
        8 or 16 bits, of one size; taken one by one. Their exposures need not be known.
    curves : ndarray, shape (1 or c, 1024)
        Inverse responses.
    white : float
        Brightness from which on pixels are saturated.

    Returns
    -------
    coefficients : ndarray, shape (3,)
        As `Passport.vignetting`.
    deviation : float
        Standard deviation of log V in the corner, by how the four quarters of the photographs differ.
    """
    logs, squared, quarters = (np.stack(each) for each in zip(*_places(images, curves, white), strict=True))
    known = np.isfinite(logs)
    rows = [known & (quarters == quarter) for quarter in range(4)]
    if (least := min(row.sum() for row in rows)) < _FEW:
        raise InputError(
            f"a quarter of the photographs has {least} of {_FEW} places that are neither dark nor clipped, too few to "
            "tell the vignetting; use photographs of an evenly lit surface, well exposed to their corners"
        )
    photograph = np.broadcast_to(np.arange(len(logs))[:, None], logs.shape)
    each = [_fit(squared[row], logs[row], photograph[row]) for row in (known, *rows)]
    (coefficients, usual), deviation = each[0], float(np.std([a.sum() for a, _ in each[1:]], ddof=1) / 2.0)
    if max(deviation, usual) > _UNEVEN:
        raise InputError(
            f"this is no evenly lit surface: beside what a lens does, light differs by {usual:.0%} between places, "
            f"{2 * deviation:.0%} between the corners; use photographs of a white wall or the sky, out of focus"
        )
    return coefficients, deviation


def _places(images: Iterable[Image], curves: Array, white: float) -> Iterator[tuple[Array, ...]]:
    """Yield of each photograph, at places (p,), the log irradiance, the squared radius and in which quarter it is."""
    for image in images:
        logs = _log_irradiance(np.atleast_3d(image), curves, white)
        rows, columns = ((np.arange(n) + 0.5) / n for n in logs.shape)
        height, width = image.shape[:2]
        squared = squared_radius((height, width), rows * height, columns * width)
        yield logs.ravel(), squared.ravel(), (2 * (rows[:, None] > 0.5) + (columns > 0.5)).ravel()


def _log_irradiance(image: Image, curves: Array, white: float) -> Array:
    """Return the log irradiance at places, mean over the channels, NaN where a pixel is clipped or dark."""
    import cv2

    height, width, channels = image.shape
    scale, top = min(1.0, _SIDE / max(height, width)), np.iinfo(image.dtype).max
    size = tuple(max(1, round(scale * length)) for length in (width, height))
    reduced = partial(cv2.resize, dsize=size, interpolation=cv2.INTER_AREA)
    light = np.atleast_3d(reduced(linearise(image if channels == 3 else image[..., 0], curves)))
    clear = ((image > _DARKEST * top) & (image < white * top)).all(axis=2).astype(np.float32)
    return np.where(reduced(clear) > _WHOLE, np.log(np.maximum(light, _LEAST)).mean(axis=2), np.nan)


def _fit(squared: Array, logs: Array, photograph: NDArray[np.intp]) -> tuple[Array, float]:
    """Return coefficients and median residual by least squares, in which what is far off counts less."""
    columns = np.stack([*(squared**k for k in range(1, _TERMS + 1)), logs], axis=1)
    weight = np.ones(len(logs))
    for _ in range(_ROUNDS):
        # Each photograph less its mean, which takes its exposure out.
        total = np.maximum(np.bincount(photograph, weight), _LEAST)
        mean = np.stack([np.bincount(photograph, weight * column) / total for column in columns.T], axis=1)
        *x, y = (columns - mean[photograph]).T
        root = np.sqrt(weight)
        found = np.linalg.lstsq(root[:, None] * np.stack(x, axis=1), root * y)[0]
        off = np.abs(y - found @ x)
        usual = float(np.median(off))
        weight = np.minimum(1.0, _FAR * usual / np.maximum(off, _LEAST))
    return np.asarray(found), usual
