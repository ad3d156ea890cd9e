"""Record what the report shows and takes minutes: leaderboard, stability and trainings by seed, near-copies in DoRF.

Run: python scripts/record_report.py (DoRF must be present), after record_tables.py.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

import crfbench
from crfbench.calibration import calibrate
from crfbench.curves import GRID, Array, Direction, evaluate
from crfbench.datasets import load_dorf, load_patches
from crfbench.datasets.chart import N_PATCHES
from crfbench.datasets.middlebury import THREE_GREYS, patch_arrays, patch_intensity
from crfbench.datasets.responses import near_copies
from crfbench.history import History, latent_statistics
from crfbench.metrics import rmse, total_variance
from crfbench.models import SLR, EMoR, Kernel, ResponseModel, load_model
from crfbench.models.registry import bundled_models
from crfbench.paper.calibration import camera_rmse, camera_rmse_table, chart_observations, coverage
from crfbench.paper.results import CONSTRAINTS, LEADERBOARD, load_recorded, record
from crfbench.paper.stability import CAMERA, stability_curves
from crfbench.paper.verdicts import CALIBRATION, STABILITY
from crfbench.training import CONFIGS, train

_N_DORF = 201
#: Latents count as settled below this KL divergence: with s.d. 1, a mean within 0.32 of 0.
_SETTLED_KL = 0.05


def main() -> None:
    provenance = {"crfbench": crfbench.__version__, "command": "python scripts/record_report.py"}
    print(record(near_copy_counts(), "dorf_copies", provenance).name)
    print(record(stability_by_seed(), "stability_paper", provenance).name)
    print(record(trainings_by_seed(), "slr_trainings_dorf", provenance).name)
    forward = trainings_by_seed(["ldl"], direction="forward")
    print(record(forward, "slr_forward_trainings_dorf", provenance).name)
    print(record(cameras_by_seed(), "calibration_paper_cameras", provenance).name)
    print(record(measured_leaderboard(), "leaderboard", provenance).name)


def near_copy_counts(tolerance: float = 0.01) -> pd.DataFrame:
    """Count the curves of DoRF (which must be present) that have a near-copy in the set.

    Returns
    -------
    DataFrame
        One row: ``curves``, ``groups`` of curves that chain within an RMSE of `tolerance`, and ``not_alone``, how many
        curves are in a group of two or more.
    """
    curves = load_dorf().curves
    sizes = np.bincount(near_copies(curves, tolerance))
    return pd.DataFrame([{"curves": len(curves), "groups": len(sizes), "not_alone": int(sizes[sizes > 1].sum())}])


def stability_by_seed(seeds: Sequence[int] = (0, 1, 2)) -> pd.DataFrame:
    """Calibrate the paper's camera with 3, 6, 12 and 24 patches by the paper's method, with several random starts.

    Returns
    -------
    DataFrame
        One row a seed and model of the paper's Table 2: model, seed, ``total_variance`` of the four curves, and
        ``mean_rmse``, their mean RMSE against the RAW values of all eight photographs.
    """
    seen = patch_intensity(load_patches()).query("camera == @CAMERA")
    jpeg, raw = seen["jpeg"].to_numpy(), seen["raw"].to_numpy()
    rows = []
    for seed in seeds:
        for name in STABILITY:
            curves = stability_curves(CAMERA, name, "paper", seed=seed)
            distance = float(rmse(evaluate(curves, jpeg[None]), raw).mean())
            rows.append({"model": name, "seed": seed, "total_variance": total_variance(curves), "mean_rmse": distance})
    return pd.DataFrame(rows)


def cameras_by_seed(seeds: Sequence[int] = (0, 1, 2)) -> pd.DataFrame:
    """Calibrate from three greys by the paper's method, with several random starts.

    Returns
    -------
    DataFrame
        One row a seed and camera: seed, camera, and the RMSE with every model of the paper's Table 3.
    """
    tables = [camera_rmse_table("3", "paper", list(CALIBRATION), seed=seed).assign(seed=seed) for seed in seeds]
    return pd.concat(tables).reset_index()[["seed", "camera", *CALIBRATION]]


def trainings_by_seed(
    constraints: Sequence[str] = CONSTRAINTS, seeds: Sequence[int] = range(5), direction: Direction = "inverse"
) -> pd.DataFrame:
    """Train one-latent models of all curves of DoRF (which must be present) with each constraint and seed.

    Returns
    -------
    DataFrame
        One row a training: constraint, seed; ``mean``, ``sd``, ``kl`` and ``ks`` of its latents as in `latent_table`;
        ``settled`` and ``swing`` as in `latent_course`; ``mean_rmse`` of the best fits to the same curves.
    """
    curves, rows = load_dorf().in_direction(direction), []
    for constraint in constraints:
        for seed in seeds:
            model, history = train(curves, direction, replace(CONFIGS[f"SLR-{constraint}-1"], seed=seed))
            found = latent_statistics(model.weights_["latents"].astype(float)) | latent_course(history)
            fitted = float(rmse(model.decode(model.fit(curves)), curves).mean())
            rows.append({"constraint": constraint, "seed": seed, **found, "mean_rmse": fitted})
    return pd.DataFrame(rows)


def latent_course(history: History) -> dict[str, float]:
    """Describe how the latents of a training settle.

    Returns
    -------
    dict
        ``settled``: the epoch from which the KL divergence of N(mean, sd) of the latents to N(0, 1) stays below 0.05,
        NaN where it never does; ``swing``: the range that their sd moves in after the first third of the epochs.
    """
    mean, sd = history.latents[:, :, 0].mean(axis=1), history.latents[:, :, 0].std(axis=1)
    far = np.flatnonzero(0.5 * (mean**2 + sd**2 - 2 * np.log(sd) - 1) >= _SETTLED_KL)
    first = far[-1] + 1 if len(far) else 0
    late = sd[history.epochs > history.epochs[-1] / 3]
    settled = history.epochs[first] if first < len(history) else np.nan
    return {"settled": float(settled), "swing": float(np.ptp(late))}


def measured_leaderboard(rows: Sequence[str] | None = None) -> pd.DataFrame:
    """Calibrate with every model and set the recorded fits of DoRF beside it; some minutes for all models.

    Parameters
    ----------
    rows : sequence of str, optional
        Names of inverse models; by default all that are bundled.
    """
    fits = load_recorded("fitting_dorf")[0].set_index(["model", "split"])
    if rows is None:
        rows = [str(key) for key in bundled_models() if key.direction == "inverse"]
    return pd.DataFrame([_row(name, fits) for name in rows], columns=list(LEADERBOARD))


def steepest_slope(curves: Array) -> float:
    """Return the largest rise between neighbouring samples of curves (n, 1024), per unit of their input."""
    return float(np.diff(curves, axis=-1).max() / (GRID[1] - GRID[0]))


def _row(name: str, fits: pd.DataFrame) -> dict[str, object]:
    model = load_model(name)
    return {
        "model": name,
        "n_params": model.n_params,
        "learned": _learned(model),
        **_fit_figures(name, fits),
        **_calibration_figures(model),
    }


def _fit_figures(name: str, fits: pd.DataFrame) -> dict[str, float]:
    nothing = pd.Series(np.nan, index=fits.columns)
    inside, outside = (
        fits.loc[name, split] if (name, split) in fits.index else nothing for split in ("in-sample", "grouped-5fold")
    )
    return {
        "in_sample_rmse": inside["mean_rmse"],
        "held_out_rmse": outside["mean_rmse"],
        "nonmonotone": inside["nonmonotone"],
        "out_of_range": inside["out_of_range"],
        "fit_ms": 1000 * inside["seconds"] / _N_DORF,
    }


def _calibration_figures(model: ResponseModel) -> dict[str, float]:
    observations, jpeg, raw = chart_observations(patch_arrays(load_patches()))
    found: dict[str, float] = {}
    every = observations.take(np.arange(N_PATCHES))
    for patches, seen in (("3", observations.take(np.array(THREE_GREYS) - 1)), ("24", every)):
        for column, allow in (("calibration", True), ("alone", False)):
            result = calibrate(model, seen, "map", discrepancy=allow)
            found[f"{column}_{patches}"] = float(camera_rmse(result, jpeg, raw).mean())
    bands = calibrate(model, every, "posterior")
    return {
        **found,
        "steepest_slope": steepest_slope(result.curves),
        "coverage": coverage(bands, observations, jpeg, raw),
    }


def _learned(model: ResponseModel) -> int:
    """Count the numbers that turn parameters into a curve and were learned."""
    if isinstance(model, SLR):
        return sum(weights.size for name, weights in model.weights_.items() if name.startswith("decoder"))
    return int(model.mean_.size + model.components_.size) if isinstance(model, EMoR | Kernel) else 0


if __name__ == "__main__":
    main()
