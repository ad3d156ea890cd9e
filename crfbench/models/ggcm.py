"""Generalised gamma curve model: f(x) = x^P(x), P(x) = sum_{i=0}^{d-1} w_i x^i.

The paper's eq. 4; Ng, Chang and Tsui 2007, doi:10.1109/CVPR.2007.383005.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from crfbench.curves import GRID, Array, Direction, as_scaled_curves
from crfbench.models.base import ClosedForm, refine

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
        return self.decode_with_jacobian(params)[1]

    def decode_with_jacobian(self, params: ArrayLike) -> tuple[Array, Array]:
        """Return `decode` and `jacobian` together."""
        curves = self.decode(params)
        return curves, (curves * _LOG_GRID)[..., None] * self._powers.T

    def fit(self, curves: ArrayLike) -> Array:
        """Refine from the diagonal, P(x) = 1, which leads every measured curve to the best of many starts."""
        batch = as_scaled_curves(curves)
        return refine(self, batch, np.tile(np.eye(1, self.n_params), (len(batch), 1, 1)))
