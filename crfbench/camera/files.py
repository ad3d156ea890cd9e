"""From a folder of photographs to a response passport: with a chart, or from exposure steps alone."""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crfbench.calibration import Calibration, Noise, calibrate
from crfbench.camera.observing import observe_chart
from crfbench.charts import Exif, Problem, chart_table, load_labels, pair_photographs, read_exif
from crfbench.charts.pairs import Pair
from crfbench.charts.reading import IMAGE_SUFFIXES
from crfbench.charts.table import Measured
from crfbench.checks import as_numbers, check_choice
from crfbench.curves import repair
from crfbench.errors import InputError
from crfbench.models import ResponseModel, load_model
from crfbench.passport import Passport
from crfbench.series import Merged, calibrate_series, merge_series, read_series

if TYPE_CHECKING:
    from pandas import DataFrame

#: What `--model` may say, and the model with its number of parameters.
CHOICES = {
    "slr": ("SLR-ldl", 3),
    "slr-1": ("SLR-ldl", 1),
    "monotone": ("SLR-monotone", 3),
    "emor": ("EMoR", 3),
    "ggcm": ("GGCM", 3),
    "polynomial": ("Polynomial", 3),
    "ppisp": ("PPISP", 4),
}
_DEFAULT, _DEFAULT_FREE = "slr", "ppisp"  # with a chart, and without
_LEVEL = 0.9
_NOMINAL, _EXACT = 0.05, 0.02  # of exposures in stops: times as a camera names them, and as given
#: RAW files tell exposures to a percent or two, and JPEG patches are means of many pixels.
_WITH_RAW = Noise(brightness=0.01, exposure=0.02)


@dataclass(frozen=True)
class CameraCalibration:
    """What the photographs of one camera gave.

    Parameters
    ----------
    passport : Passport
    calibration : Calibration
        Of one set; `passport` holds its curve made monotone.
    photographs : dict of str to Path
        The JPEG of each photograph that counts.
    problems : list of Problem
        Files that were left out.
    patches : DataFrame, optional
        The patch table, where there was a chart.
    measured : dict of str to Measured
        Where the chart lies in each photograph.
    merged : Merged, optional
        The linear image that an exposure series gives.
    """

    passport: Passport
    calibration: Calibration
    photographs: dict[str, Path]
    problems: list[Problem]
    patches: "DataFrame | None"
    measured: dict[str, Measured]
    merged: Merged | None = None


def calibrate_chart(
    source: str | Path | Iterable[Path],
    labels: Path | None = None,
    exposures: Sequence[float] | None = None,
    model: str | None = None,
    created: str = "",
) -> CameraCalibration:
    """Calibrate a camera from photographs of a colour chart.

    Parameters
    ----------
    source : path or iterable of path
        A folder or files: JPEG (or PNG, TIFF), and best a RAW file of the same name beside each.
    labels : path, optional
        Corners marked by hand (`crfbench.charts.load_labels`); in other photographs the chart is sought.
    exposures : sequence of float, optional
        Exposure times of the photographs, by name in alphabetical order, in any unit; default by EXIF. Refused where
        every photograph has its RAW file, as those tell the exposures better.
    model : str, optional
        One of `CHOICES`; by default "slr".
    created : str
        ISO date for the passport.

    Returns
    -------
    CameraCalibration

    Raises
    ------
    InputError
        When no photograph with a chart is left, or something else does not fit.
    """
    ready = chosen_model(model or _DEFAULT)
    _check_there(source)
    pairing = pair_photographs(source)
    table = chart_table(pairing.pairs, load_labels(labels) if labels else None)
    problems = pairing.problems + table.problems
    if table.patches.empty:
        raise InputError(_nothing_left(problems))
    used = [pair for pair in pairing.pairs if pair.name in table.measured]
    if exposures is not None and all(pair.raw for pair in used):
        raise InputError(
            "exposures are given, and the RAW files tell them better; leave exposures out, or the RAW files"
        )
    steps = None if exposures is None else _stops(exposures, [pair.name for pair in used])
    observations = observe_chart(table.patches, steps)
    noise = _WITH_RAW if observations.absolute else Noise()
    calibration = calibrate(ready, observations, "posterior", noise=noise)
    exif = next(iter(table.measured.values())).exif
    passport = make_passport(calibration, exif, _files(used), created)
    return CameraCalibration(
        passport, calibration, {pair.name: pair.jpeg for pair in used}, problems, table.patches, table.measured
    )


def calibrate_exposures(
    source: str | Path | Iterable[Path],
    exposures: Sequence[float] | None = None,
    model: str | None = None,
    created: str = "",
) -> CameraCalibration:
    """Calibrate a camera from several exposures of one static scene, without a chart.

    Parameters
    ----------
    source : path or iterable of path
        A folder or files: aligned JPEG, PNG or TIFF photographs.
    exposures : sequence of float, optional
        Exposure times, by name of file in alphabetical order, in any unit; default by EXIF.
    model : str, optional
        One of `CHOICES`; by default "ppisp".
    created : str
        ISO date for the passport.

    Returns
    -------
    CameraCalibration
        Exposures tell no scale: that the curve ends in (1, 1) is the model's word.

    Raises
    ------
    InputError
        When fewer than two photographs are left, or something else does not fit.
    """
    ready = chosen_model(model or _DEFAULT_FREE)
    _check_there(source)
    paths = sorted(Path(source).iterdir() if isinstance(source, str | Path) else map(Path, source))
    images = [path for path in paths if path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")]
    series = read_series(images, "exif" if exposures is None else list(exposures))
    if len(series.images) < 2:
        reasons = _reasons(series.problems)
        raise InputError(
            f"{len(series.images)} photographs of a series are left ({reasons}); use two or more exposures"
        )
    calibration = calibrate_series(
        series.images, series.stops, ready, exposure_error=_NOMINAL if exposures is None else _EXACT
    )
    left = {problem.path for problem in series.problems}
    used = [path for path in images if path not in left]
    passport = make_passport(calibration, read_exif(used[0]), used, created)
    merged = merge_series(series.images, series.stops, calibration)
    return CameraCalibration(
        passport, calibration, {path.stem: path for path in used}, series.problems, None, {}, merged
    )


def chosen_model(name: str) -> ResponseModel:
    """Load the model of a choice.

    Raises
    ------
    InputError
        For a name that is not in `CHOICES`.
    """
    return load_model(*CHOICES[check_choice("model", name, CHOICES)], "inverse")


def make_passport(calibration: Calibration, exif: Exif, files: Sequence[Path], created: str = "") -> Passport:
    """Write down one calibration: its curve and band made monotone, the camera, and a digest of the files."""
    low, high = (repair(curves[:1]) for curves in calibration.bands[_LEVEL])
    curve = repair(calibration.curves[:1])
    return Passport(
        "inverse",
        curve,
        np.minimum(low, curve),
        np.maximum(high, curve),
        _LEVEL,
        camera=exif.model or "",
        iso=None if exif.iso is None else round(exif.iso),
        model=repr(calibration.model),
        params=calibration.params[:1],
        data_sha256=digest(files),
        valid_range=(float(calibration.brightness_range[0, 0]), float(calibration.brightness_range[0, 1])),
        created=created,
    )


def digest(files: Sequence[Path]) -> str:
    """Return the SHA-256 of the files' own digests, in the order of their names, so that copies elsewhere agree."""
    total = hashlib.sha256()
    for path in sorted(files, key=lambda path: path.name):
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


def _files(pairs: Sequence[Pair]) -> list[Path]:
    return [path for pair in pairs for path in (pair.jpeg, pair.raw) if path is not None]


def _stops(exposures: Sequence[float], names: list[str]) -> np.ndarray:
    times = as_numbers("exposures", exposures)
    if times.shape != (len(names),) or not (np.isfinite(times).all() and (times > 0).all()):
        raise InputError(
            f"exposures={list(exposures)} do not fit the photographs {', '.join(names)}; give one time above 0 for each"
        )
    return np.log2(times)


def _check_there(source: str | Path | Iterable[Path]) -> None:
    """Raise `InputError` for a path that leads nowhere."""
    given = [source] if isinstance(source, str | Path) else source
    missing = [path for path in map(Path, given) if not path.exists()]
    if missing:
        raise InputError(f"there is no {missing[0]}; use a folder of photographs, or the files")


def _nothing_left(problems: list[Problem]) -> str:
    return (
        f"no photograph with a chart is left ({_reasons(problems)}); "
        "mark the corners with ChartLabeller, or use other files"
    )


def _reasons(problems: list[Problem]) -> str:
    """Say of the first few files why they were left out."""
    rest = f"; and {len(problems) - 3} more" if len(problems) > 3 else ""
    return "; ".join(problem.reason for problem in problems[:3]) + rest or "there is no photograph"
