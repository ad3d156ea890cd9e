"""The log posterior of the free parameters: likelihood in log irradiance times the model's prior."""

import numpy as np
from scipy.special import log_ndtr

from crfbench.calibration.likelihood import DARKEST, Likelihood, Noise
from crfbench.calibration.looked_up import looked_up
from crfbench.calibration.observations import Observations
from crfbench.calibration.table import Table, in_parts, learned_prior
from crfbench.curves import Array, evaluate
from crfbench.models import ResponseModel
from crfbench.numerics import Objective

_EVERY = slice(None)


class Posterior:
    """The posterior of `n` sets of observations.

    The scale of all the noise is itself uncertain (inverse gamma) and integrated out, which makes Student's t of the
    Gaussian: with S the quadratic form, nu = `noise.freedom` and n the effective number of observations,

        log p = -(n + nu) / 2 log(1 + S / nu) + sum of log Phi(margins of clipped patches) + log prior

    Parameters
    ----------
    observations : Observations
    noise : Noise
    """

    def __init__(self, observations: Observations, noise: Noise) -> None:
        self.brightness = observations.brightness
        self.likelihood, self.noise = Likelihood(observations, noise), noise
        self.power = noise.independent * self.likelihood.freedom + noise.freedom

    def log_likelihood(self, irradiance: np.ndarray, rows: slice = _EVERY) -> Array:
        """Return the log likelihood (m, t) of decoded irradiances (m, e, p, t) of some sets of observations."""
        d = self.likelihood.residual(irradiance, rows)
        squares, exposures = self.likelihood.squares(d, rows)
        logs = -0.5 * self.power[rows, None] * np.log1p(self._scaled(squares))
        owner, margin = self.likelihood.margins(d, exposures, rows)
        np.add.at(logs, owner, self.noise.independent * log_ndtr(margin))
        return logs

    def log_likelihood_on(self, table: Table) -> Array:
        """Return the log likelihood of every row of a table, shape (n, t)."""
        n, e, p = self.brightness.shape
        parts = in_parts(n, e * p * len(table.free))
        return np.concatenate([self.log_likelihood(table.at(self.brightness[rows]), rows) for rows in parts])

    def objective(self, model: ResponseModel, owner: np.ndarray) -> Objective:
        """Return minus twice the log posterior for `levenberg_marquardt`."""
        prior = learned_prior(model)
        precision = np.linalg.inv(prior.covariance)

        def cost(free: Array, problems: np.ndarray) -> tuple[Array, Array, Array]:
            value, curved, gradient = self._data_terms(model, free, owner[problems])
            off = free - prior.mean
            value += np.einsum("mi,ij,mj->m", off, precision, off)
            return value, curved + precision, gradient + off @ precision

        return cost

    def noise_scale(self, model: ResponseModel, free: Array) -> Array:
        """Return by which factor the data scale the stated noise, shape (n,), given free parameters (n, k)."""
        g = evaluate(model.decode(model.from_free(free)), self.brightness.reshape(len(free), -1))
        g = g.reshape(self.brightness.shape)
        squares, _ = self.likelihood.squares(self.likelihood.residual(g[..., None], _EVERY), _EVERY)
        freedom = self.noise.independent * self.likelihood.freedom
        expected = self.noise.freedom + self.noise.independent * squares[:, 0]
        return np.sqrt(expected / (self.noise.freedom + freedom))

    def _scaled(self, squares: Array) -> Array:
        return self.noise.independent * squares / self.noise.freedom

    def _data_terms(self, model: ResponseModel, free: Array, rows: np.ndarray) -> tuple[Array, Array, Array]:
        """Return minus twice the log likelihood, half its curvature and half its gradient."""
        g, slope = looked_up(model, free, self.brightness[rows])
        slope = np.where(g[..., None] > DARKEST, slope / np.maximum(g, DARKEST)[..., None], 0.0)
        # One column is the residual, the others are its derivatives.
        columns = np.concatenate([self.likelihood.residual(g[..., None], rows), slope], axis=3)
        product, exposures = self.likelihood.products(columns, rows)
        squares = product[:, 0, 0]
        share = self.power[rows] * self.noise.independent / (self.noise.freedom + self.noise.independent * squares)
        value = self.power[rows] * np.log1p(self._scaled(squares))
        terms = value, share[:, None, None] * product[:, 1:, 1:], share[:, None] * product[:, 1:, 0]
        return self._add_censored(terms, columns, exposures, rows)

    def _add_censored(
        self, terms: tuple[Array, Array, Array], columns: Array, exposures: Array, rows: np.ndarray
    ) -> tuple[Array, Array, Array]:
        value, curved, gradient = terms
        owner, margin = self.likelihood.margins(columns, exposures, rows)
        if owner.size:
            u, along = margin[:, 0], margin[:, 1:]
            mills = np.exp(-0.5 * u**2 - log_ndtr(u)) / np.sqrt(2 * np.pi)
            share = self.noise.independent
            np.add.at(value, owner, -2.0 * share * log_ndtr(u))
            np.add.at(gradient, owner, -share * mills[:, None] * along)
            bend = share * mills * np.maximum(mills + u, 0.0)  # far out, rounding could turn its sign
            np.add.at(curved, owner, bend[:, None, None] * along[:, :, None] * along[:, None, :])
        return value, curved, gradient
