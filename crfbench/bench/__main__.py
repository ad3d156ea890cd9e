"""Measure one subject in this process: ``python -m crfbench.bench rows SUBJECT``, or ``plot SUBJECT TARGET``."""

import json
import sys
from contextlib import redirect_stdout
from importlib import import_module
from pathlib import Path

from crfbench.bench.growth import plot
from crfbench.bench.timing import Row, skipped


def rows(subject: str) -> list[Row]:
    """Return the rows of a subject, or one that says what is missing."""
    try:
        with redirect_stdout(sys.stderr):  # what is printed on the way; stdout is for the rows alone
            return list(import_module(f"crfbench.bench.{subject}").rows())
    except ModuleNotFoundError as error:
        return [skipped(subject, f"{error.name} is not installed")]


def main() -> None:
    """Do what the command line says."""
    what, subject, *target = sys.argv[1:]
    if what == "plot":
        plot(import_module(f"crfbench.bench.{subject}").growths(), Path(target[0]))
    else:
        sys.stdout.write(json.dumps(rows(subject)))


if __name__ == "__main__":
    main()
