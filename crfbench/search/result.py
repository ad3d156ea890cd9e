"""What a search finds: its journal on disk, the table of all candidates, and the choice from it."""

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from crfbench.checks import check_count
from crfbench.errors import FormatError, InputError
from crfbench.search.space import Hidden, Outcome, complexity

COLUMNS = (
    "h1", "h2", "h3", "mse", "mse_sd", "rmse", "complexity", "seconds", "rank", "chosen", "epochs",
)  # fmt: skip

_HEAD = b'{"settings": {'  # how the first line of a journal begins, whatever the search


class Journal:
    """The results of a search as they come, one line of JSON each, so that no interruption loses any.

    The path is that of a new file, or of the journal of an interrupted search with the same settings; without one,
    nothing is written. `settings` are all that decides the results, as plain values; they are the first line.
    """

    def __init__(self, path: str | Path | None, settings: Mapping[str, Any]) -> None:
        self.path = None if path is None else Path(path)
        self.outcomes: list[Outcome] = []
        if self.path is not None:
            self._open(self.path, settings)

    def _open(self, path: Path, settings: Mapping[str, Any]) -> None:
        content = path.read_bytes() if path.exists() else b""
        whole = content[: content.rfind(b"\n") + 1]
        if whole:
            held, self.outcomes = _parse(path, whole.splitlines())
            for name in {**held, **settings}:
                if held.get(name) != settings.get(name):
                    raise InputError(
                        f"{path.name} belongs to a search with {name}={held.get(name)!r}, this one has "
                        f"{settings.get(name)!r}; use another journal"
                    )
        elif content[: len(_HEAD)] != _HEAD[: len(content)]:
            raise FormatError(f"{path.name} is not a journal of a search; use another path")
        if len(whole) < len(content):  # a crash in the middle of a line leaves it without an end
            os.truncate(path, len(whole))
        if not whole:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._write({"settings": dict(settings)})

    def append(self, outcome: Outcome) -> None:
        """Add one outcome; when this returns, it is on the disk."""
        self._write(asdict(outcome))
        self.outcomes.append(outcome)

    def _write(self, row: Mapping[str, Any]) -> None:
        if self.path is not None:
            with self.path.open("ab") as file:
                file.write(json.dumps(row).encode() + b"\n")
                file.flush()
                os.fsync(file.fileno())


def _parse(path: Path, lines: list[bytes]) -> tuple[dict[str, Any], list[Outcome]]:
    try:
        first, *rows = [json.loads(line) for line in lines]
        return dict(first["settings"]), [
            Outcome(
                tuple(row["hidden"]), int(row["epochs"]), tuple(row["mse"]), tuple(row["rmse"]), float(row["seconds"])
            )
            for row in rows
        ]
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        raise FormatError(f"{path.name} is not a journal of a search; use another path") from None


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The results of all candidates, and the choice.

    The table has one row a candidate, most accurate first: neurons of the hidden layers (0 for none), mean MSE of the
    held-out curves, its standard deviation over the folds, their mean RMSE, weights and biases of the encoder, seconds
    of computing, rank by accuracy, whether it is the choice, epochs of training. Candidates that were trained for
    longer rank first: the others were given up before.
    """

    table: pd.DataFrame

    @property
    def chosen(self) -> Hidden:
        """The chosen architecture."""
        return architecture(self.table[self.table["chosen"]].iloc[0])

    @property
    def pareto(self) -> pd.DataFrame:
        """The candidates that no other beats in both accuracy and complexity, least complex first."""
        return pareto_front(self.table)


def architecture(row: pd.Series) -> Hidden:
    """Return the hidden layers that a row of the table describes, for example (50, 20)."""
    return tuple(int(row[name]) for name in ("h1", "h2", "h3") if row[name])


def tabulate(outcomes: Iterable[Outcome]) -> pd.DataFrame:
    """Return the table of a search, without a choice: of each candidate its longest training, most accurate first."""
    longest = {outcome.hidden: outcome for outcome in sorted(outcomes, key=lambda outcome: outcome.epochs)}
    rows = [
        {
            **dict(zip(("h1", "h2", "h3"), (*outcome.hidden, 0, 0), strict=False)),
            "mse": float(np.mean(outcome.mse)),
            "mse_sd": float(np.std(outcome.mse)),
            "rmse": float(np.mean(outcome.rmse)),
            "complexity": complexity(outcome.hidden),
            "seconds": outcome.seconds,
            "epochs": outcome.epochs,
        }
        for outcome in longest.values()
    ]
    table = pd.DataFrame(rows).sort_values(["epochs", "mse", "complexity"], ascending=[False, True, True])
    table["rank"] = np.arange(1, len(table) + 1)
    return table.assign(chosen=False).reset_index(drop=True)[list(COLUMNS)]


def mark_choice(table: pd.DataFrame, m: int) -> pd.DataFrame:
    """Return the table with the choice marked: the least complex of the `m` most accurate candidates."""
    best = table.nsmallest(check_count("m", m), "rank")
    return table.assign(chosen=table.index == best["complexity"].idxmin())


def pareto_front(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows, of the longest training, that no other beats in both accuracy and complexity."""
    rows = table[table["epochs"] == table["epochs"].max()].sort_values(["complexity", "mse"])
    return rows[rows["mse"] < rows["mse"].cummin().shift(fill_value=np.inf)]
