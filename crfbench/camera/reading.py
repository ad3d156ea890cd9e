"""Read photographs as numbers: RAW files as the sensor's linear values, JPEG, PNG and TIFF files as they are stored.

Nothing is balanced, brightened or converted. Files are untrusted: their headers are checked before anything is
decoded, and `crfbench.camera.worker` decodes them in a process of its own, as a decoder can crash.
"""

import struct
import unicodedata
import warnings
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.camera.worker import WORKER
from crfbench.checks import as_numbers
from crfbench.curves import Array
from crfbench.errors import FormatError, InputError

# More than any camera writes; a header that announces more is refused before it is decoded.
MAX_PIXELS = 160_000_000
MAX_BYTES = 512 * 1024 * 1024

IMAGE_SUFFIXES = frozenset({".jpg", ".jpeg", ".jpe", ".png", ".tif", ".tiff"})
_RAW_NAMES = (
    *("3fr", "ari", "arw", "bay", "cr2", "cr3", "crw", "dc2", "dcr", "dng", "erf", "fff", "gpr", "iiq", "k25"),
    *("kdc", "mdc", "mef", "mos", "mrw", "nef", "nrw", "orf", "pef", "raf", "raw", "rw2", "rwl", "sr2", "srf"),
    *("srw", "x3f"),
)
RAW_SUFFIXES = frozenset(f".{name}" for name in _RAW_NAMES)

# EXIF 2.32 (CIPA DC-008).
_MODEL, _ORIENTATION, _EXIF_FOLDER = 0x0110, 0x0112, 0x8769
_EXPOSURE_TIME, _F_NUMBER, _ISO = 0x829A, 0x829D, 0x8827
# What Pillow raises on bytes that are not an image, or one that was cut or altered.
_DAMAGE: tuple[type[Exception], ...] = (
    *(OSError, EOFError, ValueError, TypeError, KeyError, IndexError, SyntaxError, OverflowError, RuntimeError),
    *(ZeroDivisionError, AttributeError, struct.error),
)


@dataclass(frozen=True)
class Exif:
    """What a photograph says of its exposure and camera; None where it does not."""

    exposure_time: float | None = None  # seconds
    f_number: float | None = None
    iso: float | None = None  # ISO speed
    model: str | None = None  # of the camera; LibRaw, which reads the RAW files, does not tell it


def read_raw(path: Path) -> NDArray[np.float32]:
    """Read a RAW file as linear sensor values.

    Black is subtracted and the white level is 1, the same for every photograph of a camera. No white balance (factors
    1, 1, 1, 1), no colour matrix, no tone curve, no brightening; missing colours are interpolated linearly from their
    neighbours. Turned as the file says, as a JPEG of the same photograph is.

    Returned are red, green and blue in [0, 1], shape (height, width, 3). The file of another kind of sensor, a damaged
    and a too large one are a `FormatError`.
    """
    import rawpy

    with _open_raw(path) as raw:
        pixels = raw.postprocess(
            user_wb=[1.0, 1.0, 1.0, 1.0],
            output_color=rawpy.ColorSpace.raw,
            demosaic_algorithm=rawpy.DemosaicAlgorithm.LINEAR,
            gamma=(1, 1),
            no_auto_bright=True,
            adjust_maximum_thr=0.0,  # else the white level would follow the brightest pixel
            output_bps=16,
        )
    return np.asarray(pixels, dtype=np.float32) / np.float32(65535)


def read_image(path: Path) -> NDArray[np.float32]:
    """Read a JPEG, PNG or TIFF file as it is stored; colour profiles are not applied.

    Turned as its EXIF orientation says. Only red-green-blue images are read: grey, palette, CMYK, alpha and floating
    point are refused, as it would take a guess to turn them into three channels.

    Parameters
    ----------
    path : path
        Another kind of file, a damaged or a too large one is a `FormatError`.

    Returns
    -------
    ndarray of float32, shape (height, width, 3)
        Red, green and blue in [0, 1].
    """
    levels = read_levels(path)
    return levels.astype(np.float32) / np.float32(np.iinfo(levels.dtype).max)


def read_levels(path: Path) -> NDArray[Any]:
    """Read an image as the uint8 or uint16 that its file holds, shape (height, width, 3), or raise `FormatError`."""
    import cv2

    path = Path(path)
    _, content = _open_image(path)
    try:
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    except cv2.error:
        raise _unreadable(path, "image") from None
    if pixels is None or pixels.dtype not in (np.uint8, np.uint16):
        raise FormatError(f"{path.name} cannot be decoded; use a complete JPEG, PNG or TIFF file of 8 or 16 bits")
    # Reversed here: OpenCV 5.0 garbles TIFF files of 16 bits where it is asked for red first.
    return np.ascontiguousarray(pixels[..., ::-1])


def read_size(path: Path) -> tuple[int, int]:
    """Read width and height in pixels, turned as the file says, from the header alone."""
    path = Path(path)
    if path.suffix.lower() in RAW_SUFFIXES:
        with _open_raw(path) as raw:
            return _turned_size(raw)
    image, _ = _open_image(path)
    # Pillow turns the size of TIFF files itself.
    turned = _exif_tags(image).get(_ORIENTATION) in (5, 6, 7, 8) and image.format != "TIFF"
    width, height = image.size
    return (height, width) if turned else (width, height)


def read_exif(path: Path) -> Exif:
    """Read exposure and camera from the header of a JPEG, PNG, TIFF or RAW file."""
    path = Path(path)
    if path.suffix.lower() in RAW_SUFFIXES:
        with _open_raw(path) as raw:
            other = raw.other
        return Exif(_positive(other.shutter_speed), _positive(other.aperture), _positive(other.iso_speed))
    tags = _exif_tags(_open_image(path)[0])
    model = str(tags.get(_MODEL, "")).strip("\0 ")
    time, f_number, iso = (_positive(tags.get(tag)) for tag in (_EXPOSURE_TIME, _F_NUMBER, _ISO))
    return Exif(time, f_number, iso, model or None)


@contextmanager
def _open_raw(path: Path) -> Iterator[Any]:
    """Open a RAW file with LibRaw, its header read and checked but not its pixels."""
    import rawpy

    path = Path(path)
    content = _content(path)
    try:
        with rawpy.imread(BytesIO(content)) as raw:
            _check_raw(path, raw)
            yield raw
    except (rawpy.LibRawError, rawpy.NotSupportedError):
        raise _unreadable(path, "RAW file") from None


def _check_raw(path: Path, raw: Any) -> None:
    """Refuse sizes and sensors before unpacking."""
    _check_size(path, raw.sizes.raw_width, raw.sizes.raw_height)
    _check_size(path, *_turned_size(raw))
    if raw.num_colors != 3 or set(raw.color_desc) != set(b"RGB"):
        colours = raw.color_desc.decode("ascii", "replace")
        raise FormatError(f"{path.name} has a sensor of the colours {colours!r}; use one of red, green and blue")


def _turned_size(raw: Any) -> tuple[int, int]:
    sizes = raw.sizes
    return (sizes.height, sizes.width) if sizes.flip in (5, 6) else (sizes.width, sizes.height)


def _open_image(path: Path) -> tuple[Any, bytes]:
    """Return Pillow's view of an image file, its header read and checked but not its pixels, and the file's bytes."""
    from PIL import Image

    content = _content(path)
    damage: tuple[type[Exception], ...] = (*_DAMAGE, Image.DecompressionBombError)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about sizes, which are checked here, and damage that is found later
        try:
            image = Image.open(BytesIO(content), formats=("JPEG", "PNG", "TIFF"))
        except damage:
            raise _unreadable(path, "JPEG, PNG or TIFF file") from None
    _check_size(path, *image.size)
    if image.mode != "RGB" or "transparency" in image.info:
        kind = "RGB with transparency" if image.mode == "RGB" else image.mode
        raise FormatError(f"{path.name} is a {kind} image; use RGB with 8 or 16 bits and without alpha")
    return image, content


def _exif_tags(image: Any) -> dict[int, Any]:
    """Return the EXIF tags of what Pillow opened; none where they are missing or damaged."""
    if image.format == "PNG" and "exif" not in image.info:
        return {}  # Pillow would decode the pixels to look behind them
    try:
        exif = image.getexif()
        return {**exif, **exif.get_ifd(_EXIF_FOLDER)}
    except _DAMAGE:
        return {}


def _positive(value: Any) -> float | None:
    """Return a number if it is one and above 0; the first one of several."""
    try:
        number = float(value[0] if isinstance(value, tuple) else value)
    except (TypeError, ValueError, IndexError, ZeroDivisionError, OverflowError):
        return None
    return number if isfinite(number) and number > 0 else None


def _content(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise FormatError(f"{path.name} has {size} bytes; use a photograph of {MAX_BYTES} bytes or less")
        return path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path.name} cannot be read ({error.strerror}); use a file that is there") from None


def _unreadable(path: Path, kind: str) -> FormatError:
    return FormatError(f"{path.name} is not a readable {kind}; use a complete one")


def _check_size(path: Path, width: int, height: int) -> None:
    if not 0 < width * height <= MAX_PIXELS:
        raise FormatError(f"{path.name} announces {width} x {height} pixels; use 1 to {MAX_PIXELS} pixels")


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
