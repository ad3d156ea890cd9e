"""What a check finds, and the words it judges with."""

from collections.abc import Callable
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


#: Checks one statement.
Check = Callable[[Evidence], Finding]


def counted(key: str, ours: int, how: str, why: str) -> Finding:
    """Judge a count: reproduced when it equals the printed one."""
    return Finding(str(ours), how, "reproduced" if str(ours) == STATEMENTS[key].figure else "differs", why)


def judged(*, ours: str, how: str, holds: bool, why: str, spread: str = "") -> Finding:
    """Judge a statement in words."""
    return Finding(ours, how, "holds" if holds else "does not hold", why, spread)
