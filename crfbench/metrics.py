"""Distances between curves, statistics over cameras, and whether a curve can be a response at all."""

import numpy as np
from numpy.typing import ArrayLike

from crfbench.curves import Array
from crfbench.errors import InputError


def mse(a: ArrayLike, b: ArrayLike) -> Array:
    """Mean squared error over the last axis; shapes broadcast."""
    return np.mean(np.subtract(a, b, dtype=np.float64) ** 2, axis=-1)


def rmse(a: ArrayLike, b: ArrayLike) -> Array:
    """Root-mean-square error over the last axis, the paper's distance; shapes broadcast."""
    return np.sqrt(mse(a, b))


def summarise(values: ArrayLike) -> dict[str, float]:
    """Return mean, median, standard deviation (of the population), maximum and 95th percentile.

    Parameters
    ----------
    values : array_like, shape (n,)
        One distance a curve or camera.

    Raises
    ------
    InputError
        For no values, or values that are not finite.
    """
    v = np.asarray(values, dtype=np.float64)
    if v.ndim != 1 or not v.size or not np.isfinite(v).all():
        raise InputError(f"values of shape {v.shape} cannot be summarised; use a row of one or more finite numbers")
    return {
        "mean": float(v.mean()),
        "median": float(np.median(v)),
        "sd": float(v.std()),
        "max": float(v.max()),
        "p95": float(np.percentile(v, 95)),
    }


def total_variance(curves: ArrayLike) -> float:
    """Variance over a set of curves (divided by n), summed over the samples; 0 when all agree.

    Parameters
    ----------
    curves : array_like, shape (n, m)
    """
    return float(np.var(np.asarray(curves, dtype=np.float64), axis=0).sum())


def nonmonotone(curves: ArrayLike, tolerance: float = 1e-9) -> np.ndarray:
    """Say of each curve whether it falls anywhere by more than `tolerance`; shape (n,), bool."""
    return np.asarray((np.diff(_rows(curves)) < -tolerance).any(axis=1))


def out_of_range(curves: ArrayLike, tolerance: float = 1e-9) -> np.ndarray:
    """Say of each curve whether it leaves [0, 1] by more than `tolerance`; shape (n,), bool."""
    batch = _rows(curves)
    return np.asarray(((batch < -tolerance) | (batch > 1.0 + tolerance)).any(axis=1))


def off_endpoints(curves: ArrayLike, tolerance: float = 1e-6) -> np.ndarray:
    """Say of each curve whether it misses (0, 0) or (1, 1) by more than `tolerance`; shape (n,), bool."""
    return np.asarray(np.abs(_rows(curves)[:, [0, -1]] - (0.0, 1.0)).max(axis=1) > tolerance)


def _rows(curves: ArrayLike) -> Array:
    return np.atleast_2d(np.asarray(curves, dtype=np.float64))
