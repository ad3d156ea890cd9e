"""Find which JPEG and which RAW file are the same photograph: they have the same name without the extension."""

import unicodedata
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from crfbench.charts.reading import IMAGE_SUFFIXES, RAW_SUFFIXES, read_size
from crfbench.charts.safely import SafeReader
from crfbench.errors import FormatError, InputError

# Cameras crop the frame of a RAW file when they develop it, by this share of a side at most.
CROP_SHARE = 0.02


@dataclass(frozen=True)
class Pair:
    """One photograph: its name, its JPEG (or PNG, TIFF) and its RAW file, None where there is none.

    Parameters
    ----------
    name : str
    jpeg : Path
    raw : Path, optional
    """

    name: str
    jpeg: Path
    raw: Path | None = None


@dataclass(frozen=True)
class Problem:
    """A file that was left out, and why, in one sentence.

    Parameters
    ----------
    path : Path
    reason : str
    """

    path: Path
    reason: str


class Pairing(NamedTuple):
    """The pairs, sorted by name, and what was left out.

    Parameters
    ----------
    pairs : list of Pair
    problems : list of Problem
    """

    pairs: list[Pair]
    problems: list[Problem]


def pair_photographs(source: str | Path | Iterable[Path]) -> Pairing:
    """Pair RAW files with JPEGs (or PNG, TIFF) of the same name; a bad file is reported, the rest goes on.

    Extensions count in either case. Sizes may differ by `CROP_SHARE`. Where there is no RAW file at all, every JPEG
    stands alone.

    Parameters
    ----------
    source : path or iterable of path
        A folder, of which everything else than photographs is passed over, or files.

    Returns
    -------
    Pairing

    Raises
    ------
    InputError
        If `source` is one path and no folder.
    """
    groups: dict[str, list[Path]] = defaultdict(list)
    problems: list[Problem] = []
    for path in _files(source):
        if path.suffix.lower() in IMAGE_SUFFIXES | RAW_SUFFIXES:
            groups[unicodedata.normalize("NFC", path.stem)].append(path)
        else:
            problems.append(Problem(path, f"{path.name} is neither RAW nor JPEG, PNG or TIFF by its extension"))
    alone = not any(path.suffix.lower() in RAW_SUFFIXES for paths in groups.values() for path in paths)
    pairs = []
    with SafeReader() as reader:
        for name, paths in sorted(groups.items()):
            found = Pair(name, paths[0]) if alone and len(paths) == 1 else _pair(name, paths, reader)
            if isinstance(found, Pair):
                pairs.append(found)
            else:
                problems += found
    return Pairing(pairs, problems)


def check_sizes(jpeg: Path, jpeg_size: tuple[int, int], raw: Path, raw_size: tuple[int, int]) -> None:
    """Raise `FormatError` if two sizes (width, height) differ by more than a camera crops."""
    if any(abs(a - b) > CROP_SHARE * b for a, b in zip(jpeg_size, raw_size, strict=True)):
        sizes = " and ".join(f"{path.name} is {w} x {h}" for path, (w, h) in ((jpeg, jpeg_size), (raw, raw_size)))
        raise FormatError(f"{sizes} pixels; use the JPEG of the same photograph, neither resized nor turned")


def _files(source: str | Path | Iterable[Path]) -> list[Path]:
    if not isinstance(source, str | Path):
        return [Path(path) for path in source]
    folder = Path(source)
    if not folder.is_dir():
        raise InputError(f"{folder.name} is no folder; use a folder of photographs or a list of files")
    photographs = (path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES | RAW_SUFFIXES)
    return sorted(path for path in photographs if path.is_file() and not path.name.startswith("."))


def _pair(name: str, paths: list[Path], reader: SafeReader) -> Pair | list[Problem]:
    raws = [path for path in paths if path.suffix.lower() in RAW_SUFFIXES]
    jpegs = [path for path in paths if path not in raws]
    if len(raws) == len(jpegs) == 1:
        return _checked(name, jpegs[0], raws[0], reader)
    if len(raws) > 1 or len(jpegs) > 1:
        files = ", ".join(sorted(path.name for path in paths))
        return [Problem(path, f"{path.name} has more than one partner among {files}") for path in paths]
    missing = "RAW file" if jpegs else "JPEG"
    return [Problem(path, f"{path.name} has no {missing} of the same name") for path in paths]


def _checked(name: str, jpeg: Path, raw: Path, reader: SafeReader) -> Pair | list[Problem]:
    """Return the pair if both files have a header that can be read, and much the same size."""
    sizes, problems = [], []
    for path in (jpeg, raw):
        try:
            sizes.append(reader.run(read_size, path))
        except FormatError as error:
            problems.append(Problem(path, str(error)))
    if problems:
        return problems
    try:
        check_sizes(jpeg, sizes[0], raw, sizes[1])
    except FormatError as error:
        return [Problem(jpeg, str(error))]
    return Pair(name, jpeg, raw)
