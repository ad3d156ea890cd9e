"""The formats of a response, one small file each; a new one gets its line in the table and joins every test.

A module has the end of its files' names as ``SUFFIX``, and ``write`` (passport to bytes) and ``read`` (bytes to
passport), which raises `InputError` or `FormatError` for bytes that do not fit.
"""

from typing import Protocol

import numpy as np

from crfbench.errors import FormatError, InputError
from crfbench.passport.formats import csv_table, cube, dorf, hugin, npy, opencv, passport_json, pcalib
from crfbench.passport.passport import Passport


class Format(Protocol):
    """What every module of the table has."""

    SUFFIX: str

    def write(self, passport: Passport) -> bytes:
        """Turn a passport into the content of a file."""

    def read(self, data: bytes) -> Passport:
        """Turn the content of a file into a passport."""


#: Every format by its name.
FORMATS: dict[str, Format] = {
    "passport": passport_json,
    "csv": csv_table,
    "npy": npy,
    "opencv": opencv,
    "dorf": dorf,
    "cube": cube,
    "hugin": hugin,
    "pcalib": pcalib,
}


def decode(name: str, data: bytes) -> Passport:
    """Turn the content of a file of that format into a passport.

    Raises
    ------
    FormatError
        For bytes that are not of the format.
    """
    try:
        with np.errstate(all="ignore"):  # what overflows is not finite, which Passport refuses
            return FORMATS[name].read(data)
    except (InputError, FormatError) as error:
        raise FormatError(f"this is no response in the format {name!r}: {error}") from None
