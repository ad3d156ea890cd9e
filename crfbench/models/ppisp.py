"""PPISP response: a toe and a shoulder joined smoothly at a centre, then a gamma (arXiv 2601.18336).

With toe t, shoulder s, gamma g, centre c, and a = s c / (t + (s - t) c), b = 1 - a:

    f(x) = [a (x / c)^t]^g                      for x <= c
    f(x) = [1 - b ((1 - x) / (1 - c))^s]^g      for x >  c

The two pieces meet in value and slope. t = s = 1 is the gamma curve.
"""

from collections.abc import Callable
from functools import cache
from itertools import product
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from crfbench.curves import GRID, Array, Direction, as_scaled_curves
from crfbench.errors import InputError
from crfbench.models.base import ClosedForm, nearest_in_table, refine
from crfbench.models.gamma import Gamma

Slopes = Callable[[], tuple[Array, ...]]

_INNER = GRID[1:-1]  # both ends are fixed, and the logarithms below are finite inside
_THIN = GRID[8:-1:16]  # enough to tell which start leads farthest
_TABLE = np.array(
    list(product((0.5, 1.0, 2.0, 4.0), (0.5, 1.0, 2.0, 4.0), np.geomspace(0.15, 6.0, 14), (0.2, 0.5, 0.8)))
)


class PPISP(ClosedForm):
    """Toe, shoulder, gamma (all above 0) and centre (inside 0..1): always monotone, from (0, 0) to (1, 1).

    In the inverse direction a curve is the exact inverse function of the formula above.

    Parameters
    ----------
    direction : {"inverse", "forward"}
    """

    name = "PPISP"
    equation = "y = [a (x/c)^{t}]^{γ} for x ≤ c, else y = [1 − b ((1 − x)/(1 − c))^{s}]^{γ}; a + b = 1"
    param_notes = (
        "t: above 1, shadows stay dark for longer",
        "s: above 1, bright tones flatten before white",
        "γ: below 1 brightens the whole picture, above 1 darkens it",
        "c: where toe and shoulder meet",
    )

    def __init__(self, direction: Direction = "inverse") -> None:
        super().__init__(4, direction)
        self.param_names = ("toe", "shoulder", "gamma", "centre")
        if direction == "inverse":
            self.equation = self.equation.translate(str.maketrans("xy", "yx"))

    @classmethod
    def from_curves(cls, curves: ArrayLike, n_params: int = 4, direction: Direction = "inverse") -> Self:
        """Build the model; there is nothing to learn."""
        if n_params != 4:
            raise InputError(f"n_params={n_params!r} is out of range for PPISP; use 4")
        return cls(direction)

    def decode(self, params: ArrayLike, dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """Turn (..., 4), ordered toe, shoulder, gamma, centre, into curves (..., 1024)."""
        inner = self._pieces(params, _INNER)[0]
        curves = np.pad(inner, [(0, 0)] * (inner.ndim - 1) + [(1, 1)])
        curves[..., -1] = 1.0
        return curves.astype(dtype, copy=False)

    def jacobian(self, params: ArrayLike) -> Array:
        """Differentiate the formula by toe, shoulder, gamma and centre; 0 at both ends."""
        inner = self._evaluate(params, _INNER)[1]
        return np.pad(inner, [(0, 0)] * (inner.ndim - 2) + [(1, 1), (0, 0)])

    def fit(self, curves: ArrayLike) -> Array:
        """Polish the best gamma curve and the six nearest of a table on every 16th sample, the best on all."""
        batch = as_scaled_curves(curves)
        # Gamma is nested in PPISP: started there, the fit is never worse than Gamma's.
        exponent = Gamma().fit(batch)[:, 0]
        starts = np.tile([1.0, 1.0, 1.0, 0.5], (len(batch), 7, 1))
        starts[:, 0, 2] = exponent if self.direction == "forward" else 1.0 / exponent
        starts[:, 1:] = nearest_in_table(batch, _TABLE, _decoded_table(self.direction), n_best=6)
        best = refine(self, batch[:, 8:-1:16], starts, lambda params: self._evaluate(params, _THIN))
        return refine(self, batch[:, 1:-1], best[:, None], lambda params: self._evaluate(params, _INNER))

    def to_unconstrained(self, params: Array) -> Array:
        """Return the logarithms of toe, shoulder and gamma and the logit of the centre."""
        centre = params[..., 3:]
        return np.concatenate([np.log(params[..., :3]), np.log(centre / (1.0 - centre))], axis=-1)

    def from_unconstrained(self, unconstrained: Array) -> Array:
        """Undo `to_unconstrained`, kept within what floating point can decode."""
        bounded = np.clip(unconstrained, -6.0, 6.0)
        return np.concatenate([np.exp(bounded[..., :3]), 1.0 / (1.0 + np.exp(-bounded[..., 3:]))], axis=-1)

    def unconstrained_slope(self, params: Array) -> Array:
        """Return the derivative of each parameter by its unconstrained one: p, and c (1 - c) for the centre."""
        return np.concatenate([params[..., :3], params[..., 3:] * (1.0 - params[..., 3:])], axis=-1)

    def _evaluate(self, params: ArrayLike, x: Array) -> tuple[Array, Array]:
        values, slopes = self._pieces(params, x)
        return values, np.stack(slopes(), axis=-1)

    def _pieces(self, params: ArrayLike, x: Array) -> tuple[Array, Slopes]:
        p = self._params(params)
        if (p <= 0).any() or (p[..., 3] >= 1).any():
            raise InputError("PPISP takes toe, shoulder and gamma above 0 and a centre between 0 and 1")
        t, s, g, c = (p[..., i, None] for i in range(4))
        return _forward(x, t, s, g, c) if self.direction == "forward" else _inverse(x, t, s, g, c)


def _shares(t: Array, s: Array, c: Array) -> tuple[Array, Array, tuple[Array, Array, Array]]:
    """Return a, b and the derivatives of a by t, s and c (those of b are their negatives)."""
    d = t * (1.0 - c) + s * c
    return s * c / d, t * (1.0 - c) / d, (-s * c * (1.0 - c) / d**2, t * c * (1.0 - c) / d**2, s * t / d**2)


def _forward(x: Array, t: Array, s: Array, g: Array, c: Array) -> tuple[Array, Slopes]:
    """Return the curve and its derivatives; p, the curve before its gamma, is kept as a logarithm."""
    a, b, (at, as_, ac) = _shares(t, s, c)
    low = x <= c
    log_u = np.where(low, np.log(x) - np.log(c), 0.0)
    log_v = np.where(low, -np.inf, np.log1p(-x) - np.log(1.0 - c))
    rest = b * np.exp(s * log_v)
    log_p = np.where(low, np.log(a) + t * log_u, np.log1p(-rest))
    curve = np.exp(g * log_p)

    def slopes() -> tuple[Array, ...]:
        odds = rest / (1.0 - rest)
        dt = np.where(low, at / a + log_u, odds * at / b)
        ds = np.where(low, as_ / a, odds * (as_ / b - np.where(low, 0.0, log_v)))
        dc = np.where(low, ac / a - t / c, odds * (ac / b - s / (1.0 - c)))
        return curve * g * dt, curve * g * ds, curve * log_p, curve * g * dc

    return curve, slopes


def _inverse(x: Array, t: Array, s: Array, g: Array, c: Array) -> tuple[Array, Slopes]:
    """Return the inverse function and its derivatives; 1 - p is computed without cancellation."""
    a, b, (at, as_, ac) = _shares(t, s, c)
    log_p = np.log(x) / g
    rest = -np.expm1(log_p)
    low = rest >= b
    log_u = np.where(low, log_p - np.log(a), 0.0) / t
    log_v = np.where(low, 0.0, np.log(rest) - np.log(b)) / s
    toe, shoulder = c * np.exp(log_u), (1.0 - c) * np.exp(log_v)

    def slopes() -> tuple[Array, ...]:
        dt = np.where(low, -toe * (log_u + at / a) / t, -shoulder * at / (b * s))
        ds = np.where(low, -toe * as_ / (a * t), shoulder * (log_v - as_ / b) / s)
        dg = np.where(low, -toe * log_p / (g * t), -shoulder * (1.0 - rest) * log_p / (g * s * rest))
        dc = np.where(low, toe * (1.0 / c - ac / (a * t)), shoulder * (1.0 / (1.0 - c) - ac / (b * s)))
        return dt, ds, dg, dc

    return np.where(low, toe, 1.0 - shoulder), slopes


@cache
def _decoded_table(direction: Direction) -> Array:
    return PPISP(direction).decode(_TABLE)
