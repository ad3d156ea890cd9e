"""A NumPy file of float64: the inverse response, shape (1024,) for one curve and (3, 1024) for red, green, blue.

Carries the channels, to the last digit. The direction is always inverse; of the rest of the passport, bands among
it, nothing.
"""

import io
from tokenize import TokenError

import numpy as np

from crfbench.errors import FormatError
from crfbench.passport.passport import Passport

SUFFIX = ".npy"

_MAGIC = b"\x93NUMPY"
# What NumPy raises on a head or data that were cut or altered.
_DAMAGE = (ValueError, EOFError, OSError, MemoryError, OverflowError, TypeError, SyntaxError, TokenError)


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
    """Read a ``.npy`` file of real numbers; nothing in it can run code.

    Raises
    ------
    FormatError
        For bytes that are no such file.
    """
    if not data.startswith(_MAGIC):
        raise FormatError("it does not begin as a .npy file does")
    try:
        array: np.ndarray = np.load(io.BytesIO(data), allow_pickle=False)
    except _DAMAGE as error:
        raise FormatError(f"the .npy file is damaged ({str(error)[:80]})") from None
    if array.dtype.kind not in "fiu":
        raise FormatError(f"it holds {array.dtype}; use real numbers")
    return array
