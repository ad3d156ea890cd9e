"""The published EMoR basis: mean response and 25 principal components of DoRF, as text files.

Grossberg and Nayar 2004, "Modeling the space of camera response functions", doi:10.1109/TPAMI.2004.88.
The text prints, four numbers a line, the grid (E or B), the mean (f0 or g0) and the components (h or hinv, 1 to 25).
"""

import re

import numpy as np

from crfbench.curves import GRID, N_SAMPLES, Array, Direction, check_direction
from crfbench.datasets.registry import require
from crfbench.errors import FormatError

N_COMPONENTS = 25

_FILES = {"forward": "dorf/emor.txt", "inverse": "dorf/invemor.txt"}
_HEADS = {"forward": ("E", "f0", "h"), "inverse": ("B", "g0", "hinv")}
_NAME = re.compile(r"^[ \t]*([A-Za-z]\w*(?:\(\d+\))?)[ \t]*=[ \t\r]*$", re.MULTILINE)
_GRID_TOLERANCE = 1e-6


def load_emor_basis(direction: Direction) -> tuple[Array, Array]:
    """Load the published basis from the data folders.

    Parameters
    ----------
    direction : {"forward", "inverse"}
        ``emor.txt`` or ``invemor.txt``.

    Returns
    -------
    mean : ndarray, shape (1024,)
    components : ndarray, shape (25, 1024)
        Orthonormal to 1e-7, the largest eigenvalue first.

    Raises
    ------
    MissingDataError
        If the file is in no data folder.
    FormatError
        If it is damaged or is the basis of the other direction.
    """
    path = require(_FILES[check_direction(direction)], "emor")
    text = path.read_text(encoding="latin-1")
    grid, mean, components = parse_emor(text)
    head = _HEADS[direction][0]
    if not text.lstrip().startswith(head):
        raise FormatError(f"{path.name} starts with {text.lstrip()[:1]!r}; the {direction} basis starts with {head!r}")
    if np.abs(grid - GRID).max() > _GRID_TOLERANCE:
        raise FormatError(f"{path.name} has an uneven grid; use the published file of 1024 even samples from 0 to 1")
    return mean, components


def parse_emor(text: str) -> tuple[Array, Array, Array]:
    """Parse ``emor.txt`` or ``invemor.txt``.

    Returns
    -------
    grid : ndarray, shape (1024,)
    mean : ndarray, shape (1024,)
    components : ndarray, shape (25, 1024)

    Raises
    ------
    FormatError
        For blocks that are missing, misnamed or out of order, or hold too few, too many or other than numbers.
    """
    before, *parts = _NAME.split(text)
    names, blocks = parts[0::2], parts[1::2]
    if before.strip() or not any(names == _names(*heads) for heads in _HEADS.values()):
        raise FormatError(
            f"the text has {len(names)} blocks ({', '.join(names[:3])} ...); "
            "use emor.txt (E, f0, h(1) to h(25)) or invemor.txt (B, g0, hinv(1) to hinv(25))"
        )
    values = np.array([_values(name, block) for name, block in zip(names, blocks, strict=True)])
    return values[0], values[1], values[2:]


def _names(grid: str, mean: str, component: str) -> list[str]:
    return [grid, mean, *(f"{component}({number})" for number in range(1, N_COMPONENTS + 1))]


def _values(name: str, block: str) -> Array:
    words = block.split()
    if len(words) != N_SAMPLES:
        raise FormatError(f"block {name} has {len(words)} values; it needs {N_SAMPLES}")
    try:
        values = np.array(words, dtype=np.float64)
    except ValueError as error:
        raise FormatError(f"block {name} holds something that is no number: {str(error)[:80]}") from None
    if not np.isfinite(values).all():
        raise FormatError(f"block {name} holds NaN or infinite values; use finite numbers")
    return values
