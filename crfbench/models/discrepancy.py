"""How a model misses curves: a discrepancy in log irradiance, on knots in brightness.

No family holds the response of every camera. What it misses of a curve that it has not seen is taken as a normal
process of log irradiance about the model's nearest curve, with a kernel K learned from such curves, and of an unknown
scale a: log g ~ N(log of the model's curve, a^2 K). Why a calibration must know of it: Brynjarsdottir and O'Hagan
2014, doi:10.1088/0266-5611/30/11/114007.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crfbench.curves import GRID, Array, evaluate
from crfbench.errors import InputError

DARKEST = 1e-3  # irradiance below which the logarithm is held


_B = np.linspace(1 / 255, 1.0, 20001)
_DENSITY = np.cumsum(1 / (_B + 0.03) + 0.35 / (1.01 - _B) + 1.0)
#: Brightnesses, from 1/255 to 1, at which log irradiance is kept: denser in the dark, where it bends, and near white.
KNOTS: Array = np.interp(np.linspace(_DENSITY[0], _DENSITY[-1], 64), _DENSITY, _B)
LOG_KNOTS: Array = np.log(KNOTS)

#: Scales of the discrepancy; at the least the family is nearly alone.
SCALES: Array = np.array([1 / 64, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0])


@dataclass(frozen=True)
class Discrepancy:
    """What is learned about the misses of a model, see `crfbench.calibration.learn_discrepancy`."""

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
