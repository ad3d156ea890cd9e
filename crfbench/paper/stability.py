"""The paper's Table 2 and more: how much the inverse response moves when a camera is calibrated with fewer patches."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from crfbench.calibration import METHODS, Observations, calibrate
from crfbench.checks import check_choice, check_count, check_seed
from crfbench.curves import Array
from crfbench.datasets import load_patches
from crfbench.datasets.middlebury import N_PATCHES, PATCH_ORDER, REFERENCE_IRRADIANCE, PatchArrays, patch_arrays
from crfbench.metrics import total_variance
from crfbench.models import load_model
from crfbench.paper.printed import STABILITY
from crfbench.paper.verdicts import verdict

COLUMNS = ("model", "method", "camera", "subsets", "total_variance", "median", "paper", "verdict")
SIZES = (3, 6, 12, 24)
CAMERA = "CanonPowerShotG9"
#: The paper's four, then ours.
ROWS = (*STABILITY, "SLR-baseline-1", "SLR-monotone-1", "SLR-ldl-3", "Gamma-1")
DEFINITION = (
    "total variance: the variance of four inverse responses (divided by 4), from 3, 6, 12 and 24 patches of all eight "
    f"photographs, summed over 1024 samples; stated subsets take patches in the order "
    f"{', '.join(map(str, PATCH_ORDER))}; "
    "random subsets are nested too, each for one of the cameras in turn, patches that a camera always clips last"
)


def stability_table(
    camera: str = CAMERA, random_subsets: int = 200, rows: Sequence[str] = ROWS, seed: int = 0
) -> pd.DataFrame:
    """Calibrate with nested subsets of the patches and measure how far the curves lie apart.

    Parameters
    ----------
    camera : str
        Shown by itself; the paper's is "CanonPowerShotG9".
    random_subsets : int
        How many random nested subsets, spread over all cameras; 0 leaves them out.
    rows : sequence of str
        Inverse models.
    seed : int
        Of the subsets and of the random starts.

    Returns
    -------
    DataFrame
        With the columns of `COLUMNS`, for each model and the methods "paper", "map" and "posterior": ``camera`` is its
        name or "all", the mean over all; ``subsets`` is "stated" or "<n> random"; ``total_variance`` is the mean and
        ``median`` the median over cameras or subsets. See `DEFINITION`. The paper's method is run for the one camera
        only.
    """
    chart = patch_arrays(load_patches())
    check_choice("camera", camera, chart.cameras)
    check_count("random_subsets", random_subsets, least=0)
    rng = np.random.default_rng(check_seed(seed))
    every = list(range(len(chart.cameras)))
    cases = [
        (camera, "stated", _stated(chart, [chart.cameras.index(camera)]), ("paper", "map", "posterior")),
        ("all", "stated", _stated(chart, every), ("map", "posterior")),
    ]
    if random_subsets:
        turns = [index % len(every) for index in range(random_subsets)]
        drawn = np.array([_drawn(chart.clipped[index], rng) for index in turns])
        cases.append(("all", f"{random_subsets} random", _nested(chart, turns, drawn), ("map",)))
    found = [
        _row(name, method, (whose, subsets), _variances(name, observations, method, seed))
        for whose, subsets, observations, methods in cases
        for name in rows
        for method in methods
    ]
    return pd.DataFrame(found, columns=list(COLUMNS))


def stability_curves(camera: str, model: str, method: str, seed: int = 0) -> Array:
    """Return the inverse responses (4, 1024) of a camera from 3, 6, 12 and 24 patches: the paper's figure."""
    chart = patch_arrays(load_patches())
    check_choice("camera", camera, chart.cameras)
    check_choice("method", method, METHODS)
    return calibrate(
        load_model(model), _stated(chart, [chart.cameras.index(camera)]), method, discrepancy=False, seed=seed
    ).curves


def _stated(chart: PatchArrays, cameras: list[int]) -> Observations:
    return _nested(chart, cameras, np.tile(np.array(PATCH_ORDER) - 1, (len(cameras), 1)))


def _drawn(clipped: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Shuffle the patches of a camera; those that are clipped in all its photographs come last."""
    order = rng.permutation(N_PATCHES)
    never = np.asarray(clipped.all(axis=(0, 1)))
    return order[np.argsort(never[order], kind="stable")]


def _nested(chart: PatchArrays, cameras: list[int], orders: np.ndarray) -> Observations:
    """Observe each camera with the first 3, 6, 12 and 24 patches of its order (n, 24): 4 n sets."""
    rank = np.argsort(orders, axis=1)
    weights = (rank[:, None] < np.array(SIZES)[:, None]).reshape(-1, 1, N_PATCHES).astype(float)
    picked = np.repeat(cameras, len(SIZES))
    shape = (len(picked), -1, N_PATCHES)
    return Observations.from_rgb(
        chart.jpeg[picked].reshape(*shape, 3),
        REFERENCE_IRRADIANCE,
        clipped=chart.clipped[picked].reshape(shape),
        weights=weights,
    )


def _variances(name: str, observations: Observations, method: str, seed: int) -> list[float]:
    curves = calibrate(load_model(name), observations, method, discrepancy=False, seed=seed).curves
    return [total_variance(four) for four in curves.reshape(-1, len(SIZES), curves.shape[-1])]


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
