"""Polynomial: f(x) = sum_{i=1}^{d} w_i x^i.

The paper's eq. 2; Mitsunaga and Nayar 1999, doi:10.1109/CVPR.1999.786966.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from crfbench.curves import GRID, Array, Direction, as_scaled_curves
from crfbench.models.base import ClosedForm


class Polynomial(ClosedForm):
    """Powers 1 to d of x, so f(0) = 0; nothing makes f(1) = 1 or the curve monotone.

    Parameters
    ----------
    n_params : int
        The degree d.
    direction : {"inverse", "forward"}
    """

    name = "Polynomial"
    equation = "y = Σ_{i} w_{i} x^{i}"

    def __init__(self, n_params: int = 3, direction: Direction = "inverse") -> None:
        super().__init__(n_params, direction)
        self.param_names = tuple(f"w{i + 1}, of x^{i + 1}" for i in range(self.n_params))
        self.param_notes = tuple(f"w_{{{i + 1}}}: how much of x^{{{i + 1}}} is added" for i in range(self.n_params))
        self._powers = GRID ** np.arange(1, self.n_params + 1)[:, None]

    def decode(self, params: ArrayLike, dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """Turn coefficients (..., d) into curves (..., 1024)."""
        return (self._params(params) @ self._powers).astype(dtype, copy=False)

    def jacobian(self, params: ArrayLike) -> Array:
        """d f / d w_i = x^i, for any coefficients."""
        shape = self._params(params).shape[:-1]
        return np.broadcast_to(self._powers.T, (*shape, *self._powers.T.shape)).copy()

    def fit(self, curves: ArrayLike) -> Array:
        """Solve the linear least squares of all curves at once."""
        return np.asarray(np.linalg.lstsq(self._powers.T, as_scaled_curves(curves).T, rcond=None)[0].T)
