"""How time grows with the work: measured by one benchmark, drawn the same way for all."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from crfbench.curves import Array
from crfbench.files import write_atomically


class Growth(NamedTuple):
    """Seconds, shape (n, methods), for n sizes of the work; `over` is what there is more and more of."""

    over: str
    methods: tuple[str, ...]
    sizes: tuple[int, ...]
    seconds: Array


def print_growth(growth: Growth) -> None:
    """Print seconds, and milliseconds for each unit of work."""
    print(f"\nseconds by number of {growth.over}")
    print(f"{growth.over:>8}" + "".join(f"{method:>22}{'ms each':>9}" for method in growth.methods))
    for n, seconds in zip(growth.sizes, growth.seconds, strict=True):
        print(f"{n:8d}" + "".join(f"{each:22.4f}{1e3 * each / n:9.3f}" for each in seconds))


def plot(growths: list[Growth], target: Path) -> None:
    """Draw seconds over size, doubly logarithmic, with a dotted guide that is proportional to the size (slope 1)."""
    from io import BytesIO

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
