"""The whole architecture search against a plain loop over `crfbench.training`, one network after another.

Run it with: python -m crfbench.bench.search. The loop's time for all 468 networks is extrapolated from a sample of the
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
from crfbench.bench.growth import Growth, print_growth
from crfbench.bench.timing import Row, row
from crfbench.curves import Array
from crfbench.datasets import Responses
from crfbench.metrics import mse
from crfbench.search import Halving, Random, SearchSpace, naive_search
from crfbench.search.result import architecture
from crfbench.search.run import EPOCHS, N_FOLDS, deal_folds, search_recipe
from crfbench.search.space import Hidden
from crfbench.search.stacked import initial_trainer

SIZES = (1, 3, 10, 30, 100)


@dataclass(frozen=True)
class Plain:
    """What the plain loop gives for one candidate."""

    mse: float
    seconds: float


def plain_loop(curves: Array, folds: np.ndarray, hidden: Hidden, epochs: int = EPOCHS) -> Plain:
    """Train one candidate on each fold in turn, all 1024 samples, and measure it on the curves held out."""
    start, errors = time.perf_counter(), []
    recipe = search_recipe(hidden, epochs)
    for fold in range(N_FOLDS):
        trainer = initial_trainer(curves[folds != fold], "inverse", recipe)
        for _ in range(recipe.epochs):
            trainer.epoch()
        model, held_out = trainer.model(), curves[folds == fold]
        errors.append(float(mse(model.decode(model.encode(held_out)), held_out).mean()))
    return Plain(float(np.mean(errors)), time.perf_counter() - start)


@dataclass(frozen=True)
class Compared:
    """The search's table and seconds, and what the plain loop gave for a sample of its candidates."""

    table: pd.DataFrame
    seconds: float
    plain: dict[Hidden, Plain]

    def rows(self) -> pd.DataFrame:
        """Return the search's rows of the sample."""
        return self.table.set_index(self.table.apply(architecture, axis=1).rename("hidden")).loc[list(self.plain)]

    def extrapolated(self) -> float:
        """Return the seconds of the plain loop for all candidates, in proportion to what each costs in crfbench."""
        share = self.rows()["seconds"].sum() / self.table["seconds"].sum()
        return sum(result.seconds for result in self.plain.values()) / float(share)


def compare(responses: Responses, sample: int, epochs: int = EPOCHS) -> Compared:
    """Run the search of all candidates, then the plain loop over a random sample of them."""
    curves, folds = responses.in_direction("inverse"), deal_folds(responses, "random", 0)
    start = time.perf_counter()
    table = naive_search(responses, epochs=epochs, progress=True).table
    seconds = time.perf_counter() - start
    chosen = [trial.hidden for trial in Random(sample).propose(SearchSpace(), epochs, {})]
    plain = {hidden: plain_loop(curves, folds, hidden, epochs) for hidden in tqdm(chosen, desc="plain loop")}
    return Compared(table, seconds, plain)


def rows(sample: int = 6, epochs: int = 50) -> list[Row]:
    """Search with a tenth of the epochs, which costs both sides about a tenth."""
    torch.set_num_threads(1)  # as `crfbench.training` does; on a busy machine more threads wait for each other
    compared = compare(load_responses("auto"), sample, epochs)
    n = len(compared.table)
    note = (
        f"plain loop on {sample} of {n} candidates, extrapolated, one thread against {os.cpu_count()} processes; "
        f"{epochs} of {EPOCHS} epochs"
    )
    name = f"search {n} architectures in {N_FOLDS} folds"
    return [row(name, compared.seconds, "plain loop over trainings", compared.extrapolated(), note)]


def growths() -> list[Growth]:
    """Time searches of more and more candidates with a fiftieth of the epochs, and the plain loop over as many."""
    torch.set_num_threads(1)
    responses, epochs = load_responses("auto"), EPOCHS // 50
    curves, folds = responses.in_direction("inverse"), deal_folds(responses, "random", 0)
    plain_loop(curves, folds, (10,), 1)  # PyTorch starts up with what is first
    seconds = []
    for n in SIZES:
        start = time.perf_counter()
        naive_search(responses, m=1, strategy=Random(n), epochs=epochs)
        ours = time.perf_counter() - start
        trials = Random(n).propose(SearchSpace(), epochs, {})
        seconds.append([ours, sum(plain_loop(curves, folds, trial.hidden, epochs).seconds for trial in trials)])
    return [Growth("candidates", ("crfbench, all processes", "plain loop, one process"), SIZES, np.array(seconds))]


def main() -> None:
    """Print the times, the ratio, and how well the ranks agree."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sample", type=int, default=24, help="candidates of the plain loop")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads(), help="PyTorch's, in the plain loop")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    responses = load_responses("auto")
    print(f"{len(responses)} curves of {responses.dataset}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    report(compare(responses, options.sample))
    start = time.perf_counter()
    halved = naive_search(responses, strategy=Halving())
    print(f"successive halving: {(time.perf_counter() - start) / 60:.1f} min, chooses {halved.chosen}")
    for growth in growths():
        print_growth(growth)


def report(compared: Compared) -> None:
    """Print how the times compare, and whether both rank the sample alike."""
    plain, whole = compared.plain, compared.extrapolated()
    agreement = spearmanr([result.mse for result in plain.values()], compared.rows()["mse"]).statistic
    print(f"crfbench, {len(compared.table)} candidates in {N_FOLDS} folds: {compared.seconds / 60:.1f} min")
    print(f"plain loop, extrapolated from {len(plain)} of them: {whole / 60:.1f} min;", end=" ")
    print(f"{torch.get_num_threads()} threads, load {os.getloadavg()[0]:.1f}")
    print(f"ratio {whole / compared.seconds:.1f}; Spearman {agreement:.3f} on {len(plain)} candidates")


if __name__ == "__main__":
    main()
