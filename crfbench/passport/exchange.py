"""Reading and writing a response in any of the formats, by the end of its file's name."""

from pathlib import Path

from crfbench.checks import check_choice
from crfbench.errors import FormatError, InputError, MissingDataError
from crfbench.files import write_new
from crfbench.passport.formats import FORMATS, decode
from crfbench.passport.passport import Passport

# A passport of 3 curves with its band takes 0.2 MB, a project file of Hugin little more.
_MOST_BYTES = 32 * 2**20


def write_response(passport: Passport, path: str | Path, format: str | None = None, overwrite: bool = False) -> None:
    """Write the response for another program.

    Parameters
    ----------
    passport : Passport
    path : path
    format : str, optional
        A name in `crfbench.passport.formats.FORMATS`; by default that of the end of the file's name.
    overwrite : bool

    Raises
    ------
    InputError
        For an unknown format, a passport that the format cannot hold, and where there is a file already and
        `overwrite` is false.
    MissingDataError
        For "hugin" where the published EMoR basis is absent.
    """
    module = FORMATS[_format(path, format)]
    write_new(path, module.write(passport), overwrite)


def read_response(path: str | Path, format: str | None = None) -> Passport:
    """Read a response that `write_response` or another program wrote.

    Parameters
    ----------
    path : path
    format : str, optional
        A name in `crfbench.passport.formats.FORMATS`; by default that of the end of the file's name.

    Returns
    -------
    Passport
        What the format does not carry stays unknown.

    Raises
    ------
    InputError
        For an unknown format.
    MissingDataError
        For a path that leads nowhere, and for "hugin" where the published EMoR basis is absent.
    FormatError
        For a file that is not of the format.
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


def _format(path: str | Path, name: str | None) -> str:
    """Choose the format; of several that fit the file's name, that of the longest suffix."""
    ends = {key: module.SUFFIX for key, module in FORMATS.items()}
    if name is not None:
        return check_choice("format", name, FORMATS)
    fitting = [key for key, suffix in ends.items() if Path(path).name.lower().endswith(suffix)]
    if not fitting:
        raise InputError(f"the name {path} tells no format; let it end in one of {', '.join(ends.values())}")
    return max(fitting, key=lambda key: len(ends[key]))
