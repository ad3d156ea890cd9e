"""What training one candidate on every fold gave."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

from crfbench.search.space import Hidden


@dataclass(frozen=True)
class Outcome:
    """What the folds of one candidate gave.

    Parameters
    ----------
    hidden : tuple of int
    epochs : int
    mse, rmse : tuple of float
        One a fold: the mean over its held-out curves.
    seconds : float
        The candidate's share of the time of those it was trained with.
    """

    hidden: Hidden
    epochs: int
    mse: tuple[float, ...]
    rmse: tuple[float, ...]
    seconds: float

    def to_row(self) -> dict[str, Any]:
        """Return plain values by name."""
        return asdict(self)

    @classmethod
    def from_row(cls, row: Mapping[str, Any]) -> Self:
        """Build what `to_row` took apart, also after a way through JSON."""
        lists = {name: tuple(row[name]) for name in ("hidden", "mse", "rmse")}
        return cls(epochs=int(row["epochs"]), seconds=float(row["seconds"]), **lists)
