"""The naive architecture search of the paper's Algorithm 1: the M most accurate, of those the least complex."""

import hashlib
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, as_completed
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from tqdm.auto import tqdm

from crfbench.checks import check_choice, check_count, check_seed
from crfbench.curves import Array, Direction, check_direction
from crfbench.datasets import Responses
from crfbench.datasets.folds import Labels, group_labels, grouped_folds
from crfbench.errors import InputError
from crfbench.search.journal import Journal
from crfbench.search.outcome import Outcome
from crfbench.search.result import SearchResult, check_m, mark_choice, tabulate
from crfbench.search.space import Hidden, SearchSpace
from crfbench.search.stacked import Stack, train_stack
from crfbench.search.strategies import Strategy, Trial, find_strategy
from crfbench.search.workers import local_workers
from crfbench.training import Recipe

Folds = Literal["random", "grouped"]
N_FOLDS = 3
EPOCHS = 500
LEARNING_RATE = 5e-4
BLOCKS = 128
_BAR = "{desc} |{bar}| {percentage:3.0f} % [{elapsed}, {remaining} left]"
_STACK_WEIGHTS = 150_000  # of a stack's networks on one fold; larger stacks leave the processor's cache
_STACK_OVERHEAD = 20_000  # what one more stack costs, in weights


def search_recipe(hidden: Hidden, epochs: int = EPOCHS, seed: int = 0) -> Recipe:
    """Return how a candidate is trained: with smaller steps where the first layer is wider than 50.

    With steps four times as large the figures are chaotic: the seventh digit of a curve decides the ranks.
    """
    rate = LEARNING_RATE * min(1.0, math.sqrt(50 / hidden[0]))
    return Recipe(hidden, epochs=epochs, learning_rate=rate, smoothness=0.0, seed=seed)


@dataclass(frozen=True)
class Plan:
    """How each candidate is measured.

    Parameters
    ----------
    curves : ndarray, shape (n, 1024)
    direction : {"forward", "inverse"}
        Of the curves.
    folds : ndarray of int, shape (n,)
    seed : int
        Of the networks' first weights.
    """

    curves: Array
    direction: Direction
    folds: Labels
    seed: int

    def settings(self) -> dict[str, str | int | float]:
        """Return what decides the results besides the candidates, as plain values."""
        digest = hashlib.sha256(np.ascontiguousarray(self.curves, dtype="<f4").tobytes() + self.folds.tobytes())
        settings = {"direction": self.direction, "seed": self.seed, "learning rate": LEARNING_RATE, "blocks": BLOCKS}
        return {**settings, "curves and folds": digest.hexdigest()[:16]}

    def stacks(self, trials: Sequence[Trial]) -> list[Stack]:
        """Pack trials of equal depth that differ in their last layer alone, the most laborious stacks first."""
        packs: dict[tuple[int, ...], list[list[Trial]]] = {}
        for trial in sorted(trials, key=lambda trial: trial.hidden):
            alike = packs.setdefault((trial.epochs, len(trial.hidden), trial.hidden[0], *trial.hidden[1:-1]), [[]])
            if sum(map(_weights, alike[-1])) + _weights(trial) > _STACK_WEIGHTS and alike[-1]:
                alike.append([])
            alike[-1].append(trial)
        stacks = [self._stack(pack) for alike in packs.values() for pack in alike]
        return sorted(stacks, key=work, reverse=True)

    def _stack(self, trials: Sequence[Trial]) -> Stack:
        hidden, epochs = tuple(trial.hidden for trial in trials), trials[0].epochs
        recipe = search_recipe(hidden[0], epochs, self.seed)  # the same for all, for their first layers are
        return Stack(self.curves.astype(np.float32), self.direction, self.folds, hidden, recipe, BLOCKS)


def work(stack: Stack) -> float:
    """Estimate what a stack costs, in any unit, to tell the time left."""
    weights = sum(_weights(Trial(hidden, 1)) for hidden in stack.hidden)
    return stack.recipe.epochs * float(weights + _STACK_OVERHEAD)


def _weights(trial: Trial) -> int:
    """Count the weights of the thinned network, encoder and decoder."""
    widths = (BLOCKS, *trial.hidden, 1)
    return 2 * sum(before * after for before, after in pairwise(widths))


def deal_folds(responses: Responses, folds: str, seed: int) -> Labels:
    """Return the fold of each response, shape (n,): dealt at random, or whole units (films, near-copies) together.

    Raises
    ------
    InputError
        For folds that are not known, too few responses, or a seed that is none.
    """
    check_choice("folds", folds, get_args(Folds))
    if len(responses) < 2 * N_FOLDS:
        raise InputError(f"{len(responses)} responses are too few for {N_FOLDS} folds; use {2 * N_FOLDS} or more")
    if folds == "grouped":
        return grouped_folds(group_labels(responses.units), N_FOLDS)
    return np.random.default_rng(check_seed(seed)).permutation(len(responses)) % N_FOLDS


def naive_search(
    responses: Responses,
    space: SearchSpace | None = None,
    m: int = 10,
    strategy: str | Strategy = "grid",
    *,
    direction: Direction = "inverse",
    folds: str = "random",
    seed: int = 0,
    epochs: int = EPOCHS,
    journal: Path | None = None,
    executor: Executor | None = None,
    progress: bool = False,
) -> SearchResult:
    """Search the space for the `m` most accurate architectures and choose the least complex of them.

    Accuracy is the paper's: the MSE of held-out curves after encoder and decoder, in three-fold cross-validation of an
    SLR with one latent and LDL.

    Parameters
    ----------
    responses : Responses
    space : SearchSpace, optional
        By default the paper's 156 candidates.
    m : int
    strategy : str or Strategy
        "grid", "random", "halving", "optuna", or an object with a method `propose`.
    direction : {"forward", "inverse"}
        Of the curves to learn; calibration uses "inverse".
    folds : {"random", "grouped"}
        "grouped" keeps near-copies of a curve, and curves of one film or camera, in one fold.
    seed : int
        Of the random folds and of the networks' first weights.
    epochs : int
        Of a full training.
    journal : Path, optional
        Where results go as they come. A second call with the same arguments goes on where the first one stopped.
    executor : Executor, optional
        Any executor of the kind of `concurrent.futures`; by default one process a core of this machine, and then a
        script must call this under ``if __name__ == "__main__":``.
    progress : bool
        Whether to show a bar with the time left.

    Returns
    -------
    SearchResult

    Raises
    ------
    InputError
        For arguments that are not known or do not fit, or a journal of another search.

    Examples
    --------
    >>> from crfbench import load_responses
    >>> result = naive_search(load_responses("opencrf"), journal=Path("search.jsonl"))  # doctest: +SKIP
    >>> result.chosen, result.table.head(), result.pareto  # doctest: +SKIP
    """
    check_m(m)
    check_count("epochs", epochs)
    explorer = find_strategy(strategy)
    curves = responses.in_direction(check_direction(direction))
    plan = Plan(curves, direction, deal_folds(responses, folds, seed), seed)
    book = Journal(journal, plan.settings())
    with nullcontext(executor) if executor else local_workers() as workers:
        outcomes = _explore(explorer, space or SearchSpace(), epochs, _Bench(plan, book, workers, progress))
    return SearchResult(mark_choice(tabulate(outcomes), m), m)


@dataclass(frozen=True)
class _Bench:
    """Where trials are carried out."""

    plan: Plan
    book: Journal
    workers: Executor
    progress: bool


def _explore(strategy: Strategy, space: SearchSpace, epochs: int, bench: _Bench) -> list[Outcome]:
    """Ask the strategy and carry out what it proposes until it proposes nothing new.

    It hears of nothing but its own trials, so it proposes the same after an interruption as it would have without.
    """
    done: dict[Trial, Outcome] = {}
    while True:
        figures = {trial: _accuracy(outcome) for trial, outcome in done.items()}
        new = [trial for trial in strategy.propose(space, epochs, figures) if trial not in done]
        if not new:
            return list(done.values())
        done |= _carry_out(new, bench)


def _carry_out(trials: Sequence[Trial], bench: _Bench) -> dict[Trial, Outcome]:
    """Take the outcomes that the journal holds and train the rest."""
    held = {Trial(outcome.hidden, outcome.epochs): outcome for outcome in bench.book.outcomes}
    missing = [trial for trial in trials if trial not in held]
    for outcome in _train(missing, bench) if missing else ():
        bench.book.append(outcome)
        held[Trial(outcome.hidden, outcome.epochs)] = outcome
    return {trial: held[trial] for trial in trials}


def _train(trials: Sequence[Trial], bench: _Bench) -> Iterator[Outcome]:
    """Yield outcomes as they come, under a bar that tells the time left."""
    futures = {bench.workers.submit(train_stack, stack): stack for stack in bench.plan.stacks(trials)}
    finished = 0
    try:
        with tqdm(total=sum(map(work, futures.values())), bar_format=_BAR, disable=not bench.progress) as bar:
            bar.set_description_str(f"0 of {len(trials)} architectures")
            for future in as_completed(futures):
                yield from future.result()
                finished += len(futures[future].hidden)
                bar.set_description_str(f"{finished} of {len(trials)} architectures", refresh=False)
                bar.update(work(futures[future]))
    finally:
        for future in futures:
            future.cancel()


def _accuracy(outcome: Outcome) -> float:
    mse = float(np.mean(outcome.mse))
    return mse if math.isfinite(mse) else math.inf
