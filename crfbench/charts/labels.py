"""Corners of the chart that a person marked, photograph by photograph, kept as JSON.

``{"version": 1, "labels": [{"photograph": "IMG_1", "corners": [[x, y], [x, y], [x, y], [x, y]]}]}``: the name of the
file without its extension, and the corners as `crfbench.charts.geometry` has them, from any corner on.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from crfbench.charts.geometry import as_corners
from crfbench.curves import Array
from crfbench.errors import FormatError, InputError
from crfbench.files import write_atomically

VERSION = 1


def load_labels(path: Path) -> dict[str, Array]:
    """Load the corners of every labelled photograph.

    Returns
    -------
    dict of str to ndarray, shape (4, 2)

    Raises
    ------
    FormatError
        If the file is missing, is no such JSON, names a photograph twice or holds corners that cannot be a chart's.
    """
    path = Path(path)
    try:
        document = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=_object)
        labels = [_label(entry) for entry in _entries(document)]
        return _object(labels)
    except OSError as error:
        raise FormatError(f"{path.name} cannot be read ({error.strerror}); use a file that is there") from None
    except (ValueError, TypeError, RecursionError) as error:
        raise FormatError(f"{path.name} holds no labels of version {VERSION} ({error}); label again") from None


def save_labels(path: Path, labels: Mapping[str, ArrayLike]) -> None:
    """Save the corners of photographs, sorted by name.

    Parameters
    ----------
    path : path
    labels : mapping of str to array_like, shape (4, 2)

    Raises
    ------
    InputError
        For corners that cannot be a chart's, or an empty name.
    """
    if not all(isinstance(name, str) and name for name in labels):
        raise InputError(f"labels={list(labels)} have a name that is no text or empty; use the photographs' names")
    entries = [{"photograph": name, "corners": as_corners(labels[name]).tolist()} for name in sorted(labels)]
    # Escaped to ASCII: names of files may hold what UTF-8 cannot.
    document = json.dumps({"version": VERSION, "labels": entries}, indent=1)
    write_atomically(Path(path), document.encode("ascii"))


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a dict; a name that comes twice is refused, not overwritten."""
    names = [name for name, _ in pairs]
    if len(set(names)) < len(names):
        raise ValueError(f"{next(name for name in names if names.count(name) > 1)!r} stands there twice")
    return dict(pairs)


def _entries(document: Any) -> list[Any]:
    if not isinstance(document, dict) or set(document) != {"version", "labels"}:
        raise ValueError("its top is not version and labels")
    if document["version"] is not VERSION or not isinstance(document["labels"], list):
        raise ValueError(f"version {document['version']!r}")
    return document["labels"]


def _label(entry: Any) -> tuple[str, Array]:
    if not isinstance(entry, dict) or set(entry) != {"photograph", "corners"}:
        raise ValueError("an entry is not photograph and corners")
    name, corners = entry["photograph"], entry["corners"]
    if not (isinstance(name, str) and name):
        raise ValueError(f"photograph {name!r} is no name")
    if not all(type(value) in (int, float) for point in corners for value in point):
        raise ValueError(f"the corners of {name!r} are not all numbers")
    return name, as_corners(corners)
