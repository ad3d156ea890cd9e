"""Render a colour chart before a camera: irradiance, the sensor's linear values, and the image after a response.

Noise follows the usual sensor model, photon noise plus read noise: Foi et al. 2008, "Practical Poissonian-Gaussian
noise modeling and fitting for single-image raw-data", doi:10.1109/TIP.2008.2001399.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.camera.synthetic import render_series
from crfbench.curves import GRID, Array, as_valid_curves, evaluate
from crfbench.datasets.chart import COLUMNS, N_PATCHES, ROWS, UNIT, chart_colours, homography, project

# In widths of a patch, measured on a ColorChecker Classic: the gap between patches and the frame around them. The gap
# is not the one that crfbench measures with, which must serve any make of chart.
GAP, FRAME = 0.13, 0.3
_PITCH = 1.0 + GAP
_SIZE = np.array([COLUMNS * _PITCH - GAP, ROWS * _PITCH - GAP])
_FRAME_REFLECTANCE = 0.03
# No real patch reflects nothing: cyan's red would be negative in sRGB.
_DARKEST = 0.01
# Subpixels a pixel and axis.
_FINE = 2


@dataclass(frozen=True, eq=False)
class Scene:
    """One rendered photograph and the truth about it.

    Parameters
    ----------
    raw : ndarray, shape (height, width, 3)
        Sensor values, linear, in [0, 1] of full scale, with noise and clipping.
    jpeg : ndarray of uint8, shape (height, width, 3)
        ``raw`` after the response, in 8 bits.
    corners : ndarray, shape (4, 2)
        Outer corners of the patches 1, 6, 24 and 19, x and y as fractions of width and height.
    irradiance : ndarray, shape (24, 3)
        At the centre of each patch, without noise, in units of full scale; above 1 it clips.
    """

    raw: Array
    jpeg: NDArray[np.uint8]
    corners: Array
    irradiance: Array


def render_chart(
    response: ArrayLike,
    seed: int = 0,
    *,
    size: tuple[int, int] = (640, 480),
    exposure: float = 1.0,
    illuminant: tuple[float, float, float] = (1.0, 1.0, 1.0),
    turn: float = 0.0,
    tilt: float = 0.04,
    vignetting: float = 0.2,
    full_well: float = 20_000.0,
    read_noise: float = 0.001,
) -> Scene:
    """Photograph a chart of 24 patches from a random place, before a random blurred background.

    Parameters
    ----------
    response : array_like, shape (1024,)
        Forward response from irradiance to brightness, the same in all channels.
    seed : int
        Chooses the view, the background and the noise.
    size : tuple of int
        Width and height in pixels.
    exposure : float
        Irradiance of a perfect reflector in the middle of the image, in units of full scale.
    illuminant : tuple of float
        Factors on red, green and blue.
    turn : float
        Degrees by which the chart is turned clockwise, beside up to 15 degrees at random.
    tilt : float
        How far perspective moves each corner at random, as a fraction of the chart's width.
    vignetting : float
        Share of the light that is lost in the corners of the image.
    full_well : float
        Electrons at full scale; photon noise has the variance irradiance / full_well.
    read_noise : float
        Standard deviation of the read noise, in units of full scale.

    Returns
    -------
    Scene
    """
    light = exposure * np.array(illuminant)
    curve = as_valid_curves(response)[0]
    rng = np.random.default_rng(seed)
    corners = _random_view(rng, size, turn, tilt)
    chart, view = _SIZE * UNIT, corners * np.array(size)
    reflectance = _draw(homography(view, chart), _background(rng, size), size)
    irradiance = reflectance * light * _falloff(_pixel_centres(size, 1), size, vignetting)[..., None]
    noise = rng.standard_normal(irradiance.shape) * np.sqrt(irradiance / full_well + read_noise**2)
    raw = np.clip(irradiance + noise, 0.0, 1.0)
    jpeg = np.rint(255.0 * evaluate(curve, raw.ravel()).reshape(raw.shape)).astype(np.uint8)
    falloff = _falloff(project(homography(chart, view), _patch_centres()), size, vignetting)
    return Scene(raw, jpeg, corners, _reflectances() * light * falloff[:, None])


def _reflectances() -> Array:
    return np.maximum(chart_colours(), _DARKEST)


def _patch_centres() -> Array:
    """Return the centres of the patches on the chart, in widths of a patch, shape (24, 2)."""
    rows, columns = np.divmod(np.arange(N_PATCHES), COLUMNS)
    return np.column_stack([columns, rows]) * _PITCH + 0.5


def _random_view(rng: np.random.Generator, size: tuple[int, int], turn: float, tilt: float) -> Array:
    """Return the corners of the patches in the image, as fractions, with the whole frame inside it."""
    angle = np.deg2rad(turn + rng.uniform(-15.0, 15.0))
    rotation = np.array([(np.cos(angle), np.sin(angle)), (-np.sin(angle), np.cos(angle))])
    jitter = rng.uniform(-tilt, tilt, (4, 2)) * _SIZE[0]
    view = (_SIZE * UNIT + jitter) @ rotation
    outline = project(homography(_SIZE * UNIT, view), (_SIZE + 2 * FRAME) * UNIT - FRAME)
    low, extent = outline.min(axis=0), np.ptp(outline, axis=0)
    scale = rng.uniform(0.65, 0.95) * (size / extent).min()
    place = rng.uniform(0.0, 1.0, 2) * (size - scale * extent)
    return ((view - low) * scale + place) / size


def _pixel_centres(size: tuple[int, int], fine: int) -> Array:
    """Return x and y of every subpixel in pixels, shape (fine * height, fine * width, 2)."""
    x, y = ((np.arange(fine * length) + 0.5) / fine for length in size)
    return np.stack(np.meshgrid(x, y), axis=-1)


def _draw(to_chart: Array, background: Array, size: tuple[int, int]) -> Array:
    """Return the reflectance of every pixel, averaged over its subpixels, shape (height, width, 3)."""
    chart = project(to_chart, _pixel_centres(size, _FINE))
    colours = np.repeat(np.repeat(background, _FINE, axis=0), _FINE, axis=1)
    colours[((chart > -FRAME) & (chart < _SIZE + FRAME)).all(axis=-1)] = _FRAME_REFLECTANCE
    cell = np.floor(chart / _PITCH).astype(np.intp)
    in_patch = ((chart - cell * _PITCH < 1.0) & (cell >= 0) & (cell < (COLUMNS, ROWS))).all(axis=-1)
    column, row = np.moveaxis(cell[in_patch], -1, 0)
    colours[in_patch] = _reflectances()[row * COLUMNS + column]
    return colours.reshape(size[1], _FINE, size[0], _FINE, 3).mean(axis=(1, 3))


def _background(rng: np.random.Generator, size: tuple[int, int]) -> Array:
    """Return random colours, much blurred, shape (height, width, 3)."""
    import cv2

    return np.clip(cv2.resize(rng.uniform(0.05, 0.6, (4, 5, 3)), size, interpolation=cv2.INTER_CUBIC), 0.02, 0.9)


def _falloff(points: Array, size: tuple[int, int], vignetting: float) -> Array:
    """Return the share of light that reaches points given in pixels: 1 in the middle, less with the squared radius."""
    radius = np.linalg.norm(points - np.divide(size, 2), axis=-1) / (np.linalg.norm(size) / 2)
    return np.asarray(1.0 - vignetting * radius**2)


#: What a camera makes of its balanced sensor's colours; rows sum to 1.
MATRIX = np.array([[1.5, -0.35, -0.15], [-0.2, 1.4, -0.2], [0.0, -0.5, 1.5]])
BALANCE = (2.0, 1.0, 1.5)


def render_photograph(
    response: ArrayLike,
    seed: int = 0,
    *,
    matrix: ArrayLike = MATRIX,
    balance: tuple[float, float, float] = BALANCE,
    gain: float = 1.1,
    size: tuple[int, int] = (1200, 800),
    crop: float = 0.02,
    distortion: float = 0.01,
) -> tuple[Array, NDArray[np.uint8]]:
    """Photograph a random scene of smooth colours and edges; the JPEG is developed, cropped and its lens corrected.

    Parameters
    ----------
    response : array_like, shape (1024,) or (3, 1024)
        Forward, of all channels or of red, green and blue.
    seed : int
        Of scene and noise.
    matrix : array_like, shape (3, 3)
        From the sensor's colours, balanced, to those that the response bends.
    balance : tuple of float
    gain : float
        What the camera multiplies the sensor's colours by; green that fills the sensor is beyond white from 1 on.
    size : tuple of int
        Width and height in pixels of the sensor.
    crop : float
        Share of each side that the JPEG lacks.
    distortion : float
        By how much of its distance from the centre a corner is moved.

    Returns
    -------
    raw : ndarray, shape (height, width, 3)
    jpeg : ndarray of uint8
    """
    import cv2

    rng = np.random.default_rng(seed)
    light = render_series(GRID, seed, size=size, stops=(0.0,), decades=2.0).radiance
    colour = [cv2.resize(rng.uniform(-0.6, 0.6, (4, 6)), size, interpolation=cv2.INTER_CUBIC) for _ in range(3)]
    sensor = 1.3 * light * np.exp(np.stack(colour, axis=-1)) / np.array(balance)
    noise = rng.standard_normal(sensor.shape) * np.sqrt(sensor / 20_000 + 0.001**2)
    raw = np.clip(sensor + noise, 0.0, 1.0)
    calm = cv2.GaussianBlur(raw, (0, 0), 1.0)  # cameras take out most of the noise
    developed = np.clip(gain * calm * np.array(balance) @ np.asarray(matrix).T, 0.0, 1.0)
    curves = np.broadcast_to(as_valid_curves(response), (3, len(GRID)))
    bent = np.stack([np.interp(developed[..., c], GRID, curves[c]) for c in range(3)], axis=-1)
    return raw, np.rint(255 * _corrected(bent, crop, distortion)).astype(np.uint8)


def _corrected(image: Array, crop: float, distortion: float) -> Array:
    """Return the picture without its border, each point moved outwards with the square of its distance."""
    import cv2

    height, width = image.shape[:2]
    x, y = np.meshgrid(*(np.arange(round(n * (1 - crop))) - (round(n * (1 - crop)) - 1) / 2 for n in (width, height)))
    scale = 1 - distortion * (x**2 + y**2) / (np.hypot(width, height) / 2) ** 2
    columns, rows = ((scale * v + (n - 1) / 2).astype(np.float32) for v, n in ((x, width), (y, height)))
    return np.asarray(cv2.remap(image, columns, rows, cv2.INTER_LINEAR))
