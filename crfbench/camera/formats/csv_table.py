"""A table with a head: ``brightness,irradiance`` for an inverse response, ``irradiance,brightness`` for a response.

Three curves have ``_r``, ``_g`` and ``_b`` after the name of the second quantity. Keeps direction and channels, to the
last digit; loses the rest of the passport, such as the band.
"""

import numpy as np

from crfbench.camera.formats.text import decode_text, numbers
from crfbench.camera.passport import Passport
from crfbench.curves import GRID, Direction
from crfbench.errors import FormatError

SUFFIX = ".csv"

_AXES: dict[Direction, tuple[str, str]] = {
    "inverse": ("brightness", "irradiance"),
    "forward": ("irradiance", "brightness"),
}
_ENDINGS = {1: ("",), 3: ("_r", "_g", "_b")}
_END_TOLERANCE = 1e-6


def write(passport: Passport) -> bytes:
    """Write 1024 rows below the head."""
    rows = np.column_stack([GRID, *passport.curves]).tolist()
    lines = [_head(passport.direction, len(passport.curves)), *(",".join(map(repr, row)) for row in rows)]
    return ("\n".join(lines) + "\n").encode()


def read(data: bytes) -> Passport:
    """Read two or more rows whose first column rises from 0 to 1, or raise `FormatError`.

    Spaces and quotes about the names do no harm.
    """
    head, *lines = decode_text(data).strip().splitlines() or [""]
    heads = {_head(direction, c): direction for direction in _AXES for c in _ENDINGS}
    name = "".join(head.lower().replace('"', "").split())
    if name not in heads:
        raise FormatError(f"its head is {head[:60]!r}; use one of {'; '.join(heads)}")
    table = numbers([line.split(",") for line in lines if line.strip()], "the table")
    if table.shape[1] != name.count(",") + 1:
        raise FormatError(f"its rows have {table.shape[1]} values below a head of {name.count(',') + 1}")
    x = table[:, 0]
    if (np.diff(x) <= 0).any() or max(abs(x[0]), abs(x[-1] - 1.0)) > _END_TOLERANCE:
        raise FormatError(f"its first column runs from {x[0]:.4g} to {x[-1]:.4g}; let it rise strictly from 0 to 1")
    return Passport(heads[name], np.array([np.interp(GRID, x, y) for y in table.T[1:]]))


def _head(direction: Direction, c: int) -> str:
    first, second = _AXES[direction]
    return ",".join([first, *(f"{second}{ending}" for ending in _ENDINGS[c])])
