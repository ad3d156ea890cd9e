"""From a folder of photographs to a response passport: with a chart, by RAW files, or from exposure steps alone."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crfbench.calibration import Calibration
from crfbench.calibration import calibrate as calibrate_observations
from crfbench.calibration.colour import ColourCalibration, calibrate_colour
from crfbench.camera.measuring import MeasuredChart, chart_pairs, chart_table, observe_chart, weighed_by_scatter
from crfbench.camera.merging import Merged, merge_series
from crfbench.camera.pairs import calibrate_pairs, scene_pairs, widened
from crfbench.camera.passport import CHANNELS, Passport
from crfbench.camera.photographs import Exposures, Plan, Problems, Source, plan_photographs, read_planned
from crfbench.camera.reading import read_levels
from crfbench.camera.series import (
    EXACT,
    Reduced,
    calibrate_series,
    find_shifts,
    find_white,
    reduce_photograph,
    shifted,
    with_contradictions,
)
from crfbench.camera.vignetting import find_vignetting
from crfbench.camera.worker import WORKER
from crfbench.checks import check_choice, check_count, counted
from crfbench.curves import Array, repair
from crfbench.datasets.chart import load_labels
from crfbench.errors import InputError
from crfbench.models import DEFAULT_MODEL, ModelKey, ResponseModel

if TYPE_CHECKING:
    from pandas import DataFrame

_LEVEL = 0.9
_ESTIMATE = "estimate"
_NOMINAL = 0.05  # stops that times err by as a camera names them


@dataclass(frozen=True, repr=False)
class CameraCalibration:
    """What the photographs of one camera gave."""

    passport: Passport
    calibration: Calibration  # of a set for each curve; `passport` holds the curves made monotone
    photographs: dict[str, Path]  # the JPEG of each photograph that counts
    problems: Problems
    patches: "DataFrame | None" = None  # the patch table, where there was a chart
    measured: dict[str, MeasuredChart] = field(default_factory=dict)  # where the chart lies in each photograph
    merged: Merged | None = None  # the linear image that an exposure series gives
    notes: list[str] = field(default_factory=list)  # what was assumed of the files, in sentences
    colour: ColourCalibration | None = None  # where RAW files told the channels

    def __repr__(self) -> str:
        told = counted(len(self.photographs), "photograph"), counted(len(self.warnings), "warning")
        return f"CameraCalibration({self.passport!r}, {', '.join(told)})"

    @property
    def warnings(self) -> list[str]:
        """What is to be said of the curves, as the passport keeps it."""
        return list(self.passport.warnings)


def calibrate(
    source: Source,
    chart: str | Path = "auto",
    exposures: Exposures = None,
    model: str = DEFAULT_MODEL,
    created: str = "",
    *,
    channels: str = "rgb",
    align: str = "auto",
    vignette: bool = False,
    white_level: int | None = None,
    say: Callable[[str], object] = lambda text: None,
) -> CameraCalibration:
    """Calibrate a camera from its photographs: of a colour chart, of anything in RAW, or at several exposures.

    Without a chart, RAW files are compared with the JPEGs beside them or the previews inside (`measure_pairs`), and
    images without RAW files must be an exposure series of a static scene. When no photograph with a chart or a RAW file
    is left, or fewer than two of a series, this is an `InputError`.

    Parameters
    ----------
    source : path or iterable of path
        A folder or files: RAW files, or JPEG (or PNG, TIFF), best with a RAW file of the same name beside each.
    chart : "auto", "none" or path
        The chart is sought in every photograph, or marked by hand in a file of labels (`crfbench.camera.load_labels`)
        and sought where that has none; where none shows a chart, RAW files count. "none": RAW files of any scene, or an
        exposure series of one scene; one whose `exposures` are given, too, if there are RAW files.
    exposures : sequence, path, "names" or "exif", optional
        Exposure times of the photographs in any unit, in the order given, or in natural order of a folder: numbers,
        fractions such as "1/60", a file of them or those in the names, as `plan_photographs` takes them; default by
        EXIF. "estimate": those that best explain the photographs, whatever is told. Given ones are refused where every
        photograph of a chart has its RAW file, as those tell the exposures better.
    model : str
        Name of a bundled model of direction "inverse".
    created : str
        ISO date for the passport.
    channels : {"rgb", "shared"}
        A curve for each channel, which differ as far as the data tell, or one for all. Of a chart with its RAW files
        "rgb" also tells the colour matrix; of one without them there is one curve, of intensity. RAW files without a
        chart are for "rgb" only.
    align : {"auto", "none"}
        Without a chart: whether photographs from the hand are laid over each other (`find_shifts`).
    vignette : bool
        Whether an exposure series shows an evenly lit surface, which tells the vignetting of the lens too.
    white_level : int, optional
        Of images of 16 bits a value, such as 4095; by default guessed from their greatest level (`find_white_level`).
    say : callable, optional
        Is given, before the work begins, the photographs in order with their exposures and what is assumed of them;
        and later what was done to them.

    Returns
    -------
    CameraCalibration
        Exposures without a chart tell no scale: that the curve ends in (1, 1) is then the model's word.
    """
    try:
        given = list(map(Path, [source] if isinstance(source, str | Path) else source))
    except TypeError:
        kind = type(source).__name__
        raise InputError(f"source is a {kind}; use a folder or files, and calibrate_series for arrays") from None
    if missing := [path for path in given if not path.exists()]:
        raise InputError(f"there is no {missing[0]}; use a folder of photographs, or the files")
    check_choice("channels", channels, ("rgb", "shared"))
    check_choice("align", align, ("auto", "none"))
    if white_level is not None:
        check_count("white_level", white_level, 255, 65535)
    key = _inverse_model(model)
    if vignette and chart != "none":
        raise InputError(f"chart={chart!r} tells no vignetting; use 'none' and a series of an evenly lit surface")
    exposures = None if isinstance(exposures, str) and exposures == "exif" else exposures
    estimated = isinstance(exposures, str) and exposures == _ESTIMATE
    if vignette and estimated:
        raise InputError("estimated exposures leave the vignetting open up to a power; give the exposures")
    seek_raw = chart != "none" or exposures is None
    plan = plan_photographs(given, None if estimated else exposures, seek_raw, white_level)
    for text in (plan.table(), *plan.notes) if plan.pairs else ():
        say(text)
    if chart != "none":
        if estimated:
            plan = replace(plan, stops=np.full_like(plan.stops, np.nan))
        labels, timed = None if chart == "auto" else Path(chart), exposures is not None and not estimated
        return _from_chart(plan, labels, timed, key, channels == "rgb", created, say)
    if any(pair.raw for pair in plan.pairs):
        if vignette:
            raise InputError("RAW files tell no vignetting; use an exposure series, of JPEGs alone or with exposures")
        return _from_pairs(plan, key, channels == "rgb", created, say)
    error = None if estimated else _NOMINAL if exposures is None else EXACT
    result = _from_series(plan, error, key, channels == "rgb", align == "auto" and not vignette, vignette, created)
    for text in result.notes[len(plan.notes) :]:
        say(text)
    return result


def _inverse_model(name: str) -> ModelKey:
    try:
        key = ModelKey.parse(name)
    except InputError as error:
        raise InputError(str(error).replace("name=", "model=", 1)) from None
    if key.direction != "inverse":
        raise InputError(f"model={name!r} has direction 'forward'; use one of direction 'inverse', such as 'SLR-ldl-3'")
    key.load()  # what is no model is told before photographs are read
    return key


def _from_chart(
    plan: Plan, labels: Path | None, timed: bool, key: ModelKey, rgb: bool, created: str, say: Callable[[str], object]
) -> CameraCalibration:
    model = key.load()
    patches, measured, unmeasured = chart_table(plan.pairs, load_labels(labels) if labels else None, plan.white_level)
    used = plan.without(unmeasured)
    if patches.empty and labels is None and any(pair.raw for pair in plan.pairs):
        return _from_pairs(plan, key, rgb, created, say)
    if patches.empty:
        raise InputError(
            f"no photograph with a chart is left ({_reasons(used.problems)}); "
            "mark the corners with crfbench.widgets.ChartLabeller, or take a series of any scene and --chart none"
        )
    with_raw = all(pair.raw for pair in used.pairs)
    if timed and with_raw:
        raise InputError("exposures are given, but RAW files tell them better; leave out one of the two")
    colour = calibrate_colour(*chart_pairs(patches), model=model) if rgb and with_raw else None
    if colour is None:
        first = calibrate_observations(model, observe_chart(patches, used.stops), "map")
        calibration = calibrate_observations(model, weighed_by_scatter(first), "posterior")
        calibration = with_contradictions(calibration, [pair.jpeg.name for pair in used.pairs])
    else:
        calibration = colour.calibration
    return _result(calibration, key, used, created, plan.notes, colour=colour, patches=patches, measured=measured)


def _from_pairs(plan: Plan, key: ModelKey, rgb: bool, created: str, say: Callable[[str], object]) -> CameraCalibration:
    if not rgb:
        raise InputError("channels='shared' does not fit RAW files without a chart, which tell each channel; use 'rgb'")
    measured, problems = scene_pairs(plan.pairs, plan.white_level)
    if not measured:
        raise InputError(f"no photograph with its RAW file is left ({_reasons(plan.problems | problems)}); use others")
    found, odd, note = calibrate_pairs(measured, key.load())
    say(note)
    used = plan.without(problems | odd)
    return _result(found.calibration, key, used, created, [*plan.notes, note], colour=found)


def _from_series(
    plan: Plan, error: float | None, key: ModelKey, rgb: bool, align: bool, vignette: bool, created: str
) -> CameraCalibration:
    """Calibrate from exposures that err by so many stops, or without `error` from none."""
    model = key.load()
    if error is None:
        plan = replace(plan, stops=np.zeros(len(plan.pairs)))
    if len(plan.pairs) > 1 and np.isnan(plan.stops).all():
        give = "give times (--exposures 1/60,1/30,...), a file of them, names that hold one, or estimate"
        raise InputError(f"none of {len(plan.pairs)} photographs tells its exposure; {give}")
    images, used = read_planned(plan, reduce_photograph)
    if len(images) < 2:
        left = "".join(f", {pair.jpeg.name}" for pair in used.pairs)
        why = "" if images and not used.problems else f" ({_reasons(used.problems)})"
        raise InputError(f"{counted(len(images), 'photograph')} of a series left{left}{why}; use two or more")
    notes = plan.notes
    shifts = find_shifts([image.picture for image in images], used.stops, images[0].shape) if align else None
    if shifts is not None and shifts.any():
        notes = [*notes, _shifted(shifts, [pair.name for pair in used.pairs])]
        images = [
            WORKER.run(reduce_photograph, pair.jpeg, used.white_level, tuple(shift)) if shift.any() else image
            for pair, shift, image in zip(used.pairs, shifts, images, strict=True)
        ]
    stops, error = None if error is None else used.stops, error or EXACT
    try:
        calibration, note = _by_channel(images, stops, model, rgb, error)
    except InputError as problem:
        left_out = f" (left out: {_reasons(used.problems)})" if used.problems else ""
        raise InputError(f"{problem}{left_out}") from None
    notes = [*notes, *note, "exposures tell curves up to a scale: where white lies, the model says"]
    result = _result(widened(calibration), key, used, created, notes)
    exposures = np.asarray(calibration.observations.exposures)[0]  # the estimated ones too
    white = find_white(images, exposures)
    if vignette:
        coefficients, deviation = find_vignetting(_ahead(_again(used)), result.passport.curves, white)
        left = np.exp(coefficients.sum())
        differ = f"which differ by {2 * left * deviation:.1%}"
        notes = [*notes, f"vignetting: {left:.1%} of the light is left in the corners, {differ}"]
        result = replace(result, passport=replace(result.passport, vignetting=coefficients), notes=notes)
    again = _again(used)
    if shifts is not None:
        again = (shifted(image, *shift) for image, shift in zip(again, shifts, strict=True))
    # By the bands of the shape: the scale is common to all photographs, so it must not weigh them.
    return replace(result, merged=merge_series(_ahead(again), exposures, calibration, white))


def _by_channel(
    images: list[Reduced], stops: Array | None, model: ResponseModel, rgb: bool, error: float
) -> tuple[Calibration, list[str]]:
    """Calibrate a series channel by channel, or where one is too dark by itself all together, and say so."""
    try:
        return calibrate_series(images, stops, model, per_channel=rgb, exposure_error=error), []
    except InputError as problem:
        together = calibrate_series(images, stops, model, per_channel=False, exposure_error=error)
        return together, [f"one curve stands for all channels, for by themselves {problem}"]


def _again(used: Plan) -> Iterator[NDArray[Any]]:
    """Read the photographs again one by one, as 18 may be large."""
    return (WORKER.run(read_levels, pair.jpeg, used.white_level) for pair in used.pairs)


def _ahead(images: Iterator[NDArray[Any]]) -> Iterator[NDArray[Any]]:
    """Read the next image while the last one is used."""
    with ThreadPoolExecutor(1) as pool:
        following = pool.submit(next, images, None)
        while (image := following.result()) is not None:
            following = pool.submit(next, images, None)
            yield image


def _shifted(shifts: NDArray[np.intp], names: list[str]) -> str:
    moved = [f"{name} by {x:+d}, {y:+d}" for name, (x, y) in zip(names, shifts, strict=True) if x or y]
    return f"shifted to lie over the others, in pixels: {', '.join(moved)}"


def _warnings(calibration: Calibration, colour: ColourCalibration | None) -> list[str]:
    """Say what is doubtful of the curves; with the channel's name where it does not hold for all."""
    common = [text for text in calibration.warnings[0] if all(text in texts for texts in calibration.warnings)]
    pairs = zip(CHANNELS[len(calibration)], calibration.warnings, strict=True)
    single = [f"{name}: {text}" for name, texts in pairs for text in texts if text not in common]
    mixed = "the colours do not tell how the camera mixes its channels: the colour matrix is diagonal"
    diagonal = [mixed] if colour is not None and not colour.told[0] else []
    return [*common, *single, *diagonal]


def _result(
    calibration: Calibration, key: ModelKey, used: Plan, created: str, notes: list[str], **parts: Any
) -> CameraCalibration:
    """Write down one calibration: its curve and band made monotone, the camera, and a digest of the files.

    `parts` are further fields of `CameraCalibration`.
    """
    colour: ColourCalibration | None = parts.get("colour")
    exif = next((exif for exif in used.exifs if exif.model), used.exifs[0])
    files = [path for pair in used.pairs for path in (pair.jpeg, pair.raw) if path is not None]
    low, high = (repair(curves) for curves in calibration.bands[_LEVEL])
    curve = repair(calibration.curves)
    darkest, brightest = calibration.brightness_range[:, 0].min(), calibration.brightness_range[:, 1].max()
    passport = Passport(
        "inverse",
        curve,
        # Each made monotone by itself, a curve could leave its band by little.
        np.minimum(low, curve),
        np.maximum(high, curve),
        _LEVEL,
        camera=exif.model or "",
        iso=round(exif.iso or 0) or None,
        model=str(key),
        params=calibration.params,
        data_sha256=_digest(files),
        valid_range=(float(darkest), float(brightest)),
        created=created,
        white_level=used.white_level,
        warnings=tuple(_warnings(calibration, colour)),
        **({} if colour is None else {"matrix": colour.matrix[0], "soft": colour.soft[0], "told": colour.told[0]}),
    )
    photographs = {pair.name: pair.jpeg for pair in used.pairs}
    return CameraCalibration(passport, calibration, photographs, used.problems, notes=notes, **parts)


def _digest(files: Sequence[Path]) -> str:
    """Return the SHA-256 of the files' own digests, in the order of their names, so that copies elsewhere agree."""
    total = hashlib.sha256()
    for path in sorted(set(files), key=lambda path: path.name):
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


def _reasons(problems: Problems) -> str:
    """Say of the first few files why they were left out."""
    rest = f"; and {len(problems) - 3} more" if len(problems) > 3 else ""
    return "; ".join(list(problems.values())[:3]) + rest or "there is no photograph"
