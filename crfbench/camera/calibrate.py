"""From a folder of photographs to a response passport: with a chart, or from exposure steps alone."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crfbench.calibration import Calibration, Noise
from crfbench.calibration import calibrate as calibrate_observations
from crfbench.camera.measuring import MeasuredChart, chart_table, observe_chart
from crfbench.camera.merging import Merged, merge_series
from crfbench.camera.passport import Passport
from crfbench.camera.reading import (
    IMAGE_SUFFIXES,
    Exif,
    Problem,
    Source,
    as_times,
    list_photographs,
    pair_photographs,
    read_exif,
    read_series,
)
from crfbench.camera.series import calibrate_series
from crfbench.camera.worker import WORKER
from crfbench.curves import repair
from crfbench.datasets.chart import load_labels
from crfbench.errors import InputError
from crfbench.models import DEFAULT_MODEL, ModelKey

if TYPE_CHECKING:
    from pandas import DataFrame

_LEVEL = 0.9
_NOMINAL, _EXACT = 0.05, 0.02  # of exposures in stops: times as a camera names them, and as given
# RAW files tell exposures to a percent or two, and JPEG patches are means of many pixels.
_WITH_RAW = Noise(brightness=0.01, exposure=0.02)


@dataclass(frozen=True)
class CameraCalibration:
    """What the photographs of one camera gave."""

    passport: Passport
    calibration: Calibration  # of one set; `passport` holds its curve made monotone
    photographs: dict[str, Path]  # the JPEG of each photograph that counts
    problems: list[Problem]  # files that were left out
    patches: "DataFrame | None" = None  # the patch table, where there was a chart
    measured: dict[str, MeasuredChart] = field(default_factory=dict)  # where the chart lies in each photograph
    merged: Merged | None = None  # the linear image that an exposure series gives


def calibrate(
    source: Source,
    chart: str | Path = "auto",
    exposures: Sequence[float] | None = None,
    model: str = DEFAULT_MODEL,
    created: str = "",
) -> CameraCalibration:
    """Calibrate a camera from its photographs: of a colour chart, or of any static scene at several exposures.

    When no photograph with a chart is left, or fewer than two of a series, this is an `InputError`.

    Parameters
    ----------
    source : path or iterable of path
        A folder or files: JPEG (or PNG, TIFF), and with a chart best a RAW file of the same name beside each.
    chart : "auto", "none" or path
        The chart is sought in every photograph, or marked by hand in a file of labels (`crfbench.camera.load_labels`)
        and sought where that has none. "none": an exposure series of aligned photographs without a chart.
    exposures : sequence of float, optional
        Exposure times of the photographs, by name in alphabetical order, in any unit; default by EXIF. Refused where
        every photograph of a chart has its RAW file, as those tell the exposures better.
    model : str
        Name of a bundled model of direction "inverse".
    created : str
        ISO date for the passport.

    Returns
    -------
    CameraCalibration
        Exposures without a chart tell no scale: that the curve ends in (1, 1) is then the model's word.
    """
    given = [source] if isinstance(source, str | Path) else (source := list(source))
    if missing := [path for path in map(Path, given) if not path.exists()]:
        raise InputError(f"there is no {missing[0]}; use a folder of photographs, or the files")
    key = _inverse_model(model)
    if chart == "none":
        return _from_series(source, exposures, key, created)
    labels = None if chart == "auto" else Path(chart)
    return _from_chart(source, labels, exposures, key, created)


def _inverse_model(name: str) -> ModelKey:
    key = ModelKey.parse(name)
    if key.direction != "inverse":
        raise InputError(f"model={name!r} has direction 'forward'; use one of direction 'inverse', such as 'SLR-ldl-3'")
    return key


def _from_chart(
    source: Source, labels: Path | None, exposures: Sequence[float] | None, key: ModelKey, created: str
) -> CameraCalibration:
    model = key.load()
    pairs, unpaired = pair_photographs(source)
    patches, measured, unmeasured = chart_table(pairs, load_labels(labels) if labels else None)
    problems = unpaired + unmeasured
    if patches.empty:
        raise InputError(
            f"no photograph with a chart is left ({_reasons(problems)}); "
            "mark the corners with ChartLabeller, or use other files"
        )
    used = [pair for pair in pairs if pair.name in measured]
    if exposures is not None and all(pair.raw for pair in used):
        raise InputError("exposures are given, but RAW files tell them better; leave out one of the two")
    steps = None if exposures is None else np.log2(as_times(exposures, [pair.name for pair in used]))
    observations = observe_chart(patches, steps)
    noise = _WITH_RAW if observations.absolute else Noise()
    calibration = calibrate_observations(model, observations, "posterior", noise=noise)
    files = [path for pair in used for path in (pair.jpeg, pair.raw) if path is not None]
    passport = _passport(calibration, key, next(iter(measured.values())).exif, files, created)
    return CameraCalibration(
        passport, calibration, {pair.name: pair.jpeg for pair in used}, problems, patches, measured
    )


def _from_series(source: Source, exposures: Sequence[float] | None, key: ModelKey, created: str) -> CameraCalibration:
    model = key.load()
    paths = [path for path in sorted(list_photographs(source)) if path.suffix.lower() in IMAGE_SUFFIXES]
    images, stops, problems = read_series(paths, exposures)
    if len(images) < 2:
        raise InputError(f"{len(images)} photographs of a series are left ({_reasons(problems)}); use two or more")
    error = _NOMINAL if exposures is None else _EXACT
    calibration = calibrate_series(images, stops, model, exposure_error=error)
    left = {problem.path for problem in problems}
    used = [path for path in paths if path not in left]
    passport = _passport(calibration, key, WORKER.run(read_exif, used[0]), used, created)
    merged = merge_series(images, stops, calibration)
    return CameraCalibration(passport, calibration, {path.stem: path for path in used}, problems, merged=merged)


def _passport(calibration: Calibration, key: ModelKey, exif: Exif, files: Sequence[Path], created: str) -> Passport:
    """Write down one calibration: its curve and band made monotone, the camera, and a digest of the files."""
    low, high = (repair(curves[:1]) for curves in calibration.bands[_LEVEL])
    curve = repair(calibration.curves[:1])
    darkest, brightest = calibration.brightness_range[0].tolist()
    return Passport(
        "inverse",
        curve,
        # Each made monotone by itself, a curve could leave its band by little.
        np.minimum(low, curve),
        np.maximum(high, curve),
        _LEVEL,
        camera=exif.model or "",
        iso=None if exif.iso is None else round(exif.iso),
        model=str(key),
        params=calibration.params[:1],
        data_sha256=_digest(files),
        valid_range=(darkest, brightest),
        created=created,
    )


def _digest(files: Sequence[Path]) -> str:
    """Return the SHA-256 of the files' own digests, in the order of their names, so that copies elsewhere agree."""
    total = hashlib.sha256()
    for path in sorted(files, key=lambda path: path.name):
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


def _reasons(problems: list[Problem]) -> str:
    """Say of the first few files why they were left out."""
    rest = f"; and {len(problems) - 3} more" if len(problems) > 3 else ""
    return "; ".join(problem.reason for problem in problems[:3]) + rest or "there is no photograph"
