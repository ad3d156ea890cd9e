"""Learn how a model misses curves that it has not seen: a kernel, and how often which scale of it.

    x_n ~ sum_c sum_a pi_c w_a N(m_c, a^2 K + nugget^2 I)

x_n are log inverse responses at the knots, m_c the rows of the model's table with their prior weights pi. K and w are
found by expectation maximisation (Dempster, Laird and Rubin 1977, doi:10.1111/j.2517-6161.1977.tb01600.x).
"""

from collections.abc import Iterable
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import logsumexp

from crfbench.calibration.table import check_kind, decode_table, learned_prior, rows_near
from crfbench.curves import Array, as_valid_curves
from crfbench.errors import InputError
from crfbench.models import ResponseModel, load_model
from crfbench.models.base import KNOTS, SCALES, Discrepancy, at_knots

Rows = list[tuple[Array, Array]]

_NEAREST = 64  # components that are looked at for each curve
_NEAR, _START = 0.3, 0.2  # standard deviations that rank components and begin the kernel
_NUGGET, _LEAST_WEIGHT = 0.03, 2e-3
_STEPS = 25

M = TypeVar("M", bound=ResponseModel)


def learn_discrepancy(model: M, curves: ArrayLike) -> M:
    """Set the model's `discrepancy_`, which `calibrate` needs, from curves that it was not trained with; return it.

    Parameters
    ----------
    model : ResponseModel
        Of direction "inverse", with a prior.
    curves : array_like, shape (n, 1024)
        Inverse responses. Curves of the training give bands that are too narrow.
    """
    check_kind("model", model, ResponseModel, "load_model(name)")
    if model.direction != "inverse":
        raise InputError(f"{model!r} maps irradiance to brightness; use a model of direction 'inverse'")
    batch = as_valid_curves(curves)
    own = fit_discrepancy(at_knots(batch), rows_for(model, batch), np.ones(len(batch)))
    shared = load_model("Kernel-8").discrepancy_
    model.discrepancy_ = own if shared is None else own.blended(shared)
    return model


def rows_for(model: ResponseModel, curves: Array) -> Rows:
    """Return the model's rows for each curve, for several parameters with more of them near the curve's fit."""
    table = decode_table(model)
    logs = table.at_knots
    if model.n_params == 1 or learned_prior(model).centres is not None:
        return [(logs, table.log_prior)] * len(curves)
    _, near, weights = rows_near(model, table, model.to_unconstrained(model.fit(curves)), seed=0)
    return [(np.concatenate([logs, at_knots(np.clip(own, 0.0, 1.0))]), w) for own, w in zip(near, weights, strict=True)]


def fit_discrepancy(x: Array, rows: Iterable[tuple[Array, Array]], weight: Array) -> Discrepancy:
    """Fit kernel and scales to log irradiances x (n, 64), for each the rows of a model that has not seen it."""
    off, logs = _nearest(x, rows)
    score = logs - 0.5 * (off**2).sum(axis=2) / _START**2
    began = weight[:, None] * np.exp(score - logsumexp(score, axis=1)[:, None])
    kernel = _second_moment(off, began) / weight.sum() + 1e-4 * np.eye(len(KNOTS))
    share = np.full(len(SCALES), 1.0 / len(SCALES))
    for _ in range(_STEPS):
        values, vectors = np.linalg.eigh(kernel)
        values, turned = np.maximum(values, 0.0), off @ vectors
        responsibility = _expected(turned, logs, share, values) * weight[:, None, None]
        share = np.maximum(responsibility.sum(axis=(0, 2)) / weight.sum(), _LEAST_WEIGHT)
        share /= share.sum()
        moment = vectors @ _maximised(turned, responsibility, values) @ vectors.T / weight.sum()
        kernel = 0.5 * (moment + moment.T)
    return Discrepancy.from_kernel(kernel, share)


def _nearest(x: Array, rows: Iterable[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return what the nearest components of each curve miss, (n, c, 64), and their log weights (n, c)."""
    off, logs = np.zeros((len(x), _NEAREST, len(KNOTS))), np.full((len(x), _NEAREST), -np.inf)
    for i, (components, log_weight) in enumerate(rows):
        missed = x[i] - components
        near = np.argsort(0.5 * (missed**2).sum(axis=1) / _NEAR**2 - log_weight)[:_NEAREST]
        off[i, : len(near)], logs[i, : len(near)] = missed[near], log_weight[near]
    return off, logs


def _second_moment(off: Array, weight: Array) -> Array:
    flat = (np.sqrt(weight)[..., None] * off).reshape(-1, len(KNOTS))
    return np.asarray(flat.T @ flat)


def _expected(turned: Array, logs: Array, share: Array, values: Array) -> Array:
    """Return the probability of every scale and component, (n, a, c)."""
    variance = SCALES[:, None] ** 2 * values + _NUGGET**2
    square = np.moveaxis(turned**2 @ (1.0 / variance).T, 2, 1)
    score = logs[:, None] + np.log(share)[:, None] - 0.5 * (np.log(variance).sum(axis=1)[:, None] + square)
    return np.asarray(np.exp(score - logsumexp(score, axis=(1, 2), keepdims=True)))


def _maximised(turned: Array, responsibility: Array, values: Array) -> Array:
    """Return the expected second moment of the discrepancy at scale 1, in the eigenbasis of the kernel before."""
    moment = np.zeros((len(KNOTS), len(KNOTS)))
    for scale, share in zip(SCALES, np.moveaxis(responsibility, 1, 0), strict=True):
        variance = scale**2 * values + _NUGGET**2
        moment += _second_moment(turned * (scale * values / variance), share)
        moment += share.sum() * np.diag(values * _NUGGET**2 / variance)
    return moment
