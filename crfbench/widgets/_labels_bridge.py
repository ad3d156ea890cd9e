"""Where the charts lie in photographs, as a file: JSON, version 1."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from crfbench.curves import Array
from crfbench.errors import FormatError, InputError, MissingDataError
from crfbench.files import write_atomically

_VERSION = 1


def as_corners(name: object, corners: ArrayLike) -> Array:
    """Return the corners of a photograph's chart, shape (4, 2), or raise `InputError`."""
    if not isinstance(name, str):
        raise InputError(f"the photograph {name!r} has no name; use a text")
    try:
        array = np.array(corners, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"the corners of {name!r} are not numbers; use four pairs of shares from 0 to 1") from None
    if array.shape != (4, 2) or not ((array >= 0.0) & (array <= 1.0)).all():
        raise InputError(f"the corners of {name!r} do not fit, shape {array.shape}; use four pairs from 0 to 1")
    return array


def save_labels(path: str | Path, labels: Mapping[str, ArrayLike]) -> None:
    """Write labels: by photograph, four corners (x, y) as shares of width and height, from dark skin clockwise."""
    entries = [{"photograph": name, "corners": as_corners(name, labels[name]).tolist()} for name in labels]
    write_atomically(Path(path), (json.dumps({"version": _VERSION, "labels": entries}, indent=1) + "\n").encode())


def load_labels(path: str | Path) -> dict[str, Array]:
    """Read what `save_labels` wrote.

    Raises
    ------
    MissingDataError
        For a path that leads nowhere.
    FormatError
        For any other content.
    """
    if not Path(path).is_file():
        raise MissingDataError(f"there is no file {path}; use one that holds labels of charts")
    try:
        content = json.loads(Path(path).read_bytes())
        if content["version"] != _VERSION:
            raise InputError(f"version {content['version']!r} is not read; use {_VERSION}")
        pairs = [(entry["photograph"], entry["corners"]) for entry in content["labels"]]
        checked = [(name, as_corners(name, corners)) for name, corners in pairs]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise FormatError(f"{path} holds no labels of charts ({str(error)[:100]})") from None
    if len(dict(checked)) != len(checked):
        raise FormatError(f"{path} labels a photograph twice; keep one entry of each")
    return dict(checked)
