"""Which candidates to train next. A strategy keeps no state: all that it knows is what it is told has been done.

So a search that was interrupted goes on by asking again. A strategy is a function of a search space, the epochs of a
full training, and the MSE of each trial done so far; it returns the trials of the next round, and the search ends when
all of them are done. Its other options are set with `functools.partial`, as in ``partial(random, n=20)``.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from crfbench.checks import check_count, check_seed
from crfbench.errors import InputError, MissingDataError
from crfbench.search.space import Hidden, SearchSpace, Trial

Done = Mapping[Trial, float]
Strategy = Callable[[SearchSpace, int, Done], Sequence[Trial]]

_ASKS = 20  # for each new candidate that Optuna should find


def grid(space: SearchSpace, epochs: int, done: Done) -> list[Trial]:
    """Return every candidate, as the paper does."""
    return [(hidden, epochs) for hidden in space]


def random(space: SearchSpace, epochs: int, done: Done, n: int = 40, seed: int = 0) -> list[Trial]:
    """Return `n` random candidates, all different, or all there are (Bergstra and Bengio 2012, JMLR 13, 281-305)."""
    check_count("n", n)
    candidates = list(space)
    rows = np.random.default_rng(check_seed(seed)).permutation(len(candidates))[:n]
    return [(candidates[row], epochs) for row in rows]


def halving(space: SearchSpace, epochs: int, done: Done, rounds: int = 3, factor: int = 3) -> list[Trial]:
    """Train all candidates with few epochs, the best share of them with more, and so on (successive halving).

    From one round to the next, `factor` times fewer candidates and more epochs. Jamieson and Talwalkar 2016,
    "Non-stochastic best arm identification", arXiv:1502.07943.
    """
    check_count("rounds", rounds)
    check_count("factor", factor, least=2)
    candidates = list(space)
    for left in range(rounds - 1, -1, -1):
        trials = [(hidden, max(epochs // factor**left, 1)) for hidden in candidates]
        if left == 0 or any(trial not in done for trial in trials):
            break
        best = sorted(trials, key=lambda trial: done[trial])
        candidates = [hidden for hidden, _ in best[: -(-len(trials) // factor)]]
    return trials


def optuna(space: SearchSpace, epochs: int, done: Done, n: int = 40, batch: int = 8, seed: int = 0) -> list[Trial]:
    """Return up to `batch` new candidates by Optuna's tree-structured Parzen estimator, until there are `n`."""
    check_count("n", n)
    wanted = min(check_count("batch", batch), min(n, len(space)) - len(done))
    asked = [(hidden, epochs) for hidden in _ask(space, done, _ASKS * wanted, check_seed(seed))]
    rest = random(space, epochs, done, len(space), seed)  # where it asks for the same again and again
    new = dict.fromkeys(trial for trial in [*asked, *rest] if trial not in done)
    return list(new)[: max(wanted, 0)]


def _ask(space: SearchSpace, done: Done, count: int, seed: int) -> list[Hidden]:
    """Ask Optuna `count` times what to try, after telling it what is done."""
    try:
        import optuna
    except ModuleNotFoundError:
        raise MissingDataError("optuna is not installed; this strategy needs: pip install optuna") from None
    widths: dict[str, optuna.distributions.BaseDistribution] = {
        name: optuna.distributions.CategoricalDistribution(getattr(space, name)) for name in ("h1", "h2", "h3")
    }
    optuna.logging.set_verbosity(optuna.logging.WARNING)  # otherwise it writes a line for every study
    # A sampler that has asked is further along its random numbers; a seed of its own makes each round repeat.
    storage, sampler = optuna.storages.InMemoryStorage(), optuna.samplers.TPESampler(seed=seed + len(done))
    study = optuna.create_study(storage=storage, sampler=sampler)
    for (hidden, _), mse in done.items():
        params = dict(zip(widths, (*hidden, 0, 0), strict=False))
        study.add_trial(optuna.trial.create_trial(params=params, distributions=widths, value=mse))
    asked = [study.ask(widths).params for _ in range(count)]
    possible = [params for params in asked if params["h2"] or not params["h3"]]
    proposals = [tuple(width for width in params.values() if width) for params in possible]
    return [hidden for hidden in proposals if hidden in set(space)]


STRATEGIES: dict[str, Strategy] = {"grid": grid, "random": random, "halving": halving, "optuna": optuna}


def find_strategy(strategy: str | Strategy) -> Strategy:
    """Return the strategy of that name, or the function itself if it is one."""
    if isinstance(strategy, str) and strategy in STRATEGIES:
        return STRATEGIES[strategy]
    if callable(strategy):
        return strategy
    raise InputError(f"strategy={strategy!r} is not known; use one of {', '.join(STRATEGIES)} or a function like those")
