"""Response curves on one common grid: check, evaluate, resample, invert, repair.

A *response* ``f`` maps irradiance to brightness, its *inverse response* ``g = f^-1`` maps brightness to
irradiance. A *curve* holds 1024 samples of either on ``linspace(0, 1, 1024)``, from (0, 0) to (1, 1).
"""

from typing import Literal, cast, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.checks import as_finite, as_numbers, check_choice, check_number
from crfbench.errors import InputError

Array = NDArray[np.float64]
Direction = Literal["forward", "inverse"]

N_SAMPLES = 1024
GRID: Array = np.linspace(0.0, 1.0, N_SAMPLES)
GRID.flags.writeable = False

_MOST = 10.0  # measured curves overshoot 1 by little; those of 8-bit values exceed this
_TILT = 1e-6  # a slope that makes plateaus invertible and moves no sample by more than itself


def check_direction(direction: str) -> Direction:
    """Return `direction` if it is "forward" or "inverse"."""
    return cast(Direction, check_choice("direction", direction, get_args(Direction)))


def axis_labels(direction: Direction) -> tuple[str, str]:
    """Return the x and y axis labels of a curve of that direction."""
    labels = ("irradiance (relative, 0 to 1)", "brightness (relative, 0 to 1)")
    return labels if check_direction(direction) == "forward" else labels[::-1]


def as_curves(curves: ArrayLike) -> Array:
    """Return curves, (1024,) or (n, 1024), as a float64 batch (n, 1024) of finite values."""
    batch = np.atleast_2d(as_numbers("curves", curves))
    if batch.ndim != 2 or batch.shape[1] != N_SAMPLES or not len(batch):
        raise InputError(f"curves have shape {np.shape(curves)}; use (1024,) or (n, 1024), resample() makes them")
    if not np.isfinite(batch).all():
        row = int(np.argmin(np.isfinite(batch).all(axis=1)))
        raise InputError(f"curve {row} holds NaN or infinite values; use finite samples in [0, 1]")
    return batch


def as_scaled_curves(curves: ArrayLike) -> Array:
    """Return `curves` as a batch to fit a model to; one plainly on another scale, as 8-bit values are, is refused."""
    batch = as_curves(curves)
    most = np.abs(batch).max(axis=1)
    if most.max() > _MOST:
        row = int(np.argmax(most > _MOST))
        raise InputError(f"curve {row} reaches {most[row]:.4g}; use samples on a scale of 0 to 1")
    return batch


def as_valid_curves(curves: ArrayLike, tolerance: float = 1e-6) -> Array:
    """Return `curves` as a batch if they are monotone and run from (0, 0) to (1, 1), but for `tolerance`."""
    batch, tolerance = as_curves(curves), check_number("tolerance", tolerance, 0.0)
    drop = -np.diff(batch, axis=1).min(axis=1)
    if drop.max() > tolerance:
        row = int(np.argmax(drop))
        raise InputError(f"curve {row} falls by {drop[row]:.3g} between two samples; use a monotone curve or repair()")
    ends = np.abs(batch[:, [0, -1]] - (0.0, 1.0)).max(axis=1)
    if ends.max() > tolerance:
        row = int(np.argmax(ends))
        raise InputError(f"curve {row} runs from {batch[row, 0]:.4g} to {batch[row, -1]:.4g}; use one from 0 to 1")
    return batch


def evaluate(curves: NDArray[np.floating], x: ArrayLike) -> Array:
    """Evaluate curves (..., 1024) between their samples: piecewise linear, held at the ends.

    Positions `x` in [0, 1] have shape (m,), one row for all curves, or (..., m), one row a curve; so has the result,
    (..., m).
    """
    at = as_finite("x", x)
    if np.shape(curves)[-1:] != (N_SAMPLES,) or at.ndim not in (1, np.ndim(curves)):
        raise InputError(f"curves have shape {np.shape(curves)} and x {at.shape}; use (..., 1024) and (m,) or (..., m)")
    # The grid is even, so the left neighbour is found by division, without a search.
    position = np.clip(at, 0.0, 1.0) * (N_SAMPLES - 1)
    left = np.minimum(position.astype(np.intp), N_SAMPLES - 2)
    if left.ndim == 1:
        low, high = curves[..., left], curves[..., left + 1]
    else:
        low = np.take_along_axis(curves, left, axis=-1)
        high = np.take_along_axis(curves, left + 1, axis=-1)
    return low + (position - left) * (high - low)


def resample(x: ArrayLike, y: ArrayLike) -> Array:
    """Bring one sampled response onto the grid, shifted and scaled to run from (0, 0) to (1, 1); shape (1024,).

    Positions `x` rise strictly and values `y` do not fall; both have shape (m,), m >= 2, and any units.
    """
    positions, values = as_finite("x", x), as_finite("y", y)
    if positions.ndim != 1 or positions.shape != values.shape or len(positions) < 2:
        raise InputError(f"x has shape {positions.shape} and y {values.shape}; use two equal rows of 2 or more values")
    if (np.diff(positions) <= 0).any() or (np.diff(values) < 0).any() or values[0] == values[-1]:
        raise InputError("x must increase strictly and y must rise without falling; sort or repair the samples first")
    unit = (positions - positions[0]) / (positions[-1] - positions[0])
    return np.interp(GRID, unit, (values - values[0]) / (values[-1] - values[0]))


def invert(curves: ArrayLike) -> Array:
    """Invert monotone curves: responses become inverse responses and the other way round.

    Parameters
    ----------
    curves : array_like, shape (1024,) or (n, 1024)
        Valid curves; a plateau inverts to a steep step.

    Returns
    -------
    ndarray, shape (1024,) or (n, 1024)
    """
    batch = (as_valid_curves(curves) + _TILT * GRID) / (1.0 + _TILT)
    inverse = reached_at(batch, np.broadcast_to(GRID, batch.shape))
    inverse[:, 0], inverse[:, -1] = 0.0, 1.0
    return inverse.reshape(np.shape(curves))


def reached_at(curves: Array, values: Array) -> Array:
    """Return where rising curves (n, 1024) reach values (n, m), both from 0 to 1, piecewise linear; shape (n, m)."""
    # Rows shifted apart make one increasing sequence, so one call serves all.
    shift = 2.0 * np.arange(len(curves))[:, None]
    flat = np.interp((values + shift).ravel(), (curves + shift).ravel(), np.tile(GRID, len(curves)))
    return flat.reshape(values.shape)


def repair(curves: ArrayLike) -> Array:
    """Return the nearest valid curves, (1024,) or (n, 1024): least squares over monotone ones from (0, 0) to (1, 1).

    Isotonic regression of the inner samples, clipped to [0, 1], is that projection exactly (the bounded
    isotonic fit is the clipped isotonic fit).
    """
    from scipy.optimize import isotonic_regression

    batch = as_curves(curves).copy()
    inner = batch[:, 1:-1]  # the ends are fixed, so they take no part in the regression
    for row in np.flatnonzero((np.diff(inner, axis=1) < 0).any(axis=1)):
        inner[row] = isotonic_regression(inner[row]).x
    np.clip(batch, 0.0, 1.0, out=batch)
    batch[:, 0], batch[:, -1] = 0.0, 1.0
    return batch.reshape(np.shape(curves))
