"""A kernel mixture: log irradiance in a few components, about each of many measured curves.

log g = m + B c with m the mean and B the leading principal components of log g at the knots in brightness, and for
prior a mixture with a kernel about every training curve in place of one normal distribution. Parzen 1962,
doi:10.1214/aoms/1177704472, on such densities; log irradiance as in Grossberg and Nayar's log space of responses.
"""

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from crfbench.checks import as_finite, check_count
from crfbench.curves import GRID, Array, Direction, as_scaled_curves, check_direction
from crfbench.errors import InputError
from crfbench.models.base import KNOTS, ClosedForm, Prior, at_knots, between_knots, from_knots, refine


class Kernel(ClosedForm):
    """Coefficients of the first k components of log irradiance; ends are right, monotonicity is not guaranteed.

    Parameters
    ----------
    mean : array_like, shape (64,)
        Mean of the logarithm of the curves at the knots.
    components : array_like, shape (m, 64)
        Orthonormal eigenvectors, the largest eigenvalue first; 0 at white.
    n_params : int
        How many components to use, at most m.
    direction : {"inverse", "forward"}
    """

    name = "Kernel"
    learns = True

    def __init__(
        self, mean: ArrayLike, components: ArrayLike, n_params: int = 8, direction: Direction = "inverse"
    ) -> None:
        super().__init__(n_params, direction)
        self.param_names = tuple(f"log component {i + 1}" for i in range(self.n_params))
        basis = np.atleast_2d(as_finite("components", components))
        if n_params > len(basis) or basis.shape[1:] != KNOTS.shape:
            raise InputError(
                f"n_params={n_params} and components of shape {basis.shape}; use ({n_params}, {len(KNOTS)})"
            )
        self.mean_ = as_finite("mean", mean)
        if self.mean_.shape != KNOTS.shape:
            raise InputError(f"mean of shape {self.mean_.shape} has the wrong shape; use ({len(KNOTS)},)")
        self.components_ = basis[:n_params]

    @classmethod
    def from_curves(cls, curves: ArrayLike, n_params: int = 8, direction: Direction = "inverse") -> Self:
        """Learn mean and components from training curves (n, 1024) of that direction, n > `n_params`."""
        check_direction(direction)
        logs = at_knots(as_scaled_curves(curves))
        if check_count("n_params", n_params) >= len(logs):
            raise InputError(
                f"{len(logs)} curves have fewer than {n_params} components; use more than n_params of them"
            )
        logs[:, -1] = 0.0
        mean = logs.mean(axis=0)
        return cls(mean, np.linalg.svd(logs - mean, full_matrices=False)[2][:n_params], n_params, direction)

    def decode(self, params: ArrayLike, dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """Turn coefficients (..., k) into curves (..., 1024)."""
        logs = np.minimum(self.mean_ + self._params(params) @ self.components_, _MOST)
        return from_knots(logs).astype(dtype, copy=False)

    def jacobian(self, params: ArrayLike) -> Array:
        """d g / d c = g B between the knots."""
        along = between_knots(self.components_.T, GRID)
        return np.asarray(self.decode(params)[..., None] * along)

    def fit(self, curves: ArrayLike) -> Array:
        """Project the logarithms, then refine to the least MSE."""
        targets = as_scaled_curves(curves)
        starts = (at_knots(targets) - self.mean_) @ self.components_.T
        return refine(self, targets, starts[:, None])

    def learn_prior(self, curves: ArrayLike, weights: ArrayLike | None = None) -> Self:
        """Set `prior_` to a mixture with a centre for each curve (n, 1024), by weights (n,); by default all alike."""
        logs = at_knots(as_scaled_curves(curves))
        share = np.ones(len(logs)) if weights is None else as_finite("weights", weights)
        if share.shape != (len(logs),) or share.min() <= 0:
            raise InputError(f"weights of shape {share.shape} do not fit; use {len(logs)} values above 0")
        self.prior_ = Prior.from_centres((logs - self.mean_) @ self.components_.T, share / share.sum())
        return self


_MOST = 2.0  # log irradiance; searches that go beyond overflow
