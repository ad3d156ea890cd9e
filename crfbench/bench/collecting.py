"""Collect the rows of all benchmarks; each subject is measured in a process of its own, with one BLAS thread.

So no subject meets the threads, caches or memory that another one left behind.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from crfbench.bench.timing import Row, skipped
from crfbench.errors import InputError

SUBJECTS = (
    "imports",
    "fitting",
    "decoding",
    "training",
    "search",
    "calibration",
    "series",
    "linearise",
    "slider",
    "calibration_widget",
)
GROWING = ("fitting", "search", "calibration")


def collect(only: str | None = None) -> Iterator[Row]:
    """Measure every subject, or `only` one, and yield its rows as they come.

    Raises
    ------
    InputError
        For a subject that is not known.
    """
    if only is not None and only not in SUBJECTS:
        raise InputError(f"only={only!r} is no benchmark; use one of {', '.join(SUBJECTS)}")
    for subject in SUBJECTS if only is None else (only,):
        try:
            yield from (Row(*values) for values in json.loads(_apart("rows", subject)))
        except subprocess.CalledProcessError as error:  # the others took minutes and are worth keeping
            yield skipped(subject, f"its process ended with status {error.returncode}; what it said is above")


def to_text(row: Row) -> str:
    """Return a row as lines of text."""
    if row.ours_s is None or row.other_s is None:
        return f"{row.name}\n    {row.note}"
    times = f"crfbench {row.ours_s:.4f} s, {row.other} {row.other_s:.4f} s"
    return f"{row.name}\n    {row.ratio:.2f} x: {times}\n    {row.note}"


def draw_growth(folder: Path, only: str | None = None) -> Iterator[Path]:
    """Measure how the time of fits, searches and calibrations grows over two decades of work; yield each figure."""
    for subject in GROWING if only is None else {only}.intersection(GROWING):
        target = folder / f"time-{subject}.svg"
        _apart("plot", subject, str(target.resolve()))
        yield target


def _apart(*arguments: str) -> str:
    """Run ``python -m crfbench.bench`` and return what it prints; its errors go where ours go."""
    command = [sys.executable, "-m", "crfbench.bench", *arguments]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    return subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout
