"""What every response model can do.

A model turns parameters ``(n, k)`` into curves ``(n, 1024)`` of one direction. To add one, write a class with
`from_curves`, `decode`, `jacobian` and `fit` in a file of its own and give it a line in the table ``MODELS`` of
``models/table.py``, with the numbers of parameters to tabulate it with:

>>> import numpy as np
>>> from crfbench.models import Gamma
>>> model = Gamma(direction="inverse")
>>> model.decode([2.2]).shape
(1024,)
>>> float(np.round(model.fit(model.decode([[2.2]]))[0, 0], 6))
2.2
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.checks import as_finite, check_count, check_seed
from crfbench.curves import Array, Direction, as_curves, check_direction, repair
from crfbench.errors import InputError
from crfbench.numerics import levenberg_marquardt, normal_equations

#: From parameters (m, k) to values (m, p) and their Jacobians (m, p, k).
Evaluation = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True)
class Prior:
    """A normal distribution over the free parameters of a model.

    Parameters
    ----------
    mean : ndarray, shape (k,)
    covariance : ndarray, shape (k, k)
    """

    mean: Array
    covariance: Array

    @classmethod
    def from_samples(cls, free: Array) -> Self:
        """Take mean and covariance from free parameters of shape (n, k), n > 1.

        Raises
        ------
        InputError
            For fewer than two rows.
        """
        if np.ndim(free) != 2 or len(free) < 2:
            raise InputError(
                f"free parameters of shape {np.shape(free)} give no prior; use (n, k) of two or more curves"
            )
        return cls(free.mean(axis=0), np.atleast_2d(np.cov(free, rowvar=False)))

    def sample(self, n: int, seed: int) -> Array:
        """Draw free parameters, shape (n, k)."""
        return np.random.default_rng(check_seed(seed)).multivariate_normal(
            self.mean, self.covariance, size=check_count("n", n, least=0)
        )


class ResponseModel(ABC):
    """A family of response curves with `n_params` parameters.

    Parameters
    ----------
    n_params : int
    direction : {"forward", "inverse"}
        Whether a curve is a response (irradiance to brightness) or an inverse response.

    Attributes
    ----------
    prior_ : Prior or None
        Learned by `learn_prior`.
    """

    name: ClassVar[str]
    #: Whether `from_curves` learns the shape of the family from its curves.
    learns: ClassVar[bool] = False

    def __init__(self, n_params: int, direction: Direction) -> None:
        self.n_params = check_count("n_params", n_params)
        self.direction = check_direction(direction)
        self.prior_: Prior | None = None

    def __repr__(self) -> str:
        return f"{type(self).__name__}(n_params={self.n_params}, direction={self.direction!r})"

    @property
    def param_names(self) -> tuple[str, ...]:
        """The names of the parameters, in order."""
        return tuple(f"parameter {i + 1}" for i in range(self.n_params))

    @classmethod
    @abstractmethod
    def from_curves(cls, curves: ArrayLike, n_params: int, direction: Direction) -> Self:
        """Build the model, learning from training curves (n, 1024) of that direction whatever it learns."""

    @abstractmethod
    def decode(self, params: ArrayLike) -> Array:
        """Turn parameters (..., k) into curves (..., 1024)."""

    def decode_float32(self, params: ArrayLike) -> NDArray[np.float32]:
        """Decode parameters (n, k) in single precision: for dense tables."""
        return np.atleast_2d(self.decode(params)).astype(np.float32)

    @abstractmethod
    def jacobian(self, params: ArrayLike) -> Array:
        """Return the derivatives of the curves by the parameters: (..., k) gives (..., 1024, k)."""

    def decode_with_jacobian(self, params: ArrayLike) -> tuple[Array, Array]:
        """Return `decode` and `jacobian` together, which a model may do faster than one after the other."""
        return self.decode(params), self.jacobian(params)

    @abstractmethod
    def fit(self, curves: ArrayLike) -> Array:
        """Return the parameters (n, k) with the least MSE to each of the curves (n, 1024)."""

    def to_free(self, params: Array) -> Array:
        """Map parameters to unbounded ones, the space of the prior and of every search; identity here."""
        return params

    def from_free(self, free: Array) -> Array:
        """Undo `to_free`."""
        return free

    def free_slope(self, params: Array) -> Array:
        """Return the derivative of each parameter by its free one, shape (..., k)."""
        return np.ones_like(params)

    def learn_prior(self, curves: ArrayLike) -> Self:
        """Set `prior_` to the mean and covariance of the free parameters fitted to `curves` (n, 1024)."""
        self.prior_ = Prior.from_samples(self.to_free(self.fit(curves)))
        return self

    def nearest_valid(self, params: ArrayLike) -> Array:
        """Return the nearest monotone curves from (0, 0) to (1, 1) to the decoded ones, (..., 1024)."""
        return repair(self.decode(params))

    def _params(self, params: ArrayLike) -> Array:
        """Check parameters of shape (..., k)."""
        p = as_finite("params", params)
        if p.ndim < 1 or p.shape[-1] != self.n_params:
            raise InputError(f"params of shape {p.shape} do not fit {self!r}; use (..., {self.n_params})")
        return p


def refine(
    model: ResponseModel, targets: Array, starts: Array, evaluate: Evaluation | None = None, max_steps: int = 100
) -> Array:
    """Polish starts by batched least squares in free parameters and keep the best end of each curve.

    Parameters
    ----------
    model : ResponseModel
    targets : ndarray, shape (n, p)
        Curves, or some samples of them.
    starts : ndarray, shape (n, s, k)
        Parameters to start from, `s` for each curve.
    evaluate : callable, optional
        From parameters (m, k) to values (m, p) and their Jacobians (m, p, k); by default the whole curves.
    max_steps : int

    Returns
    -------
    ndarray, shape (n, k)
    """
    n, s, k = starts.shape
    owner = np.repeat(np.arange(n), s)
    evaluate = evaluate or model.decode_with_jacobian

    def objective(free: Array, rows: np.ndarray) -> tuple[Array, Array, Array]:
        params = model.from_free(free)
        values, jacobian = evaluate(params)
        return normal_equations(values - targets[owner[rows]], jacobian * model.free_slope(params)[:, None, :])

    free, cost = levenberg_marquardt(objective, model.to_free(starts).reshape(n * s, k), max_steps)
    best = np.argmin(cost.reshape(n, s), axis=1)
    return model.from_free(free.reshape(n, s, k)[np.arange(n), best])


def nearest_in_table(curves: ArrayLike, table: Array, decoded: NDArray[np.floating], n_best: int) -> Array:
    """Return the `n_best` rows of a parameter table whose curves lie nearest to each curve.

    One matrix product measures all distances: |a - b|^2 = |a|^2 - 2 a.b + |b|^2, and |a|^2 ranks nothing. Every
    eighth sample is enough to rank.

    Parameters
    ----------
    curves : array_like, shape (n, 1024)
    table : ndarray, shape (t, k)
    decoded : ndarray, shape (t, 1024)
        The curves of the table.
    n_best : int

    Returns
    -------
    ndarray, shape (n, n_best, k)
    """
    thin = decoded[:, ::8]
    distance = (thin**2).sum(axis=1) - 2.0 * as_curves(curves)[:, ::8] @ thin.T
    return table[np.argpartition(distance, n_best - 1, axis=1)[:, :n_best]]
