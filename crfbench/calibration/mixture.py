"""The posterior with a learned discrepancy: exact for every row of a model's table, every scale and every noise level.

With x = log g at the knots, written in a low-rank basis as x = mu + Psi v, component c of the family (a row of its
table), scale a of the discrepancy, noise level t of the readings and ratio rho of the other errors to it:

    prior   v | c, a ~ N(v_c, a^2 B B')
    data    o_ep = x(b_ep) - u_p - s_e + noise,   noise ~ N(0, t^2 (slope^2 sigma_b^2 + fine^2) / weight)
            u_p ~ N(0, (rho t)^2 error_p^2),      s_e ~ N(0, (rho t)^2 sigma_e^2) or unknown

o is what reference and exposure tell. With P the precision of o after u and s are eliminated, G the basis at the
readings and y = o - mu(b): A = G'PG, h = G'Py, B'AB = U diag(l) U', and for k = a / t

    -2 log p(o | c, a, t, rho) = 2 nu log t + log|S| + sum_i log(1 + k^2 l_i)
                                 + (R_c - sum_i k^2 y_ci^2 / (1 + k^2 l_i)) / t^2
    R_c = y'Py - 2 v_c'h + v_c'A v_c,   y_c = U'B'(h - A v_c)
    z_i | ...  ~  N(k^2 y_ci / (1 + k^2 l_i), a^2 / (1 + k^2 l_i)),   v = v_c + B U z

One Gram matrix and one eigenbasis for each ratio serve all components, scales and noise levels.

Two things hold for every camera, whatever its family: white is all the light, which components and B are conditioned on
beforehand, and below white there is less, by which every term is weighed afterwards.

Channels of one camera share v: channel c has v + H_c1 F w_1 + H_c2 F w_2 in its place, with H the orthonormal contrasts
of red, green and blue, F what channels differ by and w ~ N(0, (a q)^2 I). The state is then (v, w_1, w_2), and the Gram
matrices of the channels add up.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.special import log_ndtr, logsumexp

from crfbench.calibration.observations import UNKNOWN, Observations
from crfbench.calibration.posterior import Noise, Posterior, PosteriorSamples, degrees, log_offset, told_by_clipping
from crfbench.calibration.table import BAND_SAMPLES, N_NEARBY, Table, chunks, learned_prior, minimise, rows_near
from crfbench.curves import Array
from crfbench.errors import InputError
from crfbench.models import ResponseModel
from crfbench.models.base import SCALES, Discrepancy, at_knots, between_knots, from_knots

Indices = NDArray[np.intp]

# Chosen by held-out DoRF curves: the standard deviation of log irradiance with which white is told, and the knots, at
# brightness 0.86 and 0.93, that are told to have less.
_WHITE, _BELOW_WHITE = 0.06, (50, 54)
_RANK = 24  # of the basis; what is finer is `Noise.fine`
_POWER = 0.001  # relative standard deviation of the power that exposures tell
_SCATTERED = 3.0  # level of noise, or of errors, from which on references are thought to tell it as well
_MOST_STRETCH = 0.1
_APART, _APART_WITH_RAW = 0.08, 0.02  # colour at which a patch counts half, where RAW tells the others well less
_STEP = 4  # rows
# Standard deviation, in log, of the last step to white, where no reading lies and only known irradiances would tell it:
# so that 90 % of DoRF curves step by no more than a normal distribution lets expect.
_WHITE_STEP = 0.016
_TERMS = 256  # of the mixture that are kept for each set

# By what the data may scale the noise of readings, and the other errors over it; both log-normal.
_LEVELS: Array = np.array([0.25, 0.5, 1.0, 2.0, 4.0])
_RATIOS: Array = np.array([0.5, 1.0, 2.0, 4.0])
_LEVEL_MEAN, _LEVEL_SD, _SCALE_SD = 0.35, 0.9, 0.4


def typical_slope(brightness: Array) -> Array:
    """Return d log g / d log b of the mean measured response, for the noise of a reading.

    It is the same for every model, so that their evidence can be compared.
    """
    return 0.21 + 0.57 * brightness / (brightness + 0.036) + 0.32 / (1.057 - brightness)


@cache
def _level_weights() -> Array:
    """Return the log prior over (ratios, levels)."""
    level, scale = np.log(_LEVELS), np.log(_LEVELS) + np.log(_RATIOS)[:, None]
    logs = -0.5 * ((level - np.log(_LEVEL_MEAN)) / _LEVEL_SD) ** 2 - 0.5 * (scale / _SCALE_SD) ** 2
    return np.asarray(logs - logsumexp(logs))


# Contrasts of red, green and blue: orthonormal, and each sums to 0, so that the shared curve is the mean.
CONTRASTS: Array = np.array([(1, 1), (-1, 1), (0, -2)]) / np.sqrt([2, 6])
_DIRECTIONS = 4


class Family(NamedTuple):
    """Components in a low-rank basis, and the discrepancy about each."""

    mean: Array  # shape (64,); log irradiance at the knots
    basis: Array  # shape (64, r)
    components: Array  # shape (1 or n, c, r)
    log_weight: Array  # shape (1 or n, c)
    scale_weight: Array  # shape (a,)
    factors: Array  # shape (q, s, s); B, or with channels diag(B, q I) for every scale q of their difference
    channel_weight: Array  # shape (q,)
    maps: Array  # shape (channels, r, s); from the state to each channel's v

    @classmethod
    def of(cls, logs: Array, log_weight: Array, discrepancy: Discrepancy) -> "Family":
        """Find the basis that holds components (c, 64), of log weights (c,), and a discrepancy best."""
        logs, kernel = _with_white(logs, discrepancy.kernel())
        weight = np.exp(log_weight - logsumexp(log_weight))
        mean = weight @ logs
        spread = (logs - mean).T @ (weight[:, None] * (logs - mean)) + kernel
        basis = np.linalg.eigh(spread)[1][:, ::-1][:, :_RANK]
        values, vectors = np.linalg.eigh(basis.T @ kernel @ basis)
        factor = vectors * np.sqrt(np.maximum(values, 0.0))
        components, alone = ((logs - mean) @ basis)[None], np.eye(basis.shape[1])[None]
        weights = discrepancy.scale_weight, factor[None], np.ones(1)
        return cls(mean, basis, components, log_weight[None], *weights, alone)

    def with_channels(self, difference: Discrepancy) -> "Family":
        """Return the family of three channels that differ so; sets of observations are then theirs, in turn."""
        project = self.basis.T @ difference.factor[:, -_DIRECTIONS:]
        eye, more = np.eye(len(project)), 2 * _DIRECTIONS
        maps = np.stack([np.hstack([eye, *(h * project for h in contrast)]) for contrast in CONTRASTS])
        factors = np.stack([block_diag(self.factors[0], scale * np.eye(more)) for scale in SCALES])
        components = np.pad(self.components, [(0, 0), (0, 0), (0, more)])
        return self._replace(components=components, factors=factors, channel_weight=difference.scale_weight, maps=maps)


def _with_white(logs: Array, kernel: Array) -> tuple[Array, Array]:
    """Condition components (c, 64) and kernel on what holds for every camera: white is all the light."""
    gain = kernel[-1] / (kernel[-1, -1] + _WHITE**2)
    return logs - logs[:, -1:] * gain, kernel - gain[:, None] * kernel[-1]


class _Eliminated(NamedTuple):
    """What the data say in the basis for one ratio, and how the unknowns follow from it; m cameras of n sets."""

    a: Array  # shape (m, s, s)
    h: Array  # shape (m, s)
    square: Array  # shape (m,)
    log_det: Array  # shape (m,)
    exposures: Array  # shape (n, e, r + 1)
    references: Array  # shape (n, p, r + 1)
    share: Array  # shape (n, p); variance that is left of each reference's error, but for what ties them:
    tie: Array  # shape (n, p); the covariance of their errors is diag(share) less its outer product
    own: Array  # shape (n, e, e); precision of the exposures

    def left(self, precision: Array, sets: Indices, e: int, p: Indices) -> Array:
        """Return the variance that is left of exposure and reference together, of one patch of some sets."""
        share, tie, w = self.share[sets, p], self.tie[sets, p], precision[sets]
        along = tie[:, None] * (w @ self.tie[sets, :, None])[..., 0] - share[:, None] * precision[sets, :, p]
        along[:, e] += 1.0
        solved = np.linalg.solve(self.own[sets], along[..., None])[..., 0]
        return np.asarray(share - tie**2 + (along * solved).sum(axis=1))


class Readings:
    """Observations in a basis, with references and exposures eliminated."""

    def __init__(self, observations: Observations, noise: Noise, family: Family, tied: bool = False) -> None:
        b = observations.brightness
        self.observations, self.noise, self.maps = observations, noise, family.maps
        self.reference_power = self._reference_power() if tied else np.zeros_like(b[:, 0])
        self.independent = b.shape[1] ** (noise.repeats - 1.0)
        # The channels of a coloured patch bend apart, and in each photograph otherwise.
        apart = observations.colour / (_APART_WITH_RAW if observations.absolute else _APART)
        self.weights = observations.weights * self.independent / (1.0 + apart[:, None] ** 2)
        self.columns = between_knots(np.concatenate([family.basis, family.mean[:, None]], axis=1), b)
        stretched = (log_offset(observations) - observations.colour[:, None]) * self._stretch()[:, None, None]
        self.columns[..., -1] = stretched - self.columns[..., -1]
        steep = typical_slope(b)
        read = (steep * noise.brightness / np.maximum(b, 1 / 255)) ** 2
        self.variance = read + noise.fine**2
        counted = observations.counts * self.weights
        self.precision = counted / self.variance
        # What no ratio changes: sums over photographs and over patches, and Gram matrices.
        self.by_patch = np.einsum("nep,nepk->npk", self.precision, self.columns)
        self.by_photograph = np.einsum("nep,nepk->nek", self.precision, self.columns)
        flat = (np.sqrt(self.precision)[..., None] * self.columns).reshape(len(b), -1, self.columns.shape[-1])
        self.gram = np.swapaxes(flat, 1, 2) @ flat
        self.freedom = np.maximum(degrees(observations) * self.independent, 1.0)
        # The density of a brightness is that of log irradiance times the slope, where the noise is the brightness's.
        share = self.freedom / counted.sum(axis=(1, 2))
        steepness = (counted * np.log(steep) * read / self.variance).sum(axis=(1, 2)) * share
        self.constant = steepness - 0.5 * (counted * np.log(self.variance)).sum(axis=(1, 2))

    def _stretch(self) -> Array:
        """Return by how much references and exposures are stretched in log, (n,), against errors in variables.

        A power 1 - d of curve, references and exposures together would shrink the noise of the readings with them, so
        that a normal distribution of log irradiance prefers d > 0. In brightness, where the noise belongs, each free
        reading takes the factor 1 - d back, which moves d by their number times its variance.
        """
        o, counts = self.observations, self.observations.counts
        seen, known = counts.any(axis=1), np.zeros(len(counts))
        if o.reference is not None:
            weight, logs = seen / o.reference_error**2, np.log(o.reference)
            mean = (weight * logs).sum(axis=1, keepdims=True) / weight.sum(axis=1, keepdims=True)
            known += (weight * (logs - mean) ** 2).sum(axis=1)
        known += self.reference_power.any(axis=1) * _POWER**-2
        if o.exposures is not None:
            known += _POWER**-2
        scales = counts.any(axis=2).sum(axis=1) if o.exposures is None else 0
        share = (counts * self.weights).sum(axis=(1, 2)) / counts.sum(axis=(1, 2))
        free = np.maximum(counts.sum(axis=(1, 2)) - seen.sum(axis=1) - scales, 0) * share
        return np.asarray(1.0 + np.minimum(free / np.maximum(known, 1.0), _MOST_STRETCH))

    def exposure_prior(self, ratio: float) -> Array:
        """Return the precision of the exposures before any data, (n or 1, e, e).

        Errors of exposures that grow with the exposure are a power of the curve, which the noise of the readings would
        shrink without end (errors in variables): so the power is known to `_POWER` by itself.
        """
        o = self.observations
        prior = o.exposure_precision(ratio * self.noise.exposure)
        if o.exposures is None or len(prior) == 1:
            return prior[None]
        trend = o.exposures - o.exposures.mean(axis=1, keepdims=True)
        along = trend / np.maximum(np.sqrt((trend**2).sum(axis=1, keepdims=True)), 1e-6)
        power = np.maximum((trend**2).sum(axis=1) * np.log(2) ** 2, 1e-12) * _POWER**2
        return np.asarray(prior + along[:, :, None] * along[:, None] / power[:, None, None])

    def _reference_power(self) -> Array:
        """Return t (n, p), with which the precision of the references' errors e is diag(1 / e^2) + t t^T.

        Errors that grow with log r, of the references r, are a power of the curve too, see `exposure_prior`. With x =
        log r - mean(log r) and t = x / (x^T x `_POWER`) that power is known to `_POWER`.
        """
        known = np.asarray(self.observations.reference)
        logs = np.ma.array(np.log(known), mask=~self.observations.counts.any(axis=1))
        trend = (logs - logs.mean(axis=1, keepdims=True)).filled(0.0)
        return np.asarray(trend / np.maximum((trend**2).sum(axis=1, keepdims=True), 1e-12) / _POWER)

    def eliminate(self, ratio: float) -> _Eliminated:
        """Eliminate references, then exposures; see `crfbench.calibration.posterior.Likelihood`."""
        w, by_patch = self.precision, self.by_patch
        n, e, p = w.shape
        k = by_patch.shape[-1]
        error = ratio * self.observations.reference_error
        errors = error**2 if self.observations.reference is not None else np.full((n, p), UNKNOWN**2)
        prior = self.exposure_prior(ratio)
        share = 1.0 / (w.sum(axis=1) + 1.0 / errors)
        along = self.reference_power
        tied = 1.0 + (share * along**2).sum(axis=1)
        tie = share * along / np.sqrt(tied)[:, None]
        crossed, w_tied, h_tied = w * share[:, None], w @ tie[..., None], tie[:, None] @ by_patch
        own = np.eye(e) * w.sum(axis=2)[:, None] - crossed @ np.swapaxes(w, 1, 2) + prior
        own += w_tied @ np.swapaxes(w_tied, 1, 2)
        h = self.by_photograph - crossed @ by_patch + w_tied @ h_tied
        exposures = np.linalg.solve(own, h)
        scaled = np.sqrt(share)[..., None] * by_patch
        gram = self.gram - np.swapaxes(scaled, 1, 2) @ scaled + np.swapaxes(h_tied, 1, 2) @ h_tied
        gram -= np.swapaxes(h, 1, 2) @ exposures
        log_det = np.log(errors / share).sum(axis=1) + np.linalg.slogdet(own)[1] - np.linalg.slogdet(prior)[1]
        log_det += np.log(tied / (1.0 + (errors * along**2).sum(axis=1)))
        left = by_patch - np.swapaxes(w, 1, 2) @ exposures
        references = share[..., None] * left - tie[..., None] * (tie[:, None] @ left)
        a, maps = gram[:, :-1, :-1].reshape(-1, len(self.maps), k - 1, k - 1), self.maps
        coupled = (np.swapaxes(maps, 1, 2) @ a @ maps).sum(axis=1)
        h_coupled = np.einsum("mcr,crs->ms", gram[:, :-1, -1].reshape(a.shape[:3]), maps)
        square = self.by_camera(np.maximum(gram[:, -1, -1], 0.0))
        return _Eliminated(coupled, h_coupled, square, self.by_camera(log_det), exposures, references, share, tie, own)

    def by_camera(self, values: Array) -> Array:
        """Sum over the channels of each camera, (n,) to (m,)."""
        return np.asarray(values.reshape(-1, len(self.maps)).sum(axis=1))

    def told(self) -> list[tuple[int, Indices, Any, float]]:
        """Return the clipped patches that say most: of each photograph the dimmest white and the brightest black one.

        As photograph, patch (n,), in which sets there is one (n,), and 1 for white, -1 for black.
        """
        o, counts, told = self.observations, self.observations.counts, told_by_clipping(self.observations)
        light = o.reference
        if light is None:
            light = np.where(counts, o.brightness, 0).sum(axis=1) / np.maximum(counts.sum(axis=1), 1)
        found = []
        for e in range(o.brightness.shape[1]):
            for sign, side in ((1.0, o.brightness[:, e] > 0.5), (-1.0, o.brightness[:, e] <= 0.5)):
                use = told[:, e] & side
                if use.any():
                    found.append((e, np.where(use, sign * light, np.inf).argmin(axis=1), use.any(axis=1), sign))
        return found


class _Solved(NamedTuple):
    """The posterior in the eigenbasis of every ratio with every scale of channels; m cameras, j of these."""

    values: Array  # shape (m, j, s); l
    vectors: Array  # shape (m, j, s, s); U
    y: Array  # shape (m, j, s, c)
    square: Array  # shape (m, j, c); R
    log_det: Array  # shape (m, j)

    @classmethod
    def of(cls, found: list[_Eliminated], family: Family) -> "_Solved":
        """Diagonalise what the data say for each ratio."""
        a, h, square, log_det = (np.stack([each[i] for each in found], axis=1) for i in range(4))
        factors, v = family.factors, np.swapaxes(family.components, 1, 2)[:, None]
        left = h[..., None] - a @ v
        square = np.maximum(square[..., None] - (v * (h[..., None] + left)).sum(axis=2), 0.0)
        values, vectors = np.linalg.eigh(np.swapaxes(factors, 1, 2) @ a[:, :, None] @ factors)
        y = np.swapaxes(factors @ vectors, 3, 4) @ left[:, :, None]
        parts = (each.reshape(len(a), -1, *each.shape[3:]) for each in (np.maximum(values, 0.0), vectors, y))
        return cls(*parts, *(np.repeat(each, len(factors), axis=1) for each in (square, log_det)))

    def log_probability(self, readings: Readings) -> Array:
        """Return the log likelihood of every term, (m, j, levels, scales, components)."""
        # Many scales and levels have the same quotient: what depends on it alone is computed once.
        k2, which = np.unique((SCALES / _LEVELS[:, None]) ** 2, return_inverse=True)
        which = which.reshape(len(_LEVELS), len(SCALES))
        spread = 1.0 + k2[:, None] * self.values[:, :, None]
        left = self.square[:, :, None] - (k2[:, None] / spread) @ self.y**2
        logs = left[:, :, which]
        logs *= -0.5 / _LEVELS[:, None, None] ** 2
        constant = readings.by_camera(readings.constant)[:, None] - 0.5 * self.log_det
        each = constant[..., None] - readings.by_camera(readings.freedom)[:, None, None] * np.log(_LEVELS)
        logs += (each[..., None] - 0.5 * np.log(spread).sum(axis=3)[:, :, which])[..., None]
        return np.asarray(logs)


@dataclass(frozen=True)
class Mixture:
    """The posterior of log irradiance at the knots, for m cameras of n sets: terms, each a normal distribution."""

    family: Family
    unconstrained: Array  # shape (1 or m, c, k); parameters of the components
    best: Array  # shape (m, k); those of the component that is most probable
    which: tuple[Indices, ...]  # ratio with scale of channels, level, scale and component of each term, (m, t) each
    z: Array  # shape (m, t, s); mean of the discrepancy in the coordinates of `root`
    deviation: Array  # shape (m, t, s); its standard deviation
    vectors: Array  # shape (m, ratios x q, s, s); U
    weight: Array  # shape (m, t); by clipped patches
    log_evidence: Array  # shape (m,)

    @property
    def root(self) -> Array:
        """Return B U, the coordinates of `z` in the basis, shape (m, ratios x q, s, s)."""
        return np.asarray(np.tile(self.family.factors, (len(_RATIOS), 1, 1)) @ self.vectors)

    @property
    def noise_level(self) -> Array:
        """By which factor the data scale the stated noise, of readings or of the rest, whichever is more, (m,)."""
        ratio = _RATIOS[self.which[0] // len(self.family.factors)]
        scale = _LEVELS[self.which[1]] * np.maximum(ratio, 1.0)
        return np.asarray(np.exp((self.weight * np.log(scale)).sum(axis=1)))

    def replaced(self, rows: Indices, other: "Mixture") -> "Mixture":
        """Return the mixture with what another says of some cameras, in its order."""

        def put(whole: NDArray[Any], part: NDArray[Any]) -> NDArray[Any]:
            whole = whole.copy()
            whole[rows] = part
            return whole

        names = ("best", "z", "deviation", "vectors", "weight", "log_evidence")
        arrays: dict[str, Any] = {name: put(getattr(self, name), getattr(other, name)) for name in names}
        return replace(self, which=tuple(map(put, self.which, other.which)), **arrays)

    def middle(self) -> Array:
        """Return the median of log irradiance at the knots, (n, 64), of the most probable curves of some terms."""
        chosen = self._even(_TERMS // 4)
        logs = self._at_knots(chosen.of_terms(self.family.components) + chosen._state(chosen.z))
        return np.minimum(np.median(np.sort(logs, axis=2), axis=1), 0.0)

    def draw(self, seed: int, white: float) -> PosteriorSamples:
        """Draw rising curves, all equally likely, whose last step to white errs by the standard deviation `white`.

        Rising by rearrangement, which brings every curve, mean and band nearer to any rising truth (Chernozhukov,
        Fernandez-Val and Galichon 2009, doi:10.1093/biomet/asp030).
        """
        chosen = self._even(_TERMS // 2)
        rng = np.random.default_rng(seed)
        normal = rng.standard_normal(chosen.z.shape[1:])
        centre = chosen.of_terms(self.family.components) + chosen._state(chosen.z)
        # Turned into the eigenvectors, so that their signs, which rounding may change, do not matter.
        off = chosen._state(chosen.deviation * chosen._turned(normal, np.swapaxes(self.vectors, 2, 3)))
        # Each draw with its mirror image: the mean of the draws is then that of the terms.
        logs = self._at_knots(np.concatenate([centre + off, centre - off], axis=1))
        step = white * rng.standard_normal(len(normal))
        logs[..., :-1] += np.concatenate([step, -step])[:, None]
        logs = np.minimum(np.sort(logs, axis=2), 0.0)
        curves = from_knots(logs.astype(np.float32))
        order = np.argsort(np.swapaxes(curves[:, :, BAND_SAMPLES], 1, 2), axis=2)
        channels = len(self.family.maps)
        z = np.repeat(np.concatenate([chosen.of_terms(self.unconstrained)] * 2, axis=1), channels, axis=0)
        evidence = np.repeat(self.log_evidence, channels)
        return PosteriorSamples(z, curves, order, np.full(z.shape[:2], 1.0 / z.shape[1]), evidence)

    def of_terms(self, components: Array) -> Array:
        """Return what belongs to the component of each term, (1 or m, c, k) to (m, t, k)."""
        sets = np.arange(len(self.z))[:, None] if len(components) > 1 else 0
        return np.asarray(components[sets, self.which[3]])

    def _state(self, z: Array) -> Array:
        """Return the state of discrepancies (m, t, s) in the coordinates of `root`."""
        return self._turned(z, self.root)

    def _turned(self, z: Array, matrices: Array) -> Array:
        """Return vectors (m or 1, t, s) times the matrix (m, ratios x q, s, s) of each term, (m, t, s)."""
        out = np.zeros((*self.which[0].shape, z.shape[-1]))
        for j in np.unique(self.which[0]):
            out += ((self.which[0] == j)[..., None] * z) @ np.swapaxes(matrices[:, j], 1, 2)
        return out

    def _at_knots(self, state: Array) -> Array:
        """Return log irradiance at the knots of the channels of states (m, t, s), (n, t, 64)."""
        logs = state[:, None] @ np.swapaxes(self.family.basis @ self.family.maps, 1, 2) + self.family.mean
        return logs.reshape(-1, *logs.shape[2:])

    def _even(self, count: int) -> "Mixture":
        """Return so many terms in proportion to their weight, all alike then; only for drawing."""
        at, rows = (np.arange(count) + 0.5) / count, np.arange(len(self.z))[:, None]
        pick = np.stack([np.searchsorted(row, at * row[-1]) for row in np.cumsum(self.weight, axis=1)])
        which = tuple(index[rows, pick] for index in self.which)
        return replace(self, which=which, z=self.z[rows, pick], deviation=self.deviation[rows, pick])


def marginalised(
    model: ResponseModel,
    observations: Observations,
    noise: Noise,
    table: Table,
    seed: int,
    with_samples: bool,
    difference: Discrepancy | None,
) -> tuple[Array, Array, Array, PosteriorSamples | None]:
    """Return what a model with prior and discrepancy makes of `n` sets of observations.

    The unconstrained parameters of the most probable component (n, k), the curves (n, 1024), by which factor the data
    scale the noise of readings (n,), and samples, if asked for. With a `difference`, sets are the channels of cameras.
    """
    if model.discrepancy_ is None:
        raise InputError(f"{model!r} has no discrepancy; use learn_discrepancy(model, curves) or discrepancy=False")
    # Between the rows of one parameter the discrepancy reaches, so that a quarter of them will do.
    step = slice(None, None, _STEP if model.n_params == 1 else None)
    logs, log_weight = table.at_knots[step], table.log_prior[step]
    family = Family.of(logs, log_weight - logsumexp(log_weight), model.discrepancy_)
    near = model.n_params > 1 and learned_prior(model).centres is None
    rows = len(logs) + (N_NEARBY if near else 0)
    channels = 1 if difference is None else 3
    nearest = _most_probable(model, observations.of_sets(slice(None, None, channels)), noise, table) if near else None

    def found(cameras: slice) -> list[Array]:
        some = observations.of_sets(slice(cameras.start * channels, cameras.stop * channels))
        z, own = table.unconstrained[None, step], family
        if nearest is not None:
            z, own = _with_near_rows(model, nearest[cameras], table, family, seed)
        own = own if difference is None else own.with_channels(difference)
        mixture = solve(some, noise, own, z)
        wide = np.flatnonzero(mixture.noise_level > _SCATTERED)
        if some.reference is not None and not some.absolute and wide.size:
            sets = (channels * wide[:, None] + np.arange(channels)).ravel()
            parts = (each[wide] if len(each) > 1 else each for each in (own.components, own.log_weight, z))
            components, log_weight, z = parts
            own = own._replace(components=components, log_weight=log_weight)
            mixture = mixture.replaced(wide, solve(some.of_sets(sets), noise, own, z, tied=True))
        each = [np.repeat(a, channels, axis=0) for a in (mixture.best, mixture.noise_level)]
        if not with_samples:
            return [*each, from_knots(mixture.middle())]
        samples = mixture.draw(seed, 0.0 if some.absolute else _WHITE_STEP)
        return [*each, samples.quantiles((0.5,))[0], *vars(samples).values()]

    parts = chunks(len(observations) // channels, len(_RATIOS) * len(_LEVELS) * len(SCALES) * rows)
    best, scale, curves, *drawn = _joined(len(observations), map(found, parts))
    return best, curves, scale, PosteriorSamples(*drawn) if with_samples else None


def _joined(n: int, parts: Iterable[list[Array]]) -> list[Array]:
    """Join the arrays of parts along their first axis, of length `n`, with no more than one part in memory beside."""
    joined: list[Array] = []
    at = 0
    for part in parts:
        joined = joined or [np.empty((n, *each.shape[1:]), each.dtype) for each in part]
        for whole, each in zip(joined, part, strict=True):
            whole[at : at + len(each)] = each
        at += len(part[0])
    return joined


def _most_probable(model: ResponseModel, observations: Observations, noise: Noise, table: Table) -> Array:
    """Return the most probable parameters of the family alone, shape (n, k)."""
    posterior = Posterior(observations, noise)
    return minimise(posterior.objective(model), table, -(posterior.log_likelihood_on(table) + table.log_prior))


def _with_near_rows(model: ResponseModel, best: Array, table: Table, family: Family, seed: int) -> tuple[Array, Family]:
    """Add rows near the most probable parameters (n, k), which the table's few rows miss where data say much."""
    z, near, log_weight = rows_near(model, table, best, seed)
    logs = np.broadcast_to(table.at_knots, (len(best), *table.at_knots.shape))
    logs = np.concatenate([logs, at_knots(np.clip(near, 0.0, 1.0))], axis=1)
    return z, family._replace(components=(logs - family.mean) @ family.basis, log_weight=log_weight)


def solve(
    observations: Observations,
    noise: Noise,
    family: Family,
    unconstrained: Array,
    tied: bool = False,
) -> Mixture:
    """Return the posterior of every set of observations; components have those parameters (1 or m, c, k).

    Where they are `tied`, references tell the power of the curve as surely as exposures do. Where many readings scatter
    widely, a flat curve would else make their scatter small, and errors that grow with the references account for it.
    """
    readings = Readings(observations, noise, family, tied)
    found = [readings.eliminate(ratio) for ratio in _RATIOS]
    solved = _Solved.of(found, family)
    logs = solved.log_probability(readings)
    prior = _level_weights()[:, None] + np.log(family.channel_weight)[:, None]
    logs += prior.reshape(-1, len(_LEVELS))[..., None, None]
    logs += np.log(family.scale_weight)[:, None] + family.log_weight[:, None, None, None]
    mixture = _terms(logs, solved, family, unconstrained)
    for patch in readings.told():
        for channel in range(len(family.maps)):
            mixture = _with_clipped(mixture, readings, found, patch, channel)
    for knot in _BELOW_WHITE:
        for channel in range(len(family.maps)):
            mixture = _with_less_than_all(mixture, knot, channel)
    total = mixture.weight.sum(axis=1)
    evidence = mixture.log_evidence + np.log(total)
    return replace(mixture, weight=mixture.weight / total[:, None], log_evidence=evidence)


def _terms(logs: Array, solved: _Solved, family: Family, unconstrained: Array) -> Mixture:
    """Take terms in proportion to their probability (systematic resampling), with their moments."""
    flat, rows = logs.reshape(len(logs), -1), np.arange(len(logs))[:, None]
    most = flat.max(axis=1)
    share = np.exp(flat - most[:, None])
    total = np.cumsum(share, axis=1)
    likeliest = share.reshape(len(logs), -1, logs.shape[-1]).sum(axis=1).argmax(axis=1)
    best = unconstrained[np.arange(len(logs)) if len(unconstrained) > 1 else 0, likeliest]
    at = (np.arange(_TERMS) + 0.5) / _TERMS
    chosen = np.stack([np.searchsorted(row, at * row[-1]) for row in total])
    j, t, a, c = np.unravel_index(chosen, logs.shape[1:])
    k = (SCALES[a] / _LEVELS[t])[..., None]
    spread = 1.0 + k**2 * solved.values[rows, j]
    z, deviation = k**2 * solved.y[rows, j, :, c] / spread, SCALES[a][..., None] / np.sqrt(spread)
    even = np.full(chosen.shape, 1.0 / _TERMS)
    return Mixture(
        family, unconstrained, best, (j, t, a, c), z, deviation, solved.vectors, even, most + np.log(total[:, -1])
    )


def _with_clipped(
    mixture: Mixture,
    readings: Readings,
    found: list[_Eliminated],
    patch: tuple[int, Indices, NDArray[np.bool_], float],
    channel: int,
) -> Mixture:
    """Weigh every term by the probability that a clipped patch is clipped, and move its mean to where it is."""
    e, p, told, sign = patch
    sets = np.arange(channel, len(p), len(readings.maps))
    p, told, (j, t) = p[sets], told[sets], mixture.which[:2]
    own = readings.columns[sets, e, p]
    line = np.stack([own - f.exposures[sets, e] - f.references[sets, p] for f in found], axis=1)
    spread = [f.left(readings.precision, sets, e, p) for f in found]
    noise = readings.variance[sets, e, p][:, None] + np.stack(spread, axis=1)
    scales, rows = len(mixture.family.factors), np.arange(len(sets))[:, None]
    state = np.repeat(line[..., :-1] @ readings.maps[channel], scales, axis=1)
    line, noise = np.repeat(line[..., -1], scales, axis=1), np.repeat(noise, scales, axis=1)
    return _censored(mixture, state, line[rows, j], _LEVELS[t] ** 2 * noise[rows, j], told, sign)


def _with_less_than_all(mixture: Mixture, knot: int, channel: int) -> Mixture:
    """Weigh every term by the probability that the irradiance at a knot is less than that of white, and move it."""
    family, (m, j, s, _) = mixture.family, mixture.vectors.shape
    state = np.broadcast_to(family.basis[knot] @ family.maps[channel], (m, j, s))
    line = np.full_like(mixture.weight, -family.mean[knot])
    return _censored(mixture, state, line, np.full_like(line, 1e-9), np.ones(m, dtype=bool), 1.0)


def _censored(
    mixture: Mixture, state: Array, line: Array, noise: Array, told: NDArray[np.bool_], sign: float
) -> Mixture:
    """Weigh terms by the probability that what the state (m, ratios x q, s) tells, with noise (m, t), is below a line.

    Or above it, where the `sign` is -1; only the sets that are `told` (m,).
    """
    rows, j = np.arange(len(told))[:, None], mixture.which[0]
    here = (state[:, :, None] @ mixture.root)[:, :, 0][rows, j]
    spanned = mixture.deviation**2 * here
    total = np.sqrt(noise + (spanned * here).sum(axis=2))
    centre = (state @ np.swapaxes(mixture.family.components, 1, 2))[rows, j, mixture.which[3]]
    margin = sign * (line - centre - (here * mixture.z).sum(axis=2)) / total
    log_p = log_ndtr(margin)
    # phi / Phi, the slope of log Phi, in logarithms because both vanish far out.
    mills = np.exp(np.clip(-0.5 * margin**2 - 0.5 * np.log(2 * np.pi) - log_p, -50, 50))
    z = mixture.z - (told[:, None] * sign * mills / total)[..., None] * spanned
    weight = np.where(told[:, None], mixture.weight * np.exp(log_p), mixture.weight)
    return replace(mixture, z=z, weight=np.maximum(weight, 1e-300))
