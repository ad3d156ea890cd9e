"""Variational autoencoder: the encoder gives a normal distribution for each curve, and the latent is drawn from it.

Kingma and Welling 2014, arXiv:1312.6114. The KL divergence of each curve's distribution to N(0, 1) is the penalty.
"""

import torch
from torch import Tensor

from crfbench.constraints.base import Constraint, kl_to_standard_normal


class VAE(Constraint):
    """Codes are the mean and the log variance of each latent; inference uses the mean."""

    codes_per_latent = 2
    weights = (3e-4, 2e-5)

    def latents(self, codes: Tensor) -> Tensor:
        """Draw the latents: mean + standard deviation x noise."""
        # Mean plus scaled noise, rather than a draw from the distribution, lets gradients reach both.
        mean, log_variance = codes.chunk(2, dim=1)
        return mean + torch.exp(0.5 * log_variance) * torch.randn(mean.shape, generator=self.generator)

    def penalty(self, codes: Tensor, curves: Tensor) -> Tensor:
        """Return the mean over the curves of the KL divergence to N(0, 1)."""
        mean, log_variance = codes.chunk(2, dim=1)
        return kl_to_standard_normal(mean, log_variance.exp()).mean()
