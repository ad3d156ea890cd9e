"""Read photographs as numbers: RAW files as the sensor's linear values, JPEG, PNG and TIFF files as they are stored.

Nothing is balanced, brightened or converted. Files are untrusted: their headers are checked before anything is
decoded, and `crfbench.charts.safely` decodes them in a process of its own, as a decoder can crash.
"""

import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crfbench.errors import FormatError

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

_ORIENTATION, _EXIF_FOLDER = 0x0112, 0x8769
_FORMATS = ("JPEG", "PNG", "TIFF")
# What Pillow raises on bytes that are no image, or one that was cut or altered.
_DAMAGE: tuple[type[Exception], ...] = (
    *(OSError, EOFError, ValueError, TypeError, KeyError, IndexError, SyntaxError, OverflowError, RuntimeError),
    *(ZeroDivisionError, AttributeError, struct.error),
)


class Picture(NamedTuple):
    """Pixels in [0, 1], float32, shape (height, width, 3), red green blue; and the bits that each value had.

    Parameters
    ----------
    pixels : ndarray of float32, shape (height, width, 3)
    bits : int
        8 or 16.
    """

    pixels: NDArray[np.float32]
    bits: int


def read_raw(path: Path) -> Picture:
    """Read a RAW file as linear sensor values.

    Black is subtracted and the white level is 1, the same for every photograph of a camera. No white balance (factors
    1, 1, 1, 1), no colour matrix, no tone curve, no brightening; missing colours are interpolated linearly from their
    neighbours. Turned as the file says, as a JPEG of the same photograph is.

    Parameters
    ----------
    path : path

    Returns
    -------
    Picture
        16 bits.

    Raises
    ------
    FormatError
        If the file is no RAW file of a red-green-blue sensor, is damaged or too large.
    """
    import rawpy

    with open_raw(path) as raw:
        pixels = raw.postprocess(
            user_wb=[1.0, 1.0, 1.0, 1.0],
            output_color=rawpy.ColorSpace.raw,
            demosaic_algorithm=rawpy.DemosaicAlgorithm.LINEAR,
            gamma=(1, 1),
            no_auto_bright=True,
            adjust_maximum_thr=0.0,  # else the white level would follow the brightest pixel
            output_bps=16,
        )
    return Picture(np.asarray(pixels, dtype=np.float32) / np.float32(65535), 16)


def read_image(path: Path) -> Picture:
    """Read a JPEG, PNG or TIFF file as it is stored; colour profiles are not applied.

    Turned as its EXIF orientation says. Only red-green-blue images are read: grey, palette, CMYK, alpha and floating
    point are refused, as it would take a guess to turn them into three channels.

    Parameters
    ----------
    path : path

    Returns
    -------
    Picture
        8 or 16 bits.

    Raises
    ------
    FormatError
        For another kind of file, or one that is damaged or too large.
    """
    import cv2

    path = Path(path)
    _, content = open_image(path)
    try:
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    except cv2.error:
        raise _unreadable(path, "image") from None
    if pixels is None or pixels.dtype not in (np.uint8, np.uint16):
        raise FormatError(f"{path.name} cannot be decoded; use a complete JPEG, PNG or TIFF file of 8 or 16 bits")
    bits = 8 * pixels.itemsize
    # Reversed here: OpenCV 5.0 garbles TIFF files of 16 bits where it is asked for red first.
    return Picture(pixels[..., ::-1].astype(np.float32) / np.float32(2**bits - 1), bits)


def read_size(path: Path) -> tuple[int, int]:
    """Read width and height in pixels, turned as the file says, from the header alone.

    Raises
    ------
    FormatError
        As `read_raw` and `read_image`.
    """
    path = Path(path)
    if path.suffix.lower() in RAW_SUFFIXES:
        with open_raw(path) as raw:
            return _turned_size(raw)
    image, _ = open_image(path)
    # Pillow turns the size of TIFF files itself.
    turned = exif_tags(image).get(_ORIENTATION) in (5, 6, 7, 8) and image.format != "TIFF"
    width, height = image.size
    return (height, width) if turned else (width, height)


@contextmanager
def open_raw(path: Path) -> Iterator[Any]:
    """Open a RAW file with LibRaw, its header read and checked but not its pixels; for errors see `read_raw`."""
    import rawpy

    path = Path(path)
    content = _content(path)
    try:
        with rawpy.imread(BytesIO(content)) as raw:
            _check_raw(path, raw)
            yield raw
    except (rawpy.LibRawError, rawpy.NotSupportedError):
        raise _unreadable(path, "RAW file") from None


def open_image(path: Path) -> tuple[Any, bytes]:
    """Return Pillow's view of an image file, its header read and checked but not its pixels, and the file's bytes.

    Raises
    ------
    FormatError
        As `read_image`.
    """
    from PIL import Image

    path = Path(path)
    content = _content(path)
    damage: tuple[type[Exception], ...] = (*_DAMAGE, Image.DecompressionBombError)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about sizes, which are checked here, and damage that is found later
        try:
            image = Image.open(BytesIO(content), formats=_FORMATS)
        except damage:
            raise _unreadable(path, "JPEG, PNG or TIFF file") from None
    _check_size(path, *image.size)
    if image.mode != "RGB" or "transparency" in image.info:
        kind = "RGB with transparency" if image.mode == "RGB" else image.mode
        raise FormatError(f"{path.name} is a {kind} image; use RGB with 8 or 16 bits and without alpha")
    return image, content


def exif_tags(image: Any) -> dict[int, Any]:
    """Return the EXIF tags of what `open_image` returned; none where they are missing or damaged."""
    if image.format == "PNG" and "exif" not in image.info:
        return {}  # Pillow would decode the pixels to look behind them
    try:
        exif = image.getexif()
        return {**exif, **exif.get_ifd(_EXIF_FOLDER)}
    except _DAMAGE:
        return {}


def _content(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise FormatError(f"{path.name} has {size} bytes; use a photograph of {MAX_BYTES} bytes or less")
        return path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path.name} cannot be read ({error.strerror}); use a file that is there") from None


def _unreadable(path: Path, kind: str) -> FormatError:
    return FormatError(f"{path.name} is no readable {kind}; use a complete one")


def _check_size(path: Path, width: int, height: int) -> tuple[int, int]:
    if not 0 < width * height <= MAX_PIXELS:
        raise FormatError(f"{path.name} announces {width} x {height} pixels; use 1 to {MAX_PIXELS} pixels")
    return width, height


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
