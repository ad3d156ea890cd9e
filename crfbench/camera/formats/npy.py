"""A NumPy file of float64: the inverse response, shape (1024,) for one curve and (3, 1024) for red, green, blue.

Keeps the channels, to the last digit. The direction is always inverse; loses the rest, such as the band.
"""

import io
import re

import numpy as np

from crfbench.camera.passport import Passport
from crfbench.errors import FormatError

SUFFIX = ".npy"

# The head as NumPy writes it, of plain real numbers. NumPy's own reader tries to make sense of damaged heads.
_HEAD = re.compile(
    rb"\x93NUMPY(?:\x01\x00..|[\x02\x03]\x00....)\{'descr': '(?P<kind>[<>|](?:f[248]|[iu][1248]))', "
    rb"'fortran_order': (?P<fortran>False|True), 'shape': \((?P<shape>[\d, ]{,40})\), \} *\n",
    re.DOTALL,
)


def write(passport: Passport) -> bytes:
    """Write the inverse response."""
    curves = passport.in_direction("inverse")
    return save_array(curves if len(curves) > 1 else curves[0])


def read(data: bytes) -> Passport:
    """Read curves; the samples must be on the grid already."""
    return Passport("inverse", load_array(data))


def save_array(array: np.ndarray) -> bytes:
    """Return the content of a ``.npy`` file."""
    file = io.BytesIO()
    np.save(file, array, allow_pickle=False)
    return file.getvalue()


def load_array(data: bytes) -> np.ndarray:
    """Read a ``.npy`` file of real numbers, in which nothing can run code; other bytes are a `FormatError`."""
    head = _HEAD.match(data)
    if not head:
        raise FormatError("it does not begin as a .npy file of real numbers does")
    shape = [int(size) for size in head["shape"].replace(b",", b" ").split()]
    try:
        flat = np.frombuffer(data, head["kind"].decode(), offset=head.end())
        return flat.reshape(shape, order="F" if head["fortran"] == b"True" else "C")
    except (ValueError, OverflowError) as error:
        raise FormatError(f"the .npy file is damaged ({str(error)[:80]})") from None
