"""How the benchmarks take time, the rows that they give, and the figure of how time grows with the work."""

import time
from collections.abc import Callable
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from crfbench.curves import Array
from crfbench.files import write_atomically

Result = TypeVar("Result")


class Row(NamedTuple):
    """One thing that crfbench does fast beside what one would take otherwise, both measured in the same minute.

    `ratio` is other_s / ours_s. The three numbers are None where no times are compared; `note` says what was found.
    """

    name: str
    ours_s: float | None
    other: str
    other_s: float | None
    ratio: float | None
    note: str

    def text(self) -> str:
        """Return the row as lines of text."""
        if self.ratio is None:
            return f"{self.name}\n    {self.note}"
        times = f"crfbench {self.ours_s:.4f} s, {self.other} {self.other_s:.4f} s"
        return f"{self.name}\n    {self.ratio:.2f} x: {times}\n    {self.note}"


class Growth(NamedTuple):
    """Seconds, shape (n, methods), for n sizes of the work; `over` is what there is more and more of."""

    over: str
    methods: tuple[str, ...]
    sizes: tuple[int, ...]
    seconds: Array


def row(name: str, ours_s: float, other: str, other_s: float, note: str = "") -> Row:
    """Return a row of what was measured."""
    return Row(name, ours_s, other, other_s, other_s / ours_s, note)


def noted(name: str, note: str) -> Row:
    """Return a row that compares no times."""
    return Row(name, None, "", None, None, note)


def median_seconds(run: Callable[[], object], repeats: int) -> float:
    """Time a call several times and return the median."""
    return float(np.median([seconds_of(run)[0] for _ in range(repeats)]))


def seconds_of(run: Callable[[], Result]) -> tuple[float, Result]:
    """Time a call; return the seconds and what it gave."""
    start = time.perf_counter()
    result = run()
    return time.perf_counter() - start, result


def draw_growth(growths: list[Growth], target: Path) -> None:
    """Draw seconds over size, doubly logarithmic, with a dotted guide that is proportional to the size (slope 1)."""
    import matplotlib.pyplot as plt

    from crfbench.plots import PALETTE

    figure, axes = plt.subplots(
        1, len(growths), figsize=(4.5 * len(growths), 3.6), sharey=True, squeeze=False, layout="constrained"
    )
    for ax, (over, methods, sizes, seconds) in zip(axes[0], growths, strict=True):
        for method, each, colour, marker in zip(methods, seconds.T, PALETTE, "osD^v", strict=False):
            ax.loglog(sizes, each, marker=marker, color=colour, label=method)
        guide = np.array(sizes) * seconds[-1, 0] / sizes[-1]
        ax.loglog(sizes, guide, ":", color="grey", label="proportional")
        ax.set(xlabel=f"number of {over}")
        ax.legend()
    axes[0, 0].set(ylabel="time (s)")
    buffer = BytesIO()
    figure.savefig(buffer, format=target.suffix[1:])
    plt.close(figure)
    write_atomically(target, buffer.getvalue())


# Here and not beside the command line: a new process cannot import what ``python -m`` runs.
def rows_of(subject: str) -> list[Row]:
    """Measure one subject in this process."""
    return list(import_module(f"benchmarks.{subject}").rows())


def growths_of(subject: str) -> list[Growth]:
    """Measure in this process how the time of one subject grows."""
    return list(import_module(f"benchmarks.{subject}").growths())
