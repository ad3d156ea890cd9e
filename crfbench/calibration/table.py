"""A dense table of decoded curves, and the way from its best rows to the best parameters.

For one parameter the table holds every curve that the model can make. Here and in the modules that build on it, `z` is
a model's unconstrained parameters: the space of its prior.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from scipy.special import logsumexp

from crfbench.checks import check_count, check_seed
from crfbench.curves import N_SAMPLES, Array, evaluate
from crfbench.errors import InputError
from crfbench.models import ResponseModel
from crfbench.models.base import Prior, at_knots
from crfbench.numerics import Objective, levenberg_marquardt

#: The samples at which bands are computed: every eighth and the last, 129 of them.
BAND_SAMPLES = np.append(np.arange(0, N_SAMPLES, 8), N_SAMPLES - 1)

ONE_PARAMETER, MORE_PARAMETERS = 512, 1024  # rows
_REACH = 5.0  # standard deviations of the prior, and the least reach of an unconstrained parameter
_FEWEST = 16  # rows
N_NEARBY, _NEARBY = 256, 0.25  # draws near the best parameters, and their spread in that of the prior
_CELLS = 2**19  # numbers in one array over the table; memory then grows with the results alone


@dataclass(frozen=True)
class Table:
    """Parameters and their curves."""

    unconstrained: Array  # shape (t, k); for one parameter in even steps, for more drawn from the prior
    params: Array  # shape (t, k)
    curves: NDArray[np.float32]  # shape (t, 1024)
    log_prior: Array  # shape (t,); log weight that each row has before any data; the weights sum to 1

    @cached_property
    def by_sample(self) -> NDArray[np.float32]:
        """The curves, sample by sample: (1024, t), so that a look-up reads neighbouring numbers."""
        return np.ascontiguousarray(self.curves.T)

    @cached_property
    def at_knots(self) -> Array:
        """Log irradiance at the knots, shape (t, 64)."""
        return at_knots(np.clip(self.curves, 0.0, 1.0))

    @cached_property
    def order(self) -> np.ndarray:
        """Rows in rising order of irradiance at the samples of `BAND_SAMPLES`, shape (129, t)."""
        return np.argsort(self.by_sample[BAND_SAMPLES], axis=1, kind="stable")

    def at(self, brightness: Array) -> NDArray[np.float32]:
        """Evaluate all curves at brightnesses (...), linear between samples: (..., t)."""
        position = brightness * (N_SAMPLES - 1)
        left = np.minimum(position.astype(np.intp), N_SAMPLES - 2)
        share = (position - left).astype(np.float32)[..., None]
        # In place, because these are by far the largest arrays of a calibration.
        low = self.by_sample[left]
        low += share * (self.by_sample[left + 1] - low)
        return low


def chunks(n: int, cells: int) -> Iterator[slice]:
    """Split `n` sets of observations that need `cells` numbers each into parts that stay in the processor's cache."""
    size = max(1, _CELLS // max(cells, 1))
    return (slice(first, min(first + size, n)) for first in range(0, n, size))


def check_kind(name: str, value: object, kind: type, source: str) -> None:
    """Refuse a value of another type and say where the right one comes from."""
    if not isinstance(value, kind):
        raise InputError(f"{name} is a {type(value).__name__}; use what {source} gives")


def learned_prior(model: ResponseModel) -> Prior:
    """Return the prior of a model that has one."""
    check_kind("model", model, ResponseModel, "load_model(name)")
    if model.prior_ is None:
        raise InputError(f"{model!r} has no prior; give it one with learn_prior(curves)")
    return model.prior_


def decode_table(model: ResponseModel, rows: int | None = None, seed: int = 0) -> Table:
    """Decode a table of the curves of a model with a prior; for many calibrations, decode it once.

    It has so many `rows`, by default 512 for one parameter, 1024 draws by `seed` for more.
    """
    prior = learned_prior(model)
    if rows is not None:
        check_count("rows", rows, _FEWEST)
    check_seed(seed)
    if model.n_params == 1:
        mean, sd = prior.mean[0], np.sqrt(prior.covariance[0, 0])
        reach = max(_REACH * sd, _REACH)
        z = mean + np.linspace(-reach, reach, rows or ONE_PARAMETER)[:, None]
        log_prior = -0.5 * ((z[:, 0] - mean) / sd) ** 2
    elif prior.centres is not None and prior.weights is not None:
        z, log_prior = prior.centres, np.log(prior.weights)
    else:
        z = np.concatenate([prior.mean[None], prior.sample((rows or MORE_PARAMETERS) - 1, seed)])
        log_prior = np.zeros(len(z))  # how often a region is drawn is its prior already
    params = model.from_unconstrained(z)
    return Table(z, params, model.decode(params, np.float32), log_prior - logsumexp(log_prior))


def rows_near(model: ResponseModel, table: Table, best: Array, seed: int) -> tuple[Array, NDArray[np.float32], Array]:
    """Return a table's rows and as many draws near each of the parameters z (n, k), as one sample of the prior.

    Where data say much, few rows of a table of several parameters lie near the truth. Weights follow the balance
    heuristic (Veach and Guibas 1995, doi:10.1145/218380.218498). Returns unconstrained parameters (n, r, k), the curves
    of the draws (n, d, 1024) and the log weights of all (n, r).
    """
    prior, (n, k), rows = learned_prior(model), best.shape, len(table.unconstrained)
    root = np.linalg.cholesky(prior.covariance)
    drawn = best[:, None] + _NEARBY * np.random.default_rng(seed).standard_normal((N_NEARBY, k)) @ root.T
    z = np.concatenate([np.broadcast_to(table.unconstrained, (n, rows, k)), drawn], axis=1)
    at_prior, at_draw = (-0.5 * (np.linalg.solve(root, off.reshape(-1, k).T) ** 2).sum(axis=0).reshape(z.shape[:2])
                         for off in (z - prior.mean, (z - best[:, None]) / _NEARBY))  # fmt: skip
    at_draw -= k * np.log(_NEARBY)
    log_weight = at_prior - np.logaddexp(np.log(rows) + at_prior, np.log(N_NEARBY) + at_draw)
    curves = model.decode(model.from_unconstrained(drawn.reshape(-1, k)), np.float32).reshape(n, N_NEARBY, -1)
    return z, curves, log_weight


N_STARTS = 4  # of models with several parameters: so many lowest rows, and so many others
_APART = 0.7  # standard deviations of the table between rows of different folds
_NEAR = 0.01  # a valley of the table this share above the lowest may lie below it once polished


def evaluate_with_gradient(model: ResponseModel, z: Array, brightness: Array) -> tuple[Array, Array]:
    """Evaluate curves (m, k) at brightnesses (m, e, p): irradiance (m, e, p) and its derivatives by z (m, e, p, k)."""
    params, at = model.from_unconstrained(z), brightness.reshape(len(z), -1)
    curves, jacobian = model.decode_with_jacobian(params)
    slope = evaluate(np.swapaxes(jacobian, 1, 2), at[:, None]) * model.unconstrained_slope(params)[:, :, None]
    shape = brightness.shape
    return evaluate(curves, at).reshape(shape), np.moveaxis(slope, 1, 2).reshape(*shape, model.n_params)


def minimise(objective: Objective, table: Table, values: Array) -> Array:
    """Polish the best few rows of a table, for one parameter its lowest valleys; returns z (n, k).

    `objective` takes z (m, k) and the sets of observations (m,) that they belong to, see `crfbench.numerics.Objective`;
    `values` (n, t) are the loss of every row for each set. They may differ from the objective by any rising function.
    """
    sets, rows = _valleys(values) if table.unconstrained.shape[1] == 1 else _best(values, table.unconstrained)
    z, cost = levenberg_marquardt(
        lambda z, starts: objective(z, sets[starts]), table.unconstrained[rows], max_steps=30, tolerance=1e-12
    )
    ranked = np.lexsort((cost, sets))
    return z[ranked[np.unique(sets, return_index=True)[1]]]


def _valleys(values: Array) -> tuple[np.ndarray, np.ndarray]:
    """Return sets and rows of the local minima, ends included, that lie near the lowest of their set."""
    padded = np.pad(values, ((0, 0), (1, 1)), constant_values=np.inf)
    lowest = values.min(axis=1, keepdims=True)
    near = values <= lowest + _NEAR * np.abs(lowest)
    sets, rows = np.nonzero(near & (values < padded[:, :-2]) & (values <= padded[:, 2:]))
    return sets, rows


def _best(values: Array, unconstrained: Array) -> tuple[np.ndarray, np.ndarray]:
    """Return sets and rows of the lowest values of each set, and of the lowest of other folds of the family.

    A family of several parameters folds: two far regions may make much the same curve, and the lower one need not hold
    the lowest row.
    """
    rows = np.argpartition(values, N_STARTS - 1, axis=1)[:, :N_STARTS]
    scaled, left, latest = unconstrained / unconstrained.std(axis=0), values, rows
    for _ in range(N_STARTS):
        near = cdist(scaled[latest.ravel()], scaled).reshape(*latest.shape, -1) < _APART
        left = np.where(near.any(axis=1), np.inf, left)
        latest = left.argmin(axis=1)[:, None]
        rows = np.concatenate([rows, latest], axis=1)
    return np.repeat(np.arange(len(values)), rows.shape[1]), rows.ravel()
