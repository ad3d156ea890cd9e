"""The paper's Table 2 and more: how much the inverse response moves when a camera is calibrated with fewer patches."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from crfbench.calibration import METHODS, Observations, calibrate
from crfbench.checks import check_choice, check_count, check_seed
from crfbench.curves import Array
from crfbench.datasets import load_patches
from crfbench.datasets.middlebury import N_PATCHES, REFERENCE_IRRADIANCE, PatchArrays, patch_arrays
from crfbench.errors import InputError
from crfbench.metrics import total_variance
from crfbench.paper import STABILITY, verdict
from crfbench.tables.calibration import table_model

COLUMNS = (
    "model", "constraint", "n_params", "method", "camera", "subsets", "total_variance", "median", "paper", "verdict",
)  # fmt: skip
SIZES = (3, 6, 12, 24)
#: The patches, from 1, in the order in which the stated subsets grow: the greys, then every other row by row.
ORDER = (19, 21, 24, 20, 22, 23, 2, 4, 7, 9, 14, 18, 1, 3, 5, 6, 8, 10, 11, 12, 13, 15, 16, 17)
CAMERA = "CanonPowerShotG9"
#: Model, constraint, number of parameters: the paper's four, then ours.
ROWS = (
    ("SLR", "ldl", 1),
    ("Polynomial", "", 3),
    ("GGCM", "", 3),
    ("EMoR", "", 3),
    ("SLR", "baseline", 1),
    ("SLR", "monotone", 1),
    ("SLR", "ldl", 3),
    ("Gamma", "", 1),
)
DEFINITION = (
    "total variance: the variance of four inverse responses (divided by 4), from 3, 6, 12 and 24 patches of all eight "
    f"photographs, summed over 1024 samples; stated subsets take patches in the order {', '.join(map(str, ORDER))}; "
    "random subsets are nested too, each for one of the cameras in turn, patches that a camera always clips last"
)


def stability_table(camera: str = CAMERA, random_subsets: int = 200, seed: int = 0) -> pd.DataFrame:
    """Calibrate with nested subsets of the patches and measure how far the curves lie apart.

    Parameters
    ----------
    camera : str
        Shown by itself; the paper's is "CanonPowerShotG9".
    random_subsets : int
        How many random nested subsets, spread over all cameras; 0 leaves them out.
    seed : int
        Of the subsets and of the random starts.

    Returns
    -------
    DataFrame
        With the columns of `COLUMNS`, for each model and the methods "paper", "map" and "posterior": ``camera`` is its
        name or "all", the mean over all; ``subsets`` is "stated" or "<n> random"; ``total_variance`` is the mean and
        ``median`` the median over cameras or subsets. See `DEFINITION`. The paper's method is run for the one camera
        only.

    Raises
    ------
    InputError
        For a camera that is not in the table.
    """
    chart = patch_arrays(load_patches())
    if camera not in chart.cameras:
        raise InputError(f"camera={camera!r} is not in the patch table; use one of {', '.join(chart.cameras)}")
    one, every = [chart.cameras.index(camera)], list(range(len(chart.cameras)))
    stated = np.array([patch - 1 for patch in ORDER])
    check_count("random_subsets", random_subsets, least=0)
    rng = np.random.default_rng(check_seed(seed))
    cases = [
        (camera, "stated", _nested(chart, one, stated[None]), ("paper", "map", "posterior")),
        ("all", "stated", _nested(chart, every, np.tile(stated, (len(every), 1))), ("map", "posterior")),
    ]
    if random_subsets:
        turns = [index % len(every) for index in range(random_subsets)]
        drawn = np.array([_drawn(chart.clipped[camera_index], rng) for camera_index in turns])
        cases.append(("all", f"{random_subsets} random", _nested(chart, turns, drawn), ("map",)))
    return pd.DataFrame([row for case in cases for row in _rows(case, seed)], columns=list(COLUMNS))


def stability_curves(camera: str, model: tuple[str, str, int], method: str, seed: int = 0) -> Array:
    """Return the inverse responses (4, 1024) of a camera from 3, 6, 12 and 24 patches: the paper's figure.

    Raises
    ------
    InputError
        For a camera or a method that is not known.
    """
    chart = patch_arrays(load_patches())
    if camera not in chart.cameras:
        raise InputError(f"camera={camera!r} is not in the patch table; use one of {', '.join(chart.cameras)}")
    check_choice("method", method, METHODS)
    order = np.array(ORDER)[None] - 1
    return calibrate(table_model(model), _nested(chart, [chart.cameras.index(camera)], order), method, seed=seed).curves


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


def _rows(case: tuple[str, str, Observations, tuple[str, ...]], seed: int) -> Iterator[dict[str, object]]:
    camera, subsets, observations, methods = case
    for row in ROWS:
        for method in methods:
            curves = calibrate(table_model(row), observations, method, seed=seed).curves.reshape(-1, len(SIZES), 1024)
            variances = [total_variance(four) for four in curves]
            comparable = (camera, subsets, method) == (CAMERA, "stated", "paper") and row in ROWS[: len(STABILITY)]
            printed = STABILITY[row[0]] if comparable else None
            yield {
                **dict(zip(("model", "constraint", "n_params"), row, strict=True)),
                "method": method,
                "camera": camera,
                "subsets": subsets,
                "total_variance": float(np.mean(variances)),
                "median": float(np.median(variances)),
                "paper": printed,
                "verdict": verdict(float(np.mean(variances)), f"{printed:.2f}" if printed else None),
            }
