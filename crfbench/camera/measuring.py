"""Find a chart of 24 patches in a photograph, tell which way round it lies, and measure its patches.

OpenCV's detector proposes places. Its own judgement supposes sRGB colours and drops charts in dark or tinted
photographs, so it is asked for every candidate, and the colours of the patches decide here.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.calibration import Calibration, Observations
from crfbench.calibration.mixture import typical_slope
from crfbench.calibration.observations import colour_error
from crfbench.camera.photographs import Pair, Problems, exposure_steps
from crfbench.camera.reading import Exif, read_exif, read_image, read_raw, reduced
from crfbench.camera.worker import WORKER
from crfbench.checks import counted
from crfbench.curves import Array
from crfbench.datasets.chart import CLIPPED_SHARE, N_PATCHES, as_corners, chart_colours, sample_positions, within_margin
from crfbench.errors import FormatError, InputError

# Larger photographs are reduced to the first side, and where that shows no chart, as it may be small, to the second.
_LONGEST_SIDES, _SHORTEST_SIDE = (1000, 4000), 32
_CANDIDATES = 30
_MARGIN = 0.1  # widths of a patch, of the detector's box round the patches
_CROP_SHARE = 0.02  # of a side, by which cameras crop the frame of a RAW file at most
_BOX_SHARE = 0.5  # the inner half of a patch keeps clear of its edges, of shadows and of corners a little off
_TRIMMED_SHARE = 0.1  # left out at either end before averaging: dust, scratches, hot pixels
_MIN_BOX_PIXELS, _FEW_PIXELS, _MAX_BOX_PIXELS = 4, 8, 128
# The 14 cameras of the Middlebury set reach 0.90 to 0.98, and less than 0 mirrored or upside down. Glare, clipping and
# mixed channels bring others down to 0.58; then every patch must lie so near, in units of the spread of all, to a
# linear mix of the published colours. No board of random colours does, and a hidden patch lies 1.4 to 2.7 off.
_MIN_CONFIDENCE, _LEAST_CONFIDENCE, _FARTHEST = 0.8, 0.5, 1.1
# The spread within patches in units of that of all: charts have 0.02 to 0.46, a grid beside the patches 0.5 to 1.1.
_MOST_UNEVEN = 0.5
_MANY_CLIPPED, _FEWEST = 6, 2
_GREY_TOLERANCE = 0.02  # by which the grey row may rise between two patches, both black or both white
_GREY_ROW = slice(18, 24)
_BLACK, _WHITE = 0.5 / 65535, 253.5 / 255  # 0 and 254 of 255, as in the Middlebury table, halfway to the next values


class PatchValues(NamedTuple):
    """What was measured in the 24 patches of one image."""

    means: Array  # shape (24, 3); trimmed means of red, green and blue over the inner box, in [0, 1]
    clipped: Array  # shape (24,); share of the pixels with any channel at 0 or at 254/255 and more
    # shape (24,); half the distance between the 16th and 84th percentile of a pixel's mean over the channels: a
    # standard deviation that outliers do not move
    spread: Array


class _Reading(NamedTuple):
    """Four corners, read as those of a chart."""

    corners: Array  # shape (4, 2); in the order that suits a chart best
    confidence: float
    unevenness: float
    fault: str  # what speaks against a chart; nothing if it is one


def find_chart(image: ArrayLike) -> tuple[Array, float]:
    """Find a chart of 24 patches (ColorChecker Classic) in a developed photograph, whichever way round it lies.

    Takes an image (height, width, 3) in [0, 1]; returns the corners (4, 2) in chart order, as fractions of the image,
    and the `chart_confidence`.
    """
    pixels = _check_image(image).astype(np.float32, copy=False)
    nearest = _Reading(np.zeros((4, 2)), -1.0, 1.0, "nothing in it looks like one")
    for longest in _LONGEST_SIDES:
        small = reduced(pixels, longest)
        # The detector enlarges the shorter side to 1000 pixels, so a strip would become huge.
        proposed = _candidates(small) if min(small.shape[:2]) >= _SHORTEST_SIDE else ()
        readings = [_read(pixels, corners) for corners in proposed]
        if charts := [reading for reading in readings if not reading.fault]:
            best = min(charts, key=lambda reading: reading.unevenness)
            return best.corners, best.confidence
        nearest = max([nearest, *readings], key=lambda reading: reading.confidence)
        if max(pixels.shape[:2]) <= longest:
            break
    raise InputError(
        f"no chart of 24 patches was found in the photograph ({nearest.fault}); label its four corners by hand"
    )


def orient(image: ArrayLike, corners: ArrayLike) -> tuple[Array, float]:
    """Turn corners (4, 2), clockwise from any on, into chart order: of four readings, the one most like a chart.

    Takes an image and returns corners and confidence as `find_chart` does.
    """
    reading = _read(_check_image(image), as_corners(corners))
    if reading.fault:
        raise InputError(
            f"the patches are not a chart's in any of four directions ({reading.fault}); "
            "use the corners of a whole chart, evenly lit and not mirrored"
        )
    return reading.corners, reading.confidence


def _read(pixels: NDArray, corners: Array) -> _Reading:
    """Read corners in four directions, judge the one most like a chart."""
    turns = [np.roll(corners, -turn, axis=0) for turn in range(4)]
    samples = [_sample(pixels, turn, _FEW_PIXELS) for turn in turns]
    means = [_trimmed_means(each) for each in samples]
    confidences = [chart_confidence(each) for each in means]
    best = int(np.argmax(confidences))
    mirrored = max(chart_confidence(each.reshape(4, 6, 3)[::-1].reshape(24, 3)) for each in means)
    contrast = means[best].std(axis=0).mean()
    uneven = float(np.percentile(_spread(samples[best]), 80) / (contrast + 1e-6))
    if mirrored >= max(_MIN_CONFIDENCE, confidences[best]):
        return _Reading(turns[best], mirrored, uneven, "the nearest is mirrored")
    fault = _fault(means[best], confidences[best])
    if not fault and ((corners < 0) | (corners > 1)).any():
        fault = "a part of the nearest lies outside"
    if not fault and (side := _box_sides(pixels, corners).min()) < _MIN_BOX_PIXELS:
        fault = f"the inner box of a patch has {side:.1f} pixels a side of at least {_MIN_BOX_PIXELS}"
    if not fault and uneven > _MOST_UNEVEN:
        fault = "the patches of the nearest are not even"
    return _Reading(turns[best], confidences[best], uneven, fault)


def _fault(means: Array, confidence: float) -> str:
    """Say what speaks against a chart in 24 colours; nothing if they are one's."""
    if confidence < _LEAST_CONFIDENCE or (confidence < _MIN_CONFIDENCE and _farthest(means) > _FARTHEST):
        clipped = int((means >= _WHITE).any(axis=1).sum())
        light = f", {clipped} of 24 are overexposed" if clipped >= _MANY_CLIPPED else ""
        return f"the nearest has other colours, or something hides a part of it, confidence {confidence:.2f}{light}"
    if (np.diff(means[_GREY_ROW].mean(axis=1)) > _GREY_TOLERANCE).any():
        return "the grey row does not fall from white to black, as under a reflection"
    return ""


def _farthest(means: Array) -> float:
    """Say how far the worst of 24 colours lies from a linear mix of the published ones, in units of their spread."""
    published = np.column_stack([np.maximum(chart_colours(), 0.0) ** (1 / 2.2), np.ones(N_PATCHES)])
    rest = means - published @ np.linalg.lstsq(published, means)[0]
    return float(np.linalg.norm(rest, axis=1).max() / np.linalg.norm(means.std(axis=0)))


def measure_chart(image: ArrayLike, corners: ArrayLike) -> PatchValues:
    """Measure the patches of an image (height, width, 3) in [0, 1] between corners (4, 2) in chart order."""
    whole, points = _check_image(image), as_corners(corners)
    if (side := _box_sides(whole, points).min()) < _MIN_BOX_PIXELS:
        raise InputError(
            f"the inner box of a patch has {side:.1f} pixels a side; use a larger image of the chart, "
            f"with {_MIN_BOX_PIXELS} or more"
        )
    pixels = _sample(whole, points, _MAX_BOX_PIXELS)
    clipped = ((pixels <= _BLACK) | (pixels >= _WHITE)).any(axis=2).mean(axis=1)
    return PatchValues(_trimmed_means(pixels), clipped, _spread(pixels))


def chart_confidence(means: Array) -> float:
    """Say how far 24 colours are in the order of the chart's: 1 if each channel ranks them as the published colours do.

    The smallest of the three channels' rank correlations (Spearman) with the published colours. Neither a response
    nor the colour of the light changes ranks within a channel, so this holds for any camera.
    """
    from scipy.stats import rankdata

    measured, published = (rankdata(np.round(colours, 6), axis=0) for colours in (means, chart_colours()))
    if not np.ptp(measured, axis=0).all():
        return 0.0
    return float(min(np.corrcoef(measured[:, c], published[:, c])[0, 1] for c in range(3)))


def _check_image(image: ArrayLike) -> NDArray:
    """Return `image` as an array of shape (height, width, 3) of finite numbers, else raise `InputError`."""
    pixels = np.asarray(image)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or not pixels.size or not np.issubdtype(pixels.dtype, np.floating):
        raise InputError(f"the image has shape {pixels.shape} of {pixels.dtype}; use (height, width, 3) in [0, 1]")
    if not np.isfinite(pixels).all():
        raise InputError("the image holds NaN or infinite values; use finite values in [0, 1]")
    return pixels


def _candidates(pixels: NDArray[np.float32]) -> Iterator[Array]:
    """Yield the corners of the patches of all that may be a chart, clockwise, as fractions of the image."""
    import cv2

    # In 8 bits, each channel stretched to the full range, blue first.
    white = np.maximum(np.percentile(pixels, 99.5, axis=(0, 1)), 1e-3)
    image = np.rint(255 * np.clip(pixels / white, 0, 1)).astype(np.uint8)[..., ::-1].copy()
    detector = cv2.mcc.CCheckerDetector.create()
    detector.setColorChartType(cv2.mcc.MCC24)  # must be said: OpenCV 5.0 leaves it uninitialised
    detector.setUseDnnModel(False)
    settings = detector.getDetectionParams()
    # With these two, the detector drops no candidate for its colours or for lying near another.
    settings.maxError, settings.minInterCheckerDistance = 1e9, 0
    detector.setDetectionParams(settings)
    detector.process(image, _CANDIDATES)
    for checker in detector.getListColorChecker():
        corners = (within_margin(np.array(checker.getBox()), _MARGIN) + 0.5) / image.shape[1::-1]
        x, y = corners.T
        yield corners if x @ np.roll(y, -1) > y @ np.roll(x, -1) else corners[::-1]  # it may see one in a mirror


def _trimmed_means(pixels: Array) -> Array:
    cut = int(_TRIMMED_SHARE * pixels.shape[1])
    return np.asarray(np.sort(pixels, axis=1)[:, cut : pixels.shape[1] - cut].mean(axis=1))


def _spread(pixels: Array) -> Array:
    low, high = np.percentile(pixels.mean(axis=2), [16, 84], axis=1)
    return np.asarray((high - low) / 2)


def _box_sides(image: NDArray, corners: Array) -> Array:
    """Return the sides of the inner boxes in pixels, shape (24, 4)."""
    box = sample_positions(corners, 2, 2 * _BOX_SHARE) * image.shape[1::-1]  # its four points are the box's corners
    return np.asarray(np.linalg.norm(box[:, [1, 3, 2, 0]] - box[:, [0, 1, 3, 2]], axis=2))


def _sample(image: NDArray, corners: Array, most: int) -> Array:
    """Return pixels of the inner boxes, about each one once but `most` a row and column, shape (24, n, 3)."""
    size = np.array(image.shape[1::-1])
    n = int(np.clip(np.ceil(_box_sides(image, corners).max()), 1, most))
    x, y = np.moveaxis(np.floor(sample_positions(corners, n, _BOX_SHARE) * size).astype(np.intp), -1, 0)
    return image[y.clip(0, size[1] - 1), x.clip(0, size[0] - 1)].astype(np.float64)


if TYPE_CHECKING:
    from pandas import DataFrame

_COLUMNS = (
    *("photograph", "camera", "exposure_step", "confidence", "patch"),
    *(f"{kind}_{value}" for kind in ("jpeg", "raw") for value in ("r", "g", "b", "clipped", "spread")),
)
_RAW_ERROR, _CHART_ERROR = 0.01, 0.05  # relative standard deviation of a patch's irradiance: measured, published
_DARKEST_RAW = 0.002  # of full scale; below, noise and the black level say more than the light
_ROUNDS = 20
# Of scatter: what is near in log brightness, as a share of its range, and how many readings of the usual scatter, in
# units of the stated noise, are thought to be there before any is seen.
_NEAR, _FEW_READINGS, _USUAL = 0.125, 2.0, 0.25


class MeasuredChart(NamedTuple):
    """One photograph of a chart: where the chart lies, how surely, and its patches in the JPEG and in the RAW file."""

    corners: Array  # shape (4, 2); in chart order, x and y as fractions of the image
    confidence: float  # from 0 to 1
    jpeg: PatchValues
    raw: PatchValues | None
    exif: Exif


def measure_photograph(
    jpeg: Path, raw: Path | None = None, corners: ArrayLike | None = None, white_level: int | None = None
) -> MeasuredChart:
    """Measure the chart in one photograph, decoding its files in this process.

    The chart lies at the same place in both files. Corners marked by hand, shape (4, 2), are clockwise from any corner
    on; without them the chart is sought in the JPEG. `white_level` as in `read_image`. Grey photographs and two sizes
    are a `FormatError`.
    """
    pixels, exif = read_image(jpeg, white_level), read_exif(jpeg, raw)
    if pixels.ndim == 2:
        raise FormatError(f"{jpeg.name} is grey, and a chart is told by its colours; use --chart none and a series")
    found, confidence = find_chart(pixels) if corners is None else orient(pixels, corners)
    values = measure_chart(pixels, found)
    if raw is None:
        return MeasuredChart(found, confidence, values, None, exif)
    linear = read_raw(raw)
    (height, width), (raw_height, raw_width) = pixels.shape[:2], linear.shape[:2]
    whole = height / raw_height if jpeg == raw else 1.0  # previews are smaller
    if max(abs(height / raw_height - whole), abs(width / raw_width - whole)) > _CROP_SHARE * whole:
        sizes = f"{jpeg.name} is {width} x {height} and {raw.name} is {raw_width} x {raw_height} pixels"
        raise FormatError(f"{sizes}; use the JPEG of the same photograph, neither resized nor turned")
    return MeasuredChart(found, confidence, values, measure_chart(linear, found), exif)


def chart_table(
    pairs: Sequence[Pair], labels: Mapping[str, ArrayLike] | None = None, white_level: int | None = None
) -> tuple["DataFrame", dict[str, MeasuredChart], Problems]:
    """Measure the chart in every photograph; one that cannot be measured is reported, the rest goes on.

    Parameters
    ----------
    pairs : sequence of Pair
        See `pair_photographs`; without a RAW file, its columns are NaN.
    labels : mapping of str to array_like, shape (4, 2), optional
        Corners by the name of the photograph (`load_labels`) or of its file; in the other photographs the chart is
        sought, and where none is found, tried at the corners of the surest.
    white_level : int, optional
        As in `crfbench.camera.read_image`.

    Returns
    -------
    patches : DataFrame
        One row a photograph and patch (1 to 24). ``{jpeg,raw}_{r,g,b,clipped,spread}`` are the `PatchValues`,
        ``exposure_step`` is in stops relative to the first photograph that tells its exposure (`exposure_steps`),
        ``camera`` the model by EXIF.
    measured : dict of str to MeasuredChart
        By the name of the photograph.
    problems : dict of Path to str
        Why a photograph was not measured, by its JPEG.
    """
    import pandas as pd

    given = labels or {}
    corners = {pair.name: given[key] for pair in pairs for key in (pair.name, pair.jpeg.name) if key in given}
    if labels is not None and not corners:
        names = ", ".join(pair.name for pair in pairs)
        raise InputError(f"the labels are of {', '.join(labels) or 'no photograph'}; use labels of {names}")
    found = {pair.name: _measured(pair, corners.get(pair.name), white_level) for pair in pairs}
    charts = [each for each in found.values() if isinstance(each, MeasuredChart)]
    if charts and len(charts) < len(found):  # the camera may have stood still
        surest = max(charts, key=lambda chart: chart.confidence).corners
        for pair in pairs:
            again = _measured(pair, surest, white_level) if isinstance(found[pair.name], InputError) else None
            found[pair.name] = again if isinstance(again, MeasuredChart) else found[pair.name]
    measured = {name: each for name, each in found.items() if isinstance(each, MeasuredChart)}
    problems = {
        pair.jpeg: str(each) if isinstance(each, FormatError) else f"{pair.jpeg.name}: {each}"
        for pair in pairs
        if isinstance(each := found[pair.name], Exception)
    }
    steps = exposure_steps([photograph.exif for photograph in measured.values()])
    rows = [
        (name, photograph.exif.model, step, photograph.confidence, patch + 1, *values)
        for (name, photograph), step in zip(measured.items(), steps, strict=True)
        for patch, values in enumerate(np.column_stack([_values(photograph.jpeg), _values(photograph.raw)]).tolist())
    ]
    return pd.DataFrame(rows, columns=list(_COLUMNS)), measured, problems


def _measured(
    pair: Pair, corners: ArrayLike | None, white_level: int | None
) -> MeasuredChart | FormatError | InputError:
    try:
        found = WORKER.run(measure_photograph, pair.jpeg, pair.raw, corners, white_level)
    except (FormatError, InputError) as error:
        return error
    clear = np.all([each.clipped < CLIPPED_SHARE for each in (found.jpeg, found.raw) if each], axis=0)
    if clear.sum() >= _FEWEST:
        return found
    return InputError(f"{N_PATCHES - clear.sum()} of {N_PATCHES} patches are clipped; use another exposure")


def _values(values: PatchValues | None) -> Array:
    if values is None:
        return np.full((N_PATCHES, 5), np.nan)
    return np.column_stack([values.means, values.clipped, values.spread])


def observe_chart(patches: "DataFrame", exposures: ArrayLike | None = None) -> Observations:
    """Make observations of a measured patch table.

    Where every photograph has its RAW file, they tell the irradiance of the patches and the exposures; else the
    published colours of the chart do, and `exposures`, shape (e,), in stops; by default those of the table, if all are
    known.
    """
    rgb, raw = (_cube(patches, kind) for kind in ("jpeg", "raw"))
    clipped = _by_photograph(patches, "jpeg_clipped") >= CLIPPED_SHARE
    brightness, colour = rgb.mean(axis=-1), colour_error(rgb)
    if np.isfinite(raw).all():
        bad = _by_photograph(patches, "raw_clipped") >= CLIPPED_SHARE
        reference, steps = separate(raw.mean(axis=-1), bad)
        known = reference > 0  # a patch that no RAW file measured says nothing
        error = np.hypot(_RAW_ERROR, colour)
        reference, weights = np.where(known, reference, 1.0), known.astype(float)
        return Observations(
            brightness, reference, steps, clipped, weights=weights, reference_error=error, absolute=True, colour=colour
        )
    steps = np.asarray(_by_photograph(patches, "exposure_step")[:, 0] if exposures is None else exposures)
    if np.shape(steps) != (len(rgb),):
        raise InputError(
            f"there are {np.size(steps)} exposures for {counted(len(rgb), 'photograph')} with a chart; give one each"
        )
    reference = np.maximum(chart_colours(), 0.0).mean(axis=1)
    known_steps = steps if np.isfinite(steps).all() else None
    return Observations(
        brightness, reference, known_steps, clipped, reference_error=np.hypot(_CHART_ERROR, colour), colour=colour
    )


def weighed_by_scatter(found: Calibration) -> Observations:
    """Let readings of one chart count less where those of near brightness scatter more between its photographs.

    What all photographs of a patch share is no scatter but an error of its reference.
    """
    o, (counts,) = found.observations, found.observations.counts
    if len(counts) == 1:
        return o
    b = np.maximum(o.brightness[0], 1 / 255)
    noise = np.hypot(typical_slope(b) * found.noise.brightness / b, found.noise.fine)
    off = np.ma.array(found.residuals[0], mask=~counts)
    off = ((off - np.ma.average(off, axis=0, weights=noise**-2)) / noise)[counts].filled(0.0)
    logs = np.log(b[counts])
    near = np.exp(-0.5 * ((logs[:, None] - logs) / (_NEAR * np.ptp(logs))) ** 2)
    spread = (near @ off**2 + _FEW_READINGS * _USUAL**2) / (near.sum(axis=1) + _FEW_READINGS)
    factor = np.ones(counts.shape)
    factor[counts] = np.minimum(1.0, np.median(spread) / spread)
    return o.weighed(factor)


def chart_pairs(patches: "DataFrame") -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return JPEG and RAW of a measured patch table, (e, 24, 3), and which patches are clipped in neither, (e, 24)."""
    jpeg, raw = (_by_photograph(patches, f"{kind}_clipped") < CLIPPED_SHARE for kind in ("jpeg", "raw"))
    return _cube(patches, "jpeg"), _cube(patches, "raw"), jpeg & raw


def separate(raw: Array, clipped: np.ndarray) -> tuple[Array, Array]:
    """Split RAW intensities (e, p) into irradiance of patches times exposure of photographs: least squares of logs.

    The irradiance (p,) is in units of the first photograph that measures any, and 0 where no photograph does. The
    exposures (e,) are in stops, and 0 where a photograph measures nothing.
    """
    weight = np.where(clipped, 0.0, np.maximum(raw - _DARKEST_RAW, 0.0))
    logs = np.log(np.maximum(raw, _DARKEST_RAW))
    exposure = np.zeros(len(raw))
    # The best irradiances at given exposures are weighted means, and the other way round; in turn, both converge.
    for _ in range(_ROUNDS):
        irradiance = _mean(logs - exposure[:, None], weight, 0)
        exposure = _mean(logs - irradiance, weight, 1)
    first = exposure[np.argmax(weight.any(axis=1))]
    measured = weight.any(axis=0)
    return np.where(measured, np.exp(irradiance + first), 0.0), (exposure - first * weight.any(axis=1)) / np.log(2.0)


def _mean(values: Array, weight: Array, axis: int) -> Array:
    return np.asarray((weight * values).sum(axis=axis) / np.maximum(weight.sum(axis=axis), 1e-300))


def _by_photograph(patches: "DataFrame", column: str) -> Array:
    return np.asarray(patches[column].to_numpy().reshape(-1, N_PATCHES))


def _cube(patches: "DataFrame", kind: str) -> Array:
    """Return red, green and blue as (photographs, 24, 3)."""
    return patches[[f"{kind}_{channel}" for channel in "rgb"]].to_numpy(float).reshape(-1, N_PATCHES, 3)
