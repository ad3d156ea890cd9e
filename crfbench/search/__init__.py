"""Naive architecture search (the paper's Algorithm 1): which widths of the hidden layers, at what complexity."""

from typing import TYPE_CHECKING

from crfbench.search.result import SearchResult
from crfbench.search.space import SearchSpace, complexity
from crfbench.search.strategies import STRATEGIES, Grid, Halving, Optuna, Random, Strategy, Trial

if TYPE_CHECKING:
    from crfbench.search.run import naive_search

__all__ = [
    "STRATEGIES",
    "Grid",
    "Halving",
    "Optuna",
    "Random",
    "SearchResult",
    "SearchSpace",
    "Strategy",
    "Trial",
    "complexity",
    "naive_search",
]


def __getattr__(name: str) -> object:
    if name == "naive_search":  # it needs PyTorch, which looking at results does not
        from crfbench.search.run import naive_search

        return naive_search
    raise AttributeError(f"module 'crfbench.search' has no attribute {name!r}; it has {', '.join(__all__)}")
