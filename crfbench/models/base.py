"""What every response model can do, and what is known of it beforehand: its prior, and how it misses real curves.

A model turns parameters ``(n, k)`` into curves ``(n, 1024)`` of one direction. To add one, write a `ClosedForm` with
`decode`, `jacobian` and `fit` in a file of its own and give it a line in ``MODELS`` of ``models/registry.py``, with the
numbers of parameters to tabulate it with:

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
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from crfbench.checks import as_finite, check_count, check_seed
from crfbench.curves import GRID, Array, Direction, as_curves, check_direction, evaluate, repair
from crfbench.errors import InputError
from crfbench.numerics import levenberg_marquardt, normal_equations

#: From parameters (m, k) to values (m, p) and their Jacobians (m, p, k).
Evaluation = Callable[[Array], tuple[Array, Array]]

DARKEST = 1e-3  # irradiance below which the logarithm is held


_B = np.linspace(1 / 255, 1.0, 20001)
_DENSITY = np.cumsum(1 / (_B + 0.03) + 0.35 / (1.01 - _B) + 1.0)
#: Brightnesses, from 1/255 to 1, at which log irradiance is kept: denser in the dark, where it bends, and near white.
KNOTS: Array = np.interp(np.linspace(_DENSITY[0], _DENSITY[-1], 64), _DENSITY, _B)
LOG_KNOTS: Array = np.log(KNOTS)

#: Scales of the discrepancy; at the least the family is nearly alone.
SCALES: Array = np.array([1 / 64, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0])


@dataclass(frozen=True)
class Prior:
    """A normal distribution over the unconstrained parameters of a model, or a mixture of that mean and covariance."""

    mean: Array  # shape (k,)
    covariance: Array  # shape (k, k)
    centres: Array | None = None  # shape (c, k); of a mixture
    weights: Array | None = None  # shape (c,); of the centres, they sum to 1

    @classmethod
    def from_samples(cls, samples: Array) -> Self:
        """Take mean and covariance from unconstrained parameters of shape (n, k), n > 1."""
        if np.ndim(samples) != 2 or len(samples) < 2:
            raise InputError(f"samples of shape {np.shape(samples)} give no prior; use (n, k) of two or more curves")
        return cls(samples.mean(axis=0), np.atleast_2d(np.cov(samples, rowvar=False)))

    @classmethod
    def from_centres(cls, centres: Array, weights: Array) -> Self:
        """Return a mixture about centres (c, k)."""
        if len(centres) < 2:
            raise InputError("1 centre gives no prior; use two or more curves")
        return cls(weights @ centres, np.cov(centres, rowvar=False, aweights=weights), centres, weights)

    def sample(self, n: int, seed: int) -> Array:
        """Draw unconstrained parameters, shape (n, k)."""
        generator, size = np.random.default_rng(check_seed(seed)), check_count("n", n, least=0)
        if self.centres is None:
            return generator.multivariate_normal(self.mean, self.covariance, size=size)
        return self.centres[generator.choice(len(self.centres), size, p=self.weights)]


@dataclass(frozen=True)
class Discrepancy:
    """How a model misses curves that it has not seen, see `crfbench.calibration.learn_discrepancy`.

    No family holds the response of every camera. What it misses is taken as a normal process of log irradiance about
    the model's nearest curve, with a kernel K on knots in brightness, and of an unknown scale a: log g ~ N(log of the
    model's curve, a^2 K). Brynjarsdottir and O'Hagan 2014, doi:10.1088/0266-5611/30/11/114007, on why a calibration
    must know of it.
    """

    factor: Array  # shape (64, r); F F' holds the leading directions of the kernel at the knots
    scale_weight: Array  # shape (6,); how often which of `SCALES`

    def __post_init__(self) -> None:
        if np.shape(self.factor)[:1] != KNOTS.shape or np.shape(self.scale_weight) != SCALES.shape:
            shapes = np.shape(self.factor), np.shape(self.scale_weight)
            raise InputError(f"a discrepancy has shapes {shapes}; use ({len(KNOTS)}, r) and ({len(SCALES)},)")

    @classmethod
    def from_kernel(cls, kernel: Array, scale_weight: Array, rank: int = 12) -> "Discrepancy":
        """Keep the leading directions of a kernel at the knots (64, 64)."""
        values, vectors = np.linalg.eigh(kernel)
        return cls(vectors[:, -rank:] * np.sqrt(np.maximum(values[-rank:], 0.0)), scale_weight)

    def blended(self, other: "Discrepancy") -> "Discrepancy":
        """Take half of the kernel from another discrepancy, the scales from this one."""
        halves = self.factor @ self.factor.T, other.factor @ other.factor.T
        return self.from_kernel(0.5 * (halves[0] + halves[1]), self.scale_weight)

    def kernel(self, rank: int = 8, length: float = 0.35, floor: float = 0.02) -> Array:
        """Return the kernel at the knots, (64, 64), made smooth.

        It keeps the `rank` leading directions, and what they leave out as a smooth process of the same variance and of
        `length` in log brightness, whose standard deviation is at least `floor`, but 0 at white.
        """
        directions, sizes, _ = np.linalg.svd(self.factor.astype(np.float64), full_matrices=False)
        leading = directions[:, :rank] * sizes[:rank]
        left = np.sqrt(np.maximum((self.factor**2).sum(axis=1) - (leading**2).sum(axis=1), 0.0)) + floor
        left = left * np.minimum(1.0, -LOG_KNOTS / 0.05)
        near = np.exp(-0.5 * ((LOG_KNOTS[:, None] - LOG_KNOTS) / length) ** 2)
        return np.asarray(leading @ leading.T + left[:, None] * near * left)


def at_knots(curves: NDArray[np.floating]) -> Array:
    """Return the log irradiance at the knots of inverse responses (n, 1024), shape (n, 64)."""
    return np.log(np.clip(evaluate(curves, KNOTS), DARKEST, None))


def between_knots(columns: NDArray[np.floating], brightness: Array) -> Array:
    """Interpolate columns at the knots (64, k) linearly in log brightness: (...,) gives (..., k)."""
    logs = np.log(np.clip(brightness, KNOTS[0], 1.0))
    left = np.clip(np.searchsorted(LOG_KNOTS, logs, side="right") - 1, 0, len(KNOTS) - 2)
    share = (logs - LOG_KNOTS[left]) / (LOG_KNOTS[left + 1] - LOG_KNOTS[left])
    low = columns[left]
    return np.asarray(low + share[..., None] * (columns[left + 1] - low))


# From the knots to the grid, by a matrix, and what the straight line below the first knot takes off.
_TO_GRID: Array = between_knots(np.eye(len(KNOTS)), GRID).T
_IN_THE_DARK: Array = np.minimum(GRID / KNOTS[0], 1.0)


def from_knots(logs: NDArray[np.floating]) -> NDArray[Any]:
    """Return inverse responses (..., 1024) of log irradiance at the knots (..., 64); below them straight to 0."""
    g = logs @ _TO_GRID.astype(logs.dtype)
    np.exp(g, out=g)
    g *= _IN_THE_DARK.astype(logs.dtype)
    return g


class ResponseModel(ABC):
    """A family of response curves with `n_params` parameters.

    Parameters
    ----------
    n_params : int
    direction : {"inverse", "forward"}
        Whether a curve is an inverse response or a response (irradiance to brightness).

    Attributes
    ----------
    param_names : tuple of str, length n_params
    prior_ : Prior or None
        Learned by `learn_prior`; models from `crfbench.load_model` have one.
    discrepancy_ : Discrepancy or None
        How the model misses curves, learned by `crfbench.calibration.learn_discrepancy`; bundled models have one.
    """

    name: ClassVar[str]
    #: The formula of a curve y over x, with ^{...} and _{...}, and what each parameter does; for widgets.
    equation: str = ""
    param_notes: tuple[str, ...] = ()

    def __init__(self, n_params: int, direction: Direction = "inverse") -> None:
        self.n_params = check_count("n_params", n_params)
        self.direction = check_direction(direction)
        self.param_names: tuple[str, ...] = tuple(f"parameter {i + 1}" for i in range(self.n_params))
        self.prior_: Prior | None = None
        self.discrepancy_: Discrepancy | None = None

    def __repr__(self) -> str:
        return f"{type(self).__name__}(n_params={self.n_params}, direction={self.direction!r})"

    @abstractmethod
    def decode(self, params: ArrayLike, dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """Turn parameters (..., k) into curves (..., 1024) of that precision; float32 serves dense tables."""

    @abstractmethod
    def jacobian(self, params: ArrayLike) -> Array:
        """Return the derivatives of the curves by the parameters: (..., k) gives (..., 1024, k)."""

    def decode_with_jacobian(self, params: ArrayLike) -> tuple[Array, Array]:
        """Return `decode` and `jacobian` together, which a model may do faster than one after the other."""
        return self.decode(params), self.jacobian(params)

    @abstractmethod
    def fit(self, curves: ArrayLike) -> Array:
        """Return the parameters (n, k) with the least MSE to each of the curves (n, 1024)."""

    def sample(self, n: int, seed: int) -> Array:
        """Draw parameters of `n` plausible curves from the prior, shape (n, k)."""
        if self.prior_ is None:
            raise InputError(f"{self!r} has no prior to draw from; use load_model(name) or learn_prior(curves)")
        return self.from_unconstrained(self.prior_.sample(n, seed))

    # Searches and priors need parameters that may take any value; identity serves models whose parameters do.
    def to_unconstrained(self, params: Array) -> Array:
        """Map parameters to unconstrained ones, the space of the prior and of every search; identity here."""
        return params

    def from_unconstrained(self, unconstrained: Array) -> Array:
        """Undo `to_unconstrained`."""
        return unconstrained

    def unconstrained_slope(self, params: Array) -> Array:
        """Return the derivative of each parameter by its unconstrained one, shape (..., k)."""
        return np.ones_like(params)

    def learn_prior(self, curves: ArrayLike) -> Self:
        """Set `prior_` to the mean and covariance of the unconstrained parameters fitted to `curves` (n, 1024)."""
        self.prior_ = Prior.from_samples(self.to_unconstrained(self.fit(curves)))
        return self

    def nearest_valid(self, params: ArrayLike) -> Array:
        """Return the nearest monotone curves from (0, 0) to (1, 1) to the decoded ones, (..., 1024)."""
        return repair(self.decode(params))

    def _params(self, params: ArrayLike) -> Array:
        p = as_finite("params", params)
        if p.ndim < 1 or p.shape[-1] != self.n_params:
            raise InputError(f"params of shape {p.shape} have the wrong shape for {self!r}; use (..., {self.n_params})")
        return p


class ClosedForm(ResponseModel):
    """A model with a formula, which is built from training curves in one step; networks are trained instead."""

    #: Whether `from_curves` learns the shape of the family from its curves.
    learns: ClassVar[bool] = False

    @classmethod
    def from_curves(cls, curves: ArrayLike, n_params: int, direction: Direction = "inverse") -> Self:
        """Build the model, learning whatever it learns from curves (n, 1024) of that direction; here nothing."""
        return cls(n_params, direction)


def refine(
    model: ResponseModel, targets: Array, starts: Array, evaluate: Evaluation | None = None, max_steps: int = 100
) -> Array:
    """Polish starts by batched least squares in unconstrained parameters and keep the best end of each curve.

    `targets` (n, p) are curves or some samples of them; `starts` (n, s, k) are parameters, `s` for each curve.
    `evaluate` turns parameters (m, k) into values (m, p) and Jacobians (m, p, k); by default of whole
    curves. Returns (n, k).
    """
    n, s, k = starts.shape
    owner = np.repeat(np.arange(n), s)
    evaluate = evaluate or model.decode_with_jacobian

    def objective(unconstrained: Array, rows: np.ndarray) -> tuple[Array, Array, Array]:
        params = model.from_unconstrained(unconstrained)
        values, jacobian = evaluate(params)
        cost, normal, gradient = normal_equations(values - targets[owner[rows]], jacobian)
        # The chain rule: the search moves the unconstrained parameters.
        slope = model.unconstrained_slope(params)
        return cost, normal * (slope[:, :, None] * slope[:, None]), gradient * slope

    ends, cost = levenberg_marquardt(objective, model.to_unconstrained(starts).reshape(n * s, k), max_steps)
    best = np.argmin(cost.reshape(n, s), axis=1)
    return model.from_unconstrained(ends.reshape(n, s, k)[np.arange(n), best])


def nearest_in_table(curves: ArrayLike, table: Array, decoded: NDArray[np.floating], n_best: int) -> Array:
    """Return the `n_best` rows of a parameter table (t, k) whose curves lie nearest to each curve, (n, n_best, k).

    One matrix product measures all distances to the table's curves `decoded` (t, 1024): |a - b|^2 = |a|^2 - 2 a.b +
    |b|^2, and |a|^2 ranks nothing. Every eighth sample is enough to rank.
    """
    thin = decoded[:, ::8]
    distance = (thin**2).sum(axis=1) - 2.0 * as_curves(curves)[:, ::8] @ thin.T
    return table[np.argpartition(distance, n_best - 1, axis=1)[:, :n_best]]
