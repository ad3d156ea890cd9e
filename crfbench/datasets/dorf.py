"""DoRF, the database of response functions: 201 measured responses of films, sensors and cameras.

Grossberg and Nayar 2004, "Modeling the space of camera response functions", doi:10.1109/TPAMI.2004.88.
No licence is stated, so crfbench does not ship it: ``crfbench fetch dorf`` gets it.
"""

import hashlib
import json
import re
import zipfile
import zlib
from functools import cache
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from crfbench.curves import GRID, N_SAMPLES, Array, as_curves, resample
from crfbench.datasets.registry import find, known, require
from crfbench.datasets.responses import Responses
from crfbench.errors import FormatError, InputError
from crfbench.resources import shipped

MEMBER = "dorfCurves.txt"
# 201 records of 2048 printed numbers make about 7 MB.
MAX_TEXT_BYTES = 32 * 2**20

_MAT = "dorf/201_CRF_data.mat"
_OFFICIAL = ("dorf/dorfCurves.zip", f"dorf/{MEMBER}")
_CHANNEL = re.compile(r"(?<=.)[\s_-]*(Red|Green|Blue)$")
# Far above the rounding of any of the files, far below the distance of two cameras.
_COPY_RMSE = 1e-4
_GRID_TOLERANCE = 1e-6
_FINGERPRINT_TOLERANCE = 1e-4
# What zipfile raises on bytes that are no archive, or one that was cut or altered.
_ZIP_DAMAGE = (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, NotImplementedError)


class DorfText(NamedTuple):
    """The records of the official text: n names, n scale labels, irradiance and brightness (n, 1024).

    Parameters
    ----------
    names : tuple of str, length n
    scale_labels : tuple of str, length n
    irradiance, brightness : ndarray, shape (n, 1024)
    """

    names: tuple[str, ...]
    scale_labels: tuple[str, ...]
    irradiance: Array
    brightness: Array


def load_dorf() -> Responses:
    """Load DoRF from the data folders; the official text is preferred, for its names.

    With names, the unit of a curve is its film or camera (the name without Red, Green or Blue), and two films
    whose curves are copies are one unit. Without (the ``.mat``), curves that chain within an RMSE of 0.01 are one.

    Returns
    -------
    Responses
        201 forward responses.

    Raises
    ------
    MissingDataError
        If neither file is there.
    FormatError
        If the file that is there is damaged or does not hold the DoRF curves.
    """
    official = next((path for path in map(find, _OFFICIAL) if path), None)
    path = official or require(_MAT, "dorf")
    try:
        return read_official(path) if official else _read_nameless(path)
    except FormatError as error:
        raise FormatError(f"{path} is not DoRF: {error}; delete it and run 'crfbench fetch dorf'") from error


def _read_nameless(path: Path) -> Responses:
    """Read the ``.mat``."""
    from crfbench.datasets.folds import near_copies

    curves = _known_curves(*_read_mat(path))
    names = tuple(f"curve {number}" for number in range(1, len(curves) + 1))
    units = tuple(f"group {group}" for group in near_copies(curves) + 1)
    return _responses(curves, names, units, path)


def _known_curves(irradiance: Array, brightness: Array) -> Array:
    """Bring the records onto the grid and check that they are DoRF's."""
    try:
        curves = np.array(list(map(_on_grid, irradiance, brightness)))
    except InputError as error:
        raise FormatError(str(error)) from None
    check_fingerprint(curves)
    return curves


def _responses(curves: Array, names: tuple[str, ...], units: tuple[str, ...], path: Path) -> Responses:
    n = len(curves)
    source = f"DoRF, {path.name} (Grossberg and Nayar 2004)"
    return Responses("dorf", curves, names, units, ("measured",) * n, (source,) * n, ("unknown",) * n)


def _on_grid(irradiance: ArrayLike, brightness: ArrayLike) -> Array:
    """Resample one record; samples that are on the grid but for rounding are taken as they are."""
    x = np.asarray(irradiance, dtype=np.float64)
    return resample(GRID if np.abs(x - GRID).max() < _GRID_TOLERANCE else x, brightness)


def _named_units(names: tuple[str, ...], curves: Array) -> tuple[str, ...]:
    """Name the unit of each curve after the first curve that shares its film's name or is a copy of it."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    from crfbench.datasets.folds import near_copies

    films = np.array([_CHANNEL.sub("", name) for name in names])
    copies = near_copies(curves, _COPY_RMSE)
    related = (films[:, None] == films) | (copies[:, None] == copies)
    units = connected_components(csr_array(related), directed=False)[1]
    return tuple(str(films[np.argmax(units == unit)]) for unit in units)


def _read_mat(path: Path) -> tuple[Array, Array]:
    """Read I and B, (n, 1024) each, as float64."""
    from scipy.io import loadmat

    # SciPy's reader can crash on damaged bytes, so it gets only the file that is known.
    with path.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    if found not in (file.sha256 for file in known()["dorf"].files):
        raise FormatError(f"its SHA-256 {found} is not the known one")
    content = loadmat(path, variable_names=["I", "B"])
    return as_curves(content["I"]), as_curves(content["B"])


def read_official(path: Path) -> Responses:
    """Read the official zip, or the ``.txt`` inside it, and check that it holds the DoRF curves.

    Raises
    ------
    FormatError
        If it is damaged, unsafe to unpack or holds other curves.
    """
    data = path.read_bytes() if path.suffix == ".txt" else _read_member(path)
    text = parse_dorf_text(data.decode("latin-1"))
    curves = _known_curves(text.irradiance, text.brightness)
    return _responses(curves, text.names, _named_units(text.names, curves), path)


def _read_member(path: Path) -> bytes:
    """Read dorfCurves.txt from a zip; nothing is unpacked to disk."""
    try:
        with zipfile.ZipFile(path) as archive:
            return _read_limited(archive, _member(archive))
    except FormatError:
        raise
    except _ZIP_DAMAGE as error:
        raise FormatError(f"the zip cannot be read ({error})") from error


def _member(archive: zipfile.ZipFile) -> zipfile.ZipInfo:
    for name in (info.orig_filename for info in archive.infolist()):
        if "\\" in name or ":" in name or name.startswith("/") or ".." in PurePosixPath(name).parts:
            raise FormatError(f"the zip holds the unsafe name {name[:60]!r}; plain relative names would fit")
    members = [info for info in archive.infolist() if PurePosixPath(info.filename).name == MEMBER]
    if len(members) != 1:
        raise FormatError(f"the zip holds {len(members)} files {MEMBER} where one would fit")
    return members[0]


def _read_limited(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytes:
    # Other methods unpack without a limit, and an encrypted member would ask for a password.
    if info.flag_bits & 1 or info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise FormatError(f"{MEMBER} is encrypted or packed in a way that is not read; deflated or stored would fit")
    with archive.open(info) as file:
        data = file.read(MAX_TEXT_BYTES + 1)
    if len(data) > MAX_TEXT_BYTES:
        raise FormatError(f"{MEMBER} unpacks to more than the {MAX_TEXT_BYTES} bytes that would fit")
    return data


def parse_dorf_text(text: str) -> DorfText:
    """Parse the official text: records of a name, a scale label, "I =", 1024 values, "B =", 1024 values.

    Blank lines, any line ends and any number of spaces are accepted.

    Returns
    -------
    DorfText
        Irradiance rises strictly, brightness does not fall; both as printed, in any unit.

    Raises
    ------
    FormatError
        Naming the record that is cut off, or whose values are too few, too many, not numbers or not monotone.
    """
    lines = [line for raw in re.split(r"\r\n|\r|\n", text) if (line := raw.strip())]
    records = [_record(lines[start : start + 6], start // 6 + 1) for start in range(0, len(lines), 6)]
    if not records:
        raise FormatError("the text holds no record; a record has 6 lines")
    names, labels, irradiance, brightness = zip(*records, strict=True)
    return DorfText(names, labels, np.array(irradiance), np.array(brightness))


def _record(lines: list[str], number: int) -> tuple[str, str, Array, Array]:
    where = f"record {number} ({lines[0][:60]!r})"
    if len(lines) < 6:
        raise FormatError(f"{where} is cut off after {len(lines)} lines; a record has 6")
    for line, letter in ((lines[2], "I"), (lines[4], "B")):
        if line.split("=", 1)[0].strip() != letter or line[-1] != "=":
            raise FormatError(f"{where} has {line[:20]!r} where '{letter} =' belongs")
    irradiance, brightness = _values(lines[3], f"I of {where}"), _values(lines[5], f"B of {where}")
    if (irradiance[1:] <= irradiance[:-1]).any():
        raise FormatError(f"I of {where} does not rise at every sample; use strictly increasing irradiance")
    if (brightness[1:] < brightness[:-1]).any() or brightness[0] == brightness[-1]:
        raise FormatError(f"B of {where} falls or is constant; use brightness that rises with irradiance")
    return lines[0], lines[1], irradiance, brightness


def _values(line: str, where: str) -> Array:
    words = line.split()
    if len(words) != N_SAMPLES:
        raise FormatError(f"{where} has {len(words)} values; it needs {N_SAMPLES}")
    try:
        values = np.array(words, dtype=np.float64)
    except ValueError as error:
        raise FormatError(f"{where} holds something that is no number: {str(error)[:80]}") from None
    if not np.isfinite(values).all():
        raise FormatError(f"{where} holds NaN or infinite values; use finite numbers")
    return values


def fingerprint(curves: ArrayLike) -> dict[str, list[float]]:
    """Summarise a set of curves so that its identity, but no curve, can be told from the numbers.

    Parameters
    ----------
    curves : array_like, shape (n, 1024)

    Returns
    -------
    dict of list of float, length n
        The means of B, B * I and B^2 over the samples of each curve, each list sorted by itself, 6 digits.
    """
    batch = as_curves(curves)
    moments = {"B": batch, "B*I": batch * GRID, "B^2": batch**2}
    return {name: np.sort(values.mean(axis=1)).round(6).tolist() for name, values in moments.items()}


def check_fingerprint(curves: ArrayLike) -> None:
    """Raise `FormatError` unless the curves, in any order, are DoRF's."""
    found, expected = fingerprint(curves), known_fingerprint()
    if len(found["B"]) != len(expected["B"]):
        raise FormatError(f"it holds {len(found['B'])} curves where DoRF has {len(expected['B'])}")
    gap = max(np.abs(np.subtract(found[name], expected[name])).max() for name in expected)
    if not gap <= _FINGERPRINT_TOLERANCE:
        raise FormatError(f"it holds other curves than DoRF, their means differ by {gap:.2g}")


@cache
def known_fingerprint() -> dict[str, list[float]]:
    """Return `fingerprint` of DoRF, as shipped."""
    content: dict[str, list[float]] = json.loads(shipped("data/registry/dorf_fingerprint.json").read_text())
    return content
