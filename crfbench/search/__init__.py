"""Naive architecture search (the paper's Algorithm 1): which widths of the hidden layers, at what complexity."""

from typing import TYPE_CHECKING

from crfbench.lazy import found_when_used
from crfbench.search.space import SearchSpace, Trial, complexity
from crfbench.search.strategies import STRATEGIES, grid, halving, optuna, random

if TYPE_CHECKING:
    from crfbench.search.result import SearchResult, architecture, mark_choice, pareto_front
    from crfbench.search.run import search_architectures

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

# Searching needs PyTorch, which looking at results does not.
__getattr__ = found_when_used(
    __name__,
    {"search.result": "SearchResult architecture mark_choice pareto_front", "search.run": "search_architectures"},
)
