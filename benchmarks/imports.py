"""``import crfbench`` beside ``import numpy``, each in a new Python; crfbench loads NumPy only when it is used."""

import subprocess
import sys
from functools import partial

from benchmarks.timing import Row, median_seconds, row

_REPEATS = 7


def rows() -> list[Row]:
    """Time both."""
    _start("import crfbench")  # the files are in the cache of the disk from now on
    ours, other = (median_seconds(partial(_start, f"import {name}"), _REPEATS) for name in ("crfbench", "numpy"))
    note = f"each in a new Python, median of {_REPEATS}; crfbench loads NumPy only when it is used"
    return [row("import crfbench", ours, "import numpy", other, note)]


def _start(code: str) -> None:
    subprocess.run([sys.executable, "-c", code], check=True)
