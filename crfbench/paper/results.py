"""Our side of the comparison: tables that take minutes to compute, recorded with their provenance.

``scripts/record_*.py`` compute and record them.
"""

import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from crfbench.datasets import load_patches
from crfbench.errors import FormatError, MissingDataError
from crfbench.files import bundled, write_atomically
from crfbench.history import latent_statistics
from crfbench.models import load_model
from crfbench.models.registry import pretrained_models
from crfbench.models.slr import SLR

#: How `tqdm` tells the time left of a table: not before it has taken two seconds, and gone when the table is there.
BAR: dict[str, Any] = {
    "bar_format": "{desc} |{bar}| {percentage:3.0f} % [{elapsed}, {remaining} left]", "delay": 2, "ncols": 79,
    "leave": False,
}  # fmt: skip
CONSTRAINTS = ("ldl", "auc", "aae", "vae", "baseline")
LATENT_COLUMNS = (
    "model", "n_latent", "direction", "constraint", "mean", "sd", "kl", "ks", "best_mse", "best_rmse", "encoder_mse",
)  # fmt: skip
#: Of each column its heading, how its numbers are written, and what it holds. All are of inverse responses, the
#: direction that calibration uses.
LEADERBOARD: dict[str, list[str]] = pd.read_csv(
    Path(__file__).with_name("leaderboard.csv"), index_col="column", keep_default_na=False
).T.to_dict("list")


@dataclass(frozen=True)
class PaperResults:
    """Our tables, by what they speak of; all but the patches are recorded."""

    fitting: pd.DataFrame  # of DoRF, from `fitting_table`
    held_out: pd.DataFrame  # SLR models on unseen curves of DoRF, by seed
    calibration: pd.DataFrame  # by the paper's method, from `calibration_table`, indexed by model
    cameras: pd.DataFrame  # likewise the RMSE of each camera (rows), by seed of the search, from `cameras_by_seed`
    stability: pd.DataFrame  # by the paper's method and seed, from `stability_by_seed`
    copies: pd.DataFrame  # one row, from `near_copy_counts`
    search: pd.DataFrame  # the architecture search with one seed
    search_seeds: pd.DataFrame  # its ranks and choices with several
    patches: pd.DataFrame  # the bundled patch table
    trainings: pd.DataFrame  # one-latent inverse models by constraint and seed, from `trainings_by_seed`
    forward_trainings: pd.DataFrame  # likewise one-latent forward models with LDL

    def fits(self, split: str = "in-sample") -> pd.DataFrame:
        """Return the fits of a split, indexed by model; the names of forward models end in "-forward"."""
        return self.fitting[self.fitting["split"] == split].set_index("model")


def load_results() -> PaperResults:
    """Gather the tables; nothing is fetched, trained or calibrated."""
    calibration = load_recorded("calibration_paper")[0]
    return PaperResults(
        fitting=load_recorded("fitting_dorf")[0],
        held_out=load_recorded("slr_heldout_dorf")[0],
        calibration=calibration[calibration["patches"].astype(str) == "3"].set_index("model"),
        cameras=load_recorded("calibration_paper_cameras")[0].set_index(["seed", "camera"]),
        stability=load_recorded("stability_paper")[0],
        copies=load_recorded("dorf_copies")[0],
        search=load_recorded("search_dorf")[0],
        search_seeds=load_recorded("search_seeds_dorf")[0],
        patches=load_patches(),
        trainings=load_recorded("slr_trainings_dorf")[0],
        forward_trainings=load_recorded("slr_forward_trainings_dorf")[0],
    )


def to_rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a table as plain Python values; missing ones are None."""
    return [dict(row) for row in json.loads(table.to_json(orient="records", double_precision=15))]


def record(table: pd.DataFrame, name: str, provenance: dict[str, str], folder: Path | None = None) -> Path:
    """Write ``<name>.json`` with the rows and their provenance, and return its path."""
    path = (folder or bundled("data/recorded")) / f"{name}.json"
    text = json.dumps({"provenance": provenance, "rows": to_rows(table)}, indent=1)
    write_atomically(path, text.encode() + b"\n")
    return path


def load_recorded(name: str, folder: Path | None = None) -> tuple[pd.DataFrame, dict[str, str]]:
    """Read a recorded table and its provenance, by a name such as "fitting_dorf".

    A name that is not there is a `MissingDataError`, a damaged file a `FormatError`.
    """
    folder = folder or bundled("data/recorded")
    path = folder / f"{name}.json"
    if not path.is_file():
        names = ", ".join(sorted(p.stem for p in folder.glob("*.json"))) or "none"
        raise MissingDataError(f"there is no recorded table {name!r}; there are: {names}")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return pd.read_json(io.StringIO(json.dumps(content["rows"])), orient="records"), content["provenance"]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        reason = f"is not a valid recorded table ({str(error)[:80]})"
        raise FormatError(f"{path.name} {reason}; use one that crfbench wrote") from None


def latent_table() -> pd.DataFrame:
    """Describe the latents of every pretrained SLR, one row a model, with the columns of `LATENT_COLUMNS`.

    ``mean``, ``sd``, ``kl`` and ``ks`` are of the training curves' latents, as in `crfbench.history.latent_statistics`;
    then three figures of the model's metadata: mean MSE and RMSE with the best latent of each training curve, and
    MSE with the encoder's. ``constraint`` is the loss that shaped the latents.
    """
    rows = []
    for key in pretrained_models():
        model = load_model(key)
        assert isinstance(model, SLR)  # noqa: S101  all pretrained models are
        about = {"model": str(key), "n_latent": key.n_params, "direction": key.direction}
        latents, figures = model.weights_["latents"].astype(float), model.metadata_["figures"]
        about["constraint"] = model.metadata_["constraint"]
        rows.append({**about, **latent_statistics(latents), **figures})
    return pd.DataFrame(rows, columns=list(LATENT_COLUMNS))


def leaderboard() -> pd.DataFrame:
    """Return the recorded leaderboard: one row a model, with the columns of `LEADERBOARD`.

    Figures that a model cannot have, such as those in sample of one that learned from another set, are missing.
    """
    return load_recorded("leaderboard")[0][list(LEADERBOARD)]
