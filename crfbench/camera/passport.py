"""The response passport, the curves of one camera with what is known of them, and linearising images by it."""

import re
from dataclasses import dataclass, field, replace
from datetime import date
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.calibration import Calibration
from crfbench.calibration.colour import to_raw
from crfbench.checks import as_finite, check_choice, check_count, check_number, refuse_masked
from crfbench.curves import Array, Direction, as_curves, as_valid_curves, check_direction, evaluate, invert, repair
from crfbench.errors import InputError

CHANNELS = {1: ("intensity",), 3: ("red", "green", "blue")}

_SHA256 = re.compile(r"[0-9a-f]{64}")
_MOST_BRIGHTNESS = 2.0  # of floats; what is less may be full scale and an overshoot
_MOST_FALL = 30.0  # of the coefficients of log V together; more is no lens
_TEXTS = ("camera", "model", "data_sha256", "version", "created")


@dataclass(frozen=True, eq=False, repr=False)
class Passport:
    """One camera's response and what is known of it; what is not known stays at its default.

    Parameters
    ----------
    direction : {"inverse", "forward"}
        Brightness to irradiance, or irradiance to brightness; of the curves and of the band.
    curves : array_like, shape (1024,), (1, 1024) or (3, 1024)
        Monotone, from (0, 0) to (1, 1): one curve for intensity, or red, green and blue. Kept read-only.
    low, high : array_like, same shape, optional
        A pointwise band about the curves.
    level : float, optional
        The probability that the band stands for, such as 0.9; given if and only if the band is.
    camera : str
    iso : int, optional
        Sensitivity setting that the curves hold for.
    model : str
        Name of the model that the curves were decoded from, such as "SLR-ldl-3".
    params : array_like, shape (c, k), optional
        Its parameters, a row a curve.
    data_sha256 : str
        SHA-256 of the data it was calibrated from, 64 small hexadecimal digits.
    valid_range : tuple of float
        Lowest and highest brightness, in [0, 1], that the data constrained; beyond it the curves extrapolate.
    created : str
        ISO date, such as "2026-01-31"; the caller says it, no clock is read.
    version : str
        Of the crfbench that made it; by default this one.
    white_level : int, optional
        That counted as brightness 1 in images of 16 bits, where it was not 65535.
    warnings : sequence of str
        What is to be said wherever the curves are used, in sentences: of doubt in the calibration, or of what was
        repaired in the curves of another program.
    matrix : array_like, shape (3, 3), optional
        What mixes RAW to the light that the three curves bend; given if and only if `soft` and `told` are.
    soft : float, optional
        How softly colours are drawn into the gamut, see `crfbench.calibration.colour`.
    told : bool, optional
        Whether the data told the matrix; else it is diagonal.
    vignetting : array_like, shape (k,), optional
        Coefficients a_k of log V(r) = a_1 r^2 + a_2 r^4 + ...: the share V of the light that is left at the distance r
        from the middle of the photograph, 1 in its corners. It holds for one lens, focal length and f-number.

    Examples
    --------
    >>> from crfbench.curves import GRID
    >>> Passport("inverse", GRID**2.2, camera="Coolcam 3")
    Passport('Coolcam 3', inverse, intensity)
    """

    direction: Direction
    curves: Array
    low: Array | None = None
    high: Array | None = None
    level: float | None = None
    camera: str = ""
    iso: int | None = None
    model: str = ""
    params: Array | None = None
    data_sha256: str = ""
    valid_range: tuple[float, float] = (0.0, 1.0)
    created: str = ""
    version: str = field(default_factory=lambda: version("crfbench"))
    white_level: int | None = None
    warnings: tuple[str, ...] = ()
    matrix: Array | None = None
    soft: float | None = None
    told: bool | None = None
    vignetting: Array | None = None

    def __post_init__(self) -> None:
        check_direction(self.direction)
        for name in _TEXTS:
            if not isinstance(getattr(self, name), str):
                raise InputError(f"{name}={getattr(self, name)!r} is not text; use a str")
        curves = np.array(as_valid_curves(self.curves))  # a copy, so that no change of the caller's array reaches it
        if len(curves) not in CHANNELS:
            raise InputError(f"{len(curves)} curves are not a passport's; use 1 (intensity) or 3 (red, green, blue)")
        self._set(curves=curves, **_checked_band(self.low, self.high, self.level, curves.shape))
        self._set(params=_checked_params(self.params, len(curves)), valid_range=_checked_range(self.valid_range))
        if not isinstance(self.warnings, list | tuple) or not all(isinstance(text, str) for text in self.warnings):
            raise InputError(f"warnings={self.warnings!r} are not texts; use a list of str")
        self._set(warnings=tuple(self.warnings))
        if self.iso is not None:
            self._set(iso=check_count("iso", self.iso))
        if self.white_level is not None:
            self._set(white_level=check_count("white_level", self.white_level, 255, 65535))
        self._set(**_checked_matrix(self.matrix, self.soft, self.told, len(curves)))
        if self.vignetting is not None:
            self._set(vignetting=_checked_vignetting(self.vignetting))
        _check_created(self.created)
        if self.data_sha256 and not _SHA256.fullmatch(self.data_sha256):
            raise InputError(f"data_sha256={self.data_sha256!r} is not a SHA-256; use 64 small hexadecimal digits")

    def __repr__(self) -> str:
        name = [repr(self.camera)] if self.camera else []
        return f"Passport({', '.join([*name, self.direction, *self.channels])})"

    @property
    def channels(self) -> tuple[str, ...]:
        """The names of the curves: "intensity", or "red", "green" and "blue"."""
        return CHANNELS[len(self.curves)]

    def in_direction(self, direction: str) -> Array:
        """Return the curves as responses ("forward") or inverse responses ("inverse"), shape (c, 1024)."""
        return self.curves if check_direction(direction) == self.direction else invert(self.curves)

    def channel(self, name: str) -> "Passport":
        """Return the passport of one of `channels`, as intensity."""
        if name not in self.channels:
            raise InputError(f"channel={name!r} is not in this passport; use one of {', '.join(self.channels)}")
        row = self.channels.index(name)
        low, high, params = (None if part is None else part[[row]] for part in (self.low, self.high, self.params))
        alone = replace(self, matrix=None, soft=None, told=None)
        return replace(alone, curves=self.curves[[row]], low=low, high=high, params=params)

    def falloff(self, height: int, width: int) -> NDArray[np.float32]:
        """Return the share of the light that vignetting leaves at each pixel, shape (height, width)."""
        if self.vignetting is None:
            raise InputError(
                f"{self!r} holds no vignetting; use one of a series of an evenly lit surface, see --vignette"
            )
        rows, columns = (np.arange(length, dtype=np.float64) + 0.5 for length in (height, width))
        squared = squared_radius((height, width), rows, columns)
        return np.exp(squared * np.polyval(self.vignetting[::-1], squared)).astype(np.float32)

    def _set(self, **values: Any) -> None:
        """Set checked values; only `__post_init__` may, as the class is frozen."""
        for name, value in values.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)


def _checked_band(low: Array | None, high: Array | None, level: object, shape: tuple[int, ...]) -> dict[str, Any]:
    if low is None and high is None and level is None:
        return {}
    if low is None or high is None or level is None:
        raise InputError("the band lacks one of low, high and level; use all three or none")
    low, high = np.array(as_curves(low)), np.array(as_curves(high))
    if not low.shape == high.shape == shape or (low > high).any():
        raise InputError(f"low {low.shape} and high {high.shape} are not a band; use low <= high of shape {shape}")
    number = as_finite("level", level)
    if number.ndim or not 0.0 < number < 1.0:
        raise InputError(f"level={level!r} is not a probability; use a number between 0 and 1, such as 0.9")
    return {"low": low, "high": high, "level": float(number)}


def _checked_params(params: ArrayLike | None, c: int) -> Array | None:
    if params is None:
        return None
    rows = np.array(as_finite("params", params), ndmin=2)
    if rows.ndim != 2 or len(rows) != c:
        raise InputError(f"params have the wrong shape, {rows.shape}, for {c} curves; use a row a curve")
    return rows


def _checked_range(valid_range: object) -> tuple[float, float]:
    values = as_finite("valid_range", valid_range)
    if values.shape != (2,) or not 0.0 <= values[0] < values[1] <= 1.0:
        raise InputError(f"valid_range={valid_range!r} is out of range; use two rising brightnesses in [0, 1]")
    return float(values[0]), float(values[1])


def _checked_matrix(matrix: ArrayLike | None, soft: object, told: object, c: int) -> dict[str, Any]:
    if matrix is None and soft is None and told is None:
        return {}
    if c != 3 or matrix is None or not isinstance(told, bool | np.bool_):
        raise InputError(f"matrix, soft={soft!r} and told={told!r} of {c} curves; use all with three curves, or none")
    rows, share = np.array(as_finite("matrix", matrix)), check_number("soft", soft, 0.0, 1.0)
    if rows.shape != (3, 3) or not abs(np.linalg.det(rows)) > 1e-9:
        raise InputError(f"the matrix is {rows.tolist()}; use one of shape (3, 3) that can be inverted")
    return {"matrix": rows, "soft": share, "told": bool(told)}


def _checked_vignetting(coefficients: ArrayLike) -> Array:
    values = np.array(as_finite("vignetting", coefficients))
    if values.ndim != 1 or not values.size or np.abs(values).sum() > _MOST_FALL:
        raise InputError(f"vignetting={values.tolist()} is out of range; use a row of numbers that log V(r) may have")
    return values


def squared_radius(shape: tuple[int, int], rows: Array, columns: Array) -> Array:
    """Return r^2 at places `rows` (m,) by `columns` (n,), in pixels from the upper left corner, shape (m, n).

    r is the distance from the middle of a photograph of `shape`, 1 in its corners.
    """
    middle = np.array(shape) / 2.0
    return np.asarray(((rows - middle[0]) ** 2)[:, None] + (columns - middle[1]) ** 2) / (middle**2).sum()


def _check_created(created: str) -> None:
    try:
        if created and date.fromisoformat(created).isoformat() != created:
            raise ValueError
    except ValueError:
        raise InputError(f"created={created!r} is not a valid date; use one like '2026-01-31'") from None


def linearise(
    image: ArrayLike,
    response: Calibration | Passport | ArrayLike,
    to: str = "light",
    vignette: bool = False,
) -> NDArray[np.float32]:
    """Return the irradiance of an image: linear in light, 1 where the brightness is greatest.

    Parameters
    ----------
    image : array_like, shape (h, w) or (h, w, 3)
        Brightness. Integers of 8 or 16 bits count from 0 to 255 or 65535; floats from 0 to 1, a little beyond
        which the curve's ends hold. The three channels are red, green and blue.
    response : Calibration, Passport, or array_like of shape (1024,), (1, 1024) or (3, 1024)
        Curves by themselves are inverse responses. One curve serves all channels.
    to : {"light", "camera"}
        Linear light of the image's own colours, or by the passport's matrix the camera's RAW.
    vignette : bool
        Whether to divide by the passport's vignetting; only then values may exceed 1.

    Returns
    -------
    ndarray of float32, shape of `image`

    Examples
    --------
    >>> from crfbench.curves import GRID
    >>> linearise(np.array([[0, 128, 255]], dtype=np.uint8), GRID**2).astype(float).round(3).tolist()
    [[0.0, 0.252, 1.0]]
    """
    if isinstance(response, Calibration):
        response = repair(response.curves)
    if vignette:
        if not isinstance(response, Passport):
            raise InputError("curves alone hold no vignetting; use a passport of a series calibrated with it")
        light = linearise(image, response, to=to)
        falloff = response.falloff(*light.shape[:2])
        return light / (falloff[..., None] if light.ndim == 3 else falloff)
    if check_choice("to", to, ("light", "camera")) == "camera":
        if not isinstance(response, Passport) or response.matrix is None or response.soft is None:
            raise InputError("to='camera' needs a colour matrix; use the passport of a chart with RAW, or to='light'")
        return _unit(to_raw(linearise(image, response), response.matrix, response.soft))
    refuse_masked("image", image)
    pixels = np.asarray(image)
    curves = response.in_direction("inverse") if isinstance(response, Passport) else as_valid_curves(response)
    if len(curves) not in (1, 3):
        raise InputError(f"{len(curves)} curves do not match the channels of an image; use 1 or 3")
    if not (pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] == 3)) or not pixels.size:
        raise InputError(f"the image has shape {pixels.shape}; use (h, w) or (h, w, 3)")
    if len(curves) == 3 and pixels.ndim == 2:
        raise InputError(
            f"three curves do not match a grey image of shape {pixels.shape}; use one of them, as "
            "passport.channel('green') or `crfbench convert --channel green` gives, or a colour image"
        )
    if pixels.dtype in (np.uint8, np.uint16):
        table = _unit(evaluate(curves, np.linspace(0.0, 1.0, np.iinfo(pixels.dtype).max + 1)))
        return look_up(pixels, table.T[:, None])
    return _unit(_interpolate(pixels, curves))


def look_up(
    pixels: NDArray[Any], table: NDArray[np.float32], out: NDArray[np.float32] | None = None
) -> NDArray[np.float32]:
    """Look every pixel up in a table of all its possible values, (levels, 1, c); shape of `pixels`."""
    import cv2

    found = cv2.LUT(np.ascontiguousarray(pixels), np.ascontiguousarray(table), out)
    return np.asarray(found, dtype=np.float32).reshape(pixels.shape)


def _interpolate(pixels: NDArray[Any], curves: Array) -> Array:
    if pixels.dtype.kind != "f":
        raise InputError(f"the pixels are {pixels.dtype}; use uint8, uint16 or floats")
    if not np.isfinite(pixels).all():
        raise InputError("the image holds NaN or infinite values; use finite floats from 0 to 1")
    if pixels.max() >= _MOST_BRIGHTNESS:
        raise InputError(f"the image reaches {pixels.max():.4g}; use floats from 0 to 1, or uint8 or uint16")
    if len(curves) == 1:
        return evaluate(curves[0], pixels.ravel()).reshape(pixels.shape)
    return evaluate(curves, pixels.reshape(-1, 3).T).T.reshape(pixels.shape)


def _unit(irradiance: Array) -> NDArray[np.float32]:
    return np.clip(irradiance, 0.0, 1.0).astype(np.float32)  # a valid curve may leave [0, 1] by a rounding
