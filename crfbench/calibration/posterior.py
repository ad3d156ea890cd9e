"""The posterior: likelihood in log irradiance times the model's prior, its samples, and the bands that they give."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp, softmax

from crfbench.calibration.observations import UNKNOWN, Observations
from crfbench.calibration.table import BAND_SAMPLES, Table, chunks, evaluate_with_gradient, learned_prior
from crfbench.checks import check_number
from crfbench.curves import GRID, Array, evaluate
from crfbench.models import ResponseModel
from crfbench.numerics import Objective

DARKEST = 1e-4  # irradiance below which the logarithm is held

_GAMMA = 2.2  # slope of log irradiance over log brightness, of a typical response
_LEAST = 1e-6  # standard deviation; sums over known and unknown lose no digits that count
_SHARPEST = 1e8  # precision of one log irradiance, for the same reason

Sets = np.ndarray | slice


@dataclass(frozen=True)
class Noise:
    """What is not exact, as standard deviations."""

    # of a patch's brightness, in units of the full range; a share 2.2 `brightness` / b of the irradiance
    brightness: float = 0.02
    exposure: float = 0.1  # of each known exposure, in stops
    # the share of the observations that count as independent. How a model misses a real curve varies slowly along it,
    # so that neighbours repeat each other; by default four photographs of one chart count as one
    independent: float = 0.25
    # degrees of freedom with which these figures are believed; the data may scale all of them together
    freedom: float = 2.0
    # of log irradiance at each reading, of what is too fine for a discrepancy
    fine: float = 0.03
    # the power of the number of photographs of one scene that count as independent, beside a discrepancy: light, dirt,
    # glare and how a curve is missed are much the same in all of them; so four count as two, and with 1 all count
    repeats: float = 0.5

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check_number(f"noise {name}", value, _LEAST, 1.0 if name == "repeats" else 1 / _LEAST)

    def relative(self, brightness: Array) -> Array:
        """Return the relative standard deviation of the irradiance that the brightness of a patch tells."""
        return _GAMMA * self.brightness / np.maximum(brightness, 1 / 255)


class Likelihood:
    """The likelihood of `n` sets of observations.

    The methods take arrays (m, e, p, k) for some of the sets, `sets`: k curves, or a residual and its derivatives.
    """

    def __init__(self, observations: Observations, noise: Noise) -> None:
        counts = observations.counts
        self.variance = noise.relative(observations.brightness) ** 2
        self.precision = counts * np.minimum(observations.weights / self.variance, _SHARPEST)
        known = observations.reference is not None
        self.error = np.clip(observations.reference_error, _LEAST, UNKNOWN) if known else UNKNOWN
        self.offset = log_offset(observations)
        # Variance that is left of each patch's reference error u_p once its photographs have been seen.
        self._share = 1.0 / (self.precision.sum(axis=1) + np.broadcast_to(self.error, self.precision[:, 0].shape) ** -2)
        self._prior = observations.exposure_precision(noise.exposure)
        weighted = self.precision * self._share[:, None]
        own = np.eye(len(self._prior)) * self.precision.sum(axis=2)[:, None] - weighted @ np.swapaxes(
            self.precision, 1, 2
        )
        self._inverse = np.linalg.inv(own + self._prior)
        self.freedom = np.maximum(degrees(observations), 1.0)

        sigmas = np.sqrt(self.variance + np.broadcast_to(self.error, self._share.shape)[:, None] ** 2)
        side = np.where(observations.brightness > 0.5, 1.0, -1.0)
        self.clip = np.where(told_by_clipping(observations), side / sigmas, 0.0)

    def residual(self, g: Array, sets: Sets) -> Array:
        """Return log g minus the log irradiance that reference and exposure tell, for g of shape (m, e, p, k)."""
        return np.log(np.maximum(g, DARKEST)) - self.offset[sets][..., None]

    def squares(self, d: Array, sets: Sets) -> tuple[Array, Array]:
        """Return d^T M d, shape (m, k), and the exposures (m, e, k) of residuals (m, e, p, k).

        M is the precision of the residuals after the unknowns are eliminated.
        """
        w = self.precision[sets]
        weighted = w[..., None] * d
        by_patch = weighted.sum(axis=1)
        total = np.einsum("nepk,nepk->nk", weighted, d)
        total -= np.einsum("npk,np,npk->nk", by_patch, self._share[sets], by_patch)
        h = weighted.sum(axis=2) - w @ (self._share[sets][..., None] * by_patch)
        exposures = self._inverse[sets] @ h
        return np.maximum(total - np.einsum("nek,nek->nk", h, exposures), 0.0), exposures

    def products(self, d: Array, sets: Sets) -> tuple[Array, Array]:
        """Return d^T M d between all columns, shape (m, k, k), and the exposures; see `squares`.

        A sum of squares: slower, but positive and smooth whatever the rounding.
        """
        w = self.precision[sets][..., None]
        exposures = self.squares(d, sets)[1]
        rest = d - exposures[:, :, None]
        errors = self._share[sets][..., None] * (w * rest).sum(axis=1)
        rest -= errors[:, None]
        eliminated = errors / np.broadcast_to(self.error, self._share.shape)[sets][..., None]
        product = np.einsum("mepi,mepj->mij", w * rest, rest) + np.swapaxes(eliminated, 1, 2) @ eliminated
        return product + np.swapaxes(exposures, 1, 2) @ self._prior @ exposures, exposures

    def margins(self, d: Array, exposures: Array, sets: Sets) -> tuple[np.ndarray, Array]:
        """Return by how many standard deviations each clipped patch lies beyond its brightness, shape (c, k).

        Before it, which of the sets each belongs to, shape (c,). The margin is linear in `d`; the probability of what
        was seen is the normal distribution function of it.
        """
        clip = self.clip[sets]
        i, e, p = np.nonzero(clip)
        return i, (exposures[i, e] - d[i, e, p]) * clip[i, e, p][:, None]


def degrees(observations: Observations) -> Array:
    """Count the observations of each set beyond those that the eliminated unknowns take up."""
    counts = observations.counts
    n = (counts * observations.weights).sum(axis=(1, 2))
    scales = counts.any(axis=2).sum(axis=1) if observations.exposures is None else 1 - observations.absolute
    patches = counts.any(axis=1).sum(axis=1) - 1 if observations.reference is None else 0
    return np.asarray(n - scales - patches)


def told_by_clipping(observations: Observations) -> NDArray[np.bool_]:
    """Say which clipped patches tell something, (n, e, p).

    A photograph of unknown exposure that is all clipped does not, nor does a patch of unknown irradiance.
    """
    counts, told = observations.counts, observations.clipped & (observations.weights > 0)
    if observations.exposures is None:
        told = told & counts.any(axis=2, keepdims=True)
    return told if observations.reference is not None else told & counts.any(axis=1, keepdims=True)


def log_offset(observations: Observations) -> Array:
    """Return the log irradiance that reference and exposure tell, shape (n, e, p).

    Unless the reference is absolute it is centred, so that nothing depends on the reference's unit or the zero of the
    exposures.
    """
    offset = np.zeros(observations.brightness.shape)
    if observations.reference is not None:
        offset += np.log(observations.reference)[:, None, :]
    if observations.exposures is not None:
        offset += np.log(2.0) * observations.exposures[:, :, None]
    if observations.absolute:
        return offset
    counts = observations.counts
    return offset - (counts * offset).sum(axis=(1, 2), keepdims=True) / counts.sum(axis=(1, 2), keepdims=True)


_EVERY = slice(None)
_DRAWS = 256  # for each calibration of a model with several parameters
_WIDER = 1.4  # than the curvature at the maximum tells, for draws that are weighted afterwards


class Posterior:
    """The posterior of `n` sets of observations.

    The scale of all the noise is itself uncertain (inverse gamma) and integrated out, which makes Student's t of the
    Gaussian: with S the quadratic form, nu = `noise.freedom` and n the effective number of observations,

        log p = -(n + nu) / 2 log(1 + S / nu) + sum of log Phi(margins of clipped patches) + log prior
    """

    def __init__(self, observations: Observations, noise: Noise) -> None:
        self.observations, self.brightness = observations, observations.brightness
        self.likelihood, self.noise = Likelihood(observations, noise), noise
        self.power = noise.independent * self.likelihood.freedom + noise.freedom

    def log_likelihood(self, irradiance: np.ndarray, sets: slice = _EVERY) -> Array:
        """Return the log likelihood (m, t) of decoded irradiances (m, e, p, t) of some sets of observations."""
        d = self.likelihood.residual(irradiance, sets)
        squares, exposures = self.likelihood.squares(d, sets)
        logs = -0.5 * self.power[sets, None] * np.log1p(self.noise.independent * squares / self.noise.freedom)
        owner, margin = self.likelihood.margins(d, exposures, sets)
        np.add.at(logs, owner, self.noise.independent * log_ndtr(margin))
        return logs

    def log_likelihood_on(self, table: Table) -> Array:
        """Return the log likelihood of every row of a table, shape (n, t)."""
        n, e, p = self.brightness.shape
        parts = chunks(n, e * p * len(table.params))
        return np.concatenate([self.log_likelihood(table.at(self.brightness[sets]), sets) for sets in parts])

    def objective(self, model: ResponseModel) -> Objective:
        """Return minus twice the log posterior of parameters (m, k) for sets of observations (m,)."""
        prior = learned_prior(model)
        precision = np.linalg.inv(prior.covariance)

        def cost(z: Array, sets: np.ndarray) -> tuple[Array, Array, Array]:
            value, curved, gradient = self._data_terms(model, z, sets)
            off = z - prior.mean
            value += np.einsum("mi,ij,mj->m", off, precision, off)
            return value, curved + precision, gradient + off @ precision

        return cost

    def noise_scale(self, model: ResponseModel, z: Array) -> Array:
        """Return by which factor the data scale the stated noise, shape (n,), given parameters (n, k)."""
        g = self.observations.decoded(model.decode(model.from_unconstrained(z)))
        squares, _ = self.likelihood.squares(self.likelihood.residual(g[..., None], _EVERY), _EVERY)
        freedom = self.noise.independent * self.likelihood.freedom
        expected = self.noise.freedom + self.noise.independent * squares[:, 0]
        return np.sqrt(expected / (self.noise.freedom + freedom))

    def _data_terms(self, model: ResponseModel, z: Array, sets: np.ndarray) -> tuple[Array, Array, Array]:
        """Return minus twice the log likelihood, half its curvature and half its gradient."""
        g, slope = evaluate_with_gradient(model, z, self.brightness[sets])
        slope = np.where(g[..., None] > DARKEST, slope / np.maximum(g, DARKEST)[..., None], 0.0)
        # One column is the residual, the others are its derivatives.
        columns = np.concatenate([self.likelihood.residual(g[..., None], sets), slope], axis=3)
        product, exposures = self.likelihood.products(columns, sets)
        squares = product[:, 0, 0]
        # The slope of the logarithm: how much less a residual counts when all of them are large.
        share = self.power[sets] * self.noise.independent / (self.noise.freedom + self.noise.independent * squares)
        value = self.power[sets] * np.log1p(self.noise.independent * squares / self.noise.freedom)
        terms = value, share[:, None, None] * product[:, 1:, 1:], share[:, None] * product[:, 1:, 0]
        return self._add_censored(terms, columns, exposures, sets)

    def _add_censored(
        self, terms: tuple[Array, Array, Array], columns: Array, exposures: Array, sets: np.ndarray
    ) -> tuple[Array, Array, Array]:
        """Add what clipped patches say: only that they lie beyond their brightness."""
        value, curved, gradient = terms
        owner, margin = self.likelihood.margins(columns, exposures, sets)
        if owner.size:
            u, along = margin[:, 0], margin[:, 1:]
            # phi / Phi, the slope of log Phi, in logarithms because both vanish far out.
            mills = np.exp(-0.5 * u**2 - log_ndtr(u)) / np.sqrt(2 * np.pi)
            share = self.noise.independent
            np.add.at(value, owner, -2.0 * share * log_ndtr(u))
            np.add.at(gradient, owner, -share * mills[:, None] * along)
            bend = share * mills * np.maximum(mills + u, 0.0)  # far out, rounding could turn its sign
            np.add.at(curved, owner, bend[:, None, None] * along[:, :, None] * along[:, None, :])
        return value, curved, gradient


@dataclass(frozen=True)
class PosteriorSamples:
    """Weighted curves: one table for all calibrations, or draws for each."""

    unconstrained: Array  # shape (1 or n, t, k)
    curves: np.ndarray  # shape (1 or n, t, 1024)
    # shape (1 or n, 129, t); samples in rising order of irradiance at every eighth brightness; see `BAND_SAMPLES`
    order: np.ndarray
    weights: Array  # shape (n, t); they sum to 1
    log_evidence: Array  # shape (n,); log of the likelihood averaged over the prior

    def mean(self) -> Array:
        """Return the mean curves, shape (n, 1024)."""
        if len(self.curves) == 1:
            return np.asarray(self.weights @ self.curves[0].astype(np.float64))
        return np.einsum("nt,nts->ns", self.weights, self.curves)

    def quantiles(self, levels: tuple[float, ...]) -> list[Array]:
        """Return for each level the curves (n, 1024) that this share of the weight lies at or below."""
        parts = chunks(len(self.weights), self.order[0].size)
        ends = np.concatenate([self._quantiles(sets, levels) for sets in parts])
        x = GRID[BAND_SAMPLES]
        left = np.clip(np.searchsorted(x, GRID, side="right") - 1, 0, len(x) - 2)
        share = (GRID - x[left]) / (x[left + 1] - x[left])
        return list(np.moveaxis(ends[..., left] * (1 - share) + ends[..., left + 1] * share, 1, 0))

    def _quantiles(self, sets: slice, levels: tuple[float, ...]) -> Array:
        """Return the quantiles of some sets at the samples of `BAND_SAMPLES`, shape (m, levels, 129)."""
        own = _EVERY if len(self.order) == 1 else sets
        order = self.order[own]
        share = np.take_along_axis(self.weights[sets, None], order, axis=2)
        values = np.take_along_axis(np.swapaxes(self.curves[own][:, :, BAND_SAMPLES], 1, 2), order, axis=2)
        values = np.broadcast_to(values, share.shape)
        middle = np.cumsum(share, axis=2) - 0.5 * share  # a sample stands for the curves halfway to its neighbours
        return np.stack([_at_level(middle, values, level) for level in levels], axis=1)


def exact_samples(table: Table, log_likelihood: Array) -> PosteriorSamples:
    """Weight the table of a model with one parameter."""
    logs = log_likelihood + table.log_prior
    weights, log_evidence = softmax(logs, axis=1), logsumexp(logs, axis=1)
    return PosteriorSamples(table.unconstrained[None], table.curves[None], table.order[None], weights, log_evidence)


def drawn_samples(posterior: Posterior, model: ResponseModel, best: Array, seed: int) -> PosteriorSamples:
    """Draw around the most probable parameters (n, k) and weight the draws by the posterior (importance sampling)."""
    n, k = best.shape
    prior = learned_prior(model)
    curved = posterior.objective(model)(best, np.arange(n))[1]
    curved += 1e-9 * curved * np.eye(k)  # very sharp likelihoods come out singular by rounding
    root = np.swapaxes(np.linalg.inv(np.linalg.cholesky(curved)), 1, 2) * _WIDER
    normal = np.random.default_rng(seed).normal(size=(n, _DRAWS, k))
    z = best[:, None] + normal @ np.swapaxes(root, 1, 2)
    # Irradiance lies in [0, 1]; a draw of an unbounded model that leaves it must not rule the mean.
    decoded = model.decode(model.from_unconstrained(z.reshape(-1, k)), np.float32)
    curves = np.clip(decoded, 0.0, 1.0).reshape(n, _DRAWS, -1)
    at = posterior.brightness.reshape(n, 1, -1)
    irradiance = np.swapaxes(evaluate(curves, at), 1, 2).reshape(*posterior.brightness.shape, _DRAWS)
    off = np.linalg.solve(np.linalg.cholesky(prior.covariance), (z - prior.mean).reshape(-1, k).T)
    # Weight = likelihood x prior / density of the draw. The factors 2 pi of both densities cancel.
    drawn_at = 0.5 * (normal**2).sum(axis=2) + np.linalg.slogdet(root)[1][:, None]
    prior_at = -0.5 * (off**2).sum(axis=0).reshape(n, _DRAWS) - 0.5 * np.linalg.slogdet(prior.covariance)[1]
    logs = posterior.log_likelihood(irradiance) + prior_at + drawn_at - np.log(_DRAWS)
    order = np.argsort(np.swapaxes(curves[:, :, BAND_SAMPLES], 1, 2), axis=2)
    return PosteriorSamples(z, curves, order, softmax(logs, axis=1), logsumexp(logs, axis=1))


def _at_level(rising: Array, values: np.ndarray, level: float) -> Array:
    """Return the values (..., t) where `rising` (..., t) reaches a level, linear between samples; shape (...)."""
    above = np.minimum((rising < level).sum(axis=-1, keepdims=True), rising.shape[-1] - 1)
    below = np.maximum(above - 1, 0)
    (low, high), (left, right) = (
        [np.take_along_axis(each, row, axis=-1)[..., 0].astype(np.float64) for row in (below, above)]
        for each in (rising, values)
    )
    share = np.clip((level - low) / np.maximum(high - low, 1e-300), 0.0, 1.0)
    return np.asarray(left + share * (right - left))
