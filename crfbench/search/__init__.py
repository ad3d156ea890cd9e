"""Naive architecture search (the paper's Algorithm 1): which widths of the hidden layers, at what complexity."""

from importlib import import_module
from typing import TYPE_CHECKING

from crfbench.search.space import SearchSpace, Trial, complexity
from crfbench.search.strategies import STRATEGIES, grid, halving, optuna, random

if TYPE_CHECKING:
    from crfbench.search.result import SearchResult, architecture, mark_choice, pareto_front
    from crfbench.search.run import search_architectures

# Found when first used: searching needs PyTorch, which looking at results does not.
_RESULT = ("SearchResult", "architecture", "mark_choice", "pareto_front")

__all__ = [
    "STRATEGIES",
    "SearchResult",
    "SearchSpace",
    "Trial",
    "architecture",
    "complexity",
    "grid",
    "halving",
    "mark_choice",
    "optuna",
    "pareto_front",
    "random",
    "search_architectures",
]


def __getattr__(name: str) -> object:
    if name in __all__:
        return getattr(import_module(f"crfbench.search.{'result' if name in _RESULT else 'run'}"), name)
    raise AttributeError(f"module 'crfbench.search' has no attribute {name!r}; it has {', '.join(__all__)}")
