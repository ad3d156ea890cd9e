"""How the benchmarks take time, and the rows that they give."""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Row(NamedTuple):
    """One thing that crfbench does fast beside what one would take otherwise, both measured in the same minute.

    `ratio` is other_s / ours_s. All three numbers are None where the row could not be measured; `note` says why.
    """

    name: str
    ours_s: float | None
    other: str
    other_s: float | None
    ratio: float | None
    note: str


def row(name: str, ours_s: float, other: str, other_s: float, note: str = "") -> Row:
    """Return a row of what was measured."""
    return Row(name, ours_s, other, other_s, other_s / ours_s, note)


def skipped(name: str, reason: str) -> Row:
    """Return a row of what could not be measured."""
    return Row(name, None, "", None, None, f"skipped: {reason}")


def median_seconds(run: Callable[[], object], repeats: int) -> float:
    """Time a call several times and return the median."""
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))
