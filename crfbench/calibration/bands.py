"""Posterior weights to mean curves and credible bands."""

from dataclasses import dataclass

import numpy as np

from crfbench.calibration.posterior import Posterior
from crfbench.calibration.table import Table, band_samples, in_parts, learned_prior
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
        parts = in_parts(len(self.weights), self.order[0].size)
        ends = np.concatenate([self._quantiles(rows, levels) for rows in parts])
        x = GRID[band_samples()]
        left = np.clip(np.searchsorted(x, GRID, side="right") - 1, 0, len(x) - 2)
        share = (GRID - x[left]) / (x[left + 1] - x[left])
        return list(np.moveaxis(ends[..., left] * (1 - share) + ends[..., left + 1] * share, 1, 0))

    def _quantiles(self, rows: slice, levels: tuple[float, ...]) -> Array:
        """Return the quantiles of some sets at the samples of `band_samples`, shape (m, levels, 129)."""
        own = slice(None) if len(self.order) == 1 else rows
        order = self.order[own]
        share = np.take_along_axis(self.weights[rows, None], order, axis=2)
        values = np.take_along_axis(np.swapaxes(self.curves[own][:, :, band_samples()], 1, 2), order, axis=2)
        values = np.broadcast_to(values, share.shape)
        middle = np.cumsum(share, axis=2) - 0.5 * share  # a row stands for the curves up to halfway to its neighbours
        return np.stack([_at_level(middle, values, level) for level in levels], axis=1)


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
    # Irradiance lies in [0, 1]; a draw of an unbounded model that leaves it must not rule the mean.
    curves = np.clip(model.decode_float32(model.from_free(free.reshape(-1, k))), 0.0, 1.0).reshape(n, _DRAWS, -1)
    at = posterior.brightness.reshape(n, 1, -1)
    irradiance = np.swapaxes(evaluate(curves, at), 1, 2).reshape(*posterior.brightness.shape, _DRAWS)
    off = np.linalg.solve(np.linalg.cholesky(prior.covariance), (free - prior.mean).reshape(-1, k).T)
    drawn_at = 0.5 * (normal**2).sum(axis=2) + np.linalg.slogdet(root)[1][:, None]
    prior_at = -0.5 * (off**2).sum(axis=0).reshape(n, _DRAWS) - 0.5 * np.linalg.slogdet(prior.covariance)[1]
    weights, evidence = _normalised(posterior.log_likelihood(irradiance) + prior_at + drawn_at - np.log(_DRAWS))
    order = np.argsort(np.swapaxes(curves[:, :, band_samples()], 1, 2), axis=2)
    return Belief(free, curves, order, weights, evidence)


def _at_level(rising: Array, values: np.ndarray, level: float) -> Array:
    """Return the values (..., t) where `rising` (..., t) reaches a level, linear between rows; shape (...)."""
    above = np.minimum((rising < level).sum(axis=-1, keepdims=True), rising.shape[-1] - 1)
    below = np.maximum(above - 1, 0)
    (low, high), (left, right) = (
        [np.take_along_axis(each, row, axis=-1)[..., 0].astype(np.float64) for row in (below, above)]
        for each in (rising, values)
    )
    share = np.clip((level - low) / np.maximum(high - low, 1e-300), 0.0, 1.0)
    return np.asarray(left + share * (right - left))


def _normalised(log_weights: Array) -> tuple[Array, Array]:
    """Return weights that sum to 1, and the logarithm of what they summed to."""
    most = log_weights.max(axis=1, keepdims=True)
    weights = np.exp(log_weights - most)
    total = weights.sum(axis=1, keepdims=True)
    return weights / total, (np.log(total) + most)[:, 0]
