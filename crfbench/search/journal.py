"""A search's results on disk as they come: one line of JSON each, so that no interruption loses any."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from crfbench.errors import FormatError, InputError
from crfbench.search.outcome import Outcome

_HEAD = b'{"settings": {'  # how the first line begins, whatever the search


class Journal:
    """An append-only file; its first line says what search it belongs to.

    Parameters
    ----------
    path : Path, optional
        A new file, or the journal of a search with the same settings that was interrupted. Without one, nothing is
        written.
    settings : mapping
        All that decides the results; plain values that JSON can hold.

    Attributes
    ----------
    outcomes : list of Outcome
        What the file holds.

    Raises
    ------
    InputError
        For the journal of a search with other settings.
    FormatError
        For a file that is no journal.
    """

    def __init__(self, path: str | Path | None, settings: Mapping[str, Any]) -> None:
        self.path = None if path is None else Path(path)
        self.outcomes: list[Outcome] = []
        if self.path is not None:
            self._open(self.path, settings)

    def _open(self, path: Path, settings: Mapping[str, Any]) -> None:
        content = path.read_bytes() if path.exists() else b""
        whole = content[: content.rfind(b"\n") + 1]
        if whole:
            held, self.outcomes = _parse(path, whole.splitlines())
            _check_same(path, held, settings)
        elif content[: len(_HEAD)] != _HEAD[: len(content)]:
            raise FormatError(f"{path.name} is no journal of a search; use another path")
        if len(whole) < len(content):  # a crash in the middle of a line leaves it without an end
            os.truncate(path, len(whole))
        if not whole:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._write({"settings": dict(settings)})

    def append(self, outcome: Outcome) -> None:
        """Add one outcome; when this returns, it is on the disk."""
        self._write(outcome.to_row())
        self.outcomes.append(outcome)

    def _write(self, row: Mapping[str, Any]) -> None:
        if self.path is None:
            return
        with self.path.open("ab") as file:
            file.write(json.dumps(row).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())


def _parse(path: Path, lines: list[bytes]) -> tuple[dict[str, Any], list[Outcome]]:
    try:
        first, *rows = [json.loads(line) for line in lines]
        return dict(first["settings"]), [Outcome.from_row(row) for row in rows]
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        raise FormatError(f"{path.name} is no journal of a search; use another path") from None


def _check_same(path: Path, held: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    for name in {**held, **wanted}:
        if held.get(name) != wanted.get(name):
            raise InputError(
                f"{path.name} belongs to a search with {name}={held.get(name)!r}, this one has {wanted.get(name)!r}; "
                "use another journal"
            )
