"""With RAW: three curves and the colour matrix of a camera, brightness = f(M RAW), estimated together.

A camera mixes the channels of its sensor before it bends them; the rows of M sum to the white balance. Chakrabarti,
Scharstein and Zickler 2009, doi:10.5244/C.23.51; Kim et al. 2012, doi:10.1109/TPAMI.2012.58. Colours that would fall
below 0 are not cut off but drawn in softly, L = (l + sqrt(l^2 + (2 s max l)^2)) / 2 for l = M RAW, as cameras do.

M is fitted in brightness, given the curves, with weights of Student's t; the curves by `calibrate`, given M whose gains
are then known only as far as cameras differ in the RAW of what is just white in the JPEG; and so in turn.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.calibration.calibrate import Calibration, calibrate
from crfbench.calibration.observations import REFERENCE_ERROR, SATURATED, Observations, fit_shape
from crfbench.calibration.posterior import Noise
from crfbench.calibration.table import Table, decode_table
from crfbench.checks import as_finite
from crfbench.curves import GRID, Array, evaluate, reached_at
from crfbench.errors import InputError
from crfbench.models import DEFAULT_MODEL, ResponseModel, load_model
from crfbench.models.base import from_knots
from crfbench.numerics import levenberg_marquardt

# Tried at once: how softly colours are drawn in, which the data choose, and the prior standard deviation of the shares
# of M off its diagonal; with the last M stays diagonal.
_SOFT, _MIXED = np.array([0.003, 0.03, 0.003]), np.array([0.3, 0.3, 1e-3])
_TOLD = 0.1  # posterior standard deviation of a share, from which on the data do not tell M
RAW_FULL = 0.99  # from which on a colour counts as clipped
_FREEDOM = 15.0  # of Student's t
_LEAST = 0.006  # standard deviation of a brightness, at the least
_ROUNDS, _STEPS = 5, 12
_FAR = 0.4  # of the log of a gain, from which on a fit begins with one that suits the curves
_WHITE_SD = 0.35  # of log RAW of what is just white in the JPEG, over cameras
_DARKEST = 1e-4


@dataclass(frozen=True, repr=False)
class ColourCalibration:
    """Colour matrix and curves of `n` cameras.

    Parameters
    ----------
    matrix : ndarray, shape (n, 3, 3)
        M; light 1 is brightness 1, so that its rows sum to the white balance.
    deviation : ndarray, shape (n, 6)
        Posterior standard deviation of the off-diagonal shares of M, row by row, for RAW that is balanced to grey.
    told : ndarray of bool, shape (n,)
        Whether the data tell M; else it is diagonal.
    soft : ndarray, shape (n,)
        How softly colours are drawn into the gamut, s above.
    calibration : Calibration
        Of 3 n sets, given M: red, green and blue of one camera after another.
    """

    matrix: Array
    deviation: Array
    told: NDArray[np.bool_]
    soft: Array
    calibration: Calibration

    def __len__(self) -> int:
        return len(self.matrix)

    @property
    def curves(self) -> Array:
        """Inverse responses of red, green and blue, shape (n, 3, 1024)."""
        return self.calibration.curves.reshape(-1, 3, len(GRID))

    def develop(self, raw: ArrayLike) -> Array:
        """Return the brightness, shape (n, m, 3), of RAW colours, shape (n, m, 3), or (m, 3) for all cameras."""
        array = as_finite("raw", raw)
        if array.ndim not in (2, 3) or array.shape[-1] != 3 or array.shape[:-2] not in ((), (len(self),)):
            raise InputError(f"raw has shape {array.shape}; use (m, 3) or ({len(self)}, m, 3)")
        colours = np.swapaxes(np.broadcast_to(array, (len(self), *array.shape[-2:])), 1, 2)
        light = _drawn(colours, self.matrix, self.soft)[0]
        return np.swapaxes(_brightness(self.curves, light), 1, 2)


def to_raw(light: NDArray[np.floating], matrix: Array, soft: ArrayLike) -> NDArray[Any]:
    """Return the RAW colours of light (..., m, 3) by M (..., 3, 3) and softness (...,).

    Colours far outside the gamut come back only as far as rounded light tells them.
    """
    share = np.asarray(soft, light.dtype)[..., None, None]
    # The greatest channel was drawn in by itself, so that its ratio is known.
    edge = 4 * share * light.max(axis=-1, keepdims=True) / (1 + np.sqrt(1 + 4 * share**2))
    mixed = light - edge**2 / (4 * np.maximum(light, np.maximum(edge / 10, 1e-12)))
    return np.maximum(mixed @ np.swapaxes(np.linalg.inv(matrix).astype(light.dtype), -1, -2), 0.0)


def _drawn(raw: Array, matrix: Array, soft: Array) -> tuple[Array, Array]:
    """Mix RAW colours (n, 3, m) by M, and draw them into the gamut; returns light and its slope in M RAW."""
    mixed = matrix @ raw
    root = np.hypot(mixed, 2 * soft[:, None, None] * np.maximum(mixed.max(axis=1, keepdims=True), 1e-9))
    return (mixed + root) / 2, (mixed + root) / (2 * root)


def _brightness(curves: Array, light: Array) -> Array:
    """Return the brightness of light (n, 3, m) by inverse responses (n, 3, 1024)."""
    rows, at = (array.reshape(-1, array.shape[-1]) for array in (np.maximum.accumulate(curves, axis=-1), light))
    return reached_at(rows, np.clip(at, 0.0, 1.0)).reshape(light.shape)


def calibrate_colour(
    brightness: ArrayLike,
    raw: ArrayLike,
    weights: ArrayLike | None = None,
    *,
    model: ResponseModel | None = None,
    method: str = "posterior",
    seed: int = 0,
    scatter: float = Noise.brightness,
) -> ColourCalibration:
    """Find colour matrix and curves of a camera from colours as JPEG and as RAW.

    Parameters
    ----------
    brightness, raw : array_like, shape (e, p, 3) or (n, e, p, 3)
        Of the same `p` places in the JPEG and in the RAW file of `e` photographs, of one camera or of `n`, from 0 to 1;
        one matrix a camera. Channels that the JPEG clips count for nothing, nor do places that RAW clips.
    weights : array_like, shape (p,), (e, p) or (n, e, p), optional
        How many observations each place counts for; 0 leaves it out. Default 1.
    model, method, seed
        As in `calibrate`; by default the default model, and "posterior".
    scatter : float
        Standard deviation of brightness about the curves that is expected; the data may scale it.
    """
    # The mean of three independent gains has the standard deviation that it has over cameras.
    noise = Noise(scatter, np.sqrt(3) * _WHITE_SD / np.log(2), fine=Noise.fine * scatter / Noise.brightness)
    model, (jpeg, linear, weight) = model or load_model(DEFAULT_MODEL), _checked(brightness, raw, weights)
    table, n = decode_table(model, seed=seed), len(jpeg)
    every = np.tile(np.arange(n), len(_SOFT))
    pairs = _Pairs(jpeg[every], linear[every], weight[every], np.repeat(_SOFT, n), np.repeat(_MIXED, n))
    tried = _in_turn(pairs, model, table, noise)
    best = tried.log_likelihood.reshape(-1, n)[:-1].argmax(axis=0) * n + np.arange(n)
    deviation = tried.deviation[best]
    told = deviation.max(axis=1) < _TOLD
    rows = np.where(told, best, len(every) - n + np.arange(n))
    pairs, found = _taken(pairs, rows), _taken(tried, rows)
    calibration = _curves(pairs, found, model, table, noise, method, seed)
    matrix = _fit(pairs, calibration.curves.reshape(n, 3, -1), found.matrix).matrix
    matrix = np.where(told[:, None, None], matrix, matrix * np.eye(3))
    return ColourCalibration(matrix, deviation, told, pairs.soft, calibration)


def _checked(brightness: ArrayLike, raw: ArrayLike, weights: ArrayLike | None) -> tuple[Array, Array, Array]:
    """Return brightness, RAW and weights, 0 where RAW is clipped or brightness black, of shape (n, 3, m) each."""
    jpeg, linear = as_finite("brightness", brightness), as_finite("raw", raw)
    share = as_finite("weights", 1.0 if weights is None else weights)
    if jpeg.ndim not in (3, 4) or jpeg.shape[-1] != 3 or not jpeg.size or linear.shape != jpeg.shape:
        shapes = f"brightness has shape {jpeg.shape} and raw {linear.shape}"
        raise InputError(f"{shapes}; use (photographs, places, 3) or (n, photographs, places, 3) for both")
    for name, values, most in (("brightness", jpeg, 1.0), ("raw", linear, 1.0), ("weights", share, 1e6)):
        if values.min(initial=0.0) < 0 or values.max(initial=0.0) > most:
            raise InputError(f"{name} reaches from {values.min():g} to {values.max():g}; use values from 0 to {most:g}")
    inside = (jpeg > 0) & (linear.max(axis=-1, keepdims=True) < RAW_FULL)
    weight = inside * fit_shape("weights", share, jpeg.shape[:-1])[..., None]
    n = 1 if jpeg.ndim == 3 else len(jpeg)
    jpeg, linear, weight = (np.swapaxes(array.reshape(n, -1, 3), 1, 2) for array in (jpeg, linear, weight))
    return jpeg, linear, weight


class _Pairs(NamedTuple):
    """Colours of n cameras, m each, and how they are to be fitted."""

    jpeg: Array  # shape (n, 3, m)
    raw: Array  # shape (n, 3, m)
    told: Array  # shape (n, 3, m); weights, of white too: it tells the curves that its light is at least so much
    soft: Array  # shape (n,)
    mixed: Array  # shape (n,)

    @property
    def weight(self) -> Array:
        """Of what is measured, shape (n, 3, m)."""
        return self.told * (self.jpeg < SATURATED)

    def middle(self, values: Array, axis: tuple[int, ...] = (1, 2)) -> Array:
        """Return the median of what counts."""
        counted = np.ma.masked_where(self.weight <= 0, values)
        return np.asarray(np.ma.median(counted, axis=axis, keepdims=True).filled(1.0))


class _Fit(NamedTuple):
    """M given the curves, and what follows from it."""

    matrix: Array  # shape (n, 3, 3)
    deviation: Array  # shape (n, 6)
    weight: Array  # shape (n, 3, m); of each reading, for the curves
    log_likelihood: Array  # shape (n,)


def _taken(parts: Any, rows: NDArray[np.intp]) -> Any:
    return type(parts)(*(part[rows] for part in parts))


def _in_turn(pairs: _Pairs, model: ResponseModel, table: Table, noise: Noise) -> _Fit:
    """Fit M and curves in turn, from a diagonal M by the mean curve."""
    curves = np.tile(from_knots(np.exp(table.log_prior) @ table.at_knots), (len(pairs.soft), 3, 1))
    start = pairs.middle(evaluate(curves, pairs.jpeg) / np.maximum(pairs.raw, 1e-3), (2,)) * np.eye(3)
    found = _fit(pairs, curves, start)
    for _ in range(_ROUNDS):
        curves = _curves(pairs, found, model, table, noise, "map", 0).curves.reshape(curves.shape)
        found = _fit(pairs, curves, found.matrix)
    return found


def _curves(
    pairs: _Pairs, found: _Fit, model: ResponseModel, table: Table, noise: Noise, method: str, seed: int
) -> Calibration:
    """Calibrate the curves given M, up to its gains."""
    light = np.maximum(_drawn(pairs.raw, found.matrix, pairs.soft)[0], _DARKEST)
    white = np.exp(np.log(np.clip(_grey(found.matrix), 1e-2, 1e2)).mean(axis=1))[:, None, None]
    parts = pairs.jpeg, light * white, np.minimum(pairs.told * found.weight, 1e6)
    jpeg, light, weight = (part.reshape(-1, 1, part.shape[2]) for part in parts)
    observations = Observations(jpeg, light[:, 0], [0.0], weights=weight, absolute=True)
    return calibrate(model, observations, method, channels=True, noise=noise, seed=seed, table=table)


def _student(z: Array) -> Array:
    """Return the weight of a residual by Student's t."""
    return (_FREEDOM + 1) / (_FREEDOM + z**2)


def _fit(pairs: _Pairs, curves: Array, start: Array) -> _Fit:
    """Fit M to the brightness, by least squares that are weighed again at every step."""
    light = np.maximum(_drawn(pairs.raw, start, pairs.soft)[0], _DARKEST)
    gain = pairs.middle(evaluate(curves, pairs.jpeg) / light, (2,))
    # From far off the first step would end past 0, where every colour is black.
    start = np.where(abs(np.log(np.maximum(gain, _DARKEST))) > _FAR, gain, 1.0) * start
    sigma = pairs.middle(abs(pairs.jpeg - _brightness(curves, _drawn(pairs.raw, start, pairs.soft)[0])))
    sigma, balance = np.maximum(sigma / 0.674, _LEAST), np.repeat(_grey(start)[:, None], 3, axis=1).reshape(-1, 9)
    # Shares of M for RAW that is balanced to grey; gains are known to a factor of e^100, lest no reading tells one.
    prior = (balance * np.where(np.eye(3, dtype=bool).ravel(), 1e-2, 1 / pairs.mixed[:, None])) ** 2

    def objective(params: Array, rows: NDArray[np.intp]) -> tuple[Array, Array, Array]:
        cost, normal, gradient = _equations(params.reshape(-1, 3, 3), _taken(pairs, rows), curves[rows], sigma[rows])
        back = prior[rows] * np.where(np.eye(3, dtype=bool).ravel(), 0.0, params)
        return cost + (back * params).sum(axis=1), normal + prior[rows, :, None] * np.eye(9), gradient + back

    params = levenberg_marquardt(objective, start.reshape(-1, 9), _STEPS)[0]
    covariance = np.linalg.inv(objective(params, np.arange(len(params)))[1])
    deviation = (balance * np.sqrt(np.einsum("nii->ni", covariance)))[:, [1, 2, 3, 5, 6, 7]]
    matrix = params.reshape(-1, 3, 3)
    light = np.maximum(_drawn(pairs.raw, matrix, pairs.soft)[0], _DARKEST)
    z = (pairs.jpeg - _brightness(curves, light)) / sigma
    logs = -0.5 * (_FREEDOM + 1) * np.log1p(z**2 / _FREEDOM) - np.log(sigma)
    # A wild reading of a dark colour lies much farther off in log irradiance, where curves are calibrated.
    far = np.log(np.maximum(evaluate(curves, pairs.jpeg), _DARKEST) / light)
    far /= np.hypot(REFERENCE_ERROR, 0.02 / np.maximum(pairs.jpeg, 1 / 255))
    weight = _student(z) * _student(far / np.maximum(pairs.middle(abs(far)) / 0.674, 0.2))
    weight = np.where(pairs.jpeg < SATURATED, weight, 1.0)
    return _Fit(matrix, deviation, weight, (pairs.weight * logs).sum(axis=(1, 2)))


def _equations(matrix: Array, pairs: _Pairs, curves: Array, sigma: Array) -> tuple[Array, Array, Array]:
    """Return cost, normal matrix (n, 9, 9) and gradient (n, 9) of M given the data."""
    light, slope = _drawn(pairs.raw, matrix, pairs.soft)
    low, high = np.clip(0.98 * light - 1e-4, 0, 0.999), np.clip(1.02 * light + 1e-4, 0, 1)
    steep = slope * (_brightness(curves, high) - _brightness(curves, low)) / (high - low) / sigma
    z = (_brightness(curves, light) - pairs.jpeg) / sigma
    cost = (pairs.weight * (_FREEDOM + 1) * np.log1p(z**2 / _FREEDOM)).sum(axis=(1, 2))
    by = pairs.weight * _student(z)
    rows = np.einsum("ncm,nim,njm->ncij", by * steep**2, pairs.raw, pairs.raw, optimize=True)
    gradient = np.einsum("ncm,nim->nci", by * steep * z, pairs.raw)
    return cost, np.einsum("ncij,cd->ncidj", rows, np.eye(3)).reshape(-1, 9, 9), gradient.reshape(-1, 9)


def _grey(matrix: Array) -> Array:
    """Return the RAW (n, 3) that M makes grey, or where that is far off, what its diagonal alone does."""
    diagonal = 1.0 / np.einsum("ncc->nc", matrix)
    grey = np.linalg.solve(matrix, np.ones((len(matrix), 3, 1)))[..., 0]
    odd = (grey < 0.3 * diagonal) | (grey > 3.0 * diagonal)
    return np.where(odd.any(axis=1, keepdims=True), diagonal, grey)
