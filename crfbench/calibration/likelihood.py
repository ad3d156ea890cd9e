"""How probable observations are under a curve: Gaussian in log irradiance, with what is not known eliminated.

For patch p in photograph e, with g the inverse response and b the brightness,

    log g(b_ep) = log r_p + u_p + s_e + v_ep

r_p is the reference and u_p its error, the same in all photographs; s_e is the exposure, unknown or known to some
accuracy; v_ep is the error of the brightness. u and s are Gaussian, so they are eliminated in closed form. What remains
is a quadratic form of the left side: the squared distance to the nearest irradiances that the scene could have had.
Logarithms are used because a residual in units of irradiance rewards curves that shrink everything.
"""

from dataclasses import dataclass

import numpy as np

from crfbench.calibration.observations import Observations
from crfbench.checks import check_number
from crfbench.curves import Array

#: Irradiance below which the logarithm is held.
DARKEST = 1e-4

_GAMMA = 2.2  # slope of log irradiance over log brightness, of a typical response
_UNKNOWN = 1e3  # standard deviation, in log units, of what is not known at all
_LEAST = 1e-6  # standard deviation; sums over known and unknown lose no digits that count
_SHARPEST = 1e8  # precision of one log irradiance, for the same reason

#: Which of the sets of observations arrays belong to.
Sets = np.ndarray | slice


@dataclass(frozen=True)
class Noise:
    """What is not exact, as standard deviations."""

    # of a patch's brightness, in units of the full range; a share 2.2 `brightness` / b of the irradiance
    brightness: float = 0.02
    exposure: float = 0.1  # of each known exposure, in stops
    # the share of the observations that count as independent. How a model misses a real curve varies slowly along it,
    # so that neighbours repeat each other; by default four photographs of one chart count as one
    independent: float = 0.25
    # degrees of freedom with which these figures are believed; the data may scale all of them together
    freedom: float = 2.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check_number(f"noise {name}", value, _LEAST, 1 / _LEAST)

    def relative(self, brightness: Array) -> Array:
        """Return the relative standard deviation of the irradiance that the brightness of a patch tells."""
        return _GAMMA * self.brightness / np.maximum(brightness, 1 / 255)


class Likelihood:
    """The likelihood of `n` sets of observations.

    The methods take arrays (m, e, p, k) for some of the sets, `sets`: k curves, or a residual and its derivatives.
    """

    def __init__(self, observations: Observations, noise: Noise) -> None:
        counts = observations.counts
        self.variance = noise.relative(observations.brightness) ** 2
        self.precision = counts * np.minimum(observations.weights / self.variance, _SHARPEST)
        known = observations.reference is not None
        self.error = np.clip(observations.reference_error, _LEAST, _UNKNOWN) if known else _UNKNOWN
        self.offset = _offset(observations)
        # Variance that is left of each patch's reference error u_p once its photographs have been seen.
        self._share = 1.0 / (self.precision.sum(axis=1) + np.broadcast_to(self.error, self.precision[:, 0].shape) ** -2)
        sigma = _UNKNOWN if observations.exposures is None else noise.exposure * np.log(2)
        e = self.precision.shape[1]
        # Unless the reference is absolute, only the differences of the exposures are known to `sigma`.
        self._prior = (np.eye(e) - 1.0 / e) / sigma**2 + np.eye(e) / _UNKNOWN**2
        if observations.absolute:
            self._prior += np.full((e, e), 1.0 / e) / sigma**2
        self._inverse = np.linalg.inv(self._exposure_precision() + self._prior)
        self.freedom = self._degrees(observations)
        self.clip = self._clip(observations)

    def _exposure_precision(self) -> Array:
        """Return the precision of the exposures that the data give, (n, e, e)."""
        weighted = self.precision * self._share[:, None]
        own = np.eye(weighted.shape[1]) * self.precision.sum(axis=2)[:, None]
        return np.asarray(own - weighted @ np.swapaxes(self.precision, 1, 2))

    def _degrees(self, observations: Observations) -> Array:
        """Count the observations beyond those that the eliminated unknowns take up; at least 1."""
        counts = observations.counts
        n = (counts * observations.weights).sum(axis=(1, 2))
        scales = counts.any(axis=2).sum(axis=1) if observations.exposures is None else 1 - observations.absolute
        patches = counts.any(axis=1).sum(axis=1) - 1 if observations.reference is None else 0
        return np.maximum(n - scales - patches, 1.0)

    def _clip(self, observations: Observations) -> Array:
        """Return 1 / sigma of clipped patches that others give a scale to, negative for black ones, else 0."""
        counts = observations.counts
        told = observations.clipped & (observations.weights > 0)
        # A photograph of unknown exposure that is all clipped says nothing, nor does a patch of unknown irradiance.
        if observations.exposures is None:
            told = told & counts.any(axis=2, keepdims=True)
        if observations.reference is None:
            told = told & counts.any(axis=1, keepdims=True)
        sigma = np.sqrt(self.variance + np.broadcast_to(self.error, self._share.shape)[:, None] ** 2)
        return np.where(told, np.where(observations.brightness > 0.5, 1.0, -1.0) / sigma, 0.0)

    def residual(self, g: Array, sets: Sets) -> Array:
        """Return log g minus the log irradiance that reference and exposure tell, for g of shape (m, e, p, k)."""
        return np.log(np.maximum(g, DARKEST)) - self.offset[sets][..., None]

    def squares(self, d: Array, sets: Sets) -> tuple[Array, Array]:
        """Return d^T M d, shape (m, k), and the exposures (m, e, k) of residuals (m, e, p, k).

        M is the precision of the residuals after the unknowns are eliminated.
        """
        w = self.precision[sets]
        weighted = w[..., None] * d
        by_patch = weighted.sum(axis=1)
        total = np.einsum("nepk,nepk->nk", weighted, d)
        total -= np.einsum("npk,np,npk->nk", by_patch, self._share[sets], by_patch)
        h = weighted.sum(axis=2) - w @ (self._share[sets][..., None] * by_patch)
        exposures = self._inverse[sets] @ h
        return np.maximum(total - np.einsum("nek,nek->nk", h, exposures), 0.0), exposures

    def products(self, d: Array, sets: Sets) -> tuple[Array, Array]:
        """Return d^T M d between all columns, shape (m, k, k), and the exposures; see `squares`.

        A sum of squares: slower, but positive and smooth whatever the rounding.
        """
        w = self.precision[sets][..., None]
        exposures = self.squares(d, sets)[1]
        rest = d - exposures[:, :, None]
        errors = self._share[sets][..., None] * (w * rest).sum(axis=1)
        rest -= errors[:, None]
        eliminated = errors / np.broadcast_to(self.error, self._share.shape)[sets][..., None]
        product = np.einsum("mepi,mepj->mij", w * rest, rest) + np.swapaxes(eliminated, 1, 2) @ eliminated
        return product + np.swapaxes(exposures, 1, 2) @ self._prior @ exposures, exposures

    def margins(self, d: Array, exposures: Array, sets: Sets) -> tuple[np.ndarray, Array]:
        """Return by how many standard deviations each clipped patch lies beyond its brightness, shape (c, k).

        Before it, which of the sets each belongs to, shape (c,). The margin is linear in `d`; the probability of what
        was seen is the normal distribution function of it.
        """
        clip = self.clip[sets]
        i, e, p = np.nonzero(clip)
        return i, (exposures[i, e] - d[i, e, p]) * clip[i, e, p][:, None]


def _offset(observations: Observations) -> Array:
    """Return the log irradiance that reference and exposure tell, shape (n, e, p).

    Unless the reference is absolute it is centred, so that nothing depends on the reference's unit or the zero of the
    exposures.
    """
    offset = np.zeros(observations.brightness.shape)
    if observations.reference is not None:
        offset += np.log(observations.reference)[:, None, :]
    if observations.exposures is not None:
        offset += np.log(2.0) * observations.exposures[:, :, None]
    if observations.absolute:
        return offset
    counts = observations.counts
    return offset - (counts * offset).sum(axis=(1, 2), keepdims=True) / counts.sum(axis=(1, 2), keepdims=True)
