"""Files: written so that none is ever half-written or replaced unasked, and read so that damage is noticed."""

import os
import secrets
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from crfbench.errors import FormatError, InputError

_PACKAGE = Path(__file__).resolve().parent

# What NumPy and zipfile raise on bytes that are not an npz file, or on one that was cut or altered.
_NPZ_DAMAGE = (OSError, EOFError, ValueError, KeyError, RuntimeError, zipfile.BadZipFile, zlib.error)


@contextmanager
def reading_npz(
    path: Path, wrong: str = "is missing or damaged", use: str = "install crfbench again to restore it"
) -> Iterator["np.lib.npyio.NpzFile"]:
    """Open an npz file, by default a bundled one; what is wrong with it or its arrays is a `FormatError`."""
    try:
        with zipfile.ZipFile(path) as archive:  # NumPy would read altered numbers without a word
            if (broken := archive.testzip()) is not None:
                raise zipfile.BadZipFile(f"wrong checksum of {broken}")
        with np.load(path, allow_pickle=False) as file:
            yield file
    except _NPZ_DAMAGE as error:
        raise FormatError(f"{path.name} {wrong} ({error}); {use}") from None


def write_atomically(path: str | Path, content: bytes | Callable[[Path], object], overwrite: bool = True) -> None:
    """Write a temporary file beside `path`, with that content or by that function, then rename it into place.

    What a symbolic link points to is replaced, not the link. An `OSError` names `path`, where it cannot be written.
    Without `overwrite`, of two processes that write it at the same time the first one counts.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    real = Path(os.path.realpath(path))
    # Short, as the name of the file itself may be as long as a name can be.
    temporary = real.with_name(f".crfbench-{secrets.token_hex(8)}")
    try:
        if callable(content):
            content(temporary)
        else:
            temporary.write_bytes(content)  # with the permissions that the umask leaves
        if not overwrite:
            with suppress(OSError):  # a camera's card has no links
                return os.link(temporary, real)
            check_new(path, overwrite)
        temporary.replace(real)
    except OSError as error:  # names the file that was asked for, not the temporary one
        raise type(error)(error.errno, error.strerror or str(error), str(path)) from None
    finally:
        temporary.unlink(missing_ok=True)


def check_new(path: str | Path, overwrite: bool) -> Path:
    """Return `path`; raise `InputError` where there is something already and `overwrite` is false."""
    if Path(path).exists() and not overwrite:
        raise InputError(f"{path} exists already; use another path or overwrite=True (--force on the command line)")
    return Path(path)


def write_new(path: str | Path, content: bytes | Callable[[Path], object], overwrite: bool) -> None:
    """Write a file, complete or not at all, and replace an older one only where `overwrite` says so."""
    write_atomically(check_new(path, overwrite), content, overwrite)


def bundled(name: str) -> Path:
    """Return the path of a bundled folder or file, for example ``data/opencrf.npz`` or ``notebooks``.

    They lie inside an installed package, or beside it in a checkout.
    """
    installed = _PACKAGE / name
    return installed if installed.exists() else _PACKAGE.parent / name
