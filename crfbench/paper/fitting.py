"""The paper's Table 1 and more: how well each model fits response curves, in sample and held out."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from tqdm.auto import tqdm

from crfbench.curves import Array, Direction
from crfbench.datasets import Responses, load_emor_basis, load_responses, registry
from crfbench.datasets.responses import grouped_folds
from crfbench.metrics import mse, nonmonotone, out_of_range, rmse, summarise
from crfbench.models import SLR, EMoR, ResponseModel, load_model
from crfbench.models.base import ClosedForm
from crfbench.models.registry import MODELS, ModelKey, pretrained_models
from crfbench.paper.results import BAR, load_recorded
from crfbench.paper.verdicts import FITTING, verdict

COLUMNS = (
    "model", "n_params", "direction", "split", "mean_rmse", "median_rmse", "p95_rmse", "max_rmse", "mean_mse",
    "nonmonotone", "out_of_range", "seconds", "paper", "verdict",
)  # fmt: skip
DIRECTIONS: tuple[Direction, ...] = ("forward", "inverse")
N_FOLDS = 5


def fitting_table(
    responses: Responses, directions: Sequence[Direction] = DIRECTIONS, progress: bool = False
) -> pd.DataFrame:
    """Fit every model to every curve with its best parameters and summarise the distances.

    Returns one row for each model and split, with the columns of `COLUMNS`. ``split`` is "in-sample" (what a model
    learns, it learned from these curves), "grouped-5fold" (from the other folds, and curves of one film or camera
    stay together; a model that learns nothing has the same figures in both) or "other-set" (it learned from DoRF
    and these are OpenCRF's, or the other way round). The "grouped-5fold" rows of SLR models were recorded, for they
    train five networks each; see ``scripts/record_slr.py``. RMSE and MSE are in units of the curve's range;
    ``nonmonotone`` and ``out_of_range`` are shares of the decoded curves; ``seconds`` is the time of all fits of
    the row; ``paper`` is the figure of the paper's Table 1, which speaks of forward in-sample fits of DoRF, and
    ``verdict`` follows `crfbench.paper.verdicts.verdict`. "EMoR-published-..." has the published basis, "EMoR-..."
    one learned here. `progress` shows a bar with the time left.
    """
    recorded = load_recorded("fitting_dorf")[0].query("split != 'grouped-5fold' and direction in @directions")
    seconds, rows = recorded.groupby("model")["seconds"].sum(), []
    with tqdm(total=seconds.sum(), desc=responses.dataset, disable=not progress, **BAR) as bar:
        for row in (row for direction in directions for row in _rows(responses, direction)):
            rows.append(row)
            bar.update(0.0 if row["split"] == "grouped-5fold" else seconds.get(row["model"], 0.0))
    return pd.DataFrame(rows, columns=list(COLUMNS)).astype({"paper": float})


def fitting_tables(
    which: str = "auto", directions: Sequence[Direction] = DIRECTIONS, progress: bool = False
) -> dict[str, pd.DataFrame]:
    """Return the fitting table of the data asked for; with "auto" and no DoRF, the recorded DoRF table beside it.

    `which` is that of `crfbench.load_responses`, `progress` that of `fitting_table`. Each table stands under a title
    that says where its figures come from.
    """
    responses = load_responses(which)
    tables = {f"{responses.dataset}, computed now": fitting_table(responses, directions, progress)}
    if which == "auto" and responses.dataset != "dorf":
        table, provenance = load_recorded("fitting_dorf")
        title = f"dorf, recorded with crfbench {provenance['crfbench']} (the curves are not on this machine)"
        tables[title] = table[table["direction"].isin(directions)]
    return tables


def display_table(table: pd.DataFrame, direction: Direction, split: str) -> pd.DataFrame:
    """Return one direction and split of a fitting table as people read it: rounded, and without the times.

    Columns: model, parameters, the RMSE statistics and mean MSE, shares in percent, the paper's figure, verdict.
    """
    rows = table[(table["direction"] == direction) & (table["split"] == split)]
    rows = rows.drop(columns=["direction", "split", "seconds"]).reset_index(drop=True)
    for name in ("mean_rmse", "median_rmse", "p95_rmse", "max_rmse", "mean_mse", "paper"):
        rows[name] = ["" if pd.isna(value) else f"{value:.2e}" for value in rows[name]]
    for name in ("nonmonotone", "out_of_range"):
        rows[name] = [f"{100 * value:.0f} %" for value in rows[name]]
    return rows


def papers_rising_rows() -> list[str]:
    """Name the steps of the paper's Table 1 where a model gets worse by one more parameter."""
    rising = []
    for name, figure in FITTING.items():
        key = ModelKey.parse(name)
        larger = FITTING.get(str(replace(key, n_params=key.n_params + 1)))
        if larger and float(larger) > float(figure):
            rising.append(f"{key.family}: {figure} with {key.n_params}, {larger} with {key.n_params + 1} parameters")
    return rising


def figures(decoded: Array, curves: Array) -> dict[str, float]:
    """Return the columns of a fitting table that judge decoded curves (n, 1024) against the measured ones."""
    distance = summarise(rmse(decoded, curves))
    return {
        **{f"{name}_rmse": distance[name] for name in ("mean", "median", "p95", "max")},
        "mean_mse": float(mse(decoded, curves).mean()),
        "nonmonotone": float(nonmonotone(decoded).mean()),
        "out_of_range": float(out_of_range(decoded).mean()),
    }


def _rows(responses: Responses, direction: Direction) -> Iterator[dict[str, object]]:
    """Yield the rows of one direction: closed forms, EMoR as published, then networks."""
    curves, dataset = responses.in_direction(direction), responses.dataset
    folds = grouped_folds(responses.units, N_FOLDS)
    for kind, counts in MODELS.items():
        for k in counts:
            key = ModelKey(kind.name, "", k, direction)
            in_sample = _timed_fit(kind.from_curves(curves, k, direction), curves)
            held_out = _fit_folds(kind, k, direction, curves, folds) if kind.learns else in_sample
            yield _row(key, "in-sample", curves, in_sample, dataset)
            yield _row(key, "grouped-5fold", curves, held_out, dataset)
    if registry.find(f"dorf/{'emor' if direction == 'forward' else 'invemor'}.txt"):
        for k in MODELS[EMoR]:
            published = _timed_fit(EMoR(*load_emor_basis(direction), k, direction), curves)
            split = "in-sample" if dataset == "dorf" else "other-set"
            yield _row(ModelKey("EMoR", "published", k, direction), split, curves, published, dataset)
    yield from _network_rows(direction, curves, dataset)


def _network_rows(direction: Direction, curves: Array, dataset: str) -> Iterator[dict[str, object]]:
    for key in pretrained_models(direction):
        model = load_model(key)
        assert isinstance(model, SLR)  # noqa: S101  all pretrained models are
        split = "in-sample" if model.metadata_["data"] == dataset else "other-set"
        yield _row(key, split, curves, _timed_fit(model, curves), dataset)
    if dataset == "dorf":
        recorded = load_recorded("slr_heldout_dorf")[0].query("direction == @direction")
        by_seed = recorded.drop(columns=["seed", "in_sample_mean_rmse"]).groupby(["model", "n_params", "direction"])
        for row in by_seed.mean().reset_index().to_dict("records"):
            yield _judged({**row, "split": "grouped-5fold"}, ModelKey.parse(row["model"]), dataset)


def _fit_folds(
    kind: type[ClosedForm], k: int, direction: Direction, curves: Array, folds: np.ndarray
) -> tuple[Array, float]:
    decoded, seconds = np.empty_like(curves), 0.0
    for fold in np.unique(folds):
        test = folds == fold
        decoded[test], spent = _timed_fit(kind.from_curves(curves[~test], k, direction), curves[test])
        seconds += spent
    return decoded, seconds


def _timed_fit(model: ResponseModel, curves: Array) -> tuple[Array, float]:
    start = time.perf_counter()
    params = model.fit(curves)
    seconds = time.perf_counter() - start
    return model.decode(params), seconds


def _row(key: ModelKey, split: str, curves: Array, fit: tuple[Array, float], dataset: str) -> dict[str, object]:
    decoded, seconds = fit
    row = {"model": str(key), "n_params": key.n_params, "direction": key.direction, "split": split}
    return _judged({**row, **figures(decoded, curves), "seconds": seconds}, key, dataset)


def _judged(row: dict[str, object], key: ModelKey, dataset: str) -> dict[str, object]:
    """Add the paper's figure, which speaks of forward in-sample fits of DoRF, and the verdict on ours."""
    printed = FITTING.get(str(key)) if dataset == "dorf" and row["split"] == "in-sample" else None
    return {
        **row,
        "paper": float(printed) if printed else None,
        "verdict": verdict(float(str(row["mean_rmse"])), printed),
    }
