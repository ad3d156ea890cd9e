"""Posterior weights to mean curves and credible bands."""

from dataclasses import dataclass

import numpy as np

from crfbench.calibration.posterior import Posterior
from crfbench.calibration.table import Table, band_samples, learned_prior
from crfbench.curves import GRID, Array, evaluate
from crfbench.models import ResponseModel

_DRAWS = 256  # for each calibration of a model with several parameters
_WIDER = 1.4  # than the curvature at the maximum tells, for draws that are weighted afterwards


@dataclass(frozen=True)
class Belief:
    """Weighted curves: one table for all calibrations, or draws for each.

    Parameters
    ----------
    free : ndarray, shape (1 or n, t, k)
    curves : ndarray, shape (1 or n, t, 1024)
    order : ndarray, shape (1 or n, 129, t)
        Rows in rising order at the samples of `band_samples`.
    weights : ndarray, shape (n, t)
        They sum to 1.
    log_evidence : ndarray, shape (n,)
        Log of the likelihood averaged over the prior.
    """

    free: Array
    curves: np.ndarray
    order: np.ndarray
    weights: Array
    log_evidence: Array

    def mean(self) -> Array:
        """Return the mean curves, shape (n, 1024)."""
        if len(self.curves) == 1:
            return np.asarray(self.weights @ self.curves[0].astype(np.float64))
        return np.einsum("nt,nts->ns", self.weights, self.curves)

    def quantiles(self, levels: tuple[float, ...]) -> list[Array]:
        """Return for each level the curves (n, 1024) that this share of the weight lies at or below."""
        samples = band_samples()
        cumulative = np.cumsum(np.take_along_axis(self.weights[:, None], self.order, axis=2), axis=2)
        values = np.swapaxes(self.curves[:, :, samples], 1, 2)
        return [self._interpolate(values, np.argmax(cumulative >= level, axis=2)) for level in levels]

    def _interpolate(self, values: np.ndarray, rank: np.ndarray) -> Array:
        """Turn ranks (n, 129) into curves (n, 1024)."""
        row = np.take_along_axis(np.broadcast_to(self.order, (len(rank), *self.order.shape[1:])), rank[..., None], 2)
        picked = np.take_along_axis(np.broadcast_to(values, (len(rank), *values.shape[1:])), row, 2)[..., 0]
        x = GRID[band_samples()]
        left = np.clip(np.searchsorted(x, GRID, side="right") - 1, 0, len(x) - 2)
        share = (GRID - x[left]) / (x[left + 1] - x[left])
        return np.asarray(picked[:, left] * (1 - share) + picked[:, left + 1] * share, dtype=np.float64)


def exact_belief(table: Table, log_likelihood: Array) -> Belief:
    """Weight the table of a model with one parameter."""
    weights, evidence = _normalised(log_likelihood + table.log_prior)
    return Belief(table.free[None], table.curves[None], table.order[None], weights, evidence)


def drawn_belief(posterior: Posterior, model: ResponseModel, best: Array, seed: int) -> Belief:
    """Draw around the most probable parameters (n, k) and weight the draws by the posterior."""
    n, k = best.shape
    prior = learned_prior(model)
    curved = posterior.objective(model, np.arange(n))(best, np.arange(n))[1]
    curved += 1e-9 * curved * np.eye(k)  # very sharp likelihoods come out singular by rounding
    root = np.swapaxes(np.linalg.inv(np.linalg.cholesky(curved)), 1, 2) * _WIDER
    normal = np.random.default_rng(seed).normal(size=(n, _DRAWS, k))
    free = best[:, None] + normal @ np.swapaxes(root, 1, 2)
    curves = model.decode_float32(model.from_free(free.reshape(-1, k))).reshape(n, _DRAWS, -1)
    at = posterior.brightness.reshape(n, 1, -1)
    irradiance = np.swapaxes(evaluate(curves, at), 1, 2).reshape(*posterior.brightness.shape, _DRAWS)
    off = np.linalg.solve(np.linalg.cholesky(prior.covariance), (free - prior.mean).reshape(-1, k).T)
    drawn_at = 0.5 * (normal**2).sum(axis=2) + np.linalg.slogdet(root)[1][:, None]
    prior_at = -0.5 * (off**2).sum(axis=0).reshape(n, _DRAWS) - 0.5 * np.linalg.slogdet(prior.covariance)[1]
    weights, evidence = _normalised(posterior.log_likelihood(irradiance) + prior_at + drawn_at - np.log(_DRAWS))
    order = np.argsort(np.swapaxes(curves[:, :, band_samples()], 1, 2), axis=2)
    return Belief(free, curves, order, weights, evidence)


def _normalised(log_weights: Array) -> tuple[Array, Array]:
    """Return weights that sum to 1, and the logarithm of what they summed to."""
    most = log_weights.max(axis=1, keepdims=True)
    weights = np.exp(log_weights - most)
    total = weights.sum(axis=1, keepdims=True)
    return weights / total, (np.log(total) + most)[:, 0]
