"""What is done with calibrations, of one camera or many: passport, exports, report; linear images; a check of them."""

import base64
import io
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, as_completed
from contextlib import nullcontext
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crfbench.camera.calibrate import CameraCalibration, calibrate
from crfbench.camera.formats import FORMATS, read_response, write_response
from crfbench.camera.measuring import measure_chart
from crfbench.camera.merging import write_hdr
from crfbench.camera.passport import Passport, linearise
from crfbench.camera.photographs import find_white_level
from crfbench.camera.reading import read_image, read_levels
from crfbench.camera.worker import WORKER
from crfbench.curves import Array
from crfbench.datasets.chart import N_PATCHES
from crfbench.errors import CrfbenchError, InputError, MissingDataError
from crfbench.files import check_new, write_new
from crfbench.parallel import local_workers, worker_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

_REPORT, _MERGED, _VIGNETTE = "report.html", "merged.exr", "vignette.png"
_GREYS = slice(18, 24)


def write_outputs(
    result: CameraCalibration,
    folder: str | Path,
    overwrite: bool = False,
    say: Callable[[str], object] = lambda text: None,
) -> Iterator[Path]:
    """Write passport, exports, report and merged image into a folder, yielding each path as it is complete.

    An export that needs data which are not here (Hugin's, without the published EMoR basis) is left out, and of three
    curves what holds but one.

    Parameters
    ----------
    result : CameraCalibration
    folder : path
    overwrite : bool
        Else, where one of the files is there, `InputError` is raised before anything is written.
    say : callable, optional
        Is told what is left out for want of data.
    """
    folder = Path(folder)
    held = len(result.passport.curves)
    paths = {}
    for name, each in FORMATS.items():
        if held in each.channels:
            stem = "passport" if name == "passport" else "response"
            paths[name] = folder / (stem + each.suffix if each.suffix.startswith(".") else each.suffix)
    vignetted = result.merged is not None and result.passport.vignetting is not None
    others = {_REPORT: True, _MERGED: result.merged is not None, _VIGNETTE: vignetted}
    for path in (*paths.values(), *(folder / name for name, there in others.items() if there)):
        check_new(path, overwrite)
    page = report_page(result)
    for name, path in paths.items():
        try:
            write_response(result.passport, path, name, overwrite)
        except MissingDataError as error:
            say(f"{path.name} is left out: {error}")
            continue
        yield path
    write_new(folder / _REPORT, page.encode(errors="replace"), overwrite)
    yield folder / _REPORT
    if result.merged:
        write_hdr(folder / _MERGED, result.merged.radiance, overwrite)
        yield folder / _MERGED
        if vignetted:
            write_new(folder / _VIGNETTE, _vignette(result.passport, *result.merged.weight.shape), overwrite)
            yield folder / _VIGNETTE


def _vignette(passport: Passport, height: int, width: int) -> bytes:
    """Return a PNG of 16 bits as DSO takes it: https://github.com/tum-vision/mono_dataset_code, vignette.png."""
    import cv2

    falloff = passport.falloff(height, width)
    return cv2.imencode(".png", np.rint(65535 * falloff / falloff.max()).astype(np.uint16))[1].tobytes()


def linearise_file(
    image: Path,
    response: Path,
    out: Path,
    overwrite: bool = False,
    *,
    to: str = "light",
    vignette: bool = False,
    format: str | None = None,
    white_level: int | None = None,
    say: Callable[[str], object] = lambda text: None,
) -> Path:
    """Turn the brightness of an image file back into irradiance, write it as a linear image, and return its path.

    `response` is a passport or a response of another program, of that `format`, else as its content tells; `out` ends
    in ``.exr`` or ``.tif`` (floats in units of full scale) or ``.hdr``. `white_level` is by default that of the
    passport, else guessed; `to` and `vignette` as in `linearise`, `say` as in `crfbench.camera.calibrate`.
    """
    passport = read_response(response, format)
    check_new(out, overwrite)
    for text in passport.warnings:
        say(f"{response}: {text}")
    white_level = white_level or passport.white_level
    if white_level is None:
        white_level, notes = find_white_level([image])
        for note in notes:
            say(note)
    levels = WORKER.run(read_levels, image, white_level)
    write_hdr(out, linearise(levels, passport, to=to, vignette=vignette), overwrite)
    return out


def linearised_patches(result: CameraCalibration, name: str) -> "DataFrame":
    """Measure the chart in one photograph before and after it was linearised.

    Parameters
    ----------
    result : CameraCalibration
        Of photographs of a chart.
    name : str
        Of the photograph.

    Returns
    -------
    DataFrame
        One row a patch and channel, without the clipped ones. raw: share of full scale, NaN without a RAW file; jpeg:
        brightness; linear: irradiance by the calibration, each channel times the factor that brings it nearest to raw
        (white balance and exposure are no part of a response).
    """
    import pandas as pd

    if name not in result.measured:
        raise InputError(f"name={name!r} is not a photograph with a chart; use one of {', '.join(result.measured)}")
    photograph = result.measured[name]
    to = "light" if result.passport.matrix is None else "camera"
    pixels = linearise(WORKER.run(read_image, result.photographs[name]), result.passport, to=to)
    linear = measure_chart(pixels, photograph.corners).means
    raw = np.full_like(linear, np.nan) if photograph.raw is None else photograph.raw.means
    kept = photograph.jpeg.clipped == 0
    if photograph.raw is not None:
        kept &= photograph.raw.clipped == 0
        linear = linear * (raw * linear)[kept].sum(axis=0) / (linear**2)[kept].sum(axis=0)
    patch, channel = np.indices(linear.shape)[:, kept].reshape(2, -1)
    columns = {"raw": raw[kept].ravel(), "jpeg": photograph.jpeg.means[kept].ravel(), "linear": linear[kept].ravel()}
    return pd.DataFrame({"patch": patch + 1, "channel": np.array(list("rgb"))[channel], **columns})


def report_page(result: CameraCalibration) -> str:
    """Return the report as one HTML page with its pictures inside, which asks the network for nothing.

    It shows facts, warnings, the curve with its band, residuals, and the chart with the boxes that were measured.
    """
    import matplotlib as mpl
    from jinja2 import Environment, StrictUndefined

    from crfbench.plots import plot_calibration, plot_residuals, plot_vignetting

    calibration, vignetting = result.calibration, result.passport.vignetting
    with mpl.rc_context({"svg.hashsalt": "crfbench"}):  # else the names inside a picture would differ every time
        curves = {
            name: [
                _picture(6.0, height, partial(plot, calibration, i))
                for plot, height in ((plot_calibration, 4.5), (plot_residuals, 3.0))
            ]
            for i, name in enumerate(result.passport.channels)
        }
        fall = None if vignetting is None else _picture(6.0, 3.0, partial(plot_vignetting, vignetting))
    # Names of files and cameras come from strangers: the template escapes them.
    source = files("crfbench.camera").joinpath("report.html.jinja").read_text(encoding="utf-8")
    template = Environment(autoescape=True, undefined=StrictUndefined).from_string(source)
    chart = _chart(result) if result.measured else None
    return template.render(result=result, facts=_facts(result), curves=curves, vignetting=fall, chart=chart)


def _facts(result: CameraCalibration) -> dict[str, str]:
    passport, calibration = result.passport, result.calibration
    counts, residuals = calibration.observations.counts, calibration.residuals
    residual = f"{_rms(residuals[counts])} of irradiance"
    if result.measured:
        greys = residuals.reshape(-1, N_PATCHES)[:, _GREYS][counts.reshape(-1, N_PATCHES)[:, _GREYS]]
        residual += f"; of the grey patches {_rms(greys)}" if greys.size else ""
    mixed = {} if passport.matrix is None else {"colour matrix, RAW to light": matrix_text(passport.matrix)}
    if passport.vignetting is not None:
        mixed["light left in the corners"] = f"{np.exp(passport.vignetting.sum()):.1%}"
    return {
        "model": passport.model,
        "photographs": ", ".join(result.photographs),
        "measurements": f"{int(counts.sum())}, {int((~counts).sum())} clipped or left out",
        "brightness measured": f"{passport.valid_range[0]:.3f} to {passport.valid_range[1]:.3f}",
        "root mean square residual": residual,
        **mixed,
        "SHA-256 of the files": passport.data_sha256,
        "crfbench": passport.version,
    }


def matrix_text(matrix: Array) -> str:
    """Return the rows of a matrix for red, green and blue on one line."""
    return "; ".join(" ".join(f"{value:.3f}" for value in row) for row in matrix)


def _rms(residuals: np.ndarray) -> str:
    return f"{100 * np.sqrt((residuals**2).mean()):.1f} %"


def _chart(result: CameraCalibration) -> dict[str, str]:
    """Draw the chart where it was found most surely, with the boxes that were measured."""
    from crfbench.plots import plot_chart

    name, measured = max(result.measured.items(), key=lambda item: item[1].confidence)
    pixels = WORKER.run(read_image, result.photographs[name])
    height = 8.0 * pixels.shape[0] / pixels.shape[1]
    return {"name": name, "picture": _picture(8.0, height, lambda ax: plot_chart(pixels, measured.corners, ax), "png")}


def _picture(width: float, height: float, draw: Callable[["Axes"], object], kind: str = "svg") -> str:
    """Draw a figure that no notebook shows by itself, and return it as a data address."""
    from matplotlib.figure import Figure

    figure, content = Figure(figsize=(width, height), layout="constrained"), io.BytesIO()
    draw(figure.subplots())
    metadata = {"Date": None} if kind == "svg" else None
    figure.savefig(content, format=kind, bbox_inches="tight", dpi=110, metadata=metadata)
    media = "image/svg+xml" if kind == "svg" else f"image/{kind}"
    return f"data:{media};base64,{base64.b64encode(content.getvalue()).decode()}"


def calibrate_cameras(
    folders: Iterable[str | Path], out: str | Path, executor: Executor | None = None, **options: Any
) -> Iterator[tuple[Path, str]]:
    """Calibrate each folder as a camera of its own, and write its files into a folder of the same name.

    A camera whose folder is there counts as done, so that a second call goes on where the first one stopped. A worker
    process that ends by itself is a `WorkerError`; what was done stays.

    Parameters
    ----------
    folders : iterable of path
        Of different names.
    out : path
        Where their folders go. Each appears when it is complete.
    executor : Executor, optional
        Any executor of the kind of `concurrent.futures`, whose workers see the same files; by default one process a
        core of this machine.
    **options
        Of `calibrate`, the same for all cameras.

    Yields
    ------
    tuple of Path and str
        Each folder as it is done, with what was wrong with its photographs, or "".
    """
    paths, out = list(map(Path, folders)), Path(out).resolve()
    given = {path.resolve().name: path for path in paths}
    if len(given) < len(paths):
        raise InputError(f"{len(paths)} folders, and {len(given)} different names; use folders of different names")
    if inside := [path for path in paths if path.resolve().parent == out]:
        raise InputError(f"out={str(out)!r} holds {inside[0].name} itself; use another folder")
    out.mkdir(parents=True, exist_ok=True)
    todo = {name: path for name, path in given.items() if not (out / name).exists()}
    yield from ((path, "") for name, path in given.items() if name not in todo)
    with nullcontext(executor) if executor else local_workers() as workers:
        futures: dict[Future[str], Path] = {}
        try:
            for name, path in todo.items():
                futures[workers.submit(_calibrate, path, out / name, options)] = path
            yield from ((futures[future], future.result()) for future in as_completed(futures))
        except (BrokenExecutor, OSError) as error:
            raise worker_error(error, "calibrate the same folders again") from error
        finally:
            for future in futures:
                future.cancel()


def _calibrate(folder: Path, out: Path, options: dict[str, Any]) -> str:
    """Return why a camera gave no response, which must not end the others: its files, or a full disk."""
    try:
        result = calibrate(folder, **options)
        with tempfile.TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent) as part:
            complete = Path(part) / "complete"
            list(write_outputs(result, complete))
            complete.rename(out)
    except (CrfbenchError, OSError) as error:
        return "" if out.exists() else str(error)  # another process may have been faster
    return ""
