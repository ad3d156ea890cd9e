"""What a photograph says of its exposure (EXIF 2.32, CIPA DC-008), and exposures in stops."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from crfbench.charts.reading import RAW_SUFFIXES, exif_tags, open_image, open_raw
from crfbench.curves import Array

_MODEL, _EXPOSURE_TIME, _F_NUMBER, _ISO = 0x0110, 0x829A, 0x829D, 0x8827


@dataclass(frozen=True)
class Exif:
    """Exposure time in seconds, f-number, ISO speed and camera model; None where the file does not say.

    Parameters
    ----------
    exposure_time : float, optional
        Seconds.
    f_number : float, optional
    iso : float, optional
        ISO speed.
    model : str, optional
        Of the camera.
    """

    exposure_time: float | None = None
    f_number: float | None = None
    iso: float | None = None
    model: str | None = None


def read_exif(path: Path) -> Exif:
    """Read exposure and camera from the header of a JPEG, PNG, TIFF or RAW file.

    LibRaw, which reads the RAW files, tells no camera model.

    Raises
    ------
    FormatError
        If the file is no photograph, as `crfbench.charts.read_size`.
    """
    path = Path(path)
    return _raw_exif(path) if path.suffix.lower() in RAW_SUFFIXES else _image_exif(path)


def exposure_steps(exifs: Sequence[Exif]) -> Array:
    """Return exposures in stops relative to the first photograph that tells its own.

    A stop more is twice the light: log2(t ISO / N^2) with exposure time t, f-number N.

    Parameters
    ----------
    exifs : sequence of Exif, length n

    Returns
    -------
    ndarray, shape (n,)
        NaN where time, f-number or ISO speed is missing.
    """
    stated = [(e.exposure_time or np.nan, e.iso or np.nan, e.f_number or np.nan) for e in exifs]
    time, iso, f_number = np.array(stated, dtype=np.float64).reshape(-1, 3).T
    stops = np.log2(time * iso / f_number**2)
    known = stops[np.isfinite(stops)]
    return np.asarray(stops - known[0]) if known.size else stops


def _raw_exif(path: Path) -> Exif:
    with open_raw(path) as raw:
        other = raw.other
    return Exif(_positive(other.shutter_speed), _positive(other.aperture), _positive(other.iso_speed))


def _image_exif(path: Path) -> Exif:
    tags = exif_tags(open_image(path)[0])
    model = str(tags.get(_MODEL, "")).strip("\0 ")
    time, f_number, iso = (_positive(tags.get(tag)) for tag in (_EXPOSURE_TIME, _F_NUMBER, _ISO))
    return Exif(time, f_number, iso, model or None)


def _positive(value: Any) -> float | None:
    """Return a number if it is one and above 0; the first one of several."""
    try:
        number = float(value[0] if isinstance(value, tuple) else value)
    except (TypeError, ValueError, IndexError, ZeroDivisionError, OverflowError):
        return None
    return number if isfinite(number) and number > 0 else None
