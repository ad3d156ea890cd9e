"""The whole architecture search against a plain loop over `crfbench.training`, one network after another.

Run it with: python benchmarks/search.py. The loop's time for all 468 networks is extrapolated from a sample of the
candidates, in proportion to what each candidate costs in crfbench; sample and search run on the same machine, one
right after the other. The ratio is the claim; the seconds are of this machine and this minute.
"""

import argparse
import os
import time
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from scipy.stats import spearmanr
from tqdm import tqdm

from crfbench import load_responses
from crfbench.curves import Array
from crfbench.metrics import mse
from crfbench.search import Halving, Random, SearchSpace, naive_search
from crfbench.search.result import architecture
from crfbench.search.run import EPOCHS, N_FOLDS, deal_folds, search_recipe
from crfbench.search.space import Hidden
from crfbench.search.stacked import initial_trainer


@dataclass(frozen=True)
class Plain:
    """What the plain loop gives for one candidate."""

    mse: float
    seconds: float


def plain_loop(curves: Array, folds: np.ndarray, hidden: Hidden) -> Plain:
    """Train one candidate on each fold in turn, all 1024 samples, and measure it on the curves held out."""
    start, errors = time.perf_counter(), []
    recipe = search_recipe(hidden)
    for fold in range(N_FOLDS):
        trainer = initial_trainer(curves[folds != fold], "inverse", recipe)
        for _ in range(recipe.epochs):
            trainer.epoch()
        model, held_out = trainer.model(), curves[folds == fold]
        errors.append(float(mse(model.decode(model.encode(held_out)), held_out).mean()))
    return Plain(float(np.mean(errors)), time.perf_counter() - start)


def main() -> None:
    """Print the times, the ratio, and how well the ranks agree."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sample", type=int, default=24, help="candidates of the plain loop")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads(), help="PyTorch's, in the plain loop")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    responses = load_responses("auto")
    curves, folds = responses.in_direction("inverse"), deal_folds(responses, "random", 0)
    start = time.perf_counter()
    table = naive_search(responses, progress=True).table
    grid = time.perf_counter() - start
    print(f"{len(responses)} curves of {responses.dataset}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    print(f"crfbench, {len(table)} candidates in {N_FOLDS} folds: {grid / 60:.1f} min")
    sample = [trial.hidden for trial in Random(options.sample).propose(SearchSpace(), EPOCHS, {})]
    plain = {hidden: plain_loop(curves, folds, hidden) for hidden in tqdm(sample, desc="plain loop")}
    report(table, plain, grid)
    start = time.perf_counter()
    halved = naive_search(responses, strategy=Halving())
    print(f"successive halving: {(time.perf_counter() - start) / 60:.1f} min, chooses {halved.chosen}")


def report(table: pd.DataFrame, plain: dict[Hidden, Plain], grid: float) -> None:
    """Compare the sample of the plain loop with the rows of the same candidates."""
    rows = table.set_index(table.apply(architecture, axis=1).rename("hidden")).loc[list(plain)]
    seconds = sum(result.seconds for result in plain.values())
    whole = seconds * table["seconds"].sum() / rows["seconds"].sum()
    agreement = spearmanr([result.mse for result in plain.values()], rows["mse"]).statistic
    print(f"plain loop, {len(plain)} of them: {seconds / 60:.1f} min, so all: {whole / 60:.1f} min;", end=" ")
    print(f"{torch.get_num_threads()} threads, load {os.getloadavg()[0]:.1f}")
    print(f"ratio {whole / grid:.1f}; Spearman {agreement:.3f} on {len(plain)} candidates")


if __name__ == "__main__":
    main()
