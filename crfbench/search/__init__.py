"""Naive architecture search (the paper's Algorithm 1): which widths of the hidden layers, at what complexity."""

from typing import TYPE_CHECKING

from crfbench.lazy import found_when_used
from crfbench.search.space import SearchSpace, complexity

if TYPE_CHECKING:
    from crfbench.search.result import SearchResult
    from crfbench.search.run import search_architectures

__all__ = ["SearchResult", "SearchSpace", "complexity", "search_architectures"]

# Searching needs PyTorch, which looking at results does not.
__getattr__ = found_when_used(__name__, {"search.result": "SearchResult", "search.run": "search_architectures"})
