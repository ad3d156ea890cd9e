"""Gamma curve: f(x) = x^gamma, gamma > 0 (the paper's eq. 3; Farid 2001, doi:10.1109/83.951529)."""

from functools import cache
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from crfbench.curves import GRID, Array, Direction, as_scaled_curves
from crfbench.errors import InputError
from crfbench.models.base import ResponseModel, nearest_in_table, refine

_LOG_GRID = np.log(np.maximum(GRID, 1e-300))
_TABLE = np.geomspace(0.02, 50.0, 400)[:, None]


class Gamma(ResponseModel):
    """One parameter, the exponent; below 1 brightens, above 1 darkens.

    Parameters
    ----------
    direction : {"forward", "inverse"}
    """

    name = "Gamma"

    def __init__(self, direction: Direction = "forward") -> None:
        super().__init__(1, direction)

    @property
    def param_names(self) -> tuple[str, ...]:
        """The names of the parameters, in order."""
        return ("gamma",)

    @classmethod
    def from_curves(cls, curves: ArrayLike, n_params: int, direction: Direction) -> Self:
        """Build the model; there is nothing to learn.

        Raises
        ------
        InputError
            For another number of parameters than 1.
        """
        if n_params != 1:
            raise InputError(f"n_params={n_params!r} does not fit Gamma; use 1")
        return cls(direction)

    def decode(self, params: ArrayLike) -> Array:
        """Turn exponents (..., 1) into curves (..., 1024).

        Raises
        ------
        InputError
            For exponents that are not above 0.
        """
        gamma = self._params(params)
        if (gamma <= 0).any():
            raise InputError(f"gamma={gamma.min():g} is no response; use an exponent above 0")
        curves = np.exp(gamma * _LOG_GRID)
        curves[..., 0] = 0.0  # also for exponents so small that the least logarithm is not low enough
        return curves

    def jacobian(self, params: ArrayLike) -> Array:
        """d f / d gamma = x^gamma log x, and 0 at x = 0."""
        return (self.decode(params) * _LOG_GRID)[..., None]

    def fit(self, curves: ArrayLike) -> Array:
        """Search a dense table of exponents, then polish: the global least MSE."""
        batch = as_scaled_curves(curves)
        return refine(self, batch, nearest_in_table(batch, _TABLE, _decoded_table(), n_best=1))

    def to_free(self, params: Array) -> Array:
        """Return log gamma."""
        return np.log(params)

    def from_free(self, free: Array) -> Array:
        """Return exp of the free parameter, kept within what floating point can decode."""
        return np.exp(np.clip(free, -12.0, 12.0))

    def free_slope(self, params: Array) -> Array:
        """d gamma / d log gamma = gamma."""
        return params


@cache
def _decoded_table() -> Array:
    return Gamma().decode(_TABLE)
