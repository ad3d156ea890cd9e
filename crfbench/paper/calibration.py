"""The paper's Table 3 and more: 14 cameras calibrated from a colour chart, tested on the other illumination."""

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd
from scipy.optimize import isotonic_regression

from crfbench.calibration import METHODS, Calibration, Noise, Observations, calibrate
from crfbench.calibration.likelihood import DARKEST
from crfbench.calibration.observations import REFERENCE_ERROR, colour_spread
from crfbench.checks import check_choice, check_seed
from crfbench.curves import Array, evaluate
from crfbench.datasets import load_patches, load_responses, registry
from crfbench.datasets.middlebury import N_PATCHES, REFERENCE_IRRADIANCE, THREE_GREYS, PatchArrays, patch_arrays
from crfbench.metrics import rmse, statistics, summarise
from crfbench.models import load_model
from crfbench.models.registry import ModelKey
from crfbench.paper.printed import CALIBRATION, CALIBRATION_COLUMNS, SIGNIFICANT_RMSE

COLUMNS = (
    "model", "method", "patches", "channel", "mean", "median", "sd", "max", "p95", "low", "high", "difference",
    "difference_low", "difference_high", "beyond_0.005", "coverage", "seconds", "paper_mean", "paper_seconds",
    "verdict",
)  # fmt: skip
#: The models in the paper's order, then those it lacks.
ROWS = (*CALIBRATION, "SLR-monotone-1", "SLR-monotone-3", "PPISP-4")
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
    seed: int = 0,
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
    seed : int
        Of the triples, of the random starts and of the bootstrap.

    Returns
    -------
    DataFrame
        With the columns of `COLUMNS`. A camera's RMSE is that of decoded against RAW irradiance over the 4 x 24
        patches of the illumination it was not calibrated on, without alignment, averaged over both ways. ``mean``
        to ``p95`` are over cameras; ``low`` and ``high`` bound the mean (95 %, bootstrap over cameras).
        ``difference`` is the mean less that of the first row, with its paired 95 % bounds; ``beyond_0.005`` says
        whether they lie wholly beyond what the paper calls significant. ``coverage`` is the share of held-out RAW
        inside the 90 % band for measurements ("posterior"). ``seconds`` is for all calibrations of the row.
        ``verdict``: "reproduced" when the paper's mean lies within 0.005 of ours or inside its bounds, else
        "differs"; "not comparable" unless method and patches are the paper's. Rows with the method "floor" are fitted
        to the test data themselves: no calibration gets below them.
    """
    check_choice("method", method, [name for name in METHODS if name != "grid"])
    check_choice("channel", channel, CHANNELS)
    chart, subsets = patch_arrays(load_patches()), _subsets(patches, check_seed(seed))
    found = [(name, method, *_calibrated(name, chart, subsets, (method, channel, seed))) for name in map(str, rows)]
    found += [(name, "floor", cameras, np.nan, np.nan) for name, cameras in _floors(chart, channel)]
    first, table = found[0][2], []
    for name, how, cameras, covered, seconds in found:
        case = {"model": name, "method": how, "patches": patches, "channel": channel}
        measured = {**_over_cameras(cameras, first, seed), "coverage": covered, "seconds": seconds}
        table.append({**case, **measured, **_beside_paper(case, measured)})
    return pd.DataFrame(table, columns=list(COLUMNS))


def camera_rmse_table(patches: str = "3", method: str = "map", rows: Sequence[str | ModelKey] = ROWS) -> pd.DataFrame:
    """Return the RMSE of every camera (rows) with every model (columns), as `calibration_table` summarises it."""
    chart, subsets = patch_arrays(load_patches()), _subsets(patches, 0)
    found = {name: _calibrated(name, chart, subsets, (method, "intensity", 0))[0] for name in map(str, rows)}
    floor, cameras = next(_floors(chart, "intensity"))
    return pd.DataFrame({**found, floor: cameras}, index=pd.Index(chart.cameras, name="camera"))


def chart_observations(chart: PatchArrays, channel: str = "intensity") -> tuple[Observations, Array, Array]:
    """Return what is calibrated on and tested on, both illuminations of every camera.

    Returns
    -------
    observations : Observations
        28 sets: camera by camera, illumination 1 and 2.
    jpeg, raw : ndarray, shape (28, 96)
        Of the other illumination.
    """
    rgb = chart.jpeg.reshape(-1, *chart.jpeg.shape[2:])
    clipped = chart.clipped.reshape(-1, *chart.clipped.shape[2:])
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
    """Return the RMSE of each camera, averaged over both ways (and over subsets), shape (c,)."""
    each = rmse(evaluate(result.curves, jpeg), raw)
    return each.reshape(-1, len(jpeg) // _ILLUMINATIONS, _ILLUMINATIONS).mean(axis=(0, 2))


def coverage(result: Calibration, observations: Observations, jpeg: Array, raw: Array) -> float:
    """Return the share of held-out measurements inside the 90 % band, widened by their own noise.

    Parameters
    ----------
    result : Calibration
        By "posterior", of both illuminations of every camera.
    observations : Observations
        Of all patches, from `chart_observations`; the sets of one camera are held out for each other.
    jpeg, raw : ndarray, shape (n, m)
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
    """Return the 95 % bounds of each statistic of `crfbench.metrics.summarise`, over resampled cameras.

    Parameters
    ----------
    values : ndarray, shape (c,)
        One of each camera. The same seed draws the same cameras, so that differences stay paired.
    seed : int
    """
    picked = np.random.default_rng(seed).integers(len(values), size=(_RESAMPLES, len(values)))
    bounds = {name: np.percentile(drawn, (2.5, 97.5)) for name, drawn in statistics(values[picked]).items()}
    return {name: (float(low), float(high)) for name, (low, high) in bounds.items()}


def _calibrated(
    name: str, chart: PatchArrays, subsets: list[np.ndarray], how: tuple[str, str, int]
) -> tuple[Array, float, float]:
    """Return the RMSE of each camera, the coverage of the bands and the seconds of one row of the table."""
    method, channel, seed = how
    model = load_model(name)
    observations, jpeg, raw = chart_observations(chart, channel)
    results = [calibrate(model, observations.take(subset), method, seed=seed) for subset in subsets]
    cameras = np.mean([camera_rmse(result, jpeg, raw) for result in results], axis=0)
    covered = [coverage(result, observations, jpeg, raw) for result in results if result.bands]
    return cameras, float(np.mean(covered)) if covered else np.nan, sum(result.seconds for result in results)


def _floors(chart: PatchArrays, channel: str) -> Iterator[tuple[str, Array]]:
    """Yield what no calibration gets below: fits of the test data themselves, and the RMSE of each camera."""
    _, jpeg, raw = chart_observations(chart, channel)
    order = np.argsort(jpeg, axis=1, kind="stable")
    rising = np.array([isotonic_regression(r[o]).x - r[o] for r, o in zip(raw, order, strict=True)])
    yield "best monotone curve", _per_camera(rmse(rising, 0.0))
    for name in ("dorf", "opencrf") if registry.find("dorf/201_CRF_data.mat") else ("opencrf",):
        responses = load_responses(name)
        decoded = evaluate(responses.in_direction("inverse")[None], jpeg[:, None])
        yield f"nearest {responses.dataset} curve", _per_camera(rmse(decoded, raw[:, None]).min(axis=1))


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


def _beside_paper(case: dict[str, str], ours: dict[str, object]) -> dict[str, object]:
    """Return the paper's figures of a row and, where method and patches are the paper's, the verdict on our mean."""
    if case["model"] not in CALIBRATION:
        return {"verdict": "not comparable"}
    printed = dict(zip(CALIBRATION_COLUMNS, CALIBRATION[case["model"]], strict=True))
    mean, low, high = (float(str(ours[name])) for name in ("mean", "low", "high"))
    verdict = "not comparable"
    if (case["method"], case["patches"], case["channel"]) == ("paper", "3", "intensity"):
        near = abs(mean - printed["mean"]) <= SIGNIFICANT_RMSE or low <= printed["mean"] <= high
        verdict = "reproduced" if near else "differs"
    return {"paper_mean": printed["mean"], "paper_seconds": printed["seconds"], "verdict": verdict}


def _subsets(patches: str, seed: int) -> list[np.ndarray]:
    """Return the sets of patches, from 0, that a camera is calibrated with."""
    check_choice("patches", patches, ("3", "24", "random"))
    rng = np.random.default_rng(seed)
    return {
        "3": [np.array(THREE_GREYS) - 1],
        "24": [np.arange(N_PATCHES)],
        "random": [rng.choice(N_PATCHES, 3, replace=False) for _ in range(_RANDOM_TRIPLES)],
    }[patches]
