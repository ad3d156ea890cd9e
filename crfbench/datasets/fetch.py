"""Download the data sets that are not bundled, on request only.

Every file is written aside, checked, and only then renamed: by its SHA-256 or, for the official DoRF zip, of which
no checksum is published, by the curves inside. A file that is there and right is not fetched again, so a download
that broke off goes on where it stopped. Only a killed process leaves its temporary file (``tmp...``) behind, which
nothing reads.
"""

from pathlib import Path

import pooch
import requests
from tqdm import tqdm

from crfbench.checks import check_choice
from crfbench.datasets.dorf import read_official
from crfbench.datasets.registry import RemoteFile, folders, known
from crfbench.errors import CrfbenchError, FetchError, InputError

TIMEOUT = (30.0, 30.0)  # seconds, for the connection and for the next bytes

_FEW = 5  # with more files one bar counts files; else each file has a bar that counts bytes


def fetch(key: str = "all", folder: Path | None = None, mirror: str | None = None, progress: bool = True) -> list[Path]:
    """Download a data set, or all of them, and return the paths of its files.

    Parameters
    ----------
    key : str
        "dorf", "emor", "middlebury" or "all"; "opencrf" is bundled and gives an empty list.
    folder : path, optional
        Data folder to fill; else ``$CRFBENCH_DATA`` if set, else the user cache. Another folder is found again
        only once ``CRFBENCH_DATA`` names it.
    mirror : str, optional
        Base URL under which the files lie as they do in the data folder, for example
        ``https://example.org/crf-data`` for ``https://example.org/crf-data/dorf/emor.txt``.
    progress : bool
        Show progress bars on standard error.

    Raises
    ------
    FetchError
        If a file cannot be had; files that arrived before it stay. With "all", the other sets are still fetched.
    """
    check_choice("key", key, ("all", *known()))
    if mirror is not None and not mirror.startswith(("http://", "https://")):
        raise InputError(f"mirror={mirror!r} is not a web address; use one that starts with http:// or https://")
    target = Path(folder) if folder is not None else folders()[0]
    paths, failures = [], []
    pooch.get_logger().setLevel("WARNING")  # its line a file would break the progress bars
    for which in known() if key == "all" else (key,):
        try:
            paths += _fetch_set(which, Path(target).expanduser(), mirror, progress)
        except FetchError as error:
            failures.append(str(error))
    if failures:
        raise FetchError("; ".join(failures))
    return paths


def _fetch_set(key: str, target: Path, mirror: str | None, progress: bool) -> list[Path]:
    many = len(known()[key]) > _FEW
    files = tqdm(known()[key], desc=key, unit="file", disable=not (progress and many), ncols=79)
    return [_fetch_file(file, key, target, mirror, progress and not many) for file in files]


def _fetch_file(file: RemoteFile, key: str, target: Path, mirror: str | None, progress: bool) -> Path:
    path = target / file.path
    url = f"{mirror.rstrip('/')}/{file.path}" if mirror else file.url
    try:
        if file.sha256 is None and path.exists() and not _is_dorf(path):
            path.unlink()  # pooch takes a file without a checksum as it is
        return Path(_retrieve(file, url, path, progress))
    except (CrfbenchError, OSError, ValueError) as error:
        advice = f"try 'crfbench fetch {key}' again later or with --mirror"
        usable = f" (all else is in place; {file.without})" if file.without else ""
        raise FetchError(f"{url} could not be fetched: {_reason(error, path)}; {advice}{usable}") from error


def _retrieve(file: RemoteFile, url: str, path: Path, progress: bool) -> str:
    download = pooch.HTTPDownloader(progressbar=progress, timeout=TIMEOUT)

    def download_and_check(url: str, output: str, pooch_: object) -> None:
        download(url, output, pooch_)
        if file.sha256 is None:
            read_official(Path(output))  # the one such file is the official DoRF zip

    checksum = f"sha256:{file.sha256}" if file.sha256 else None
    fetched: str = pooch.retrieve(url, checksum, path.name, path.parent, downloader=download_and_check)
    return fetched


def _is_dorf(path: Path) -> bool:
    try:
        read_official(path)
    except CrfbenchError:
        return False
    return True


def _reason(error: Exception, path: Path) -> str:
    """Say in a few words what came instead of the file."""
    if isinstance(error, requests.HTTPError) and error.response is not None:
        return f"the server answered {error.response.status_code} {error.response.reason}"
    # A stall in the middle of a body is reported as a connection error.
    if isinstance(error, requests.Timeout) or "timed out" in str(error):
        return f"the server was silent for more than {TIMEOUT[1]:g} s"
    if isinstance(error, requests.RequestException):
        return f"the connection failed or broke off ({type(error).__name__})"
    if isinstance(error, CrfbenchError):
        return f"what came is not this file ({error})"
    if isinstance(error, OSError):
        return f"{path} cannot be written ({error.strerror or error})"
    return "what came has another SHA-256 than the file should have"
