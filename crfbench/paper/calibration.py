"""The paper's Table 3 and more: 14 cameras calibrated from a colour chart, tested on the other illumination.

The chart-free table calibrates the same cameras from exposure steps alone, beside OpenCV's two calibrators.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
import pandas as pd
from scipy.optimize import isotonic_regression
from tqdm.auto import tqdm

from crfbench.calibration import METHODS, Calibration, Noise, Observations, calibrate
from crfbench.calibration.observations import REFERENCE_ERROR, colour_spread
from crfbench.calibration.posterior import DARKEST
from crfbench.checks import check_choice, check_seed
from crfbench.curves import GRID, Array, evaluate, repair
from crfbench.datasets import load_patches, load_responses, registry
from crfbench.datasets.chart import N_PATCHES
from crfbench.datasets.middlebury import EXPOSURES, REFERENCE_IRRADIANCE, THREE_GREYS, PatchArrays, patch_arrays
from crfbench.metrics import nonmonotone, rmse, statistics, summarise
from crfbench.models import load_model
from crfbench.models.registry import DEFAULT_MODEL, ModelKey
from crfbench.paper.results import BAR, load_recorded
from crfbench.paper.verdicts import CALIBRATION, CALIBRATION_COLUMNS, SIGNIFICANT_RMSE, verdict

COLUMNS = (
    "model", "method", "patches", "channel", "mean", "median", "sd", "max", "p95", "low", "high", "difference",
    "difference_low", "difference_high", "beyond_0.005", "scaled", "separate", "separate_scaled", "coverage", "seconds",
    "by_paper", "paper_mean", "paper_seconds", "verdict",
)  # fmt: skip
ROWS = (*CALIBRATION, "SLR-monotone-1", "SLR-monotone-3", "PPISP-4", DEFAULT_MODEL)
CHANNELS = ("intensity", "r", "g", "b")

_RANDOM_TRIPLES = 10
_RESAMPLES = 2000
_ILLUMINATIONS = 2
_Z90 = 1.6448536269514722  # of a normal distribution, the half width that holds 90 %
_COLOUR_SLOPE = 2.2  # relative error of one channel's reference by the relative spread of the channels


def calibration_table(
    patches: str = "3",
    method: str = "map",
    channel: str = "intensity",
    rows: Sequence[str | ModelKey] = ROWS,
    discrepancy: bool = True,
    seed: int = 0,
    progress: bool = False,
) -> pd.DataFrame:
    """Calibrate every camera on one illumination, test on the other, both ways, with every model.

    Parameters
    ----------
    patches : {"3", "24", "random"}
        "3": patches 19, 21 and 24 of the grey row; "24": all; "random": ten random triples, the RMSE averaged.
    method : str
        Of `crfbench.calibrate`, but for "grid": "lm" does the same where there is one parameter.
    channel : {"intensity", "r", "g", "b"}
        The mean of red, green and blue as in the paper, or one of them.
    rows : sequence of str or ModelKey
        Inverse models.
    discrepancy : bool
        Whether "map" and "posterior" allow for what the model misses; the paper's method never does.
    seed : int
        Of the triples, of the random starts and of the bootstrap.
    progress : bool
        Whether to show a bar with the time left.

    Returns
    -------
    DataFrame
        With the columns of `COLUMNS`. A camera's RMSE is that of decoded against RAW irradiance over the 4 x 24
        patches of the illumination it was not calibrated on, without alignment, averaged over both ways. ``mean``
        to ``p95`` are over cameras; ``low`` and ``high`` bound the mean (95 %, bootstrap over cameras).
        ``difference`` is the mean less that of the first row, with its paired 95 % bounds; ``beyond_0.005`` says
        whether they lie wholly beyond what the paper calls significant. ``scaled`` is the mean after the one scale that
        fits best, ``separate`` that of channels which are decoded first and averaged then, and ``separate_scaled``
        both (missing for one channel). ``coverage`` is the share of held-out RAW
        inside the 90 % band for measurements ("posterior"). ``seconds`` is for all calibrations of the row.
        ``by_paper`` is our mean by the paper's method, recorded for 3 and 24 patches, and ``verdict`` is on it:
        "reproduced" when the paper's mean lies within 0.005 or inside its bounds, else "differs"; "not comparable"
        unless the patches are the paper's. Rows with the method "floor" are fitted
        to the test data themselves: no calibration gets below them. That with the method "none" decodes by the mean
        curve of the 13 other cameras: a calibration is worth something where it gets below it.
    """
    check_choice("method", method, [name for name in METHODS if name != "grid"])
    check_choice("channel", channel, CHANNELS)
    chart, subsets = patch_arrays(load_patches()), _subsets(patches, check_seed(seed))
    fit = partial(calibrate, method=method, discrepancy=discrepancy, seed=seed)
    shown = tqdm(list(map(str, rows)), desc="models", disable=not progress, **BAR)
    found = [(name, method, *_calibrated(name, chart, subsets, channel, fit)) for name in shown]
    found += _without_calibration(chart, channel)
    recorded = load_recorded("calibration_paper")[0].astype({"patches": str})
    first, table = found[0][2], []
    for name, by, cameras, further in found:
        case = {"model": name, "method": by, "patches": patches, "channel": channel}
        measured = {**_over_cameras(cameras, first, seed), **further}
        table.append({**case, **measured, **_beside_paper(case, measured, recorded)})
    return pd.DataFrame(table, columns=list(COLUMNS))


def camera_rmse_table(
    patches: str = "3",
    method: str = "map",
    rows: Sequence[str | ModelKey] = ROWS,
    discrepancy: bool = True,
    seed: int = 0,
) -> pd.DataFrame:
    """Return the RMSE of every camera (rows) with every model (columns), as `calibration_table` summarises it."""
    chart, subsets = patch_arrays(load_patches()), _subsets(patches, seed)
    fit = partial(calibrate, method=method, discrepancy=discrepancy, seed=seed)
    found = {name: _calibrated(name, chart, subsets, "intensity", fit)[0] for name in map(str, rows)}
    floor, _, cameras, _ = next(_without_calibration(chart, "intensity"))
    return pd.DataFrame({**found, floor: cameras}, index=pd.Index(chart.cameras, name="camera"))


def chart_observations(chart: PatchArrays, channel: str = "intensity") -> tuple[Observations, Array, Array]:
    """Return what is calibrated on and tested on: 28 sets, camera by camera, illumination 1 and 2.

    After the observations come jpeg and raw (28, 96) of the other illumination.
    """
    rgb, clipped = chart.sets()
    if channel == "intensity":
        jpeg, raw = chart.jpeg.mean(axis=-1), chart.raw.mean(axis=-1)
        observations = Observations.from_rgb(rgb, REFERENCE_IRRADIANCE, clipped=clipped)
    else:
        which = "rgb".index(channel)
        jpeg, raw = chart.jpeg[..., which], chart.raw[..., which]
        # The reference is of intensity; one channel of a coloured patch is off by about the spread of its channels.
        error = np.hypot(REFERENCE_ERROR, _COLOUR_SLOPE * colour_spread(rgb))
        observations = Observations(rgb[..., which], REFERENCE_IRRADIANCE, clipped=clipped, reference_error=error)
    jpeg, raw = (_swapped(array.reshape(len(rgb), -1)) for array in (jpeg, raw))
    return observations, jpeg, raw


def _swapped(sets: Array) -> Array:
    """Exchange the two illuminations of every camera, along the first axis of sets (2 c, ...)."""
    return sets.reshape(-1, _ILLUMINATIONS, *sets.shape[1:])[:, ::-1].reshape(sets.shape)


def camera_rmse(result: Calibration, jpeg: Array, raw: Array) -> Array:
    """Return the RMSE of each camera, averaged over both ways, shape (c,)."""
    return _per_camera(rmse(evaluate(result.curves, jpeg), raw))


def coverage(result: Calibration, observations: Observations, jpeg: Array, raw: Array) -> float:
    """Return the share of held-out measurements inside the 90 % band, widened by their own noise.

    `result` is of both illuminations of every camera by "posterior"; `observations`, jpeg and raw (n, m) are those of
    all patches, from `chart_observations`.
    """
    # The noise is the stated one, or what the calibration found where it found more.
    scale = np.maximum(1.0 if result.noise_scale is None else result.noise_scale, 1.0)
    chart_error = _swapped(np.broadcast_to(observations.reference_error[:, None], observations.brightness.shape))
    error = np.reshape(scale, (-1, 1)) * np.hypot(Noise().relative(jpeg), chart_error.reshape(len(jpeg), -1))
    middle = np.maximum(evaluate(result.curves, jpeg), DARKEST)
    below, above = (np.log(np.maximum(evaluate(end, jpeg), DARKEST) / middle) for end in result.bands[0.9])
    off = np.log(np.maximum(raw, DARKEST) / middle)
    return float(((off >= -np.hypot(below, _Z90 * error)) & (off <= np.hypot(above, _Z90 * error))).mean())


def bootstrap_bounds(values: Array, seed: int = 0) -> dict[str, tuple[float, float]]:
    """Return the 95 % bounds of each statistic of `crfbench.metrics.summarise`, over resampled cameras."""
    picked = np.random.default_rng(seed).integers(len(values), size=(_RESAMPLES, len(values)))
    bounds = {name: np.percentile(drawn, (2.5, 97.5)) for name, drawn in statistics(values[picked]).items()}
    return {name: (float(low), float(high)) for name, (low, high) in bounds.items()}


def _calibrated(
    name: str, chart: PatchArrays, subsets: list[np.ndarray], channel: str, fit: Callable[..., Calibration]
) -> tuple[Array, dict[str, float]]:
    """Return the RMSE of each camera and the further figures of one row of the table."""
    model = load_model(name)
    observations, jpeg, raw = chart_observations(chart, channel)
    results = [fit(model, observations.take(subset)) for subset in subsets]
    cameras = np.mean([camera_rmse(result, jpeg, raw) for result in results], axis=0)
    further = {"seconds": sum(result.seconds for result in results)}
    if channel == "intensity":
        further |= _scaled_and_separate([result.curves for result in results], chart)
    if covered := [coverage(result, observations, jpeg, raw) for result in results if result.bands]:
        further["coverage"] = float(np.mean(covered))
    return cameras, further


def _scaled_and_separate(curves: list[Array], chart: PatchArrays) -> dict[str, float]:
    """Return three columns of the table, averaged over several curves (28, 1024) of all sets."""
    each = np.mean([held_out_rmse(one, chart, np.arange(len(one))) for one in curves], axis=(0, 2))
    return dict(zip(("scaled", "separate", "separate_scaled"), each[1:].tolist(), strict=True))


def held_out_rmse(curves: Array, chart: PatchArrays, sets: np.ndarray) -> Array:
    """Return how far curves (n, 1024) of those of the 28 sets lie from RAW of the other illumination, shape (4, n).

    Four ways: of the mean of the channels, that up to scale, of channels decoded by themselves, that up to scale.
    """
    rgb, raw = (_swapped(x.reshape(-1, x[0, 0, ..., 0].size, 3))[sets] for x in (chart.jpeg, chart.raw))
    parts = evaluate(curves, rgb.reshape(len(sets), -1)).reshape(rgb.shape)
    target = raw.mean(axis=2)
    both = (evaluate(curves, rgb.mean(axis=2)), parts.mean(axis=2))
    return np.array([rmse(x, target) for found in both for x in (found, _scaled(found, target))])


def _without_calibration(chart: PatchArrays, channel: str) -> Iterator[tuple[str, str, Array, dict[str, float]]]:
    """Yield rows of the table, as `_calibrated`: fits of the test data ("floor"), and what is known before ("none")."""
    _, jpeg, raw = chart_observations(chart, channel)
    order = np.argsort(jpeg, axis=1, kind="stable")
    x, y = (np.take_along_axis(values, order, axis=1) for values in (jpeg, raw))
    rising = np.array([isotonic_regression(row).x for row in y])
    yield "best monotone curve", "floor", _per_camera(rmse(rising, y)), {}
    curves = np.array([np.interp(GRID, *both) for both in zip(x, rising, strict=True)])
    camera = np.arange(len(x)) // _ILLUMINATIONS
    others = np.array([curves[camera != own].mean(axis=0) for own in camera])
    further = _scaled_and_separate([others], chart) if channel == "intensity" else {}
    yield "mean of other cameras", "none", _per_camera(rmse(evaluate(others, jpeg), raw)), further
    for name in ("dorf", "opencrf") if registry.find("dorf/201_CRF_data.mat") else ("opencrf",):
        responses = load_responses(name)
        decoded = evaluate(responses.in_direction("inverse")[None], jpeg[:, None])
        yield f"nearest {responses.dataset} curve", "floor", _per_camera(rmse(decoded, raw[:, None]).min(axis=1)), {}


def _per_camera(values: Array) -> Array:
    return values.reshape(-1, _ILLUMINATIONS).mean(axis=1)


def _over_cameras(cameras: Array, first: Array, seed: int) -> dict[str, object]:
    """Summarise the RMSE of the cameras, and how far its mean lies from that of the table's first row."""
    low, high = bootstrap_bounds(cameras, seed)["mean"]
    nearest, farthest = bootstrap_bounds(cameras - first, seed)["mean"]
    return {
        **summarise(cameras),
        "low": low,
        "high": high,
        "difference": float((cameras - first).mean()),
        "difference_low": nearest,
        "difference_high": farthest,
        "beyond_0.005": nearest > SIGNIFICANT_RMSE or farthest < -SIGNIFICANT_RMSE,
    }


def _beside_paper(case: dict[str, str], ours: dict[str, object], recorded: pd.DataFrame) -> dict[str, object]:
    """Return the paper's figures of a row, our mean by its method, and where that is comparable the verdict on it."""
    same = recorded.query("model == @case['model'] and patches == @case['patches']")
    found: dict[str, object] = {"verdict": "not comparable"}
    if case["model"] in CALIBRATION:
        printed = dict(zip(CALIBRATION_COLUMNS, CALIBRATION[case["model"]], strict=True))
        found |= {"paper_mean": printed["mean"], "paper_seconds": printed["seconds"]}
    if case["channel"] != "intensity" or case["method"] in ("floor", "none"):
        return found
    if case["method"] != "paper":
        return found | {"by_paper": same["mean"].mean(), "verdict": (*same["verdict"], found["verdict"])[0]}
    mean, low, high = (float(str(ours[name])) for name in ("mean", "low", "high"))
    found["by_paper"] = mean
    if "paper_mean" in found and case["patches"] == "3":
        found["verdict"] = verdict(mean, f"{printed['mean']:.3f}", (low, high), SIGNIFICANT_RMSE)
    return found


def _subsets(patches: str, seed: int) -> list[np.ndarray]:
    """Return the sets of patches, from 0, that a camera is calibrated with."""
    check_choice("patches", patches, ("3", "24", "random"))
    rng = np.random.default_rng(seed)
    return {
        "3": [np.array(THREE_GREYS) - 1],
        "24": [np.arange(N_PATCHES)],
        "random": [rng.choice(N_PATCHES, 3, replace=False) for _ in range(_RANDOM_TRIPLES)],
    }[patches]


CHART_FREE_COLUMNS = (
    "model", "method", "mean", "median", "max", "below_debevec", "below_robertson", "below_both", "monotone", "failed",
    "seconds",
)  # fmt: skip
STEPS: Array = np.arange(len(EXPOSURES), dtype=float)

_LEVELS = 256
_SIDE = 8  # pixels of a patch in the pictures made for OpenCV, along each side


def chart_free_table(method: str = "posterior", discrepancy: bool = True, progress: bool = False) -> pd.DataFrame:
    """Calibrate 14 cameras from four exposures of 24 unknown patches, each illumination by itself.

    Parameters
    ----------
    method : {"map", "posterior"}
        Of `crfbench.calibrate`.
    discrepancy : bool
        Whether it allows for what the model misses.
    progress : bool
        Whether to show a bar with the time left.

    Returns
    -------
    DataFrame
        One row a model, then OpenCV's, with the columns `CHART_FREE_COLUMNS`. RMSE is against the mean of RAW of the
        other light: each channel is decoded, then they are averaged, with the one scale that fits best, since exposures
        alone tell no scale; means over both illuminations of a camera. ``below_...`` count the cameras with an RMSE at
        or below OpenCV's, one that failed counting as beaten; ``monotone`` is the share of monotone curves,
        ``failed`` that of calibrations without a finite result.
        Ours are the nearest monotone curves to what the model decodes. OpenCV gets red, green and blue of all patches
        as grey pixels, which serves it better than intensities do, and its results are interpolated between the levels
        that occur.
    """
    check_choice("method", method, ("map", "posterior"))
    chart = patch_arrays(load_patches())
    shown = tqdm(ROWS, desc="models", disable=not progress, **BAR)
    found = [(name, method, *_timed(partial(chart_free_curves, chart, name, method, discrepancy))) for name in shown]
    rivals = {name: _timed(partial(opencv_curves, chart, name)) for name in ("Debevec", "Robertson")}
    found += [(f"OpenCV {name}", "opencv", *timed) for name, timed in rivals.items()]
    theirs = {name: _camera_rmse(curves, chart) for name, (curves, _) in rivals.items()}
    rows = [
        {"model": name, "method": how, **_beside_opencv(curves, chart, theirs), "seconds": seconds}
        for name, how, curves, seconds in found
    ]
    return pd.DataFrame(rows, columns=list(CHART_FREE_COLUMNS))


def chart_free_curves(chart: PatchArrays, model: str, method: str = "posterior", discrepancy: bool = True) -> Array:
    """Return the inverse responses (28, 1024) of every camera and illumination, from exposure steps alone."""
    rgb, clipped = chart.sets()
    observations = Observations.from_rgb(rgb, None, exposures=STEPS, clipped=clipped)
    return repair(calibrate(load_model(model), observations, method, discrepancy=discrepancy).curves)


def opencv_curves(chart: PatchArrays, name: str) -> Array:
    """Return what OpenCV makes of the same patches, on the grid, shape (28, 1024); NaN where it fails.

    "Debevec": Debevec and Malik 1997, doi:10.1145/258734.258884. "Robertson": Robertson, Borman and Stevenson 2003,
    doi:10.1117/1.1557695.
    """
    levels = np.rint(chart.jpeg.reshape(-1, len(EXPOSURES), chart.jpeg[0, 0, 0].size) * (_LEVELS - 1)).astype(np.uint8)
    return np.array([_opencv_curve(pictures, name) for pictures in levels])


def _opencv_curve(levels: np.ndarray, name: str) -> Array:
    """Calibrate one camera from levels (e, pixels)."""
    import cv2

    pictures = [cv2.merge([np.kron(row.reshape(6, -1), np.ones((_SIDE, _SIDE), np.uint8))] * 3) for row in levels]
    calibrator = cv2.createCalibrateDebevec() if name == "Debevec" else cv2.createCalibrateRobertson()
    response = calibrator.process(pictures, (2.0**STEPS).astype(np.float32))[:, 0, 0]
    told = np.isfinite(response) & (response > 0)
    if name == "Robertson":  # it keeps its first guess for levels that never occur
        told[np.setdiff1d(np.arange(_LEVELS), levels)] = False
    if told.sum() < 2:
        return np.full(GRID.shape, np.nan)
    at = np.flatnonzero(told) / (_LEVELS - 1)
    return np.asarray(np.interp(GRID, np.append(0.0, at), np.append(0.0, response[told])))


def _timed(run: Callable[[], Array]) -> tuple[Array, float]:
    began = time.perf_counter()
    curves = run()
    return curves, time.perf_counter() - began


def _camera_rmse(curves: Array, chart: PatchArrays) -> Array:
    """Return the RMSE of each camera, both illuminations averaged; NaN where both failed."""
    both = held_out_rmse(curves, chart, np.arange(len(curves)))[3].reshape(-1, _ILLUMINATIONS)
    known = np.isfinite(both)
    return np.where(known, both, 0.0).sum(axis=1) / np.where(known.any(axis=1), known.sum(axis=1), np.nan)


def _scaled(decoded: Array, raw: Array) -> Array:
    """Scale rows of irradiance to where they fit best."""
    return ((decoded * raw).sum(axis=1) / (decoded**2).sum(axis=1))[:, None] * decoded


def _beside_opencv(curves: Array, chart: PatchArrays, rivals: dict[str, Array]) -> dict[str, float]:
    cameras, finite = _camera_rmse(curves, chart), np.isfinite(curves).all(axis=1)
    debevec, robertson = ((cameras <= rival) | np.isnan(rival) for rival in rivals.values())
    return {
        "mean": float(np.nanmean(cameras)),
        "median": float(np.nanmedian(cameras)),
        "max": float(np.nanmax(cameras)),
        "below_debevec": int(debevec.sum()),
        "below_robertson": int(robertson.sum()),
        "below_both": int((debevec & robertson).sum()),
        "monotone": float(1.0 - nonmonotone(curves[finite]).mean()),
        "failed": float(1.0 - finite.mean()),
    }
