"""The formats of a response, one small file each; a new one gets its line in the table and joins every test.

A module has the end of its files' names as ``SUFFIX``, ``write`` (passport to bytes) and ``read`` (bytes to passport),
which raises `InputError` or `FormatError` for bytes of another kind.
"""

from pathlib import Path
from types import ModuleType

import numpy as np

from crfbench.camera.formats import csv_table, cube, dorf, hugin, npy, opencv, passport_json, pcalib
from crfbench.camera.passport import Passport
from crfbench.checks import check_choice
from crfbench.errors import FormatError, InputError, MissingDataError
from crfbench.files import write_new

#: Every format by its name.
FORMATS: dict[str, ModuleType] = {
    "passport": passport_json,
    "csv": csv_table,
    "npy": npy,
    "opencv": opencv,
    "dorf": dorf,
    "cube": cube,
    "hugin": hugin,
    "pcalib": pcalib,
}

# A passport of 3 curves with its band takes 0.2 MB, a project file of Hugin little more.
_MOST_BYTES = 32 * 2**20


def write_response(passport: Passport, path: str | Path, format: str | None = None, overwrite: bool = False) -> None:
    """Write the response for another program.

    For "hugin" the published EMoR basis must have been fetched, else this is a `MissingDataError`.

    Parameters
    ----------
    passport : Passport
        Of one curve, where the format holds no more.
    path : path
    format : str, optional
        A name in `crfbench.camera.FORMATS`; by default that of the end of the file's name.
    overwrite : bool
    """
    module = FORMATS[_format(path, format)]
    write_new(path, module.write(passport), overwrite)


def read_response(path: str | Path, format: str | None = None) -> Passport:
    """Read a response that `write_response` or another program wrote.

    A path that leads nowhere is a `MissingDataError`, a file of another format a `FormatError`.

    Parameters
    ----------
    path : path
    format : str, optional
        A name in `crfbench.camera.FORMATS`; by default that of the end of the file's name.

    Returns
    -------
    Passport
        What the format does not carry stays unknown.
    """
    name = _format(path, format)
    if not Path(path).is_file():
        raise MissingDataError(f"there is no file {path}; use one that holds a response")
    if Path(path).stat().st_size > _MOST_BYTES:
        raise FormatError(f"{path} has more than {_MOST_BYTES} bytes; a response has fewer")
    try:
        return decode(name, Path(path).read_bytes())
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from None


def decode(name: str, data: bytes) -> Passport:
    """Turn the content of a file of that format into a passport; `FormatError` for bytes that are not of the format."""
    try:
        with np.errstate(all="ignore"):  # what overflows is not finite, which Passport refuses
            passport: Passport = FORMATS[name].read(data)
            return passport
    except (InputError, FormatError) as error:
        raise FormatError(f"this is not a response in the format {name!r}: {error}") from None


def _format(path: str | Path, name: str | None) -> str:
    """Choose the format; of several whose suffix the file's name has, that of the longest."""
    if name is not None:
        return check_choice("format", name, FORMATS)
    ends = {key: module.SUFFIX for key, module in FORMATS.items()}
    matching = [key for key, suffix in ends.items() if Path(path).name.lower().endswith(suffix)]
    if not matching:
        raise InputError(f"the name {path} tells no format; let it end in one of {', '.join(ends.values())}")
    return max(matching, key=lambda key: len(ends[key]))
