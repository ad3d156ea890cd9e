"""What a calibration sees: the brightness of patches in photographs, and what is known about their irradiance."""

from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.checks import as_finite
from crfbench.curves import Array, evaluate
from crfbench.errors import InputError

#: Brightness at which 8-bit JPEG counts as saturated; 0 counts as black.
SATURATED = 254 / 255

#: Relative standard deviation of a reference value that comes from a printed chart under real light.
REFERENCE_ERROR = 0.05

UNKNOWN = 1e3  # standard deviation, in log units, of what is not known at all

_GAMMA = 2.2  # of a typical response; tells how an uneven colour shifts a mean of brightnesses
_MOST = 1e6  # observations that one patch may count for
_EXTREME = 1e30  # beyond, the fourth power of a reference leaves floating point
_STOPS = 100.0  # from the least to the greatest exposure


class Observations:
    """Photographs of patches, for one calibration or a batch of `n`.

    Parameters
    ----------
    brightness : array_like, shape (e, p) or (n, e, p)
        Of `p` patches in `e` photographs, from 0 to 1; values of a masked array that are masked weigh nothing.
    reference : array_like, shape (p,) or (n, p), optional
        Irradiance of each patch in any unit; None when it is not known (then `exposures` must be).
    exposures : array_like, shape (e,) or (n, e), optional
        Exposure of each photograph in stops, from any zero; None when it is not known.
    clipped : array_like of bool, shape (e, p) or (n, e, p), optional
        Patches that say only "at least this bright" (or "at most", below mid brightness); by default those at 0 or
        from `SATURATED`.
    weights : array_like, shape (p,), (e, p) or (n, e, p), optional
        How many observations each counts for; 0 leaves it out. Default 1.
    reference_error : array_like, shape (p,) or (n, p), optional
        Relative standard deviation of each reference value, the same in all photographs.
    absolute : bool
        Whether reference x 2^exposure is irradiance in units of full scale, as RAW files tell it, so that the scale is
        known too. It needs both.
    colour : array_like, shape (p,) or (n, p), optional
        By how much, in log, the mean of the channels of a coloured patch lies above its brightness (`colour_error`).
        With a discrepancy the reference is lowered so far, and the patch counts for less.
    """

    def __init__(
        self,
        brightness: ArrayLike,
        reference: ArrayLike | None = None,
        exposures: ArrayLike | None = None,
        clipped: ArrayLike | None = None,
        weights: ArrayLike | None = None,
        reference_error: ArrayLike = REFERENCE_ERROR,
        absolute: bool = False,
        colour: ArrayLike = 0.0,
    ) -> None:
        masked = np.ma.getmaskarray(brightness) if isinstance(brightness, np.ma.MaskedArray) else np.False_
        b = as_finite("brightness", np.ma.filled(brightness, 0.5) if masked.any() else brightness)
        if b.ndim not in (2, 3) or not b.size:
            raise InputError(f"brightness has shape {b.shape}; use (images, patches) or (n, images, patches), none 0")
        if b.min() < 0 or b.max() > 1:
            raise InputError(f"brightness runs from {b.min():g} to {b.max():g}; use values from 0 to 1")
        self.brightness: Array = b[None] if b.ndim == 2 else b
        b = self.brightness
        n, e, p = b.shape
        beyond = (b <= 0) | (b >= SATURATED) if clipped is None else as_finite("clipped", clipped) != 0
        self.clipped: NDArray[np.bool_] = fit_shape("clipped", beyond, (n, e, p))
        self.weights: Array = fit_shape(
            "weights", as_finite("weights", 1.0 if weights is None else weights) * ~masked, (n, e, p)
        )
        if self.weights.min() < 0 or self.weights.max() > _MOST:
            raise InputError(f"weights run from {self.weights.min():g} to {self.weights.max():g}; use 0 to {_MOST:g}")
        self.reference = None if reference is None else _positive("reference", reference, (n, p))
        self.reference_error = _positive("reference_error", reference_error, (n, p))
        self.exposures = None if exposures is None else _stops(exposures, (n, e))
        self.colour: Array = fit_shape("colour", as_finite("colour", colour), (n, p))
        self.absolute = bool(absolute)
        if self.absolute and (reference is None or exposures is None):
            raise InputError("absolute=True needs both reference and exposures; give them, or leave it out")
        self._check_information()

    def __repr__(self) -> str:
        n, photographs, patches = self.brightness.shape
        known = [name for name in ("reference", "exposures") if getattr(self, name) is not None]
        return f"Observations({n} x {photographs} photographs x {patches} patches; {' and '.join(known)} known)"

    def __len__(self) -> int:
        return len(self.brightness)

    @property
    def counts(self) -> NDArray[np.bool_]:
        """Which observations are measurements: neither clipped nor left out; shape (n, e, p)."""
        return (self.weights > 0) & ~self.clipped

    def decoded(self, curves: Array) -> Array:
        """Return the irradiance of each observation by the curve (n, 1024) of its set, shape (n, e, p)."""
        return evaluate(curves, self.brightness.reshape(len(self), -1)).reshape(self.brightness.shape)

    def exposure_precision(self, error: float) -> Array:
        """Return the precision of log exposures that err by so many stops, before any data, (e, e).

        Unless the reference is absolute, only their differences are known.
        """
        sigma, e = UNKNOWN if self.exposures is None else error * np.log(2), self.brightness.shape[1]
        mean = np.full((e, e), 1.0 / e)
        return np.asarray((np.eye(e) - mean + self.absolute * mean) / sigma**2 + np.eye(e) / UNKNOWN**2)

    @classmethod
    def from_rgb(cls, rgb: ArrayLike, reference: ArrayLike | None = None, **others: Any) -> Self:
        """Observe intensities, the means of red, green and blue; coloured patches count for less (`colour_error`).

        Parameters
        ----------
        rgb : array_like, shape (e, p, 3) or (n, e, p, 3)
            Brightness of each channel, from 0 to 1.
        reference : array_like, shape (p,) or (n, p), optional
        **others
            Further parameters of `Observations`.
        """
        channels = as_finite("rgb", rgb)
        if channels.ndim not in (3, 4) or channels.shape[-1] != 3:
            raise InputError(f"rgb has shape {channels.shape}; use (images, patches, 3) or (n, images, patches, 3)")
        colour = colour_error(channels)
        defaults = {"reference_error": np.hypot(REFERENCE_ERROR, colour), "colour": colour}
        return cls(channels.mean(axis=-1), reference, **{**defaults, **others})

    def weighed(self, factor: Array) -> Self:
        """Let each observation count for so many times as many."""
        return self._picked(slice(None), slice(None), weights=self.weights * factor)

    def of_sets(self, sets: slice | NDArray[np.intp]) -> Self:
        """Keep some of the `n` sets."""
        return self._picked(sets, slice(None))

    def take(self, patches: Sequence[int] | NDArray[np.intp]) -> Self:
        """Keep some patches, by index from 0."""
        chosen, p = np.asarray(patches), self.brightness.shape[-1]
        whole = chosen.ndim == 1 and chosen.dtype.kind in "iu" and chosen.size > 0
        if not (whole and chosen.min() >= 0 and chosen.max() < p):
            raise InputError(f"patches={patches!r} are out of range; use one or more whole numbers from 0 to {p - 1}")
        return self._picked(slice(None), chosen)

    def _picked(self, sets: slice | NDArray[np.intp], patches: slice | NDArray[np.intp], **others: Any) -> Self:
        names = ("brightness", "reference", "clipped", "weights", "reference_error", "colour")
        parts: dict[str, Any] = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        kept = {name: part[sets][..., patches] for name, part in parts.items()}
        exposures = None if self.exposures is None else self.exposures[sets]
        return type(self)(**{**kept, **others}, exposures=exposures, absolute=self.absolute)

    def _check_information(self) -> None:
        """Refuse sets that tell nothing, naming the first of them."""
        if self.reference is None and self.exposures is None:
            raise InputError("neither reference nor exposures are given; use one of them, or both")
        counts = self.counts
        repeated = (counts.sum(axis=1) >= 2).any(axis=1)
        if self.reference is None and not repeated.all():
            row = int(np.argmin(repeated))
            raise InputError(f"no patch of observations {row} is unclipped in 2 photographs; use more exposures")
        patches = counts.any(axis=1).sum(axis=1)
        if self.reference is not None and patches.min() < 2:
            row = int(np.argmin(patches))
            raise InputError(f"unclipped patches of observations {row}: {patches[row]}; use 2 or more")
        low = np.where(counts, self.brightness, np.inf).min(axis=(1, 2))
        same = np.where(counts, self.brightness, -np.inf).max(axis=(1, 2)) <= low
        if same.any():
            row = int(np.argmax(same))
            raise InputError(f"all patches of observations {row} have brightness {low[row]:g}; use patches that differ")


def colour_spread(rgb: Array) -> Array:
    """Return the standard deviation of the channels as a share of their mean, (..., e, p, 3) to (..., p)."""
    return np.asarray((rgb.std(axis=-1) / np.maximum(rgb.mean(axis=-1), 1 / 255)).mean(axis=-2))


def colour_error(rgb: Array) -> Array:
    """Return the relative error of a patch's irradiance for its colour, (..., e, p, 3) to (..., p).

    A camera bends each channel by itself, and the mean of bent values is not the bent mean. With a response near gamma
    2.2 and channels that spread by a share c of their mean, the intensity is off by about 2.2 (2.2 - 1) / 2 c^2.
    """
    return _GAMMA * (_GAMMA - 1) / 2 * colour_spread(rgb) ** 2


def _positive(name: str, values: ArrayLike, shape: tuple[int, int]) -> Array:
    array = as_finite(name, values)
    if array.size and not 1 / _EXTREME <= array.min() <= array.max() <= _EXTREME:
        low, high = array.min(), array.max()
        raise InputError(f"{name} runs from {low:g} to {high:g}; use values above 0, {1 / _EXTREME:g} to {_EXTREME:g}")
    return fit_shape(name, array, shape)


def _stops(values: ArrayLike, shape: tuple[int, int]) -> Array:
    array = as_finite("exposures", values)
    if array.size and np.ptp(array) > _STOPS:
        raise InputError(f"exposures span {np.ptp(array):g} stops; use stops, the base-2 logarithm of exposure")
    return fit_shape("exposures", array, shape)


def fit_shape(name: str, array: NDArray, shape: tuple[int, ...]) -> NDArray:
    """Broadcast to the shape of the brightness, or say that it cannot be."""
    try:
        return np.broadcast_to(array, shape)
    except ValueError:
        raise InputError(
            f"{name} has shape {array.shape}, which the brightness does not have; use {shape} or what broadcasts to it"
        ) from None
