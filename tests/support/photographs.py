"""Write a rendered scene as a camera would: a DNG with a Bayer mosaic and a JPEG with EXIF, one pair of files.

Tags after the Digital Negative Specification 1.4 and EXIF 2.32 (CIPA DC-008).
"""

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crfbench.curves import Array
from crfbench.files import write_atomically
from tests.support.scenes import Scene

MODEL = "crfbench synthetic"
# 14 bits above a pedestal, as many cameras have it.
BLACK, WHITE = 512, 16383
# Which channel (0 red, 1 green, 2 blue) each of 2 x 2 sensor pixels sees.
_RGGB = ((0, 1), (1, 2))
_MODEL_TAG, _ORIENTATION_TAG, _EXIF_FOLDER = 0x0110, 0x0112, 0x8769
_EXPOSURE_TIME_TAG, _F_NUMBER_TAG, _ISO_TAG = 0x829A, 0x829D, 0x8827
_SHORT, _LONG, _BYTE, _TEXT, _RATIO, _SIGNED_RATIO = 3, 4, 1, 2, 5, 10


def write_pair(
    folder: Path,
    stem: str,
    scene: Scene,
    *,
    exposure_time: float = 0.01,
    f_number: float = 5.6,
    iso: int = 100,
    model: str = MODEL,
    orientation: int = 1,
    quality: int = 95,
) -> tuple[Path, Path]:
    """Write ``stem.jpg`` and ``stem.dng``.

    Parameters
    ----------
    folder : path
        Made if it is missing.
    stem : str
        Name of both files without the extension.
    scene : Scene
        Of even width and height, as the mosaic needs them.
    exposure_time, f_number, iso, model
        What both files say about the exposure (seconds, focal ratio, ISO speed) and the camera.
    orientation : {1, 3, 6, 8}
        EXIF tag: how a reader has to turn both images; the files hold the scene as it is.
    quality : int
        Of the JPEG, 1 to 95; colours are not subsampled.

    Returns
    -------
    tuple of path
        The JPEG and the DNG.
    """
    exposure = {_EXPOSURE_TIME_TAG: exposure_time, _F_NUMBER_TAG: f_number, _ISO_TAG: iso}
    jpeg, dng = Path(folder) / f"{stem}.jpg", Path(folder) / f"{stem}.dng"
    write_atomically(jpeg, _jpeg(scene.jpeg, exposure, model, orientation, quality))
    write_atomically(dng, _dng(_mosaic(scene.raw), exposure, model, orientation))
    return jpeg, dng


def write_raw(
    path: Path,
    raw: Array,
    preview: NDArray[np.uint8],
    *,
    balance: tuple[float, float, float] = (1.0, 1.0, 1.0),
    model: str = MODEL,
    orientation: int = 1,
    beside: bool = False,
    bitmap: bool = False,
) -> Path:
    """Write a DNG that holds its own preview, as cameras do: a JPEG of quality 85 with halved colours.

    Parameters
    ----------
    path : path
        Ends in ``.dng``.
    raw : ndarray, shape (height, width, 3)
    preview : ndarray of uint8, shape (h, w, 3)
    balance : tuple of float
        Factors that make the sensor's red, green and blue of a grey equal.
    model, orientation
        As in `write_pair`; the preview tells no orientation of its own.
    beside : bool
        Whether the preview is written as a JPEG of the same name, upright by its tag, in place of inside.
    bitmap : bool
        Whether the preview is stored without compression.
    """
    exposure = {_EXPOSURE_TIME_TAG: 0.01, _F_NUMBER_TAG: 5.6, _ISO_TAG: 100}
    encoded = _jpeg(preview, exposure, model, orientation if beside else None, 85, subsampling=2)
    if beside:
        write_atomically(path.with_suffix(".jpg"), encoded)
    size, content = (preview.shape[:2], preview.tobytes()) if bitmap else (preview.shape[:2], encoded)
    inner = None if beside else (size, content, 1 if bitmap else 7)
    write_atomically(path, _dng(_mosaic(raw), exposure, model, orientation, inner, balance))
    return path


def write_linear(path: Path, pixels: NDArray[np.uint16], model: str = MODEL, orientation: int = 1) -> Path:
    """Write a DNG of linear values (h, w) or (h, w, 3), from black to white level, that need no demosaicing."""
    exposure, channels = {_EXPOSURE_TIME_TAG: 0.01, _F_NUMBER_TAG: 5.6, _ISO_TAG: 100}, pixels[0, 0].size
    tags = _dng_tags(pixels.shape[:2], exposure, model, orientation)
    # Without a mosaic, and the grey one without colours.
    for tag in (33421, 33422, *((50721, 50728, 50778) if channels == 1 else ())):
        del tags[tag]
    tags |= {262: (_SHORT, 34892), 277: (_SHORT, channels), 258: (_SHORT, (16,) * channels)}
    tags |= {279: (_LONG, pixels.nbytes), 50714: (_LONG, (BLACK,) * channels), 50717: (_LONG, (WHITE,) * channels)}
    write_atomically(path, b"II*\0\x08\0\0\0" + _folder(tags, 8) + pixels.astype("<u2").tobytes())
    return path


def _jpeg(
    image: NDArray[np.uint8],
    exposure: dict[int, float],
    model: str,
    orientation: int | None,
    quality: int,
    subsampling: int = 0,
) -> bytes:
    from PIL import Image

    exif = Image.Exif()
    if orientation:
        exif[_MODEL_TAG], exif[_ORIENTATION_TAG] = model, orientation
        exif.get_ifd(_EXIF_FOLDER).update(exposure)
    file = BytesIO()
    Image.fromarray(image).save(file, "JPEG", quality=quality, subsampling=subsampling, exif=exif)
    return file.getvalue()


def _mosaic(raw: Array) -> NDArray[np.uint16]:
    """Return what a Bayer sensor records: one channel a pixel, from black to white level, shape (height, width)."""
    channel = np.tile(_RGGB, (raw.shape[0] // 2, raw.shape[1] // 2))
    seen = np.take_along_axis(raw, channel[..., None], axis=-1)[..., 0]
    return np.rint(BLACK + seen * (WHITE - BLACK)).astype(np.uint16)


def _dng(
    mosaic: NDArray[np.uint16],
    exposure: dict[int, float],
    model: str,
    orientation: int,
    preview: tuple[tuple[int, ...], bytes, int] | None = None,
    balance: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> bytes:
    """Return the file; a preview (its height and width, content, TIFF's compression) comes first, as in cameras'."""
    tags = _dng_tags(mosaic.shape, exposure, model, orientation, balance)
    content = mosaic.astype("<u2").tobytes()
    if preview is None:
        return b"II*\0\x08\0\0\0" + _folder(tags, 8) + content
    whole = (254, 256, 257, 258, 259, 262, 273, 277, 278, 279, 33421, 33422, 50714, 50717)  # about pixels
    first = {tag: entry for tag, entry in tags.items() if tag not in whole}
    (height, width), stored, compression = preview
    first |= {
        254: (_LONG, 1),  # NewSubfileType: a preview
        256: (_LONG, width),
        257: (_LONG, height),
        258: (_SHORT, (8, 8, 8)),
        259: (_SHORT, compression),
        262: (_SHORT, 6 if compression == 7 else 2),  # PhotometricInterpretation: YCbCr or RGB
        273: (_LONG, 0),
        277: (_SHORT, 3),
        278: (_LONG, height),
        279: (_LONG, len(stored)),
        330: (_LONG, 0),  # SubIFDs: where the mosaic's folder stands
    }
    start = 8 + len(_folder(first, 8)) + len(stored)
    first[330] = (_LONG, start)
    inner = _folder({tag: tags[tag] for tag in whole}, start)
    return b"II*\0\x08\0\0\0" + _folder(first, 8) + stored + inner + content


def _folder(tags: dict[int, tuple[int, Any]], offset: int) -> bytes:
    """Return a folder of tags at that offset, whose StripOffsets is what follows it."""
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

    folder = ImageFileDirectory_v2(prefix=b"II")
    for tag, (kind, value) in tags.items():
        folder.tagtype[tag], folder[tag] = kind, value
    return bytes(folder.tobytes(offset))


def _dng_tags(
    shape: tuple[int, ...],
    exposure: dict[int, float],
    model: str,
    orientation: int,
    balance: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> dict[int, tuple[int, Any]]:
    """Return type and value of every tag of the one folder of the file."""
    height, width = shape
    return {
        254: (_LONG, 0),  # NewSubfileType: the whole image
        256: (_LONG, width),
        257: (_LONG, height),
        258: (_SHORT, 16),  # BitsPerSample
        259: (_SHORT, 1),  # Compression: none
        262: (_SHORT, 32803),  # PhotometricInterpretation: mosaic
        271: (_TEXT, "crfbench"),  # Make
        _MODEL_TAG: (_TEXT, model),
        273: (_LONG, 0),  # StripOffsets
        _ORIENTATION_TAG: (_SHORT, orientation),
        277: (_SHORT, 1),  # SamplesPerPixel
        278: (_LONG, height),  # RowsPerStrip
        279: (_LONG, 2 * height * width),  # StripByteCounts
        _EXIF_FOLDER: (_LONG, exposure),
        33421: (_SHORT, (2, 2)),  # CFARepeatPatternDim
        33422: (_BYTE, bytes(np.ravel(_RGGB).tolist())),  # CFAPattern
        50706: (_BYTE, bytes([1, 4, 0, 0])),  # DNGVersion
        50707: (_BYTE, bytes([1, 1, 0, 0])),  # DNGBackwardVersion
        50708: (_TEXT, model),  # UniqueCameraModel
        50714: (_LONG, BLACK),  # BlackLevel
        50717: (_LONG, WHITE),  # WhiteLevel
        50721: (_SIGNED_RATIO, tuple(np.eye(3).ravel().tolist())),  # ColorMatrix1
        50728: (_RATIO, tuple(1 / factor for factor in balance)),  # AsShotNeutral
        50778: (_SHORT, 21),  # CalibrationIlluminant1: D65
    }
