"""Writing what a calibration gave: the passport, its exports and the report."""

from collections.abc import Iterator
from pathlib import Path

from crfbench.camera.files import CameraCalibration
from crfbench.camera.page import report_page
from crfbench.errors import MissingDataError
from crfbench.files import check_new, write_new
from crfbench.passport import write_response
from crfbench.passport.formats import FORMATS

PASSPORT, REPORT = "passport.json", "report.html"


def write_outputs(result: CameraCalibration, folder: Path, overwrite: bool = False) -> Iterator[Path]:
    """Write passport, exports and report into a folder, yielding each path as it is complete.

    An export that needs data which are not here (Hugin's, without the published EMoR basis) is left out.

    Raises
    ------
    InputError
        Before anything is written, where one of the files is there and `overwrite` is false.
    """
    paths = {name: folder / _file_name(name) for name in FORMATS}
    for path in (*paths.values(), folder / REPORT):
        check_new(path, overwrite)
    page = report_page(result)
    for name, path in paths.items():
        try:
            write_response(result.passport, path, name, overwrite)
        except MissingDataError:
            continue
        yield path
    write_new(folder / REPORT, page.encode(), overwrite)
    yield folder / REPORT


def _file_name(name: str) -> str:
    if name == "passport":
        return PASSPORT
    suffix = FORMATS[name].SUFFIX
    return f"response{suffix}" if suffix.startswith(".") else suffix
