"""Learn how every bundled model misses DoRF curves that it has not seen; write data/discrepancies.npz.

Run: python scripts/learn_discrepancies.py NETWORKS (with CRFBENCH_DATA set, or after `crfbench fetch dorf`). Networks
are trained without each fifth of the curves, an hour in all; they are kept in the folder NETWORKS, and taken from it.
Half of each model's kernel is that of the kernel mixture, which knows more curves than any fold.
"""

import io
import sys
from pathlib import Path

import numpy as np

from crfbench.calibration.learning import Rows, fit_discrepancy, rows_for
from crfbench.calibration.mixture import CONTRASTS
from crfbench.curves import Array
from crfbench.datasets import load_dorf, load_opencrf
from crfbench.datasets.responses import grouped_folds, near_copies
from crfbench.files import write_atomically
from crfbench.models import MODELS, SLR, Kernel, ModelKey, ResponseModel, bundled_models
from crfbench.models.base import LOG_KNOTS, SCALES, Discrepancy, at_knots
from crfbench.training import CONFIGS, train

# Channels meet at white.
WHITE = np.minimum(1.0, -LOG_KNOTS / 0.05)
TARGET = Path(__file__).parents[1] / "data" / "discrepancies.npz"


def main(folder: Path) -> None:
    shared = kernel_discrepancy()
    found = {"Kernel-8": shared, "channels": channel_difference()}
    for key in bundled_models():
        if key.direction == "inverse" and key.family != Kernel.name:
            found[str(key)] = model_discrepancy(key, folder).blended(shared)
            print(key, np.round(found[str(key)].scale_weight, 3), flush=True)
    learned = {f"{key}.{name}": value for key, each in found.items() for name, value in vars(each).items()}
    content = io.BytesIO()
    np.savez_compressed(content, allow_pickle=False, **{k: v.astype(np.float32) for k, v in learned.items()})
    write_atomically(TARGET, content.getvalue())


def kernel_discrepancy() -> Discrepancy:
    """Take each curve's rows from all curves but its near copies."""
    x, labels = at_knots(load_dorf().in_direction("inverse")), near_copies(load_dorf().curves)
    weight = 1.0 / np.sqrt(np.bincount(labels)[labels])
    others = [labels != label for label in labels]
    rows = [(x[keep], np.log(weight[keep] / weight[keep].sum())) for keep in others]
    return fit_discrepancy(x, rows, weight)


def channel_difference() -> Discrepancy:
    """Learn the contrasts of red, green and blue of films.

    Their scales count from the shared discrepancy's, which is small where a family fits, so they reach to 4 times it,
    with equal weights: most cameras have channels that are alike, and these learned from films say nothing of that.
    """
    responses = load_opencrf()
    logs, units = at_knots(responses.in_direction("inverse")), np.array(responses.units)
    films = [logs[units == unit] for unit in dict.fromkeys(responses.units)]
    contrasts = np.concatenate([CONTRASTS.T @ film for film in films if len(film) == 3])
    nothing = np.zeros((1, contrasts.shape[1])), np.zeros(1)
    found = fit_discrepancy(contrasts, [nothing] * len(contrasts), np.ones(len(contrasts)))
    return Discrepancy(4.0 * found.factor * WHITE[:, None], np.full(len(SCALES), 1.0 / len(SCALES)))


def model_discrepancy(key: ModelKey, folder: Path) -> Discrepancy:
    """Take each curve's rows from a model built without the curve's fold."""
    curves = load_dorf().in_direction("inverse")
    labels = near_copies(load_dorf().curves)
    folds = grouped_folds(labels)
    rows: Rows = [(np.empty(0), np.empty(0))] * len(curves)
    for fold in range(int(folds.max()) + 1):
        model, inside = fold_model(key, curves[folds != fold], fold, folder), np.flatnonzero(folds == fold)
        for i, found in zip(inside, rows_for(model, curves[inside]), strict=True):
            rows[i] = found
    return fit_discrepancy(at_knots(curves), rows, 1.0 / np.sqrt(np.bincount(labels)[labels]))


def fold_model(key: ModelKey, curves: Array, fold: int, folder: Path) -> ResponseModel:
    """Return the model that those curves give; OpenCRF's network has seen none of DoRF."""
    if key.family != SLR.name:
        (kind,) = (kind for kind in MODELS if kind.name == key.family)
        return kind.from_curves(curves, key.n_params).learn_prior(curves)
    if key.constraint == "open":
        return key.load()
    path = folder / f"{key}-without-fold-{fold}.safetensors"
    if not path.exists():
        train(curves, "inverse", CONFIGS[str(key)])[0].save(path)
    return SLR.load(path)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
