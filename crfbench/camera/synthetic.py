"""Render an exposure series of a static scene before a camera: radiance of known value, and 8-bit photographs of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.checks import as_finite, check_count, check_number, check_seed
from crfbench.curves import Array, as_valid_curves, evaluate
from crfbench.errors import InputError
from crfbench.files import bundled

#: Four RAW and JPEG pairs of a chart before a synthetic camera, whose response is OpenCRF's "Kodak Gold 200 G".
EXAMPLE_FOLDER = bundled("data/synthetic_camera")

_REGIONS = 80
_FULL_WELL, _READ_NOISE = 20_000.0, 0.001  # electrons; of full scale
_SHADING, _COLOUR = 1.0, 0.3  # natural logarithms: of the smooth change inside regions, and between channels


@dataclass(frozen=True, eq=False)
class ExposureSeries:
    """One rendered series and the truth about it."""

    images: tuple[NDArray[np.uint8], ...]  # shape (height, width, 3)
    stops: Array  # shape (e,); exposure of each image in stops
    radiance: Array  # shape (height, width, 3); in units of what fills full scale at 0 stops


def render_series(
    response: ArrayLike,
    seed: int = 0,
    *,
    size: tuple[int, int] = (480, 320),
    stops: Sequence[float] = (-2.0, -1.0, 0.0, 1.0, 2.0),
    decades: float = 3.5,
) -> ExposureSeries:
    """Photograph random regions of smooth shading and moderate colour, whose radiance spans some decades.

    `response` (1024,) maps irradiance to brightness in all channels; `seed` chooses the scene and the noise; `size` is
    width and height in pixels. The middle of the `stops` shows the brightest region just at full scale. Photon noise
    is that of 20 000 electrons at full scale; read noise is 0.001 of it.
    """
    if not isinstance(size, Sequence) or len(size) != 2:
        raise InputError(f"size={size!r} has the wrong shape; use width and height in pixels")
    for side in size:
        check_count("size", side)
    check_number("decades", decades, 0.0, 12.0)
    curve = as_valid_curves(response)[0]
    rng = np.random.default_rng(check_seed(seed))
    exposures = as_finite("stops", stops)
    if exposures.ndim != 1 or not exposures.size:
        raise InputError(f"stops={stops!r} has the wrong shape; use a row of one or more numbers")
    radiance = _radiance(rng, size, decades) * 2.0 ** -(exposures.min() + exposures.max())
    images = []
    for light in 2.0 ** exposures[:, None, None, None] * radiance:
        noise = rng.standard_normal(light.shape) * np.sqrt(light / _FULL_WELL + _READ_NOISE**2)
        levels = 255.0 * evaluate(curve, (light + noise).ravel())
        images.append(np.rint(levels).astype(np.uint8).reshape(light.shape))
    return ExposureSeries(tuple(images), exposures, radiance)


def _radiance(rng: np.random.Generator, size: tuple[int, int], decades: float) -> Array:
    import cv2
    from scipy.spatial import KDTree

    width, height = size
    pixels = np.stack(np.meshgrid(np.arange(width) / width, np.arange(height) / height), axis=-1)
    region = KDTree(rng.uniform(size=(_REGIONS, 2))).query(pixels)[1]
    level = np.log(10.0) * decades * np.linspace(-1.0, 0.0, _REGIONS)[region]
    shading = cv2.resize(rng.uniform(-_SHADING, 0.0, (5, 7)), size, interpolation=cv2.INTER_CUBIC)
    colour = rng.uniform(-_COLOUR, _COLOUR, (_REGIONS, 3))[region]
    return np.exp((level + shading)[..., None] + colour)
