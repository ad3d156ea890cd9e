"""Batched least squares: many small non-linear problems solved at once."""

from collections.abc import Callable

import numpy as np

from crfbench.curves import Array

#: Takes parameters (m, k) and the indices (m,) of the problems they belong to; returns the costs (m,), matrices
#: (m, k, k) like J^T J, and gradients (m, k) like J^T r.
Objective = Callable[[Array, np.ndarray], tuple[Array, Array, Array]]

_CHUNK = 128  # problems solved together: their arrays fit in the processor's cache
_FIRST_DAMPING, _LAST_DAMPING = 1e-4, 1e10
_SMALLEST_STEP = 1e-8  # of a parameter, about 1 or else relative; at a kink no step gets better, only smaller


def normal_equations(residual: Array, jacobian: Array) -> tuple[Array, Array, Array]:
    """Return sums of squares, J^T J and J^T r of residuals (m, p) and Jacobians (m, p, k)."""
    transposed = np.swapaxes(jacobian, 1, 2)
    gradient = (transposed @ residual[:, :, None])[:, :, 0]
    return np.einsum("mp,mp->m", residual, residual), transposed @ jacobian, gradient


def levenberg_marquardt(
    objective: Objective, start: Array, max_steps: int = 100, tolerance: float = 1e-10
) -> tuple[Array, Array]:
    """Minimise the sum of squared residuals of `n` independent problems, each with its own damping.

    Every accepted step lowers the cost, so no result is worse than its start (n, k). A problem is done when a step
    changes its cost by no more than the share `tolerance`, or hardly moves. Returns parameters (n, k) and sums of
    squares (n,). Marquardt 1963, doi:10.1137/0111030, with his scaling by the diagonal.
    """
    params = np.array(start, dtype=np.float64)
    cost = np.empty(len(params))
    for first in range(0, len(params), _CHUNK):
        part = np.arange(first, min(first + _CHUNK, len(params)))
        params[part], cost[part] = _solve(objective, params[part], part, max_steps, tolerance)
    return params, cost


def _solve(
    objective: Objective, params: Array, rows: np.ndarray, max_steps: int, tolerance: float
) -> tuple[Array, Array]:
    cost, normal, gradient = objective(params, rows)
    damping = np.full(len(params), _FIRST_DAMPING)
    active = np.arange(len(params))
    for _ in range(max_steps):
        step = _damped_step(normal[active], gradient[active], damping[active])
        trial = params[active] - step
        trial_cost, trial_normal, trial_gradient = objective(trial, rows[active])
        better = trial_cost < cost[active]  # False for NaN, so a step into nowhere is refused
        settled = np.abs(trial_cost - cost[active]) <= tolerance * cost[active]
        settled |= (np.abs(step) <= _SMALLEST_STEP * (1.0 + np.abs(trial))).all(axis=1)
        moved = active[better]
        params[moved], cost[moved] = trial[better], trial_cost[better]
        normal[moved], gradient[moved] = trial_normal[better], trial_gradient[better]
        damping[active] *= np.where(better, 0.1, 8.0)
        active = active[~settled & (damping[active] < _LAST_DAMPING)]
        if not active.size:
            break
    return params, cost


def _damped_step(normal: Array, gradient: Array, damping: Array) -> Array:
    k = normal.shape[-1]
    diagonal = np.einsum("nkk->nk", normal)
    floor = 1e-14 * diagonal.max(axis=1, keepdims=True) + 1e-300
    scaled = (damping[:, None] * diagonal + floor)[:, :, None] * np.eye(k)
    return np.asarray(np.linalg.solve(normal + scaled, gradient[:, :, None])[:, :, 0])
