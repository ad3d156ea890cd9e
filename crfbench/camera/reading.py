"""Read photographs as numbers: RAW files as the sensor's linear values, JPEG, TIFF and others as they are stored.

Nothing is balanced, brightened or converted. Files are untrusted: their headers are checked before anything is
decoded, and `crfbench.camera.worker` decodes them in a process of its own, as a decoder can crash.
"""

import logging
import lzma
import re
import struct
import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from io import BytesIO
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from crfbench.errors import FormatError

# More than any camera writes; a header that announces more is refused before it is decoded.
MAX_PIXELS = 160_000_000
MAX_BYTES = 512 * 1024 * 1024
# On the longer side of the preview in a RAW file; smaller ones are for lists, not for looking at.
MIN_PREVIEW = 300

IMAGE_SUFFIXES = {".jpg", ".jpeg", ".jpe", ".heic", ".heif", ".hif", ".avif", ".webp", ".png", ".tif", ".tiff"}
IMAGES = "JPEG, PNG, TIFF, HEIC, AVIF or WebP"
RAW_SUFFIXES = {
    ".3fr", ".ari", ".arw", ".bay", ".cr2", ".cr3", ".crw", ".dc2", ".dcr", ".dng", ".erf", ".fff", ".gpr", ".iiq",
    ".k25", ".kdc", ".mdc", ".mef", ".mos", ".mrw", ".nef", ".nrw", ".orf", ".pef", ".raf", ".raw", ".rw2", ".rwl",
    ".sr2", ".srf", ".srw", ".x3f",
}  # fmt: skip

# EXIF 2.32 (CIPA DC-008) and TIFF 6.0.
_MODEL, _ORIENTATION, _EXIF_FOLDER = 0x0110, 0x0112, 0x8769
_EXPOSURE_TIME, _F_NUMBER, _ISO, _SHUTTER_SPEED, _APERTURE = 0x829A, 0x829D, 0x8827, 0x9201, 0x9202
_SENSITIVITIES = (0x8831, 0x8832, 0x8833)  # standard output sensitivity, recommended exposure index, ISO speed
_ISO_UNTOLD = 65535  # says that the number does not fit its 16 bits
_BITS, _PHOTOMETRIC, _PLANAR = 258, 262, 284
_MASK = 4  # the bit of NewSubfileType that says that a page is transparency
_GREY = frozenset({"L", "LA", "I;16", "I;16B", "I;16L"})
_MODES = _GREY | {"RGB", "RGBA", "RGB;16", "RGBA;16", "L;16"}
# What Pillow raises on bytes that are not an image, or one that was cut or altered.
_DAMAGE: tuple[type[Exception], ...] = (
    *(OSError, EOFError, ValueError, TypeError, KeyError, IndexError, SyntaxError, OverflowError, RuntimeError),
    *(ZeroDivisionError, AttributeError, struct.error, zlib.error, lzma.LZMAError),
)
# How files begin that people give by the names of photographs, in small letters.
_OTHER_KINDS = {
    **{b"gif8": "a GIF", b"bm": "a BMP", b"<": "an HTML or XML", b"version https://git-lfs": "a git-lfs pointer"},
    **{b"\0\0\0\x0cjp": "a JPEG 2000", b"\xffo\xffq": "a JPEG 2000", b"\xff\n": "a JPEG XL", b"v/1\1": "an OpenEXR"},
    b"\0\0\0\x0cjxl": "a JPEG XL",
}

Pixels = TypeVar("Pixels", bound=NDArray[Any])


@dataclass(frozen=True)
class Exif:
    """What a photograph says of its exposure and camera; None where it does not."""

    exposure_time: float | None = None  # seconds
    f_number: float | None = None
    iso: float | None = None
    model: str | None = None  # of the camera; LibRaw, which reads the RAW files, does not tell it


def read_raw(path: Path, half: bool = False) -> NDArray[np.float32]:
    """Read a RAW file as linear sensor values, or each `half` of its sides at half size.

    Black is subtracted and the white level is 1, the same for every photograph of a camera. No white balance (factors
    1, 1, 1, 1), no colour matrix, no tone curve, no brightening; missing colours are interpolated linearly from their
    neighbours. Turned as the file says, as a JPEG of the same photograph is.

    Returned are red, green and blue in [0, 1], shape (height, width, 3); of a monochrome sensor one channel, shape
    (height, width). The file of another kind of sensor, a damaged and a too large one are a `FormatError`.
    """
    import rawpy

    with _open_raw(path) as raw:
        black = raw.black_level_per_channel
        # Of a linear DNG, LibRaw lets the missing fourth channel, black at 0, move the white level of the others.
        stacked = raw.raw_type == rawpy.RawType.Stack and raw.num_colors == 3
        pixels = raw.postprocess(
            user_cblack=[*black[:3], black[1]] if stacked else None,
            user_wb=[1.0, 1.0, 1.0, 1.0],
            output_color=rawpy.ColorSpace.raw,
            demosaic_algorithm=rawpy.DemosaicAlgorithm.LINEAR,
            gamma=(1, 1),
            no_auto_bright=True,
            adjust_maximum_thr=0.0,  # else the white level would follow the brightest pixel
            output_bps=16,
            half_size=half,
        )
    pixels = np.asarray(pixels, dtype=np.float32) / np.float32(65535)
    return pixels[..., 0] if pixels.shape[2] == 1 else pixels


def read_balance(path: Path) -> NDArray[np.float64]:
    """Return the camera's factors (3,) that make red, green and blue of a grey equal; green's is 1, as all unknown."""
    with _open_raw(path) as raw:
        factors = np.array(raw.camera_whitebalance[:3], dtype=np.float64)
    known = np.isfinite(factors).all() and (factors > 0).all()
    return factors / factors[1] if known else np.ones(3)


def read_image(path: Path, white_level: int | None = None) -> NDArray[np.float32]:
    """Read a JPEG, PNG, TIFF, HEIC, AVIF or WebP file as it is stored; colour profiles are not applied.

    Of a RAW file, the preview is read that its camera developed.

    Turned upright as the file says. Palettes, CMYK, floating point and transparency that varies are refused, as it
    would take a guess to turn them into brightness; alpha that is the same everywhere is dropped. Of a TIFF file of
    several pages the largest one is read, as the first may be a thumbnail.

    Parameters
    ----------
    path : path
        Another kind of file, a damaged or a too large one is a `FormatError`.
    white_level : int, optional
        The level that is white in a file of 16 bits, such as 4095 of a 12-bit camera; by default 65535.

    Returns
    -------
    ndarray of float32, shape (height, width, 3) or, where the file is grey, (height, width)
        Red, green and blue in [0, 1].
    """
    levels = read_levels(path, white_level)
    return levels.astype(np.float32) / np.float32(np.iinfo(levels.dtype).max)


def read_levels(path: Path, white_level: int | None = None) -> NDArray[Any]:
    """Read what an image file holds, uint8 or uint16, as `read_image` does, or raise `FormatError`.

    `white_level` is stretched to 65535, and so is by itself the greatest number of the 12 bits that a TIFF file packs.
    """
    path = Path(path)
    image = _open_image(path)
    try:
        pixels = _decode(image)
    except _DAMAGE as error:
        reason = f" ({error})" if "imagecodecs" in str(error) else ""
        raise FormatError(f"{path.name} cannot be decoded{reason}; use a complete {IMAGES} file") from None
    if pixels.ndim == 3 and pixels.shape[2] in (2, 4):
        if np.ptp(pixels[..., -1]):
            raise FormatError(f"{path.name} is transparent in places; use an image without alpha")
        pixels = pixels[..., :-1]
    if pixels.ndim == 3 and image.decoder.mode in _GREY:
        pixels = pixels[..., 0]
    white_level = white_level or (2**image.bits - 1 if 8 < image.bits < 16 else None)
    if white_level is not None and pixels.dtype == np.uint16:
        pixels = np.minimum(np.rint(np.arange(65536) * (65535 / white_level)), 65535).astype(np.uint16)[pixels]
    return np.ascontiguousarray(pixels)


def top_level(path: Path) -> tuple[int, float]:
    """Return the greatest level of an image of 16 bits and the share of its values there; of fewer (0, 0)."""
    if _open_image(path).bits < 16:
        return 0, 0.0
    levels = read_levels(path)
    return int(levels.max()), np.count_nonzero(levels == levels.max()) / levels.size


def read_exif(path: Path, beside: Path | None = None) -> Exif:
    """Read exposure and camera from the header of an image or RAW file; what it does not tell, of a RAW file beside it.

    In this order: ExposureTime, else ShutterSpeedValue; FNumber, else ApertureValue; PhotographicSensitivity, else, or
    where it is 65535 as it does not fit, the greatest of StandardOutputSensitivity, RecommendedExposureIndex and
    ISOSpeed. A number such as 0/1 tells nothing. What the tags of a RAW file do not tell LibRaw may.
    """
    path = Path(path)
    if path.suffix.lower() not in RAW_SUFFIXES:
        told = _exif(_open_image(path).tags)
        missing = [name for name, value in vars(told).items() if value is None]
        if beside is None or not missing:
            return told
        other = vars(read_exif(beside))
        return replace(told, **{name: other[name] for name in missing})
    with _open_raw(path) as raw:
        other = raw.other
    told = _exif(_exif_tags("RAW", path.read_bytes()))
    return Exif(
        told.exposure_time or _positive(other.shutter_speed),
        told.f_number or _positive(other.aperture),
        told.iso or _positive(other.iso_speed),
        told.model,
    )


def _exif(tags: dict[int, Any]) -> Exif:
    iso = _positive(tags.get(_ISO))
    if iso in (None, _ISO_UNTOLD):
        iso = max((other for tag in _SENSITIVITIES if (other := _positive(tags.get(tag)))), default=iso)
    return Exif(
        _positive(tags.get(_EXPOSURE_TIME)) or _power(tags.get(_SHUTTER_SPEED), 0.5),
        _positive(tags.get(_F_NUMBER)) or _power(tags.get(_APERTURE), 2**0.5),
        iso,
        " ".join("".join(c if c.isprintable() else " " for c in str(tags.get(_MODEL, ""))).split())[:100] or None,
    )


@contextmanager
def _open_raw(path: Path) -> Iterator[Any]:
    """Open a RAW file with LibRaw, its header read and checked but not its pixels."""
    import rawpy

    path = Path(path)
    content = _content(path)
    try:
        with rawpy.imread(BytesIO(content)) as raw:
            # Sizes and sensors are refused before anything is unpacked.
            _check_size(path, raw.sizes.raw_width, raw.sizes.raw_height)
            _check_size(path, raw.sizes.width, raw.sizes.height)
            if raw.num_colors != 1 and (raw.num_colors != 3 or set(raw.color_desc) != set(b"RGB")):
                colours = raw.color_desc.decode("ascii", "replace")
                use = "use one of red, green and blue"
                raise FormatError(f"{path.name} has a sensor of the colours {colours!r}; {use}")
            yield raw
    except (rawpy.LibRawError, rawpy.NotSupportedError):
        raise _unreadable(path, content, "RAW", "a complete one") from None


class _Image(NamedTuple):
    """An image file, its header read and checked but not its pixels."""

    kind: str
    decoder: Any  # Pillow's view of it, or libheif's
    tags: dict[int, Any]
    bits: int  # 8 or 16, or those that a TIFF file packs
    content: bytes


def _open_image(path: Path) -> _Image:
    from PIL import Image

    path = Path(path)
    content = _preview(path) if path.suffix.lower() in RAW_SUFFIXES else _content(path)
    damage: tuple[type[Exception], ...] = (*_DAMAGE, Image.DecompressionBombError)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about sizes, which are checked here, and damage that is found later
        try:
            image = _opened(content, path.name)
        except FormatError:
            raise
        except damage:
            raise _unreadable(path, content, IMAGES, "a complete one, of whole numbers of 8 or 16 bits") from None
    width, height = image.decoder.size
    _check_size(path, width, height)
    if path.suffix.lower() in RAW_SUFFIXES and max(width, height) < MIN_PREVIEW:
        small = f"{path.name} holds a preview of {width} x {height} pixels, and {MIN_PREVIEW} are needed"
        raise FormatError(f"{small}; put the camera's JPEG of the same name beside it")
    mode = image.decoder.mode
    if mode not in _MODES or "transparency" in image.decoder.info:
        kind = f"{mode} with transparency" if mode in _MODES else mode
        raise FormatError(f"{path.name} is a {kind} image; use RGB or grey with 8 or 16 bits and without alpha")
    return image


def _unreadable(path: Path, content: bytes, kind: str, use: str) -> FormatError:
    """Say which other kind a file is by its first bytes, or else that it is damaged."""
    start = content[:64].lstrip().lower()
    if other := next((name for head, name in _OTHER_KINDS.items() if start.startswith(head)), None):
        return FormatError(f"{path.name} is {other} file by its first bytes; use a {kind} file")
    return FormatError(f"{path.name} is not a readable {kind} file; use {use}")


def _preview(path: Path) -> bytes:
    """Return the file of the preview that a RAW file holds, upright by its own tags."""
    import cv2
    import rawpy

    with _open_raw(path) as raw:
        flip = {3: 3, 5: 8, 6: 6}.get(raw.sizes.flip)
        try:
            preview = raw.extract_thumb()
        except (rawpy.LibRawNoThumbnailError, rawpy.LibRawUnsupportedThumbnailError):
            put = "put the camera's JPEG of the same name beside it"
            raise FormatError(f"{path.name} holds no preview; {put}") from None
    if preview.format == rawpy.ThumbFormat.JPEG:
        return bytes(preview.data)
    return bytes(cv2.imencode(".png", np.ascontiguousarray(_turned(preview.data, flip)[..., ::-1]))[1])


def _opened(content: bytes, name: str) -> _Image:
    """Open an image by its content: HEIC with libheif, AVIF, of the same container, and all others with Pillow."""
    from PIL import Image

    if content[4:8] == b"ftyp" and not re.search(rb"avi[fs]", content[8 : int.from_bytes(content[:4], "big")]):
        import pi_heif

        heif = pi_heif.open_heif(BytesIO(content), convert_hdr_to_8bit=False)
        tags = _exif_tags("HEIF", heif.info.get("exif") or b"")
        tags.pop(_ORIENTATION, None)  # libheif turns by itself
        return _Image("HEIF", heif, tags, 16 if heif.mode.endswith(";16") else 8, content)
    tags = {}
    if content[:4] in (b"II*\0", b"MM\0*") and (page := _largest_page(content, name)):
        tags = _exif_tags("TIFF", content)  # the page of a thumbnail may be the one that tells the exposure
        content = content[:4] + struct.pack("<I" if content[:1] == b"I" else ">I", page) + content[8:]
    image: Any = Image.open(BytesIO(content), formats=("JPEG", "PNG", "TIFF", "WEBP", "AVIF"))
    kind = "JPEG" if image.format == "MPO" else str(image.format)
    bits = content[24] if kind == "PNG" else max(image.tag_v2.get(_BITS, (1,))) if kind == "TIFF" else 8
    return _Image(kind, image, tags | _exif_tags(kind, image), bits if 8 < bits <= 16 else 8, content)


def _largest_page(content: bytes, name: str) -> int:
    """Return where the largest page of a TIFF file stands, those of SubIFDs among them; 0 where it is the first."""
    from tifffile import TiffFile

    logging.getLogger("tifffile").setLevel(logging.CRITICAL)  # damage is told by one sentence of ours
    with TiffFile(BytesIO(content)) as file:
        pages = [inner for page in file.pages for inner in (page, *(page.pages or () if page.subifds else ()))]
        largest = max(pages, key=lambda page: page.imagewidth * page.imagelength)
        alike = sum(page.shape == largest.shape for page in pages if not page.subfiletype & _MASK)
        if alike > 1:
            raise FormatError(f"{name} holds {alike} pictures of one size; use a file for each")
        return 0 if largest is pages[0] else int(largest.offset)


def _decode(image: _Image) -> NDArray[Any]:
    """Decode what was opened, upright and red first."""
    import cv2

    pixels: Any
    if image.kind in ("HEIF", "WEBP", "AVIF") or (image.kind == "TIFF" and image.bits < 16):
        pixels = np.array(image.decoder)  # a copy, as libheif frees its own
        return _turned(pixels, image.tags.get(_ORIENTATION)) if image.kind in ("WEBP", "AVIF") else pixels
    if image.kind == "TIFF" and image.decoder.tag_v2.get(_PLANAR) == 2:
        return _decode_planes(image)
    flags = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        pixels = cv2.imdecode(np.frombuffer(image.content, np.uint8), flags)
    except cv2.error as error:
        raise ValueError from error
    if pixels is None:
        raise ValueError(image.kind)
    if pixels.ndim == 3:  # OpenCV has blue first, and garbles TIFF files of 16 bits where it is asked for red
        pixels = cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB if pixels.shape[2] == 3 else cv2.COLOR_BGRA2RGBA)
    if image.kind != "TIFF":
        return _turned(pixels, image.tags.get(_ORIENTATION))
    return 65535 - pixels if image.decoder.tag_v2.get(_PHOTOMETRIC) == 0 else pixels  # 0: white is 0


def _decode_planes(image: _Image) -> NDArray[Any]:
    """Decode a TIFF file of 16 bits stored plane by plane, of which OpenCV makes garbage."""
    from tifffile import TiffFile

    with TiffFile(BytesIO(image.content)) as file:
        try:
            planes = file.pages.first.asarray()
        except ImportError:
            raise ValueError("its compression needs the 'imagecodecs' package") from None
    return _turned(planes if planes.ndim == 2 else np.moveaxis(planes, 0, -1), image.tags.get(_ORIENTATION))


def _turned(pixels: NDArray[Any], orientation: int | None) -> NDArray[Any]:
    """Turn pixels upright by an EXIF orientation from 1 to 8."""
    if orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    rows, columns = (slice(None, None, -1 if orientation in turned else 1) for turned in ((3, 4, 7, 8), (2, 3, 6, 7)))
    return pixels[rows, columns]


def _exif_tags(kind: str, source: Any) -> dict[int, Any]:
    """Return the EXIF tags of what Pillow opened, or of bytes; none where they are missing or damaged."""
    from PIL import Image

    if kind == "PNG" and "exif" not in source.info:
        return {}  # Pillow would decode the pixels to look behind them
    with warnings.catch_warnings(), suppress(*_DAMAGE):
        warnings.simplefilter("ignore")
        if isinstance(source, bytes):
            exif = Image.Exif()
            exif.load(source)
        else:
            exif = source.getexif()
        return {**exif, **exif.get_ifd(_EXIF_FOLDER)}
    return {}


def _power(value: Any, base: float) -> float | None:
    """Return what an APEX value stands for, a power of a base; none where it is no number or absurd."""
    number = _number(value)
    return None if number is None or abs(number) > 40 else float(base**number)


def _positive(value: Any) -> float | None:
    number = _number(value)
    return number if number is not None and 1e-30 < number < 1e30 else None


def _number(value: Any) -> float | None:
    """Return a finite number if it is one; the first one of several."""
    try:
        number = float(value[0] if isinstance(value, tuple) else value)
    except (TypeError, ValueError, IndexError, ZeroDivisionError, OverflowError):
        return None
    return number if isfinite(number) else None


def _content(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise FormatError(f"{path.name} has {size} bytes; use a photograph of {MAX_BYTES} bytes or less")
        return path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path.name} cannot be read ({error.strerror}); use a file that is there") from None


def _check_size(path: Path, width: int, height: int) -> None:
    if not 0 < width * height <= MAX_PIXELS:
        raise FormatError(f"{path.name} announces {width} x {height} pixels; use 1 to {MAX_PIXELS} pixels")


def reduced(pixels: Pixels, longest: int) -> Pixels:
    """Reduce an image (h, w) or (h, w, c) so that its longer side has no more than that many pixels."""
    import cv2

    scale = min(1.0, longest / max(pixels.shape[:2]))
    size = [max(2, round(scale * length)) for length in pixels.shape[1::-1]]
    return cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)  # type: ignore[return-value]
