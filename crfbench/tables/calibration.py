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
from crfbench.datasets.middlebury import N_PATCHES, REFERENCE_IRRADIANCE, PatchArrays, patch_arrays
from crfbench.errors import InputError
from crfbench.metrics import rmse, statistics, summarise
from crfbench.models import ResponseModel, load_model
from crfbench.paper import CALIBRATION, CALIBRATION_COLUMNS, SIGNIFICANT_RMSE

COLUMNS = (
    "model", "constraint", "n_params", "method", "patches", "channel", "mean", "median", "sd", "max", "p95", "low",
    "high", "difference", "difference_low", "difference_high", "beyond_0.005", "coverage", "seconds", "paper_mean",
    "paper_seconds", "verdict",
)  # fmt: skip
#: Model, constraint, number of parameters, in the paper's order, then those it lacks.
ROWS = (*CALIBRATION, ("SLR", "monotone", 1), ("SLR", "monotone", 3), ("PPISP", "", 4))
#: Numbers of the patches (from 1) used with "3": white, a middle and the black grey.
THREE_GREYS = (19, 21, 24)
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
    rows: Sequence[tuple[str, str, int]] = ROWS,
    frame: pd.DataFrame | None = None,
    seed: int = 0,
) -> pd.DataFrame:
    """Calibrate every camera on one illumination, test on the other, both ways, with every model.

    Parameters
    ----------
    patches : {"3", "24", "random"}
        "3": patches 19, 21 and 24 of the grey row; "24": all; "random": ten random triples, the RMSE averaged.
    method : str
        Of `crfbench.calibration.calibrate`, but for "grid": "lm" does the same where there is one parameter.
    channel : {"intensity", "r", "g", "b"}
        The mean of red, green and blue as in the paper, or one of them.
    rows : sequence of (model, constraint, number of parameters)
    frame : DataFrame, optional
        A patch table; default the shipped one.
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
        "differs"; "not comparable" unless method and patches are the paper's. Rows named "floor" use the test data
        themselves: no calibration gets below them.

    Raises
    ------
    InputError
        For patches, a method or a channel that are not known.
    """
    methods = [name for name in METHODS if name != "grid"]
    if method not in methods:
        raise InputError(f"method={method!r} is not for tables; use one of {', '.join(methods)}")
    check_choice("channel", channel, CHANNELS)
    check_seed(seed)
    chart = patch_arrays(load_patches() if frame is None else frame)
    subsets = _subsets(patches, seed)
    results = [_calibrated(row, chart, subsets, (method, channel, seed)) for row in rows]
    listed = [(row, method, *result) for row, result in zip(rows, results, strict=True)]
    listed += [((name, "", 0), "floor", cameras, np.nan, np.nan) for name, cameras in _floors(chart, channel)]
    first = results[0][0]
    return pd.DataFrame(
        [_row(entry, (patches, channel), first, seed) for entry in listed],
        columns=list(COLUMNS),
    )


def camera_rmse_table(
    patches: str = "3", method: str = "map", rows: Sequence[tuple[str, str, int]] = ROWS
) -> pd.DataFrame:
    """Return the RMSE of every camera (rows) with every model (columns), as `calibration_table` summarises it."""
    chart, subsets = patch_arrays(load_patches()), _subsets(patches, 0)
    found = {
        " ".join(map(str, filter(None, row))): _calibrated(row, chart, subsets, (method, "intensity", 0))[0]
        for row in rows
    }
    floors = dict(list(_floors(chart, "intensity"))[:1])
    return pd.DataFrame({**found, **floors}, index=pd.Index(chart.cameras, name="camera"))


def table_model(row: tuple[str, str, int]) -> ResponseModel:
    """Load the inverse model of a table's row: model, constraint, number of parameters."""
    family, constraint, k = row
    return load_model(f"{family}-{constraint}" if constraint else family, k, "inverse")


def held_out_rmse(curves: Array, jpeg: Array, raw: Array) -> Array:
    """Return the RMSE of inverse responses against RAW, without alignment.

    Parameters
    ----------
    curves : ndarray, shape (n, 1024)
    jpeg, raw : ndarray, shape (n, m)
        Brightness and irradiance of the same patches.

    Returns
    -------
    ndarray, shape (n,)
    """
    return rmse(evaluate(curves, jpeg), raw)


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
        error = np.hypot(REFERENCE_ERROR, _COLOUR_SLOPE * colour_spread(rgb))
        observations = Observations(rgb[..., which], REFERENCE_IRRADIANCE, clipped=clipped, reference_error=error)
    jpeg, raw = (_swapped(array.reshape(len(rgb), -1)) for array in (jpeg, raw))
    return observations, jpeg, raw


def _swapped(sets: Array) -> Array:
    """Exchange the two illuminations of every camera, along the first axis of sets (2 c, ...)."""
    return sets.reshape(-1, _ILLUMINATIONS, *sets.shape[1:])[:, ::-1].reshape(sets.shape)


def coverage(result: Calibration, observations: Observations, jpeg: Array, raw: Array) -> float:
    """Return the share of held-out measurements inside the 90 % band, widened by their own noise.

    That noise is the stated one, or what the calibration found where it found more.

    Parameters
    ----------
    result : Calibration
        By "posterior", of both illuminations of every camera.
    observations : Observations
        Of all patches, from `chart_observations`; the sets of one camera are held out for each other.
    jpeg, raw : ndarray, shape (n, m)
    """
    scale = np.maximum(1.0 if result.noise_scale is None else result.noise_scale, 1.0)
    chart_error = _swapped(np.broadcast_to(observations.reference_error[:, None], observations.brightness.shape))
    error = np.reshape(scale, (-1, 1)) * np.hypot(Noise().relative(jpeg), chart_error.reshape(len(jpeg), -1))
    middle = np.maximum(evaluate(result.curves, jpeg), DARKEST)
    below, above = (np.log(np.maximum(evaluate(end, jpeg), DARKEST) / middle) for end in result.bands[0.9])
    off = np.log(np.maximum(raw, DARKEST) / middle)
    return float(((off >= -np.hypot(below, _Z90 * error)) & (off <= np.hypot(above, _Z90 * error))).mean())


def bootstrap_means(values: Array, seed: int = 0) -> Array:
    """Return the means of resampled cameras, shape (2000,), the same resamples for the same seed: pairs stay pairs."""
    return np.asarray(_resampled(values, seed).mean(axis=1))


def bootstrap_bounds(values: Array, seed: int = 0) -> dict[str, tuple[float, float]]:
    """Return the 95 % bounds of each statistic of `crfbench.metrics.summarise`, over resampled cameras."""
    bounds = {name: np.percentile(drawn, (2.5, 97.5)) for name, drawn in statistics(_resampled(values, seed)).items()}
    return {name: (float(low), float(high)) for name, (low, high) in bounds.items()}


def _resampled(values: Array, seed: int) -> Array:
    n = values.shape[-1]
    return np.asarray(values[np.random.default_rng(seed).integers(n, size=(_RESAMPLES, n))])


def camera_rmse(result: Calibration, jpeg: Array, raw: Array) -> Array:
    """Return the RMSE of each camera, averaged over both ways (and over subsets), shape (c,)."""
    each = held_out_rmse(result.curves, jpeg, raw)
    return each.reshape(-1, len(jpeg) // _ILLUMINATIONS, _ILLUMINATIONS).mean(axis=(0, 2))


def _calibrated(
    row: tuple[str, str, int], chart: PatchArrays, subsets: list[np.ndarray], how: tuple[str, str, int]
) -> tuple[Array, float, float]:
    """Return the RMSE of each camera, the coverage of the bands and the seconds of one row of the table."""
    method, channel, seed = how
    model = table_model(row)
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


def _row(
    entry: tuple[tuple[str, str, int], str, Array, float, float], where: tuple[str, str], first: Array, seed: int
) -> dict[str, object]:
    key, method, cameras, covered, seconds = entry
    low, high = np.percentile(bootstrap_means(cameras, seed), (2.5, 97.5))
    apart = np.percentile(bootstrap_means(cameras - first, seed), (2.5, 97.5))
    figures = dict(zip(CALIBRATION_COLUMNS, CALIBRATION[key], strict=True)) if key in CALIBRATION else {}
    statistics = summarise(cameras)
    return {
        **dict(zip(("model", "constraint", "n_params"), key, strict=True)),
        **dict(zip(("patches", "channel"), where, strict=True)),
        "method": method,
        **statistics,
        "low": low,
        "high": high,
        "difference": float((cameras - first).mean()),
        "difference_low": apart[0],
        "difference_high": apart[1],
        "beyond_0.005": bool(apart[0] > SIGNIFICANT_RMSE or apart[1] < -SIGNIFICANT_RMSE),
        "coverage": covered,
        "seconds": seconds,
        "paper_mean": figures.get("mean"),
        "paper_seconds": figures.get("seconds"),
        "verdict": _verdict(statistics["mean"], (low, high), figures.get("mean"), (method, *where)),
    }


def _verdict(mean: float, bounds: tuple[float, float], printed: float | None, case: tuple[str, str, str]) -> str:
    if printed is None or case != ("paper", "3", "intensity"):
        return "not comparable"
    near = abs(mean - printed) <= SIGNIFICANT_RMSE or bounds[0] <= printed <= bounds[1]
    return "reproduced" if near else "differs"


def _subsets(patches: str, seed: int) -> list[np.ndarray]:
    if patches == "3":
        return [np.array(THREE_GREYS) - 1]
    if patches == "24":
        return [np.arange(N_PATCHES)]
    if patches == "random":
        rng = np.random.default_rng(seed)
        return [rng.choice(N_PATCHES, 3, replace=False) for _ in range(_RANDOM_TRIPLES)]
    raise InputError(f"patches={patches!r} is not known; use 3, 24 or random")
