"""What the claims of the paper are held against: our tables, computed or recorded, gathered once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from crfbench.curves import Direction
from crfbench.datasets import load_dorf, load_patches
from crfbench.datasets.folds import near_copies
from crfbench.datasets.middlebury import patch_intensity
from crfbench.history import History
from crfbench.metrics import rmse, total_variance
from crfbench.paper import STABILITY
from crfbench.tables.calibration import held_out_rmse
from crfbench.tables.latents import latent_figures
from crfbench.tables.recorded import load_recorded
from crfbench.tables.stability import CAMERA, ROWS, stability_curves

CONSTRAINTS = ("ldl", "auc", "aae", "vae", "baseline")


@dataclass(frozen=True)
class Evidence:
    """Our tables, by what they speak of.

    Parameters
    ----------
    fitting : DataFrame
        Of DoRF, recorded, from `crfbench.tables.fitting.fitting_table`.
    held_out : DataFrame
        SLR models on unseen curves of DoRF, by seed, recorded.
    calibration : DataFrame
        By the paper's method, recorded, from `crfbench.tables.calibration.calibration_table`.
    cameras : DataFrame
        The RMSE of each camera (rows) behind `calibration`, recorded, from
        `crfbench.tables.calibration.camera_rmse_table`.
    stability : DataFrame
        By the paper's method and seed, recorded, from `stability_by_seed`.
    copies : DataFrame
        One row, recorded, from `near_copy_counts`.
    search, search_seeds : DataFrame
        The architecture search with one seed, and ranks and choices with several; recorded.
    patches : DataFrame
        The shipped patch table.
    trainings : DataFrame
        One-latent inverse models by constraint and seed, recorded, from `trainings_by_seed`.
    forward_trainings : DataFrame
        Likewise one-latent forward models with LDL.
    """

    fitting: pd.DataFrame
    held_out: pd.DataFrame
    calibration: pd.DataFrame
    cameras: pd.DataFrame
    stability: pd.DataFrame
    copies: pd.DataFrame
    search: pd.DataFrame
    search_seeds: pd.DataFrame
    patches: pd.DataFrame
    trainings: pd.DataFrame
    forward_trainings: pd.DataFrame


def load_evidence() -> Evidence:
    """Gather the tables; nothing is fetched, trained or calibrated."""
    calibration = load_recorded("calibration_paper")[0].fillna({"constraint": ""})
    return Evidence(
        fitting=load_recorded("fitting_dorf")[0],
        held_out=load_recorded("slr_heldout_dorf")[0],
        calibration=calibration[calibration["patches"].astype(str) == "3"],
        cameras=load_recorded("calibration_paper_cameras")[0].set_index("camera"),
        stability=load_recorded("stability_paper")[0].fillna({"constraint": ""}),
        copies=load_recorded("dorf_copies")[0],
        search=load_recorded("search_dorf")[0],
        search_seeds=load_recorded("search_seeds_dorf")[0],
        patches=load_patches(),
        trainings=load_recorded("slr_trainings_dorf")[0],
        forward_trainings=load_recorded("slr_forward_trainings_dorf")[0],
    )


def stability_by_seed(seeds: Sequence[int] = (0, 1, 2)) -> pd.DataFrame:
    """Calibrate the paper's camera with 3, 6, 12 and 24 patches by the paper's method, with several random starts.

    Returns
    -------
    DataFrame
        One row a seed and model of the paper's Table 2: model, constraint, n_params, seed, ``total_variance`` of the
        four curves, and ``mean_rmse``, their mean RMSE against the RAW values of all eight photographs.
    """
    seen = patch_intensity(load_patches()).query("camera == @CAMERA")
    jpeg, raw = seen["jpeg"].to_numpy(), seen["raw"].to_numpy()
    rows = []
    for seed in seeds:
        for row in ROWS[: len(STABILITY)]:
            curves = stability_curves(CAMERA, row, "paper", seed)
            figures = (total_variance(curves), float(held_out_rmse(curves, jpeg[None], raw[None]).mean()))
            rows.append((*row, seed, *figures))
    return pd.DataFrame(rows, columns=["model", "constraint", "n_params", "seed", "total_variance", "mean_rmse"])


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
    counts = {"curves": len(curves), "groups": len(sizes), "not_alone": int(sizes[sizes > 1].sum())}
    return pd.DataFrame([counts])


def trainings_by_seed(
    constraints: Sequence[str] = CONSTRAINTS, seeds: Sequence[int] = range(5), direction: Direction = "inverse"
) -> pd.DataFrame:
    """Train one-latent models of all curves of DoRF (which must be present) with each constraint and seed.

    Returns
    -------
    DataFrame
        One row a training: constraint, seed; ``mean``, ``sd``, ``kl`` and ``ks`` of its latents as in
        `crfbench.tables.latents.latent_table`; ``settled`` and ``swing`` as in `latent_course`; ``mean_rmse`` of the
        best fits to the same curves.
    """
    from crfbench.training import RECIPES, train

    curves, rows = load_dorf().in_direction(direction), []
    for constraint in constraints:
        for seed in seeds:
            model, history = train(curves, direction, replace(RECIPES[f"{constraint}-1"], seed=seed))
            figures = latent_figures(model.weights_["latents"].astype(float)) | latent_course(history)
            fitted = float(rmse(model.decode(model.fit(curves)), curves).mean())
            rows.append({"constraint": constraint, "seed": seed, **figures, "mean_rmse": fitted})
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
    far = np.flatnonzero(0.5 * (mean**2 + sd**2 - 2 * np.log(sd) - 1) >= 0.05)
    first = far[-1] + 1 if len(far) else 0
    late = sd[history.epochs > history.epochs[-1] / 3]
    settled = history.epochs[first] if first < len(history) else np.nan
    return {"settled": float(settled), "swing": float(np.ptp(late))}
