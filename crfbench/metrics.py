"""Distances between curves, statistics over cameras, and whether a curve can be a response at all."""

import numpy as np
from numpy.typing import ArrayLike

from crfbench.checks import as_finite, as_numbers
from crfbench.curves import Array
from crfbench.errors import InputError

_TOLERANCE = 1e-9  # of rounding


def mse(a: ArrayLike, b: ArrayLike) -> Array:
    """Mean squared error of a and b, (..., m), over the last axis, shape (...); shapes broadcast, NaN gives NaN."""
    x, y = as_numbers("a", a), as_numbers("b", b)
    try:
        x, y = np.broadcast_arrays(x, y)
        if not x.size:
            raise ValueError
    except ValueError:
        raise InputError(f"a has shape {x.shape} and b {y.shape}; use (..., m), which broadcast") from None
    return np.mean((x - y) ** 2, axis=-1)


def rmse(a: ArrayLike, b: ArrayLike) -> Array:
    """Root-mean-square error over the last axis, the paper's distance; as `mse`.

    Parameters
    ----------
    a, b : array_like, shape (..., m)

    Returns
    -------
    ndarray, shape (...)
    """
    return np.sqrt(mse(a, b))


def summarise(values: ArrayLike) -> dict[str, float]:
    """Return mean, median, standard deviation (of the population), maximum and 95th percentile of values (n,)."""
    v = as_finite("values", values)
    if v.ndim != 1 or not v.size:
        raise InputError(f"values of shape {v.shape} cannot be summarised; use a row of one or more numbers")
    return {name: float(statistic) for name, statistic in statistics(v).items()}


def statistics(values: ArrayLike) -> dict[str, Array]:
    """Return the statistics of `summarise` along the last axis: from shape (..., n) to (...) each."""
    v = np.asarray(values, dtype=np.float64)
    return {
        "mean": v.mean(axis=-1),
        "median": np.median(v, axis=-1),
        "sd": v.std(axis=-1),
        "max": v.max(axis=-1),
        "p95": np.percentile(v, 95, axis=-1),
    }


def total_variance(curves: ArrayLike) -> float:
    """Variance over a set of curves (n, m), divided by n and summed over the samples; 0 when all agree."""
    return float(np.var(_batch(curves), axis=0).sum())


def nonmonotone(curves: ArrayLike) -> np.ndarray:
    """Say of each curve (n, m) whether it falls anywhere by more than 1e-9; shape (n,), bool."""
    return np.asarray((np.diff(_batch(curves), axis=-1) < -_TOLERANCE).any(axis=-1))


def out_of_range(curves: ArrayLike) -> np.ndarray:
    """Say of each curve (n, m) whether it leaves [0, 1] by more than 1e-9; shape (n,), bool."""
    batch = _batch(curves)
    return np.asarray(((batch < -_TOLERANCE) | (batch > 1.0 + _TOLERANCE)).any(axis=-1))


def _batch(curves: ArrayLike) -> Array:
    """Return curves of any length as (n, m); of NaN nothing can be said, so it is refused."""
    batch = np.atleast_2d(as_finite("curves", curves))
    if batch.ndim != 2 or not batch.size:
        raise InputError(f"curves have shape {np.shape(curves)}; use (n, m) or (m,)")
    return batch
