"""Gamma curve: f(x) = x^gamma, gamma > 0 (the paper's eq. 3; Farid 2001, doi:10.1109/83.951529)."""

from functools import cache
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from crfbench.curves import GRID, Array, Direction, as_scaled_curves
from crfbench.errors import InputError
from crfbench.models.base import ClosedForm, nearest_in_table, refine

_LOG_GRID = np.log(np.maximum(GRID, 1e-300))
_TABLE = np.geomspace(0.02, 50.0, 400)[:, None]


class Gamma(ClosedForm):
    """One parameter, the exponent; below 1 brightens, above 1 darkens.

    Parameters
    ----------
    direction : {"inverse", "forward"}
    """

    name = "Gamma"
    equation = "y = x^{γ}"
    param_notes = ("γ: below 1 lifts the curve, above 1 lowers it; 1 is the diagonal",)

    def __init__(self, direction: Direction = "inverse") -> None:
        super().__init__(1, direction)
        self.param_names = ("gamma",)

    @classmethod
    def from_curves(cls, curves: ArrayLike, n_params: int = 1, direction: Direction = "inverse") -> Self:
        """Build the model; there is nothing to learn."""
        if n_params != 1:
            raise InputError(f"n_params={n_params!r} is out of range for Gamma; use 1")
        return cls(direction)

    def decode(self, params: ArrayLike, dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """Turn exponents (..., 1) above 0 into curves (..., 1024)."""
        gamma = self._params(params)
        if (gamma <= 0).any():
            raise InputError(f"gamma={gamma.min():g} is out of range; use an exponent above 0")
        curves = np.exp(gamma * _LOG_GRID)
        curves[..., 0] = 0.0  # also for exponents so small that the least logarithm is not low enough
        return curves.astype(dtype, copy=False)

    def jacobian(self, params: ArrayLike) -> Array:
        """d f / d gamma = x^gamma log x, and 0 at x = 0."""
        return (self.decode(params) * _LOG_GRID)[..., None]

    def fit(self, curves: ArrayLike) -> Array:
        """Search a dense table of exponents, then polish: the global least MSE."""
        batch = as_scaled_curves(curves)
        return refine(self, batch, nearest_in_table(batch, _TABLE, _decoded_table(), n_best=1))

    def to_unconstrained(self, params: Array) -> Array:
        """Return log gamma."""
        return np.log(params)

    def from_unconstrained(self, unconstrained: Array) -> Array:
        """Return exp of it, kept within what floating point can decode."""
        return np.exp(np.clip(unconstrained, -12.0, 12.0))

    def unconstrained_slope(self, params: Array) -> Array:
        """d gamma / d log gamma = gamma."""
        return params


@cache
def _decoded_table() -> Array:
    return Gamma().decode(_TABLE)
