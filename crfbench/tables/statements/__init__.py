"""What the paper states outside its tables, checked one by one: `CHECKS` has a function for each statement."""

from crfbench.paper import STATEMENTS
from crfbench.tables.statements import calibration, data, fitting, training
from crfbench.tables.statements.finding import Check, Finding

__all__ = ["CHECKS", "Finding"]

_ALL: dict[str, Check] = {**data.CHECKS, **training.CHECKS, **fitting.CHECKS, **calibration.CHECKS}
#: The check of each of `crfbench.paper.STATEMENTS`, in their order.
CHECKS: dict[str, Check] = {key: _ALL[key] for key in STATEMENTS}
