"""Which files are photographs that belong together: RAW and JPEG pairs of one name, and exposure series.

A file that cannot be used is reported as a `Problem`, and the rest goes on.
"""

import unicodedata
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.camera.reading import IMAGE_SUFFIXES, RAW_SUFFIXES, Exif, read_exif, read_levels, read_size
from crfbench.camera.worker import WORKER
from crfbench.checks import as_numbers
from crfbench.curves import Array
from crfbench.errors import FormatError, InputError

Source = str | Path | Iterable[Path]

# Cameras crop the frame of a RAW file when they develop it, by this share of a side at most.
_CROP_SHARE = 0.02


@dataclass(frozen=True)
class Pair:
    """One photograph: its name, its JPEG (or PNG, TIFF) and its RAW file, None where there is none."""

    name: str
    jpeg: Path
    raw: Path | None = None


@dataclass(frozen=True)
class Problem:
    """A file that was left out, and why, in one sentence."""

    path: Path
    reason: str


def pair_photographs(source: Source) -> tuple[list[Pair], list[Problem]]:
    """Pair RAW files with JPEGs (or PNG, TIFF) of the same name.

    Extensions count in either case. Sizes may differ by 2 %. Where there is no RAW file at all, every JPEG stands
    alone.

    Parameters
    ----------
    source : path or iterable of path
        A folder, of which everything else than photographs is passed over, or files.

    Returns
    -------
    pairs : list of Pair
        Sorted by name.
    problems : list of Problem
    """
    groups: dict[str, list[Path]] = defaultdict(list)
    problems: list[Problem] = []
    for path in list_photographs(source):
        if path.suffix.lower() in IMAGE_SUFFIXES | RAW_SUFFIXES:
            # File systems differ in how they write é; the names of a pair must still be the same.
            groups[unicodedata.normalize("NFC", path.stem)].append(path)
        else:
            problems.append(Problem(path, f"{path.name} is neither RAW nor JPEG, PNG or TIFF by its extension"))
    alone = not any(path.suffix.lower() in RAW_SUFFIXES for paths in groups.values() for path in paths)
    pairs = []
    for name, paths in sorted(groups.items()):
        found = Pair(name, paths[0]) if alone and len(paths) == 1 else _pair(name, paths)
        if isinstance(found, Pair):
            pairs.append(found)
        else:
            problems += found
    return pairs, problems


def list_photographs(source: Source) -> list[Path]:
    """Return the files that are given, or those of a folder that are photographs by their extension."""
    if not isinstance(source, str | Path):
        return [Path(path) for path in source]
    folder = Path(source)
    if not folder.is_dir():
        raise InputError(f"{folder.name} is not a folder; use a folder of photographs or a list of files")
    photographs = (path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES | RAW_SUFFIXES)
    return sorted(path for path in photographs if path.is_file() and not path.name.startswith("."))


def check_sizes(jpeg: Path, jpeg_size: tuple[int, int], raw: Path, raw_size: tuple[int, int]) -> None:
    """Raise `FormatError` if two sizes (width, height) differ by more than a camera crops."""
    if any(abs(a - b) > _CROP_SHARE * b for a, b in zip(jpeg_size, raw_size, strict=True)):
        sizes = " and ".join(f"{path.name} is {w} x {h}" for path, (w, h) in ((jpeg, jpeg_size), (raw, raw_size)))
        raise FormatError(f"{sizes} pixels; use the JPEG of the same photograph, neither resized nor turned")


def _pair(name: str, paths: list[Path]) -> Pair | list[Problem]:
    raws = [path for path in paths if path.suffix.lower() in RAW_SUFFIXES]
    jpegs = [path for path in paths if path not in raws]
    if len(raws) == len(jpegs) == 1:
        return _checked(name, jpegs[0], raws[0])
    if len(raws) > 1 or len(jpegs) > 1:
        files = ", ".join(sorted(path.name for path in paths))
        return [Problem(path, f"{path.name} has more than one partner among {files}") for path in paths]
    missing = "RAW file" if jpegs else "JPEG"
    return [Problem(path, f"{path.name} has no {missing} of the same name") for path in paths]


def _checked(name: str, jpeg: Path, raw: Path) -> Pair | list[Problem]:
    """Return the pair if both files have a header that can be read, and much the same size."""
    sizes, problems = [], []
    for path in (jpeg, raw):
        try:
            sizes.append(WORKER.run(read_size, path))
        except FormatError as error:
            problems.append(Problem(path, str(error)))
    try:
        if not problems:
            check_sizes(jpeg, sizes[0], raw, sizes[1])
    except FormatError as error:
        problems.append(Problem(jpeg, str(error)))
    return problems or Pair(name, jpeg, raw)


def read_series(
    paths: Iterable[str | Path], exposures: ArrayLike | None = None
) -> tuple[list[NDArray[Any]], Array, list[Problem]]:
    """Read the photographs of an exposure series.

    Parameters
    ----------
    paths : iterable of path
        JPEG, PNG or TIFF files, as `crfbench.camera.read_image` takes them.
    exposures : array_like, shape (e,), optional
        Exposure times in seconds, one a path; by default time, f-number and ISO speed by EXIF.

    Returns
    -------
    images : list of ndarray, shape (h, w, 3)
        8 or 16 bits.
    stops : ndarray, shape (e,)
        Relative to the first photograph that was read.
    problems : list of Problem
    """
    files = [Path(path) for path in paths]
    times = None if exposures is None else as_times(exposures, [file.name for file in files])
    images, exifs, problems = [], [], []
    for i, file in enumerate(files):
        try:
            exif = _exposure(file) if times is None else Exif(float(times[i]), 1.0, 1.0)
            images.append(WORKER.run(read_levels, file))
            exifs.append(exif)
        except (FormatError, InputError) as error:
            problems.append(Problem(file, str(error)))
    return images, exposure_steps(exifs), problems


def exposure_steps(exifs: Sequence[Exif]) -> Array:
    """Return exposures in stops relative to the first photograph that tells its own.

    A stop more is twice the light: log2(t ISO / N^2) with exposure time t, f-number N. NaN where one is missing.
    """
    stated = [(e.exposure_time or np.nan, e.iso or np.nan, e.f_number or np.nan) for e in exifs]
    time, iso, f_number = np.array(stated, dtype=np.float64).reshape(-1, 3).T
    stops = np.log2(time * iso / f_number**2)
    known = stops[np.isfinite(stops)]
    return np.asarray(stops - known[0]) if known.size else stops


def as_times(exposures: ArrayLike, names: list[str]) -> Array:
    """Return the exposure times of the photographs of those names; one is above 0 for each, or `InputError`."""
    times = as_numbers("exposures", exposures)
    if times.shape != (len(names),) or not (np.isfinite(times) & (times > 0)).all():
        photographs = f"{len(names)} photographs ({', '.join(names)})"
        raise InputError(f"exposures={times.tolist()} do not match {photographs}; use one time above 0 for each")
    return times


def _exposure(file: Path) -> Exif:
    exif = WORKER.run(read_exif, file)
    if not np.isfinite(exposure_steps([exif])).all():
        raise InputError(f"{file.name} does not tell time, f-number and ISO speed; use exposures=[seconds, ...]")
    return exif
