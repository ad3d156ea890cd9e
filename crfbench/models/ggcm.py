"""Generalised gamma curve model: f(x) = x^P(x), P(x) = sum_{i=0}^{d-1} w_i x^i.

The paper's eq. 4; Ng, Chang and Tsui 2007, doi:10.1109/CVPR.2007.383005.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from crfbench.curves import GRID, Array, Direction, as_scaled_curves
from crfbench.models.base import ClosedForm
from crfbench.numerics import Objective, levenberg_marquardt

_LOG_GRID = np.log(np.maximum(GRID, 1e-300))  # finite at 0, where every curve is 0 anyway


class GGCM(ClosedForm):
    """An exponent that varies along the curve; passes (0, 0) and (1, 1), need not be monotone.

    Parameters
    ----------
    n_params : int
        Coefficients of the exponent.
    direction : {"inverse", "forward"}
    """

    name = "GGCM"
    equation = "y = x^{P(x)}, where P(x) = Σ_{i} w_{i} x^{i}"

    def __init__(self, n_params: int = 3, direction: Direction = "inverse") -> None:
        super().__init__(n_params, direction)
        self.param_names = tuple(f"w{i}, of x^{i}" for i in range(self.n_params))
        bends = tuple(f"w_{{{i}}}: how the exponent changes towards white" for i in range(1, self.n_params))
        self.param_notes = ("w_{0}: the exponent near black", *bends)
        self._powers = GRID ** np.arange(self.n_params)[:, None]

    def decode(self, params: ArrayLike, dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """Turn coefficients (..., d) into curves (..., 1024); f(0) = 0 for any of them."""
        # A search may try any coefficients; within these bounds exp neither overflows nor warns.
        exponent = np.clip((self._params(params) @ self._powers) * _LOG_GRID, -700.0, 50.0)
        curves = np.exp(exponent)
        curves[..., 0] = 0.0
        return curves.astype(dtype, copy=False)

    def jacobian(self, params: ArrayLike) -> Array:
        """d f / d w_i = f(x) x^i log x, and 0 at x = 0."""
        return (self.decode(params) * _LOG_GRID)[..., None] * self._powers.T

    def fit(self, curves: ArrayLike) -> Array:
        """Grow the exponent power by power on every 16th sample, then polish on all of them."""
        batch = as_scaled_curves(curves)
        start = _grow(GRID[15::16], batch[:, 15::16], self.n_params)
        return _newton(GRID[1:], batch[:, 1:], start)[0]


def _grow(x: Array, y: Array, d: int) -> Array:
    """Fit from the best fit of log f, and from one power less wherever that came out no better."""
    best, cost = _newton(x, y, _fit_logarithm(x, y, d))
    # Started from d - 1 powers, no fit is worse than theirs: one more parameter never hurts.
    if d > 1:
        nested = np.pad(_grow(x, y, d - 1), ((0, 0), (0, 1)))
        (stuck,) = np.nonzero(cost >= _objective(x, y, d)(nested, np.arange(len(y)))[0])
        if stuck.size:
            best[stuck] = _newton(x, y[stuck], nested[stuck])[0]
    return best


def _newton(x: Array, y: Array, start: Array) -> tuple[Array, Array]:
    return levenberg_marquardt(_objective(x, y, start.shape[1]), start, tolerance=1e-9)


def _objective(x: Array, y: Array, d: int) -> Objective:
    """Newton's equations of sum (f - y)^2, cheap because f is the exponential of something linear.

    With w = f log x, the gradient is sum (f - y) w x^i and the Hessian sum (2 f - y) f (log x)^2 x^(i+j): one
    matrix product gives all of it. Where 2 f < y a share of the Gauss-Newton weight keeps it positive.
    """
    log_x, moments, index = _moments(x, d)
    basis = moments[:d] * log_x
    weights, powers = (moments * log_x**2).T, basis.T

    def objective(params: Array, rows: np.ndarray) -> tuple[Array, Array, Array]:
        f = params @ basis
        np.exp(np.minimum(f, 50.0, out=f), out=f)
        residual = f - y[rows]
        curvature = residual + f
        np.maximum(curvature, 0.2 * f, out=curvature)
        curvature *= f
        f *= residual
        return np.einsum("np,np->n", residual, residual), (curvature @ weights)[:, index], f @ powers

    return objective


def _fit_logarithm(x: Array, y: Array, d: int) -> Array:
    """Least squares of log y = P(x) log x, weighted by y so that errors count as they do in y."""
    log_x, moments, index = _moments(x, d)
    y = np.maximum(y, 1e-6)  # has a logarithm where the curve is 0
    w = y * y * log_x
    normal = ((w * log_x) @ moments.T)[:, index]
    ridge = 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(d)
    right = (w * np.log(y)) @ moments[:d].T
    return np.asarray(np.linalg.solve(normal + ridge, right[:, :, None])[:, :, 0])


def _moments(x: Array, d: int) -> tuple[Array, Array, np.ndarray]:
    """Return log x, the powers x^0 to x^(2d-2), and the (d, d) table of i + j that picks a Hessian from them."""
    return np.log(x), x ** np.arange(2 * d - 1)[:, None], np.add.outer(np.arange(d), np.arange(d))
