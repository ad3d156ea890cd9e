"""Latent distribution learning: KL divergence of the latents' normal distribution to N(0, 1).

The paper, "Constraint on the latent distribution": with mu and sigma^2 the mean and variance of the latents of the
batch, KL = (mu^2 + sigma^2 - 2 log sigma - 1) / 2. Its variance lacks the 1/N, which is here.
"""

from torch import Tensor

from crfbench.constraints.base import Constraint, kl_to_standard_normal


class LDL(Constraint):
    """The latents of a batch, as a whole, are pulled to mean 0 and standard deviation 1."""

    weights = (1e-2, 1e-2)

    def penalty(self, codes: Tensor, curves: Tensor) -> Tensor:
        """Return the KL divergence, summed over the latents."""
        return kl_to_standard_normal(codes.mean(dim=0), codes.var(dim=0, unbiased=False))
