"""Read the photographs of a series and their exposures from files that nobody has checked."""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from crfbench.charts import Exif, Problem, SafeReader, exposure_steps, read_exif, read_image
from crfbench.checks import as_numbers
from crfbench.curves import Array
from crfbench.errors import CrfbenchError, InputError
from crfbench.series.checks import Image


class Series(NamedTuple):
    """Images of shape (h, w, 3), 8 or 16 bits; their exposures in stops, shape (e,); and the files left out.

    Parameters
    ----------
    images : list of ndarray, shape (h, w, 3)
    stops : ndarray, shape (e,)
    problems : list of Problem
    """

    images: list[Image]
    stops: Array
    problems: list[Problem]


def read_series(paths: Iterable[str | Path], exposures: str | ArrayLike = "exif") -> Series:
    """Read photographs; a bad file is reported and left out, the rest goes on.

    Parameters
    ----------
    paths : iterable of path
        JPEG, PNG or TIFF files, as `crfbench.charts.read_image` takes them.
    exposures : "exif" or array_like, shape (e,)
        Exposure times in seconds, one a path; "exif" takes time, f-number and ISO speed from the files.

    Returns
    -------
    Series
        Stops are relative to the first photograph that was read.

    Raises
    ------
    InputError
        For times that are not above 0 or not as many as paths.
    """
    files = [Path(path) for path in paths]
    times = None if isinstance(exposures, str) and exposures == "exif" else _times(exposures, len(files))
    images, exifs, problems = [], [], []
    with SafeReader() as reader:
        for i, file in enumerate(files):
            try:
                exif = Exif(float(times[i]), 1.0, 1.0) if times is not None else _exposed(reader, file)
                images.append(reader.run(read_levels, file))
                exifs.append(exif)
            except CrfbenchError as error:
                problems.append(Problem(file, str(error)))
    return Series(images, exposure_steps(exifs), problems)


def read_levels(path: Path) -> Image:
    """Read an image as the integers that its file holds, shape (h, w, 3); for errors see `read_image`."""
    pixels, bits = read_image(path)
    white = np.float32(2**bits - 1)
    return np.rint(pixels * white).astype(np.uint8 if bits == 8 else np.uint16)


def _exposed(reader: SafeReader, file: Path) -> Exif:
    exif = reader.run(read_exif, file)
    if not np.isfinite(exposure_steps([exif])).all():
        raise InputError(f"{file.name} does not tell time, f-number and ISO speed; use exposures=[seconds, ...]")
    return exif


def _times(exposures: str | ArrayLike, n: int) -> Array:
    if isinstance(exposures, str):
        raise InputError(f"exposures={exposures!r} do not fit; use 'exif' or {n} times in seconds")
    times = as_numbers("exposures", exposures)
    if times.shape != (n,) or not (np.isfinite(times) & (times > 0)).all():
        raise InputError(f"exposures={times.tolist()} do not fit {n} files; use one time above 0 seconds for each")
    return times
