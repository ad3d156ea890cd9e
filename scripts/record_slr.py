"""Record how SLR models do on curves they have not seen: grouped 5-fold cross-validation on DoRF, several seeds.

Trains five networks a row, so it takes some twenty minutes; `crfbench table fitting` shows what it recorded.
"""

import argparse
import time
from dataclasses import replace

import numpy as np
import pandas as pd
from tqdm import tqdm

import crfbench
from crfbench.curves import Array, Direction
from crfbench.datasets import load_dorf
from crfbench.datasets.responses import grouped_folds
from crfbench.metrics import rmse
from crfbench.models.registry import ModelKey
from crfbench.paper.fitting import figures
from crfbench.paper.results import record
from crfbench.training import CONFIGS, TrainingConfig, train

RANKED = ("SLR-ldl-1", "SLR-monotone-1", "SLR-ldl-3", "SLR-monotone-3")  # forward, five seeds: what the text ranks by
N_SEEDS = 5


def cross_validate(curves: Array, folds: np.ndarray, direction: Direction, config: TrainingConfig) -> dict[str, float]:
    """Train on four folds, fit the fifth with its best latents; in turn. The in-sample RMSE is of the same networks."""
    start, decoded, in_sample = time.perf_counter(), np.empty_like(curves), []
    for fold in range(folds.max() + 1):
        test = folds == fold
        model, _ = train(curves[~test], direction, config)
        decoded[test] = model.decode(model.fit(curves[test]))
        in_sample.append(rmse(model.decode(model.fit(curves[~test])), curves[~test]).mean())
    return {
        **figures(decoded, curves),
        "seconds": time.perf_counter() - start,
        "in_sample_mean_rmse": float(np.mean(in_sample)),
    }


def main() -> None:
    """Run every config in both directions, the ranked ones with all seeds, and write the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--epochs", type=int, help="fewer epochs, to try the script out; nothing is recorded")
    epochs = parser.parse_args().epochs
    responses = load_dorf()
    folds = grouped_folds(responses.units)
    jobs = [(name, "forward", seed) for name in RANKED for seed in range(N_SEEDS)]
    jobs += [(name, side, 0) for name in CONFIGS if name != "SLR-open-1" for side in ("forward", "inverse")]
    rows = []
    for name, side, seed in tqdm(dict.fromkeys(jobs), unit="row"):
        config = replace(CONFIGS[name], seed=seed, **({"epochs": epochs} if epochs else {}))
        direction: Direction = "forward" if side == "forward" else "inverse"
        found = cross_validate(responses.in_direction(direction), folds, direction, config)
        key = replace(ModelKey.parse(name), direction=direction)
        rows.append({"model": str(key), "n_params": key.n_params, "direction": side, "seed": seed, **found})
    if not epochs:
        provenance = {"crfbench": crfbench.__version__, "command": "python scripts/record_slr.py"}
        print(record(pd.DataFrame(rows), "slr_heldout_dorf", provenance).name)


if __name__ == "__main__":
    main()
