"""Which candidates to train next. A strategy keeps no state: all it knows is what it is told has been done.

So a search that was interrupted goes on by asking again. To add a strategy, write a class with `propose` and give it a
line in `STRATEGIES`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from crfbench.checks import check_count, check_seed
from crfbench.errors import InputError, MissingDataError
from crfbench.search.space import Hidden, SearchSpace

_ASKS = 20  # for each new candidate that Optuna should find


@dataclass(frozen=True)
class Trial:
    """A candidate and for how long to train it.

    Parameters
    ----------
    hidden : tuple of int
    epochs : int
    """

    hidden: Hidden
    epochs: int


@runtime_checkable
class Strategy(Protocol):
    """How a search space is explored."""

    def propose(self, space: SearchSpace, epochs: int, done: Mapping[Trial, float]) -> Sequence[Trial]:
        """Return trials of the next round; the search ends when all of them are done.

        Parameters
        ----------
        space : SearchSpace
        epochs : int
            Of a full training.
        done : mapping
            From each trial done so far to its MSE.
        """
        ...


@dataclass(frozen=True)
class Grid:
    """Every candidate, the paper's choice."""

    def propose(self, space: SearchSpace, epochs: int, done: Mapping[Trial, float]) -> list[Trial]:
        """Return all candidates."""
        return [Trial(hidden, epochs) for hidden in space]


@dataclass(frozen=True)
class Random:
    """A random sample of the candidates (Bergstra and Bengio 2012, JMLR 13, 281-305).

    Parameters
    ----------
    n : int
        How many candidates.
    seed : int
    """

    n: int = 40
    seed: int = 0

    def __post_init__(self) -> None:
        check_count("n", self.n)
        check_seed(self.seed)

    def propose(self, space: SearchSpace, epochs: int, done: Mapping[Trial, float]) -> list[Trial]:
        """Return `n` different candidates, or all if there are fewer."""
        candidates = list(space)
        rows = np.random.default_rng(self.seed).permutation(len(candidates))[: self.n]
        return [Trial(candidates[row], epochs) for row in rows]


@dataclass(frozen=True)
class Halving:
    """Successive halving: all candidates with few epochs, the best share of them with more, and so on.

    Jamieson and Talwalkar 2016, "Non-stochastic best arm identification", arXiv:1502.07943.

    Parameters
    ----------
    rounds : int
    factor : int
        From one round to the next, so many times fewer candidates and more epochs.
    """

    rounds: int = 3
    factor: int = 3

    def __post_init__(self) -> None:
        check_count("rounds", self.rounds)
        check_count("factor", self.factor, least=2)

    def propose(self, space: SearchSpace, epochs: int, done: Mapping[Trial, float]) -> list[Trial]:
        """Return the first round that is not complete."""
        candidates = list(space)
        for left in range(self.rounds - 1, -1, -1):
            trials = [Trial(hidden, max(epochs // self.factor**left, 1)) for hidden in candidates]
            if left == 0 or any(trial not in done for trial in trials):
                break
            best = sorted(trials, key=lambda trial: done[trial])
            candidates = [trial.hidden for trial in best[: -(-len(trials) // self.factor)]]
        return trials


@dataclass(frozen=True)
class Optuna:
    """Optuna's tree-structured Parzen estimator, `batch` candidates at a time (needs the extra ``optuna``).

    Parameters
    ----------
    n : int
        How many candidates in all.
    batch : int
    seed : int
    """

    n: int = 40
    batch: int = 8
    seed: int = 0

    def __post_init__(self) -> None:
        check_count("n", self.n)
        check_count("batch", self.batch)
        check_seed(self.seed)

    def propose(self, space: SearchSpace, epochs: int, done: Mapping[Trial, float]) -> list[Trial]:
        """Return what is done and up to `batch` new candidates, until there are `n`."""
        wanted = min(self.batch, min(self.n, len(space)) - len(done))
        asked = [Trial(hidden, epochs) for hidden in _ask(space, done, _ASKS * wanted, self.seed)]
        rest = Random(len(space), self.seed).propose(space, epochs, done)  # where it asks for the same again and again
        new = dict.fromkeys(trial for trial in [*asked, *rest] if trial not in done)
        return list(new)[: max(wanted, 0)]


def _ask(space: SearchSpace, done: Mapping[Trial, float], count: int, seed: int) -> list[Hidden]:
    """Ask Optuna `count` times what to try, after telling it what is done."""
    try:
        import optuna
    except ModuleNotFoundError:
        raise MissingDataError("optuna is not installed; this strategy needs: pip install 'crfbench[optuna]'") from None
    widths: dict[str, optuna.distributions.BaseDistribution] = {
        name: optuna.distributions.CategoricalDistribution(getattr(space, name)) for name in ("h1", "h2", "h3")
    }
    optuna.logging.set_verbosity(optuna.logging.WARNING)  # it tells of every study otherwise
    storage, sampler = optuna.storages.InMemoryStorage(), optuna.samplers.TPESampler(seed=seed + len(done))
    study = optuna.create_study(storage=storage, sampler=sampler)
    for trial, mse in done.items():
        params = dict(zip(widths, (*trial.hidden, 0, 0), strict=False))
        study.add_trial(optuna.trial.create_trial(params=params, distributions=widths, value=mse))
    asked = [study.ask(widths).params for _ in range(count)]
    proposals = [
        tuple(width for width in params.values() if width) for params in asked if params["h2"] or not params["h3"]
    ]
    return [hidden for hidden in proposals if hidden in set(space)]


STRATEGIES: dict[str, type[Strategy]] = {"grid": Grid, "random": Random, "halving": Halving, "optuna": Optuna}


def find_strategy(strategy: str | Strategy) -> Strategy:
    """Return the strategy of that name, or the object itself if it is one.

    Raises
    ------
    InputError
        For anything else.
    """
    if isinstance(strategy, str) and strategy in STRATEGIES:
        return STRATEGIES[strategy]()
    if isinstance(strategy, Strategy):
        return strategy
    raise InputError(f"strategy={strategy!r} is not known; use one of {', '.join(STRATEGIES)} or an object like those")
