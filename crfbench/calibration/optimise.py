"""Three ways to the best parameters: exhaustive and polished, and the paper's."""

from typing import Protocol

import numpy as np

from crfbench.calibration.alignment import AlignedLoss
from crfbench.calibration.table import Table, in_parts
from crfbench.curves import N_SAMPLES, Array
from crfbench.models import ResponseModel
from crfbench.numerics import Objective, levenberg_marquardt

N_STARTS = 4  # of models with several parameters
_NEAR = 0.01  # a valley of the table this share above the lowest may lie below it once polished


class Loss(Protocol):
    """What `minimise` needs."""

    def objective(self, model: ResponseModel, owner: np.ndarray) -> Objective:
        """Return a function with the same minimum for `levenberg_marquardt`."""


def minimise(loss: Loss, model: ResponseModel, table: Table, values: Array) -> Array:
    """Polish the best few rows of a table, for one parameter its lowest valleys.

    Parameters
    ----------
    loss : Loss
    model : ResponseModel
    table : Table
    values : ndarray, shape (n, t)
        The loss of every row of the table.

    Returns
    -------
    ndarray, shape (n, k)
        Free parameters.
    """
    owner, rows = _valleys(values) if model.n_params == 1 else _best(values)
    free, cost = levenberg_marquardt(loss.objective(model, owner), table.free[rows], max_steps=30, tolerance=1e-12)
    ranked = np.lexsort((cost, owner))
    return free[ranked[np.unique(owner, return_index=True)[1]]]


def _valleys(values: Array) -> tuple[np.ndarray, np.ndarray]:
    """Return sets and rows of the local minima, ends included, that lie near the lowest of their set."""
    padded = np.pad(values, ((0, 0), (1, 1)), constant_values=np.inf)
    lowest = values.min(axis=1, keepdims=True)
    near = values <= lowest + _NEAR * np.abs(lowest)
    owner, rows = np.nonzero(near & (values < padded[:, :-2]) & (values <= padded[:, 2:]))
    return owner, rows


def _best(values: Array) -> tuple[np.ndarray, np.ndarray]:
    """Return sets and rows of the `N_STARTS` lowest values of each set."""
    rows = np.argpartition(values, N_STARTS - 1, axis=1)[:, :N_STARTS]
    return np.repeat(np.arange(len(values)), N_STARTS), rows.ravel()


def descend(
    loss: AlignedLoss, model: ResponseModel, n: int, starts: int, seed: int, steps: int = 600, rate: float = 1e-3
) -> Array:
    """Run the paper's search: Adam from N(0, 1) starts, the best end kept.

    All starts of all observations run side by side. A start is done when its loss moves by less than 1e-6, in
    squared units of the reference.

    Returns
    -------
    ndarray, shape (n, k)
        Free parameters.

    References
    ----------
    Kingma and Ba 2015, arXiv:1412.6980.
    """
    drawn = np.random.default_rng(seed).normal(size=(n, starts, model.n_params))
    return np.concatenate(
        [
            _adam(loss, model, drawn[rows], np.arange(n)[rows], steps, rate)
            for rows in in_parts(n, 4 * starts * N_SAMPLES)
        ]
    )


def _adam(loss: AlignedLoss, model: ResponseModel, drawn: Array, sets: np.ndarray, steps: int, rate: float) -> Array:
    """Run all starts (m, s, k) of some sets of observations and return the best ends (m, k)."""
    m, starts, k = drawn.shape
    free, owner = drawn.reshape(-1, k).copy(), np.repeat(sets, starts)
    first, second = np.zeros_like(free), np.zeros_like(free)
    value = np.full(len(free), np.inf)
    active = np.arange(len(free))
    for step in range(1, steps + 1):
        now, gradient = _loss_and_gradient(loss, model, free[active], owner[active])
        moved = np.abs(now - value[active]) >= 1e-6
        value[active] = now
        active, gradient = active[moved], gradient[moved]
        if not active.size:
            break
        first[active] = 0.9 * first[active] + 0.1 * gradient
        second[active] = 0.999 * second[active] + 0.001 * gradient**2
        unbiased = first[active] / (1 - 0.9**step), second[active] / (1 - 0.999**step)
        free[active] -= rate * unbiased[0] / (np.sqrt(unbiased[1]) + 1e-8)
    best = np.argmin(_loss_and_gradient(loss, model, free, owner)[0].reshape(m, starts), axis=1)
    return free.reshape(m, starts, k)[np.arange(m), best]


def _loss_and_gradient(loss: AlignedLoss, model: ResponseModel, free: Array, rows: np.ndarray) -> tuple[Array, Array]:
    mse, gradient, _ = loss.evaluate(model, free, rows)
    value = np.sqrt((mse**2).sum(axis=1))
    return value, np.einsum("me,mek->mk", mse, gradient) / np.maximum(value, 1e-300)[:, None]
