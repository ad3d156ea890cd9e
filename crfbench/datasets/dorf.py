"""DoRF, the database of response functions, and EMoR, its mean response and principal components, as published.

Grossberg and Nayar 2004, "Modeling the space of camera response functions", doi:10.1109/TPAMI.2004.88.
No licence is stated, so crfbench does not bundle them: ``crfbench fetch dorf`` and ``crfbench fetch emor`` get them.
"""

import hashlib
import json
import re
import zipfile
import zlib
from functools import cache
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import ArrayLike

from crfbench.checks import parse_numbers
from crfbench.curves import GRID, N_SAMPLES, Array, Direction, as_curves, check_direction, resample
from crfbench.datasets.registry import find, known, require
from crfbench.datasets.responses import Responses, chained, near_copies
from crfbench.errors import FormatError, InputError
from crfbench.files import bundled

MEMBER = "dorfCurves.txt"
MAX_TEXT_BYTES = 32 * 2**20  # 201 records of 2048 printed numbers make about 7 MB

_MAT = "dorf/201_CRF_data.mat"
_OFFICIAL = ("dorf/dorfCurves.zip", f"dorf/{MEMBER}")
_CHANNEL = re.compile(r"(?<=.)[\s_-]*(Red|Green|Blue)$")
_COPY_RMSE = 1e-4  # far above the rounding of any file, far below the distance of two cameras
_GRID_TOLERANCE = 1e-6
_FINGERPRINT_TOLERANCE = 1e-4
_ZIP_DAMAGE = (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, NotImplementedError)

# Of each EMoR file: its path, and the names of the grid, the mean and the 25 components in it.
_EMOR = {"forward": ("dorf/emor.txt", "E", "f0", "h"), "inverse": ("dorf/invemor.txt", "B", "g0", "hinv")}
_EMOR_NAME = re.compile(r"^[ \t]*([A-Za-z]\w*(?:\(\d+\))?)[ \t]*=[ \t\r]*$", re.MULTILINE)


def load_dorf() -> Responses:
    """Load the 201 measured responses of films, sensors and cameras; the official text is preferred, for its names.

    No file is a `MissingDataError`; one that is damaged or holds other curves is a `FormatError`.

    With names, the unit of a curve is its film or camera (the name without Red, Green or Blue), and two films
    whose curves are copies are one unit. Without (the ``.mat``), curves that chain within an RMSE of 0.01 are one.
    """
    official = next((path for path in map(find, _OFFICIAL) if path), None)
    path = official or require(_MAT, "dorf")
    try:
        return read_official(path) if official else _read_mat(path)
    except FormatError as error:
        raise FormatError(f"{path} is not DoRF: {error}; delete it and run 'crfbench fetch dorf'") from error


def read_official(path: Path) -> Responses:
    """Read the official zip, or the ``.txt`` inside it; a `FormatError` tells what is wrong with either."""
    data = path.read_bytes() if path.suffix == ".txt" else _read_member(path)
    names, irradiance, brightness = parse_dorf_text(data.decode("latin-1"))
    curves = _known_curves(irradiance, brightness)
    films = np.array([_CHANNEL.sub("", name) for name in names])
    copies = near_copies(curves, _COPY_RMSE)
    groups = chained((films[:, None] == films) | (copies[:, None] == copies))
    units = tuple(str(films[np.argmax(groups == group)]) for group in groups)
    return _responses(curves, names, units, path)


def _read_mat(path: Path) -> Responses:
    from scipy.io import loadmat

    # SciPy's reader can crash on damaged bytes, so it gets only the file that is known.
    with path.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    if found not in (file.sha256 for file in known()["dorf"]):
        raise FormatError(f"its SHA-256 {found} is not the known one")
    content = loadmat(path, variable_names=["I", "B"])
    curves = _known_curves(as_curves(content["I"]), as_curves(content["B"]))
    names = tuple(f"curve {number}" for number in range(1, len(curves) + 1))
    return _responses(curves, names, tuple(f"group {group}" for group in near_copies(curves) + 1), path)


def _known_curves(irradiance: Array, brightness: Array) -> Array:
    """Bring the records onto the grid and check that they are DoRF's."""
    # Samples that are on the grid but for rounding are taken as they are.
    grids = [GRID if np.abs(x - GRID).max() < _GRID_TOLERANCE else x for x in irradiance]
    try:
        curves = np.array(list(map(resample, grids, brightness)))
    except InputError as error:
        raise FormatError(str(error)) from None
    check_fingerprint(curves)
    return curves


def _responses(curves: Array, names: tuple[str, ...], units: tuple[str, ...], path: Path) -> Responses:
    n = len(curves)
    source = f"DoRF, {path.name} (Grossberg and Nayar 2004)"
    return Responses("dorf", curves, names, units, ("measured",) * n, (source,) * n, ("unknown",) * n)


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
            raise FormatError(f"the zip holds the unsafe name {name[:60]!r}; use plain relative names")
    members = [info for info in archive.infolist() if PurePosixPath(info.filename).name == MEMBER]
    if len(members) != 1:
        raise FormatError(f"the zip holds {len(members)} files {MEMBER}; use one that holds 1")
    return members[0]


def _read_limited(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytes:
    # Other methods unpack without a limit, and an encrypted member would ask for a password.
    if info.flag_bits & 1 or info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise FormatError(f"{MEMBER} is encrypted or packed in a way that is not read; use deflated or stored")
    with archive.open(info) as file:
        data = file.read(MAX_TEXT_BYTES + 1)
    if len(data) > MAX_TEXT_BYTES:
        raise FormatError(f"{MEMBER} unpacks to more than the {MAX_TEXT_BYTES} bytes that are allowed")
    return data


def parse_dorf_text(text: str) -> tuple[tuple[str, ...], Array, Array]:
    """Parse the official text: records of a name, a scale label, "I =", 1024 values, "B =", 1024 values.

    Blank lines, any line ends and any number of spaces are accepted; a `FormatError` names the record that is wrong.
    Returns n names, and irradiance, which rises strictly, and brightness, which does not fall, (n, 1024) each.
    """
    lines = [line for raw in re.split(r"\r\n|\r|\n", text) if (line := raw.strip())]
    records = [_record(lines[start : start + 6], start // 6 + 1) for start in range(0, len(lines), 6)]
    if not records:
        raise FormatError("the text holds no record; a record has 6 lines")
    names, irradiance, brightness = zip(*records, strict=True)
    return names, np.array(irradiance), np.array(brightness)


def _record(lines: list[str], number: int) -> tuple[str, Array, Array]:
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
    return lines[0], irradiance, brightness


def _values(text: str, where: str) -> Array:
    words = text.split()
    if len(words) != N_SAMPLES:
        raise FormatError(f"{where} has {len(words)} values; it needs {N_SAMPLES}")
    return parse_numbers(words, where)


def fingerprint(curves: ArrayLike) -> dict[str, list[float]]:
    """Summarise curves (n, 1024) so that their identity, but no curve, can be told from the numbers.

    These are the means of B, B * I and B^2 over the samples of each curve, each list sorted by itself, 6 digits.
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
    """Return `fingerprint` of DoRF, as bundled."""
    content: dict[str, list[float]] = json.loads(bundled("data/registry/dorf_fingerprint.json").read_text())
    return content


def load_emor_basis(direction: Direction = "inverse") -> tuple[Array, Array]:
    """Load the published EMoR basis from the data folders: ``invemor.txt`` or ``emor.txt``.

    Returns the mean (1024,) and the components (25, 1024), orthonormal to 1e-7, the largest eigenvalue first. No file
    is a `MissingDataError`; one that is damaged is a `FormatError`.
    """
    file, head, *_ = _EMOR[check_direction(direction)]
    path = require(file, "emor")
    text = path.read_text(encoding="latin-1")
    grid, mean, components = parse_emor(text)
    if not text.lstrip().startswith(head):
        raise FormatError(f"{path.name} starts with {text.lstrip()[:1]!r}; the {direction} basis starts with {head!r}")
    if np.abs(grid - GRID).max() > _GRID_TOLERANCE:
        raise FormatError(f"{path.name} has an uneven grid; use the published file of 1024 even samples from 0 to 1")
    return mean, components


def parse_emor(text: str) -> tuple[Array, Array, Array]:
    """Parse ``emor.txt`` or ``invemor.txt``: named blocks of 1024 numbers; a `FormatError` names the one that is wrong.

    Returns grid and mean, (1024,), and the components (25, 1024).
    """
    before, *parts = _EMOR_NAME.split(text)
    names, blocks = parts[0::2], parts[1::2]
    expected = [[x, mean, *(f"{h}({number})" for number in range(1, 26))] for _, x, mean, h in _EMOR.values()]
    if before.strip() or names not in expected:
        raise FormatError(
            f"the text has {len(names)} blocks ({', '.join(names[:3])} ...); "
            "use emor.txt (E, f0, h(1) to h(25)) or invemor.txt (B, g0, hinv(1) to hinv(25))"
        )
    values = np.array([_values(block, f"block {name}") for name, block in zip(names, blocks, strict=True)])
    return values[0], values[1], values[2:]
