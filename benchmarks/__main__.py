"""The command line of the benchmarks: ``python -m benchmarks [SUBJECT ...] [--json] [--plots FOLDER]``."""

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.timing import Row, draw_growth, growths_of, noted, rows_of

SUBJECTS = (
    "imports",
    "fitting",
    "decoding",
    "training",
    "search",
    "calibration",
    "series",
    "real_series",
    "raw_photographs",
    "linearise",
    "slider",
    "accuracy",
)
GROWING = ("fitting", "search", "calibration", "series", "linearise")


def collect(subjects: Sequence[str] = SUBJECTS) -> Iterator[Row]:
    """Measure subject by subject and yield the rows; one that fails leaves the others theirs, which took minutes."""
    for subject in subjects:
        done = apart(rows_of, subject)
        if (error := done.exception()) is None:
            yield from done.result()
        else:
            yield noted(subject, f"failed: {type(error).__name__}: {error}")


def apart(function: Callable[[str], Any], subject: str) -> "Future[Any]":
    """Run a function in a new process, which meets no threads, caches or memory that another subject left behind."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        return executor.submit(function, subject)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the rows as they come, then draw how the time grows where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Leave the machine alone meanwhile.")
    parser.add_argument("subjects", nargs="*", metavar="SUBJECT", help=f"of {', '.join(SUBJECTS)}; default all")
    parser.add_argument("--json", action="store_true", help="print JSON rows instead of text")
    parser.add_argument("--plots", type=Path, metavar="FOLDER", help="draw there how the time grows")
    options = parser.parse_args(arguments)
    subjects = options.subjects or SUBJECTS
    if unknown := set(subjects) - set(SUBJECTS):
        parser.error(f"there is no benchmark {', '.join(sorted(unknown))}; use some of {', '.join(SUBJECTS)}")
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # of the processes that measure
    rows = []
    for row in collect(subjects):
        rows.append(row._asdict())
        if not options.json:
            print(row.text(), flush=True)
    if options.json:
        print(json.dumps(rows, indent=1))
    for subject in set(GROWING).intersection(subjects) if options.plots else ():
        target = options.plots / f"time-{subject}.svg"
        draw_growth(apart(growths_of, subject).result(), target)
        print(target, file=sys.stderr)


if __name__ == "__main__":
    main()
