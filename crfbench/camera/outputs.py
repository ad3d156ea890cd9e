"""Writing what a calibration gave: the passport, its exports and the report."""

from collections.abc import Iterator
from pathlib import Path

from crfbench.camera.files import CameraCalibration
from crfbench.camera.page import report_page
from crfbench.charts import SafeReader
from crfbench.errors import MissingDataError
from crfbench.files import check_new, write_new
from crfbench.passport import linearise, read_response, write_response
from crfbench.passport.formats import FORMATS
from crfbench.series import write_hdr
from crfbench.series.reading import read_levels

PASSPORT, REPORT, MERGED = "passport.json", "report.html", "merged.exr"


def write_outputs(result: CameraCalibration, folder: str | Path, overwrite: bool = False) -> Iterator[Path]:
    """Write passport, exports, report and merged image into a folder, yielding each path as it is complete.

    An export that needs data which are not here (Hugin's, without the published EMoR basis) is left out.

    Raises
    ------
    InputError
        Before anything is written, where one of the files is there and `overwrite` is false.
    """
    folder = Path(folder)
    paths = {name: folder / _file_name(name) for name in FORMATS}
    for path in (*paths.values(), folder / REPORT, *([folder / MERGED] if result.merged else [])):
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
    if result.merged:
        write_hdr(folder / MERGED, result.merged.radiance, overwrite)
        yield folder / MERGED


def linearise_file(image: Path, response: Path, out: Path, overwrite: bool = False) -> Path:
    """Turn the brightness of an image file back into irradiance and write it as a linear image.

    Parameters
    ----------
    image : path
        JPEG, PNG or TIFF, 8 or 16 bits.
    response : path
        A passport or any export of it.
    out : path
        ``.exr`` or ``.tif`` with floats in units of full scale, or ``.hdr``.
    overwrite : bool

    Returns
    -------
    Path
        `out`.
    """
    passport = read_response(response)
    check_new(out, overwrite)
    with SafeReader() as reader:
        levels = reader.run(read_levels, image)
    write_hdr(out, linearise(levels, passport), overwrite)
    return out


def _file_name(name: str) -> str:
    if name == "passport":
        return PASSPORT
    suffix = FORMATS[name].SUFFIX
    return f"response{suffix}" if suffix.startswith(".") else suffix
