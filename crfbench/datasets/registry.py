"""Every data set that crfbench knows: what it is, its licence, its files, and where they lie on this computer.

Only "opencrf" is bundled. The others are downloaded on request (`crfbench.datasets.fetch`) from pinned addresses
into ``$CRFBENCH_DATA`` or the user cache; the two are searched in this order and share one layout of folders.
"""

import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from platformdirs import user_cache_dir

from crfbench.errors import MissingDataError
from crfbench.files import bundled

_RAW = "https://raw.githubusercontent.com"
_SINGLE_HDR = f"{_RAW}/alex04072000/SingleHDR/ce89648bc95ba1615b5eb9d8a1c4456a7872a92c/training_code"
_MIDDLEBURY = f"{_RAW}/zyfccc/Representing-camera-response-function/e98c6119a95062a8d53fd7cd1dffed4cd4e84a5c/dataset"


@dataclass(frozen=True)
class RemoteFile:
    """One file to download."""

    path: str  # where it lies inside the data folder, with forward slashes
    url: str
    sha256: str | None  # None where none is published; `fetch` then checks what the file says
    without: str = ""  # what still works when this file cannot be had; empty if nothing does


@dataclass(frozen=True)
class DataSet:
    """A data set: its key, one line on what it is, its licence, and its files (none if it is bundled)."""

    key: str
    what: str
    licence: str
    files: tuple[RemoteFile, ...] = ()


_UNSTATED = "none stated; for your own use, not bundled"

_OPENCRF = DataSet("opencrf", "OpenCRF: responses of films and published camera standards", "MIT and BSD-3-Clause")

_DORF = DataSet(
    "dorf",
    "DoRF: 201 measured responses (the .mat holds the curves, the official zip adds their names)",
    _UNSTATED,
    (
        RemoteFile(
            "dorf/201_CRF_data.mat",
            f"{_RAW}/GuoShi28/CBDNet/083c2e1439f8908d58d75c1c4cf87c9b74873427/utils/201_CRF_data.mat",
            "45d7b6467f147b6dd99875652bef2d36f0a6ef5cebbd5b8ed33759ee6a4c1fc1",
        ),
        RemoteFile(
            "dorf/dorfCurves.zip",
            "https://www.cs.columbia.edu/CAVE/software/dorf/response/dorfCurves.zip",
            None,
            "the curves themselves are in place and load without names",
        ),
    ),
)

_EMOR = DataSet(
    "emor",
    "EMoR: the published mean response and 25 principal components, in both directions",
    _UNSTATED,
    (
        RemoteFile(
            "dorf/emor.txt",
            f"{_SINGLE_HDR}/emor.txt",
            "7cb62d511e936a4d597f2323d3c914b334fd2e0757a05c944f12f7d164d5cc78",
        ),
        RemoteFile(
            "dorf/invemor.txt",
            f"{_SINGLE_HDR}/invemor.txt",
            "86dd5444b1d6bbfbabb02c39519909226a77774543a82a69a6f2b962914d82ee",
        ),
    ),
)


@cache
def known() -> dict[str, DataSet]:
    """Return every known data set by its key."""
    return {entry.key: entry for entry in (_OPENCRF, _DORF, _EMOR, _middlebury())}


def _middlebury() -> DataSet:
    """Read the bundled list of checksums: ``path sha256`` a line, as pooch writes it."""
    lines = bundled("data/registry/middlebury.txt").read_text(encoding="utf-8").splitlines()
    pairs = (line.split() for line in lines)
    return DataSet(
        "middlebury",
        "Modified Middlebury: 14 cameras x 8 photographs of a colour chart as JPEG and RAW, with 24 patch boxes",
        "Apache-2.0",
        tuple(RemoteFile(f"middlebury/{path}", f"{_MIDDLEBURY}/{path}", sha256) for path, sha256 in pairs),
    )


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

    Returns
    -------
    list of dict
        With "key", "what", "licence", "present" ("bundled", "complete", "partial (n of m)" or "absent") and "where".
    """
    rows = []
    for entry in known().values():
        present, where = _presence(entry)
        rows.append(
            {"key": entry.key, "what": entry.what, "licence": entry.licence, "present": present, "where": where}
        )
    return rows


def _presence(entry: DataSet) -> tuple[str, str]:
    if not entry.files:
        return "bundled", str(bundled(f"data/{entry.key}.npz"))
    # A set may be divided: some of its files in the user's folder, the rest in the cache.
    homes = [str(home) for file in entry.files if (home := _home(file.path))]
    where = " and ".join(dict.fromkeys(homes))
    if len(homes) == len(entry.files):
        return "complete", where
    return (f"partial ({len(homes)} of {len(entry.files)})" if homes else "absent"), where
