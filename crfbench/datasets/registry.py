"""Every data set that crfbench knows: what it is, its licence, its files, and where they lie on this computer.

Only "opencrf" is bundled. The others are downloaded on request (`crfbench.datasets.fetch`) from pinned addresses
into ``$CRFBENCH_DATA`` or the user cache; the two are searched in this order and share one layout of folders.
"""

import json
import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from platformdirs import user_cache_dir

from crfbench.errors import MissingDataError
from crfbench.files import bundled


@dataclass(frozen=True)
class RemoteFile:
    """One file to download."""

    path: str  # where it lies inside the data folder, with forward slashes
    url: str
    sha256: str | None  # None where none is published; `fetch` then checks what the file says
    without: str = ""  # what only this file has, where all else works without it; empty if nothing does


@cache
def _entries() -> list[dict[str, Any]]:
    content: list[dict[str, Any]] = json.loads(bundled("data/registry/datasets.json").read_text(encoding="utf-8"))
    return content


@cache
def known() -> dict[str, tuple[RemoteFile, ...]]:
    """Return the files of every known data set by its key; none if it is bundled."""
    return {entry["key"]: _files(entry) for entry in _entries()}


def _files(entry: dict[str, Any]) -> tuple[RemoteFile, ...]:
    if "listed" not in entry:
        return tuple(RemoteFile(**file) for file in entry.get("files", ()))
    # A set of many files has a list of their checksums, ``path sha256`` a line, as pooch writes it.
    pairs = (line.split() for line in bundled(entry["listed"]).read_text(encoding="utf-8").splitlines())
    key, base = entry["key"], entry["base"]
    return tuple(RemoteFile(f"{key}/{path}", f"{base}/{path}", sha256) for path, sha256 in pairs)


def folders() -> list[Path]:
    """Return the data folders in the order of search: ``$CRFBENCH_DATA`` if set, then the user cache."""
    # Asked anew each time, for a notebook may set the variable after crfbench was imported.
    chosen = os.environ.get("CRFBENCH_DATA")
    cached = Path(user_cache_dir("crfbench")) / "data"
    return [Path(chosen).expanduser(), cached] if chosen else [cached]


def find(relative_path: str) -> Path | None:
    """Return where a file or folder of a data set lies, or None if it is in no data folder."""
    home = _home(relative_path)
    return home / relative_path if home else None


def _home(relative_path: str) -> Path | None:
    return next((folder for folder in folders() if (folder / relative_path).exists()), None)


def require(relative_path: str, key: str) -> Path:
    """Return where a file or folder of the data set `key` lies, or raise `MissingDataError`."""
    path = find(relative_path)
    if path is None:
        searched = " and ".join(str(folder) for folder in folders())
        raise MissingDataError(
            f"{relative_path} is not in {searched}; run 'crfbench fetch {key}', "
            "or set CRFBENCH_DATA to the folder that holds it"
        )
    return path


def status() -> list[dict[str, str]]:
    """Say of every known data set whether it is here, by the names of its files; the contents are not read.

    Each has key, what, licence, where, and present: "bundled", "complete" (perhaps "for everything
    here", with what is not), "partial (n of m)" or "absent".
    """
    rows = []
    for entry in _entries():
        present, where = _presence(entry["key"])
        rows.append({name: entry[name] for name in ("key", "what", "licence")} | {"present": present, "where": where})
    return rows


def _presence(key: str) -> tuple[str, str]:
    if not (files := known()[key]):
        return "bundled", str(bundled(f"data/{key}.npz"))
    # A set may be divided: some of its files in the user's folder, the rest in the cache.
    homes = [str(home) for file in files if (home := _home(file.path))]
    where, absent = " and ".join(dict.fromkeys(homes)), [file for file in files if not _home(file.path)]
    if all(file.without for file in absent):
        return f"complete for everything here ({absent[0].without})" if absent else "complete", where
    return (f"partial ({len(homes)} of {len(files)})" if homes else "absent"), where
