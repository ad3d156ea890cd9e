"""A NumPy file of float64: the inverse response, shape (1024,) for one curve and (3, 1024) for red, green, blue.

Carries the channels, to the last digit. The direction is always inverse; of the rest of the passport, bands among
it, nothing.
"""

import io
import re
from tokenize import TokenError

import numpy as np

from crfbench.errors import FormatError
from crfbench.passport.passport import Passport

SUFFIX = ".npy"

# The head as NumPy writes it, of plain real numbers: nothing else reaches NumPy's parser.
_HEAD = re.compile(
    rb"\x93NUMPY(?:\x01\x00..|[\x02\x03]\x00....)"
    rb"\{'descr': '[<>|][fiu]\d+', 'fortran_order': (?:False|True), 'shape': \([\d, ]*\), \} *\n",
    re.DOTALL,
)
# What NumPy raises on a head of the wrong length or data that were cut.
_DAMAGE = (ValueError, EOFError, MemoryError, OverflowError, SyntaxError, TokenError)


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
    if not _HEAD.match(data):
        raise FormatError("it does not begin as a .npy file of real numbers does")
    try:
        return np.asarray(np.load(io.BytesIO(data), allow_pickle=False))
    except _DAMAGE as error:
        raise FormatError(f"the .npy file is damaged ({str(error)[:80]})") from None
