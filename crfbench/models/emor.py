"""Empirical model of response: f = f0 + H c, the first k principal components of measured responses.

The paper's eq. 1; Grossberg and Nayar 2004, doi:10.1109/TPAMI.2004.88.
"""

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from crfbench.curves import Array, Direction, as_curves, as_scaled_curves
from crfbench.errors import InputError
from crfbench.models.base import ClosedForm


class EMoR(ClosedForm):
    """Coefficients of the first k components; ends are right, monotonicity is not guaranteed.

    Parameters
    ----------
    mean : array_like, shape (1024,)
        The base function f0 (or g0 for inverse responses).
    components : array_like, shape (m, 1024)
        Orthonormal eigenvectors, the largest eigenvalue first.
    n_params : int
        How many components to use, at most m.
    direction : {"inverse", "forward"}
        Of `mean`, `components` and the decoded curves.
    """

    name = "EMoR"
    equation = "y = f_{0}(x) + Σ_{i} c_{i} h_{i}(x)"
    learns = True

    def __init__(
        self, mean: ArrayLike, components: ArrayLike, n_params: int = 3, direction: Direction = "inverse"
    ) -> None:
        super().__init__(n_params, direction)
        self.param_names = tuple(f"component {i + 1}" for i in range(self.n_params))
        part = "c_{%d}: how much of component h_{%d} is added to the mean curve f_{0}"
        self.param_notes = tuple(part % (i + 1, i + 1) for i in range(self.n_params))
        basis = as_curves(components)
        if n_params > len(basis):
            raise InputError(f"n_params={n_params} is out of range for a basis of {len(basis)}; use 1 to {len(basis)}")
        self.mean_ = as_curves(mean)[0]
        self.components_ = basis[:n_params]

    @classmethod
    def from_curves(cls, curves: ArrayLike, n_params: int = 3, direction: Direction = "inverse") -> Self:
        """Learn mean and components from training curves (n, 1024) of that direction, n > `n_params`."""
        batch = as_scaled_curves(curves)
        if len(batch) < 2:
            raise InputError("1 curve has no components; use more than n_params of them")
        mean = batch.mean(axis=0)
        # n centred curves span n - 1 dimensions; the last singular vector would be rounding.
        components = np.linalg.svd(batch - mean, full_matrices=False)[2][: len(batch) - 1]
        # PCA leaves the sign open: each component's largest sample is positive.
        peak = np.take_along_axis(components, np.abs(components).argmax(axis=1)[:, None], axis=1)
        return cls(mean, components * np.sign(peak), n_params, direction)

    def decode(self, params: ArrayLike, dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """Turn coefficients (..., k) into curves (..., 1024)."""
        return (self.mean_ + self._params(params) @ self.components_).astype(dtype, copy=False)

    def jacobian(self, params: ArrayLike) -> Array:
        """d f / d c = H, for any coefficients."""
        shape = self._params(params).shape[:-1]
        return np.broadcast_to(self.components_.T, (*shape, *self.components_.T.shape)).copy()

    def fit(self, curves: ArrayLike) -> Array:
        """Project all curves onto the components, by least squares."""
        centred = as_scaled_curves(curves) - self.mean_
        # The published basis is printed in 7 digits: not quite orthonormal, so a plain product would be a little off.
        return np.asarray(np.linalg.lstsq(self.components_.T, centred.T, rcond=None)[0].T)
