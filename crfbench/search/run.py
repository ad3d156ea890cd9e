"""The naive architecture search of the paper's Algorithm 1: the M most accurate, of those the least complex."""

import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, as_completed
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from tqdm.auto import tqdm

from crfbench.checks import check_choice, check_count, check_seed
from crfbench.curves import Direction, check_direction
from crfbench.datasets import Responses
from crfbench.datasets.responses import Labels, grouped_folds
from crfbench.errors import InputError
from crfbench.parallel import local_workers, worker_error
from crfbench.search.result import Journal, SearchResult, mark_choice, tabulate
from crfbench.search.space import Hidden, Outcome, SearchSpace, Trial
from crfbench.search.stacked import Stack, train_stack
from crfbench.search.strategies import Strategy, find_strategy
from crfbench.training import TrainingConfig

N_FOLDS = 3
EPOCHS = 500
LEARNING_RATE = 5e-4
BLOCKS = 128
_BAR = "{desc} |{bar}| {percentage:3.0f} % [{elapsed}, {remaining} left]"
_STACK_WEIGHTS = 150_000  # of a stack's networks on one fold; larger stacks leave the processor's cache
_STACK_OVERHEAD = 20_000  # what one more stack costs, in weights


def search_architectures(
    responses: Responses,
    space: SearchSpace | None = None,
    m: int = 10,
    strategy: str | Strategy = "grid",
    *,
    direction: Direction = "inverse",
    folds: str = "random",
    seed: int = 0,
    epochs: int = EPOCHS,
    journal: str | Path | None = None,
    executor: Executor | None = None,
    progress: bool = False,
) -> SearchResult:
    """Search the space for the `m` most accurate architectures and choose the least complex of them.

    This is the paper's naive architecture search (Algorithm 1). Accuracy is the paper's: the MSE of held-out curves
    after encoder and decoder, in three-fold cross-validation of an SLR with one latent and LDL. A worker process that
    cannot be started or ends by itself is a `WorkerError`; the journal keeps what was done.

    Parameters
    ----------
    responses : Responses
    space : SearchSpace, optional
        By default the paper's 156 candidates.
    m : int
    strategy : str or callable
        "grid", "random", "halving", "optuna", or a function like those of `crfbench.search.strategies`.
    direction : {"inverse", "forward"}
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
        Any executor of the kind of `concurrent.futures`; by default one process a core of this machine.
    progress : bool
        Whether to show a bar with the time left.

    Examples
    --------
    >>> from crfbench import load_responses, search_architectures
    >>> result = search_architectures(load_responses("opencrf"), journal="search.jsonl")  # doctest: +SKIP
    >>> result.chosen, result.table.head(), result.pareto  # doctest: +SKIP
    """
    check_count("m", m)
    check_count("epochs", epochs)
    find_next = find_strategy(strategy)
    curves = responses.in_direction(check_direction(direction)).astype(np.float32)
    config = TrainingConfig(smoothness=0.0, seed=seed)  # of the stacks, which set their own rate and epochs
    base = Stack(curves, direction, make_folds(responses, folds, seed), (), config, BLOCKS)
    book = Journal(journal, search_settings(base))
    with nullcontext(executor) if executor else local_workers() as workers:
        run = partial(_train, base=base, workers=workers, progress=progress)
        outcomes = _explore(partial(find_next, space or SearchSpace(), epochs), book, run)
    return SearchResult(mark_choice(tabulate(outcomes), m))


def _explore(
    find_next: Callable[[dict[Trial, float]], Sequence[Trial]],
    book: Journal,
    run: Callable[[Sequence[Trial]], Iterator[Outcome]],
) -> list[Outcome]:
    """Ask the strategy and carry out what it proposes until it proposes nothing new.

    It is told of its own trials alone, whatever else the journal holds, so that after an interruption it proposes the
    same as it would have without.
    """
    held = {outcome.trial: outcome for outcome in book.outcomes}
    done: dict[Trial, Outcome] = {}
    while True:
        means = {trial: float(np.mean(outcome.mse)) for trial, outcome in done.items()}
        # A training that diverged is the worst; NaN would be in the way of sorting.
        figures = {trial: math.inf if math.isnan(mean) else mean for trial, mean in means.items()}
        new = [trial for trial in find_next(figures) if trial not in done]
        if not new:
            return list(done.values())
        missing = [trial for trial in new if trial not in held]
        for outcome in run(missing) if missing else ():
            book.append(outcome)
            held[outcome.trial] = outcome
        done |= {trial: held[trial] for trial in new}


def _train(trials: Sequence[Trial], base: Stack, workers: Executor, progress: bool) -> Iterator[Outcome]:
    """Yield outcomes as they come, under a bar that tells the time left."""
    futures, finished = {}, 0
    try:
        futures = {workers.submit(train_stack, stack): stack for stack in pack(trials, base)}
        with tqdm(total=sum(map(work, futures.values())), bar_format=_BAR, disable=not progress) as bar:
            bar.set_description_str(f"0 of {len(trials)} architectures")
            for future in as_completed(futures):
                yield from future.result()
                finished += len(futures[future].hidden)
                bar.set_description_str(f"{finished} of {len(trials)} architectures", refresh=False)
                bar.update(work(futures[future]))
    except (BrokenExecutor, OSError) as error:
        raise worker_error(error, "use the same journal") from error
    finally:
        for future in futures:
            future.cancel()


def make_folds(responses: Responses, folds: str, seed: int) -> Labels:
    """Return the fold of each response, shape (n,): at random, or whole units (films, near-copies) together."""
    check_choice("folds", folds, ("random", "grouped"))
    if len(responses) < 2 * N_FOLDS:
        raise InputError(f"{len(responses)} responses are too few for {N_FOLDS} folds; use {2 * N_FOLDS} or more")
    if folds == "grouped":
        return grouped_folds(responses.units, N_FOLDS)
    return np.random.default_rng(check_seed(seed)).permutation(len(responses)) % N_FOLDS


def search_config(hidden: Hidden, epochs: int = EPOCHS, seed: int = 0) -> TrainingConfig:
    """Return how a candidate is trained: with smaller steps where the first layer is wider than 50."""
    # With steps four times as large the figures are chaotic: the seventh digit of a curve decides the ranks.
    rate = LEARNING_RATE * min(1.0, math.sqrt(50 / hidden[0]))
    return TrainingConfig(hidden, epochs=epochs, learning_rate=rate, smoothness=0.0, seed=seed)


def search_settings(base: Stack) -> dict[str, str | int | float]:
    """Return what decides the results besides the candidates, as plain values."""
    digest = hashlib.sha256(np.ascontiguousarray(base.curves, dtype="<f4").tobytes() + base.folds.tobytes())
    settings = {"direction": base.direction, "seed": base.config.seed, "learning rate": LEARNING_RATE}
    return {**settings, "blocks": base.blocks, "curves and folds": digest.hexdigest()[:16]}


def pack(trials: Sequence[Trial], base: Stack) -> list[Stack]:
    """Stack trials of equal depth that differ in their last layer alone, the most laborious stacks first.

    `base` is a stack without candidates, with curves, folds and seed.
    """
    packs: dict[tuple[int, ...], list[list[Hidden]]] = {}
    for hidden, epochs in sorted(trials, key=lambda trial: trial[0]):
        alike = packs.setdefault((epochs, len(hidden), hidden[0], *hidden[1:-1]), [[]])
        if sum(map(_weights, alike[-1])) + _weights(hidden) > _STACK_WEIGHTS and alike[-1]:
            alike.append([])
        alike[-1].append(hidden)
    stacks = []
    for (epochs, *_), together in ((key, candidates) for key, alike in packs.items() for candidates in alike):
        # The first layers are the same, and so is the step size that depends on them.
        config = search_config(together[0], epochs, base.config.seed)
        stacks.append(replace(base, hidden=tuple(together), config=config))
    return sorted(stacks, key=work, reverse=True)


def work(stack: Stack) -> float:
    """Estimate what a stack costs, in any unit, to tell the time left."""
    return stack.config.epochs * float(sum(map(_weights, stack.hidden)) + _STACK_OVERHEAD)


def _weights(hidden: Hidden) -> int:
    """Count the weights of the thinned network, encoder and decoder."""
    return 2 * sum(before * after for before, after in pairwise((BLOCKS, *hidden, 1)))
