"""With RAW: three curves and the colour matrix of a camera, brightness = f(M RAW), estimated together.

A camera mixes the channels of its sensor before it bends them; the rows of M sum to the white balance. Chakrabarti,
Scharstein and Zickler 2009, doi:10.5244/C.23.51; Kim et al. 2012, doi:10.1109/TPAMI.2012.58. Colours that would fall
below 0 are not cut off but drawn in softly, L = (l + sqrt(l^2 + (2 s max l)^2)) / 2 for l = M RAW, as cameras do.

M is fitted in brightness, given the curves, with weights of Student's t; the curves by `calibrate`, given M, whose gains
are then known only as far as cameras differ in the RAW of what is just white in the JPEG; and so in turn.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.calibration.calibrate import Calibration, calibrate
from crfbench.calibration.observations import SATURATED, Observations
from crfbench.calibration.posterior import Noise
from crfbench.calibration.table import Table, decode_table
from crfbench.checks import as_finite
from crfbench.curves import GRID, Array, evaluate
from crfbench.errors import InputError
from crfbench.models import DEFAULT_MODEL, ResponseModel, load_model
from crfbench.models.discrepancy import from_knots
from crfbench.numerics import levenberg_marquardt

_SOFT = (0.003, 0.03)  # how softly colours may be drawn in; the data choose
_FULL = 0.99  # RAW from which on a colour counts as clipped
_MIXED, _DIAGONAL = 0.3, 1e-3  # prior standard deviation of off-diagonal shares; where M is to stay diagonal
_TOLD = 0.1  # posterior one, from which on the data do not tell M
_FREEDOM = 30.0  # of Student's t
_LEAST = 0.006  # standard deviation of a brightness, at the least
_ROUNDS, _STEPS = 3, 12
_WHITE, _WHITE_SD = -0.1, 0.25  # log RAW of what is just white in the JPEG, over cameras
_REFERENCE = 0.05  # standard deviation of log M RAW of a colour
_QUANTUM = 0.0015  # standard deviation of RAW
_OUTSIDE = 0.5  # standard deviation, in log, of a colour far outside the gamut
_DARKEST = 1e-5


@dataclass(frozen=True)
class ColourCalibration:
    """Colour matrix and curves of `n` cameras.

    Parameters
    ----------
    matrix : ndarray, shape (n, 3, 3)
        M; brightness 1 is light 1, so that its rows sum to the white balance.
    deviation : ndarray, shape (n, 6)
        Posterior standard deviation of the off-diagonal shares of M, row by row, for RAW that is balanced to grey.
    told : ndarray of bool, shape (n,)
        Whether the data tell M; else it is diagonal.
    soft : ndarray, shape (n,)
        How softly colours are drawn into the gamut, s above.
    calibration : Calibration
        Of 3 n sets: red, green and blue of one camera after another, given M.
    """

    matrix: Array
    deviation: Array
    told: NDArray[np.bool_]
    soft: Array
    calibration: Calibration

    def __repr__(self) -> str:
        return f"ColourCalibration({len(self)} cameras, M told of {int(self.told.sum())}; {self.calibration!r})"

    def __len__(self) -> int:
        return len(self.matrix)

    @property
    def curves(self) -> Array:
        """Inverse responses of red, green and blue, shape (n, 3, 1024)."""
        return self.calibration.curves.reshape(-1, 3, len(GRID))

    def develop(self, raw: ArrayLike) -> Array:
        """Return the brightness, shape (n, m, 3), of RAW colours, shape (n, m, 3) or (m, 3) for all cameras."""
        light = to_light(self._colours("raw", raw), self.matrix, self.soft)
        return _brightness(self.curves, light)

    def undevelop(self, brightness: ArrayLike) -> Array:
        """Return the RAW colours, shape (n, m, 3), of a brightness, shape (n, m, 3) or (m, 3) for all cameras."""
        at = np.swapaxes(self._colours("brightness", brightness), 1, 2)
        return to_raw(np.swapaxes(evaluate(self.curves, at), 1, 2), self.matrix, self.soft)

    def _colours(self, name: str, values: ArrayLike) -> Array:
        array = as_finite(name, values)
        if array.ndim not in (2, 3) or array.shape[-1] != 3 or array.shape[:-2] not in ((), (len(self),)):
            raise InputError(f"{name} has shape {array.shape}; use (m, 3) or ({len(self)}, m, 3)")
        return np.broadcast_to(array, (len(self), *array.shape[-2:]))


def to_light(raw: Array, matrix: Array, soft: ArrayLike) -> Array:
    """Mix RAW colours (..., m, 3) by M (..., 3, 3), and draw them into the gamut by `soft` (...,)."""
    return _drawn(raw @ np.swapaxes(matrix, -1, -2), soft)[0]


def to_raw(light: Array, matrix: Array, soft: ArrayLike) -> Array:
    """Undo `to_light`; what was far outside the gamut is brought back by as much as quantised light allows."""
    share = np.asarray(soft)[..., None, None]
    # The greatest channel was drawn by the same rule, so that its own ratio gives it back.
    edge = 2 * share * light.max(axis=-1, keepdims=True) * 2 / (1 + np.sqrt(1 + 4 * share**2))
    mixed = light - edge**2 / (4 * np.maximum(light, np.maximum(edge / 10, 1e-12)))
    return np.maximum(np.swapaxes(np.linalg.solve(matrix, np.swapaxes(mixed, -1, -2)), -1, -2), 0.0)


def _drawn(mixed: Array, soft: ArrayLike) -> tuple[Array, Array]:
    """Draw M RAW into the gamut; returns light and its slope."""
    edge = 2 * np.asarray(soft)[..., None, None] * np.maximum(mixed.max(axis=-1, keepdims=True), 1e-9)
    root = np.hypot(mixed, edge)
    light = (mixed + root) / 2
    return light, light / root


def _brightness(curves: Array, light: Array) -> Array:
    """Return the brightness of light (n, m, 3) by inverse responses (n, 3, 1024)."""
    rows = np.maximum.accumulate(curves, axis=-1).reshape(-1, len(GRID))
    # Rows shifted apart make one increasing sequence, so that one call serves all.
    shift = 2.0 * np.arange(len(rows))[:, None]
    at = np.swapaxes(np.clip(light, 0.0, 1.0), 1, 2)
    flat = np.interp((at.reshape(len(rows), -1) + shift).ravel(), (rows + shift).ravel(), np.tile(GRID, len(rows)))
    return np.swapaxes(flat.reshape(at.shape), 1, 2)


def calibrate_colour(
    brightness: ArrayLike,
    raw: ArrayLike,
    weights: ArrayLike | None = None,
    *,
    model: ResponseModel | None = None,
    method: str = "posterior",
    seed: int = 0,
) -> ColourCalibration:
    """Find the colour matrix and the curves of red, green and blue from colours as JPEG and as RAW.

    Parameters
    ----------
    brightness, raw : array_like, shape (e, p, 3) or (n, e, p, 3)
        The same `p` places in the JPEG and in the RAW file of `e` photographs, of one camera or of `n`, from 0 to 1; one
        matrix a camera. JPEG values that are black or saturated are left out, and colours that fill a channel of RAW.
    weights : array_like, shape (p,), (e, p) or (n, e, p), optional
        How many observations each place counts for; 0 leaves it out. Default 1.
    model, method, seed
        As in `calibrate`: the default model, "posterior" or "map".

    Returns
    -------
    ColourCalibration
    """
    pairs, model = _Pairs.checked(brightness, raw, weights), model or load_model(DEFAULT_MODEL)
    table, n = decode_table(model, seed=seed), len(pairs.raw)
    twice = np.repeat(_SOFT, n)
    tried = _in_turn(pairs.of(np.tile(np.arange(n), 2)), twice, _MIXED, model, table)
    best = tried.log_likelihood.reshape(2, n).argmax(axis=0) * n + np.arange(n)
    found, soft = tried.of(best), twice[best]
    told, deviation = found.deviation.max(axis=1) < _TOLD, found.deviation.copy()
    if not told.all():
        left = np.flatnonzero(~told)
        diagonal = _in_turn(pairs.of(left), soft[left], _DIAGONAL, model, table)
        found = _Fit(*(_replaced(old, left, new) for old, new in zip(found, diagonal, strict=True)))
    calibration = _curves(pairs, found, soft, model, table, method, seed)
    mixed = np.where(told, _MIXED, _DIAGONAL)
    matrix = _fit(pairs, calibration.curves.reshape(n, 3, -1), found.matrix, soft, mixed).matrix
    matrix = np.where(told[:, None, None], matrix, matrix * np.eye(3))
    return ColourCalibration(matrix, deviation, told, soft, calibration)


def _replaced(old: Array, rows: NDArray[np.intp], new: Array) -> Array:
    old[rows] = new
    return old


class _Pairs(NamedTuple):
    """Colours of n cameras, m each, and what they count for, 0 where clipped: (n, m, 3) all."""

    jpeg: Array
    raw: Array
    weight: Array

    @classmethod
    def checked(cls, brightness: ArrayLike, raw: ArrayLike, weights: ArrayLike | None) -> Self:
        jpeg, linear = as_finite("brightness", brightness), as_finite("raw", raw)
        if jpeg.ndim not in (3, 4) or jpeg.shape[-1] != 3 or not jpeg.size or linear.shape != jpeg.shape:
            raise InputError(
                f"brightness has shape {jpeg.shape} and raw {linear.shape}; use (photographs, places, 3) or "
                "(n, photographs, places, 3), the same for both"
            )
        for name, values in (("brightness", jpeg), ("raw", linear)):
            if values.min() < 0 or values.max() > 1:
                raise InputError(f"{name} runs from {values.min():g} to {values.max():g}; use values from 0 to 1")
        share = as_finite("weights", 1.0 if weights is None else weights)
        try:
            share = np.broadcast_to(share, jpeg.shape[:-1])
        except ValueError:
            raise InputError(f"weights have shape {share.shape}; use {jpeg.shape[:-1]} or what broadcasts to it") from None
        if share.min() < 0:
            raise InputError(f"weights run from {share.min():g}; use 0 and more")
        inside = (jpeg > 0) & (jpeg < SATURATED) & (linear.max(axis=-1, keepdims=True) < _FULL)
        n = 1 if jpeg.ndim == 3 else len(jpeg)
        return cls(*(a.reshape(n, -1, 3) for a in (jpeg, linear, inside * share[..., None])))

    def of(self, rows: NDArray[np.intp]) -> Self:
        return type(self)(*(part[rows] for part in self))


class _Fit(NamedTuple):
    """M given the curves, and what follows from it."""

    matrix: Array  # shape (n, 3, 3)
    deviation: Array  # shape (n, 6)
    weight: Array  # shape (n, m, 3); of Student's t
    log_likelihood: Array  # shape (n,)

    def of(self, rows: NDArray[np.intp]) -> Self:
        return type(self)(*(part[rows] for part in self))


def _in_turn(pairs: _Pairs, soft: Array, mixed: float, model: ResponseModel, table: Table) -> _Fit:
    """Fit M and curves in turn, from a diagonal M by the mean curve."""
    curves = np.tile(from_knots(np.exp(table.log_prior) @ table.at_knots), (len(soft), 3, 1))
    ratio = np.swapaxes(evaluate(curves[0], pairs.jpeg.reshape(-1, 3).T), 0, 1).reshape(pairs.raw.shape)
    ratio = np.where(pairs.weight > 0, ratio / np.maximum(pairs.raw, 1e-3), np.nan)
    start = np.nan_to_num(np.nanmedian(ratio, axis=1), nan=1.0)[..., None] * np.eye(3)
    # The first curve is a mean: a matrix that may bend itself to it would not come back.
    found = _fit(pairs, curves, start, soft, np.full(len(soft), min(mixed, 0.1)))
    for _ in range(_ROUNDS):
        curves = _curves(pairs, found, soft, model, table, "map", 0).curves.reshape(curves.shape)
        found = _fit(pairs, curves, found.matrix, soft, np.full(len(soft), mixed))
    return found


def _curves(
    pairs: _Pairs, found: _Fit, soft: Array, model: ResponseModel, table: Table, method: str, seed: int
) -> Calibration:
    """Calibrate the curves given M, up to its gains."""
    light, slope = _drawn(pairs.raw @ np.swapaxes(found.matrix, 1, 2), soft)
    light = np.maximum(light, _DARKEST)
    quantum = _QUANTUM * np.einsum("ncc->nc", found.matrix)[:, None] * slope / light
    error = np.sqrt(_REFERENCE**2 + quantum**2 + (_OUTSIDE * (1 - slope)) ** 2)
    white = np.log(np.clip(_grey(found.matrix), 1e-2, 1e2)).mean(axis=1) - _WHITE
    jpeg, reference, error, weight = (
        np.swapaxes(part, 1, 2).reshape(len(part) * 3, -1)
        for part in (pairs.jpeg, light * np.exp(white)[:, None, None], error, pairs.weight * found.weight)
    )
    known = {"exposures": [0.0], "reference_error": error, "absolute": True}
    observations = Observations(jpeg[:, None], reference, weights=weight[:, None], **known)
    # The mean of three independent gains has the standard deviation that it has over cameras.
    noise = replace(Noise(), exposure=np.sqrt(3) * _WHITE_SD / np.log(2))
    return calibrate(model, observations, method, channels=True, noise=noise, seed=seed, table=table)


def _fit(pairs: _Pairs, curves: Array, start: Array, soft: Array, mixed: Array) -> _Fit:
    """Fit M to the brightness; Student's t is an iteratively reweighted least squares."""
    counts = pairs.weight > 0
    off = np.where(counts, pairs.jpeg - _brightness(curves, to_light(pairs.raw, start, soft)), np.nan)
    sigma = np.maximum(np.nanmedian(abs(off), axis=(1, 2)) / 0.674, _LEAST)

    def objective(params: Array, rows: NDArray[np.intp]) -> tuple[Array, Array, Array]:
        return _equations(params.reshape(-1, 3, 3), pairs.of(rows), curves[rows], soft[rows], mixed[rows], sigma[rows])

    params, _ = levenberg_marquardt(objective, start.reshape(-1, 9), _STEPS)
    matrix = params.reshape(-1, 3, 3)
    covariance = np.linalg.inv(objective(params, np.arange(len(params)))[1])
    jacobian = _shares(matrix)[1]
    deviation = np.sqrt(np.einsum("nij,njk,nik->ni", jacobian, covariance, jacobian))
    z2 = ((pairs.jpeg - _brightness(curves, to_light(pairs.raw, matrix, soft))) / sigma[:, None, None]) ** 2
    logs = -0.5 * (_FREEDOM + 1) * np.log1p(z2 / _FREEDOM) - np.log(sigma)[:, None, None]
    weight = (_FREEDOM + 1) / (_FREEDOM + z2)
    return _Fit(matrix, deviation, weight, (pairs.weight * logs).sum(axis=(1, 2)))


def _equations(
    matrix: Array, pairs: _Pairs, curves: Array, soft: Array, mixed: Array, sigma: Array
) -> tuple[Array, Array, Array]:
    """Return cost, normal matrix and gradient of M, flat."""
    light, slope = _drawn(pairs.raw @ np.swapaxes(matrix, 1, 2), soft)
    low, high = np.clip(0.98 * light - 1e-4, 0, 0.999), np.clip(1.02 * light + 1e-4, 0, 1)
    steep = (_brightness(curves, high) - _brightness(curves, low)) / (high - low) * slope
    z = (_brightness(curves, light) - pairs.jpeg) / sigma[:, None, None]
    by = pairs.weight * (_FREEDOM + 1) / (_FREEDOM + z**2)
    per = steep / sigma[:, None, None]
    shares, jacobian = _shares(matrix)
    prior, back = jacobian / mixed[:, None, None], shares / mixed[:, None]
    blocks = np.einsum("nmc,nmi,nmj->ncij", by * per**2, pairs.raw, pairs.raw, optimize=True)
    normal = np.einsum("ncij,cd->ncidj", blocks, np.eye(3)).reshape(-1, 9, 9)
    gradient = np.einsum("nmc,nmi->nci", by * per * z, pairs.raw).reshape(-1, 9)
    cost = (pairs.weight * (_FREEDOM + 1) * np.log1p(z**2 / _FREEDOM)).sum(axis=(1, 2)) + (back**2).sum(axis=1)
    turned = np.swapaxes(prior, 1, 2)
    return cost, normal + turned @ prior, gradient + (turned @ back[..., None])[..., 0]


def _shares(matrix: Array) -> tuple[Array, Array]:
    """Return the off-diagonal shares (n, 6) of M for RAW that is balanced to grey, and their Jacobian (n, 6, 9)."""
    grey = _grey(matrix)[:, None]
    gains = (matrix * grey).sum(axis=2, keepdims=True)
    shares = matrix * grey / gains
    each = (np.eye(3) - shares[..., None]) * (grey / gains)[:, :, None]
    jacobian = np.einsum("ncij,cd->ncidj", each, np.eye(3)).reshape(-1, 9, 9)
    off = np.flatnonzero(~np.eye(3, dtype=bool))
    return shares.reshape(-1, 9)[:, off], jacobian[:, off]


def _grey(matrix: Array) -> Array:
    """Return the RAW (n, 3) that M makes grey, or where that is far off, what its diagonal alone does."""
    diagonal = 1.0 / np.einsum("ncc->nc", matrix)
    grey = np.linalg.solve(matrix, np.ones((len(matrix), 3, 1)))[..., 0]
    odd = (grey < 0.3 * diagonal) | (grey > 3.0 * diagonal)
    return np.where(odd.any(axis=1, keepdims=True), diagonal, grey)
