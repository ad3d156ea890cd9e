"""The whole architecture search against a plain loop over `crfbench.training`, one network after another.

The loop's time for all 468 networks is extrapolated from a sample of the candidates, in proportion to what each
candidate costs in crfbench; sample and search run on the same machine, one right after the other.
"""

import os
from functools import partial

import numpy as np
import torch
from scipy.stats import spearmanr

from benchmarks.timing import Growth, Row, row, seconds_of
from crfbench import load_responses, search_architectures
from crfbench.curves import Array
from crfbench.metrics import mse
from crfbench.search import SearchSpace
from crfbench.search.result import architecture
from crfbench.search.run import EPOCHS, N_FOLDS, make_folds, search_config
from crfbench.search.space import Hidden
from crfbench.search.stacked import initial_trainer
from crfbench.search.strategies import random

SIZES = (1, 3, 10, 30, 100)


def plain_loop(curves: Array, folds: np.ndarray, hidden: Hidden, epochs: int = EPOCHS) -> float:
    """Train one candidate on each fold in turn, all 1024 samples; return its mean MSE on the curves held out."""
    errors = []
    config = search_config(hidden, epochs)
    for fold in range(N_FOLDS):
        trainer = initial_trainer(curves[folds != fold], "inverse", config)
        for _ in range(config.epochs):
            trainer.epoch()
        model, held_out = trainer.model(), curves[folds == fold]
        errors.append(float(mse(model.decode(model.encode(held_out)), held_out).mean()))
    return float(np.mean(errors))


def rows(sample: int = 6, epochs: int = 50) -> list[Row]:
    """Search with a tenth of the epochs, which costs both sides about a tenth."""
    torch.set_num_threads(1)  # as `crfbench.training` does; on a busy machine more threads wait for each other
    responses = load_responses("auto")
    curves, folds = responses.in_direction("inverse"), make_folds(responses, "random", 0)
    ours_s, result = seconds_of(partial(search_architectures, responses, epochs=epochs, progress=True))
    candidates = [hidden for hidden, _ in random(SearchSpace(), epochs, {}, sample)]
    plain = [seconds_of(partial(plain_loop, curves, folds, hidden, epochs)) for hidden in candidates]
    table = result.table.set_index(result.table.apply(architecture, axis=1).rename("hidden"))
    same = table.loc[candidates]
    share = float(same["seconds"].sum() / table["seconds"].sum())
    agreement = spearmanr([error for _, error in plain], same["mse"]).statistic
    note = (
        f"plain loop on {sample} of {len(table)} candidates, extrapolated, one thread against {os.cpu_count()} "
        f"processes; {epochs} of {EPOCHS} epochs; Spearman of both MSE {agreement:.3f}"
    )
    name = f"search {len(table)} architectures in {N_FOLDS} folds"
    return [row(name, ours_s, "plain loop over trainings", sum(seconds for seconds, _ in plain) / share, note)]


def growths() -> list[Growth]:
    """Time searches of more and more candidates with a fiftieth of the epochs, and the plain loop over as many."""
    torch.set_num_threads(1)
    responses, epochs = load_responses("auto"), EPOCHS // 50
    curves, folds = responses.in_direction("inverse"), make_folds(responses, "random", 0)
    plain_loop(curves, folds, (10,), 1)  # PyTorch starts up with what is first
    seconds = []
    for n in SIZES:
        ours_s, _ = seconds_of(
            partial(search_architectures, responses, m=1, strategy=partial(random, n=n), epochs=epochs)
        )
        trials = random(SearchSpace(), epochs, {}, n)
        loops = [seconds_of(partial(plain_loop, curves, folds, *trial))[0] for trial in trials]
        seconds.append([ours_s, sum(loops)])
    return [Growth("candidates", ("crfbench, all processes", "plain loop, one process"), SIZES, np.array(seconds))]
