"""What a check finds, and the words it judges with."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from crfbench.paper import STATEMENTS
from crfbench.tables.evidence import Evidence


@dataclass(frozen=True)
class Finding:
    """What we found: our figure, what it ranges over, the function it comes from, the verdict, and why.

    Parameters
    ----------
    ours, how, verdict, why : str
    spread : str
        Empty where the figure has none.
    """

    ours: str
    how: str
    verdict: str
    why: str
    spread: str = ""


Range = tuple[float, float]
#: Checks one statement.
Check = Callable[[Evidence], Finding]


def counted(key: str, ours: int, how: str, why: str) -> Finding:
    """Judge a count: reproduced when it equals the printed one."""
    return Finding(str(ours), how, "reproduced" if str(ours) == STATEMENTS[key].figure else "differs", why)


def judged(*, ours: str, how: str, holds: bool | None, why: str, spread: str = "") -> Finding:
    """Judge a statement in words: it holds, does not hold, or (None) our figures say both."""
    verdict = "undecided" if holds is None else "holds" if holds else "does not hold"
    return Finding(ours, how, verdict, why, spread)


def is_least(own: Range, rivals: Iterable[Range]) -> bool | None:
    """Say whether a figure, given as the range (low, high) that it has, lies below all others; None where it may."""
    others = list(rivals)
    if all(own[1] < low for low, _ in others):
        return True
    return False if any(high < own[0] for _, high in others) else None
