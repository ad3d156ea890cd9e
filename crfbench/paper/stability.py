"""The paper's Table 2 and more: how much the inverse response moves when a camera is calibrated with fewer patches."""

from collections.abc import Sequence
from functools import cache, partial

import numpy as np
import pandas as pd
from tqdm.auto import tqdm

from crfbench.calibration import METHODS, Observations, calibrate
from crfbench.checks import check_choice, check_count, check_seed
from crfbench.curves import N_SAMPLES, Array
from crfbench.datasets import load_patches
from crfbench.datasets.chart import N_PATCHES
from crfbench.datasets.middlebury import PATCH_ORDER, REFERENCE_IRRADIANCE, PatchArrays, patch_arrays
from crfbench.metrics import total_variance
from crfbench.models import load_model
from crfbench.models.registry import DEFAULT_MODEL
from crfbench.paper.calibration import held_out_rmse
from crfbench.paper.results import BAR
from crfbench.paper.verdicts import STABILITY, verdict

COLUMNS = (
    "model", "method", "camera", "subsets", "total_variance", "median", "rmse", "rmse_scaled",
    "paper", "verdict",
)  # fmt: skip
SIZES = (3, 6, 12, 24)
CAMERA = "CanonPowerShotG9"
ROWS = (*STABILITY, "SLR-baseline-1", "SLR-monotone-1", "SLR-ldl-3", "Gamma-1", DEFAULT_MODEL)
DEFINITION = (
    "total variance: the variance of inverse responses, summed over 1024 samples. Stated subsets: four curves of a "
    "camera, from 3, 6, 12 and 24 patches of all eight photographs, patches in the order "
    f"{', '.join(map(str, PATCH_ORDER))}. "
    "Random triples: curves from three patches under one light, each of one camera and light in turn, variance among "
    "those of the same; their expected RMSE is to RAW under the other light (a stable wrong curve is worth nothing)"
)


def stability_table(
    camera: str = CAMERA,
    triples: int = 200,
    rows: Sequence[str] = ROWS,
    discrepancy: bool = True,
    seed: int = 0,
    progress: bool = False,
) -> pd.DataFrame:
    """Calibrate with subsets of the patches and measure how far the curves lie apart, and how far from the truth.

    Parameters
    ----------
    camera : str
        Shown by itself; the paper's is "CanonPowerShotG9".
    triples : int
        How many random triples, spread over all cameras and lights; with 0, no other camera is calibrated at all.
    rows : sequence of str
        Inverse models.
    discrepancy : bool
        Whether "map" and "posterior" allow for what the model misses; the paper's method never does.
    seed : int
        Of the triples and of the random starts.
    progress : bool
        Whether to show a bar with the time left.

    Returns
    -------
    DataFrame
        With the columns of `COLUMNS`, for each model and the methods "paper", "map" and "posterior": ``camera`` is its
        name or "all", the mean over all; ``subsets`` is "stated" or "triples"; ``total_variance`` is the mean and
        ``median`` the median over cameras and lights. See `DEFINITION`; ``rmse`` and the same up to scale are
        those of triples. The paper's method is run for the one camera only.
    """
    chart = patch_arrays(load_patches())
    check_choice("camera", camera, chart.cameras)
    check_count("triples", triples, least=0)
    everyone = _stated(chart, list(range(len(chart.cameras))))
    turns, drawn = _triples(chart, max(triples, 1), check_seed(seed))
    found = []
    for name in tqdm(rows, desc="models", disable=not progress, **BAR):
        model = load_model(name)
        fitted = partial(calibrate, model, discrepancy=discrepancy, seed=seed)
        for method in ("paper", "map", "posterior"):
            curves = _stated_curves(camera, name, method, discrepancy, seed)
            found.append(_row(name, method, (camera, "stated"), [total_variance(curves)]))
        for method in ("map", "posterior") if triples else ():
            fours = fitted(everyone, method).curves.reshape(-1, len(SIZES), N_SAMPLES)
            found.append(_row(name, method, ("all", "stated"), [total_variance(four) for four in fours]))
        for method in ("map", "posterior") if triples else ():
            curves = fitted(drawn, method).curves
            apart = [total_variance(curves[turns == one]) for one in np.unique(turns)]
            far = held_out_rmse(curves, chart, turns).mean(axis=1)
            row = _row(name, method, ("all", "triples"), apart)
            found.append(row | {"rmse": far[0], "rmse_scaled": far[1]})
    return pd.DataFrame(found, columns=list(COLUMNS))


def stability_curves(camera: str, model: str, method: str, discrepancy: bool = True, seed: int = 0) -> Array:
    """Return the inverse responses (4, 1024) of a camera from 3, 6, 12 and 24 patches: the paper's figure."""
    chart = patch_arrays(load_patches())
    check_choice("camera", camera, chart.cameras)
    check_choice("method", method, METHODS)
    return _stated_curves(camera, model, method, discrepancy, seed).copy()


@cache  # figure and table show the same curves, which take the paper's method seconds
def _stated_curves(camera: str, model: str, method: str, discrepancy: bool, seed: int) -> Array:
    chart = patch_arrays(load_patches())
    seen = _stated(chart, [chart.cameras.index(camera)])
    return calibrate(load_model(model), seen, method, discrepancy=discrepancy, seed=seed).curves


def _stated(chart: PatchArrays, cameras: list[int]) -> Observations:
    """Observe each camera with the first 3, 6, 12 and 24 patches of `PATCH_ORDER`: 4 n sets."""
    used = np.argsort(PATCH_ORDER) < np.array(SIZES)[:, None]
    picked = np.repeat(cameras, len(SIZES))
    shape = (len(picked), -1, N_PATCHES)
    return Observations.from_rgb(
        chart.jpeg[picked].reshape(*shape, 3),
        REFERENCE_IRRADIANCE,
        clipped=chart.clipped[picked].reshape(shape),
        weights=np.tile(used[:, None], (len(cameras), 1, 1)).astype(float),
    )


def _triples(chart: PatchArrays, n: int, seed: int) -> tuple[np.ndarray, Observations]:
    """Draw three patches for each of the 28 cameras and lights in turn; return the sets (n,) and what is seen.

    Patches that are clipped in all four photographs are not drawn.
    """
    rng = np.random.default_rng(seed)
    turns = np.arange(n) % (2 * len(chart.cameras))
    rgb, clipped = (part[turns] for part in chart.sets())
    rank = np.argsort(np.argsort(rng.random((n, N_PATCHES)) + clipped.all(axis=1), axis=1), axis=1)
    weights = (rank[:, None] < SIZES[0]).astype(float)
    return turns, Observations.from_rgb(rgb, REFERENCE_IRRADIANCE, clipped=clipped, weights=weights)


def _row(name: str, method: str, where: tuple[str, str], variances: list[float]) -> dict[str, object]:
    comparable = (*where, method) == (CAMERA, "stated", "paper")
    printed, mean = STABILITY.get(name) if comparable else None, float(np.mean(variances))
    return {
        "model": name,
        "method": method,
        **dict(zip(("camera", "subsets"), where, strict=True)),
        "total_variance": mean,
        "median": float(np.median(variances)),
        "paper": printed,
        "verdict": verdict(mean, f"{printed:.2f}" if printed else None),
    }
