"""Write linear images for other programs."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.errors import InputError
from crfbench.files import check_new, write_new

SUFFIXES = (".exr", ".tif", ".tiff", ".hdr")


def write_hdr(path: str | Path, radiance: ArrayLike, overwrite: bool = False) -> None:
    """Write a linear image, complete or not at all.

    Parameters
    ----------
    path : path
        ``.exr`` (OpenEXR, ZIP) and ``.tif`` or ``.tiff`` (not compressed) keep every float32 exactly; ``.hdr``
        (Radiance) keeps 8 bits and a common exponent.
    radiance : array_like, shape (h, w, 3)
        Red, green and blue, finite, not negative.
    overwrite : bool

    Raises
    ------
    InputError
        For another suffix or image, and where there is a file already and `overwrite` is false.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"the name {path} tells no format; let it end in one of {', '.join(SUFFIXES)}")
    pixels = np.asarray(radiance)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or not pixels.size or pixels.dtype.kind not in "fiu":
        raise InputError(f"the image is {pixels.dtype} of shape {pixels.shape}; use numbers of shape (h, w, 3)")
    pixels = np.ascontiguousarray(pixels, dtype=np.float32)
    if not np.isfinite(pixels).all() or pixels.min() < 0:
        raise InputError("the image holds values that are negative or not finite in float32; use radiances from 0")
    check_new(path, overwrite)
    write_new(path, _exr(pixels) if suffix == ".exr" else _encoded(suffix, pixels), overwrite)


def _exr(pixels: NDArray[np.float32]) -> bytes:
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with TemporaryDirectory() as folder:  # the library writes to files only
        file = Path(folder) / "image.exr"
        OpenEXR.File(header, {"RGB": pixels}).write(str(file))
        return file.read_bytes()


def _encoded(suffix: str, pixels: NDArray[np.float32]) -> bytes:
    import cv2

    options = [cv2.IMWRITE_TIFF_COMPRESSION, cv2.IMWRITE_TIFF_COMPRESSION_NONE] if suffix.startswith(".tif") else []
    return bytes(cv2.imencode(suffix, pixels[..., ::-1], options)[1].tobytes())
