"""Baseline: no constraint, the latent lies where reconstruction puts it."""

from torch import Tensor

from crfbench.constraints.base import Constraint


class Baseline(Constraint):
    """No penalty."""

    weights = (0.0, 0.0)

    def penalty(self, codes: Tensor, curves: Tensor) -> Tensor:
        """Return 0."""
        return codes.new_zeros(())
