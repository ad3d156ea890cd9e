"""Recorded tables: what crfbench computed from data it may not ship, each with its provenance."""

import io
import json
from pathlib import Path
from typing import Any

import pandas as pd

from crfbench.errors import FormatError, MissingDataError
from crfbench.files import write_atomically
from crfbench.resources import shipped


def to_rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a table as plain Python values; missing ones are None."""
    return [dict(row) for row in json.loads(table.to_json(orient="records", double_precision=15))]


def record(table: pd.DataFrame, name: str, provenance: dict[str, str], folder: Path | None = None) -> Path:
    """Write ``<name>.json`` with the rows and their provenance, and return its path."""
    path = (folder or shipped("data/recorded")) / f"{name}.json"
    text = json.dumps({"provenance": provenance, "rows": to_rows(table)}, indent=1)
    write_atomically(path, text.encode() + b"\n")
    return path


def load_recorded(name: str, folder: Path | None = None) -> tuple[pd.DataFrame, dict[str, str]]:
    """Read a recorded table and its provenance.

    Raises
    ------
    MissingDataError
        When there is no record of that name.
    FormatError
        When the file is damaged.
    """
    folder = folder or shipped("data/recorded")
    path = folder / f"{name}.json"
    if not path.is_file():
        names = ", ".join(sorted(p.stem for p in folder.glob("*.json"))) or "none"
        raise MissingDataError(f"there is no recorded table {name!r}; there are: {names}")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return pd.read_json(io.StringIO(json.dumps(content["rows"])), orient="records"), content["provenance"]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise FormatError(
            f"{path.name} is no recorded table ({str(error)[:80]}); use one that crfbench wrote"
        ) from None
