"""Turning the brightness of images into irradiance."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from crfbench.camera.passport import Passport
from crfbench.curves import Array, as_valid_curves, evaluate
from crfbench.errors import InputError


def linearise(image: ArrayLike, response: Passport | ArrayLike, dtype: DTypeLike = np.float32) -> NDArray[Any]:
    """Return the irradiance of an image: linear in light, 1 where the brightness is greatest.

    Parameters
    ----------
    image : array_like, shape (h, w) or (h, w, 3)
        Brightness. Integers of 8 or 16 bits count from 0 to 255 or 65535; floats from 0 to 1, beyond which the
        curve's ends hold. The three channels are red, green and blue.
    response : Passport, or array_like of shape (1024,), (1, 1024) or (3, 1024)
        Curves without a passport are inverse responses. One curve serves all channels.
    dtype : {float32, uint16}
        Of the result: irradiance in [0, 1], or 65535 times it, rounded.

    Returns
    -------
    ndarray, shape of `image`

    Examples
    --------
    >>> from crfbench.curves import GRID
    >>> linearise(np.array([[0, 128, 255]], dtype=np.uint8), GRID**2, dtype=np.uint16).tolist()
    [[0, 16513, 65535]]
    """
    pixels = np.asarray(image)
    curves = response.in_direction("inverse") if isinstance(response, Passport) else as_valid_curves(response)
    if len(curves) not in (1, 3):
        raise InputError(f"{len(curves)} curves do not match the channels of an image; use 1 or 3")
    if dtype not in (np.dtype(np.float32), np.dtype(np.uint16)):
        raise InputError(f"dtype={dtype!r} is not known; use float32 or uint16")
    if not (pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] == 3)) or not pixels.size:
        raise InputError(f"the image has shape {pixels.shape}; use (h, w) or (h, w, 3)")
    if len(curves) == 3 and pixels.ndim == 2:
        raise InputError(f"three curves do not match a grey image of shape {pixels.shape}; use one, or a colour image")
    if pixels.dtype in (np.uint8, np.uint16):
        return _look_up(pixels, curves, np.dtype(dtype))
    return _quantised(_interpolate(pixels, curves), np.dtype(dtype))


def _look_up(pixels: NDArray[Any], curves: Array, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Look every pixel up in a table of all its possible values."""
    import cv2

    table = _quantised(evaluate(curves, np.linspace(0.0, 1.0, np.iinfo(pixels.dtype).max + 1)), dtype)
    result: NDArray[Any] = cv2.LUT(np.ascontiguousarray(pixels), np.ascontiguousarray(table.T[None]))
    return result


def _interpolate(pixels: NDArray[Any], curves: Array) -> Array:
    if pixels.dtype.kind != "f":
        raise InputError(f"the pixels are {pixels.dtype}; use uint8, uint16 or floats")
    if not np.isfinite(pixels).all():
        raise InputError("the image holds NaN or infinite values; use finite floats from 0 to 1")
    if len(curves) == 1:
        return evaluate(curves[0], pixels.ravel()).reshape(pixels.shape)
    return evaluate(curves, pixels.reshape(-1, 3).T).T.reshape(pixels.shape)


def _quantised(irradiance: Array, dtype: np.dtype[Any]) -> NDArray[Any]:
    unit = np.clip(irradiance, 0.0, 1.0)  # a valid curve may leave [0, 1] by a rounding
    return (np.rint(unit * 65535.0) if dtype == np.uint16 else unit).astype(dtype)
