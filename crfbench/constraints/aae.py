"""Adversarial autoencoder: a discriminator learns to tell latents from N(0, 1), the encoder to deceive it.

The paper's eq. on adversarial training; Makhzani et al. 2015, arXiv:1511.05644. The discriminator has two hidden
layers of 100. The encoder's loss is the non-saturating one, -log D(z).
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from crfbench.constraints.base import Constraint


class AAE(Constraint):
    """One step of the discriminator goes with each step of the autoencoder."""

    weights = (3e-3, 1e-4)

    def prepare(self, curves: Tensor) -> None:
        """Set up the discriminator and its own optimiser."""
        layers = [nn.Linear(self.n_latent, 100), nn.ReLU(), nn.Linear(100, 100), nn.ReLU(), nn.Linear(100, 1)]
        self.discriminator = nn.Sequential(*layers)
        self.optimiser = torch.optim.Adam(self.discriminator.parameters(), lr=1e-3, betas=(0.5, 0.999))
        self.loss = float("nan")

    def penalty(self, codes: Tensor, curves: Tensor) -> Tensor:
        """Train the discriminator by one step, then return the encoder's loss, -log D(z)."""
        drawn = torch.randn(codes.shape, generator=self.generator)
        # softplus(-s) is -log D, softplus(s) is -log(1 - D) of the score s; detached codes leave the encoder as it is.
        loss = functional.softplus(-self.discriminator(drawn)) + functional.softplus(self.discriminator(codes.detach()))
        self.optimiser.zero_grad()
        torch.autograd.backward(loss.mean())
        self.optimiser.step()
        self.loss = float(loss.mean().detach())
        return functional.softplus(-self.discriminator(codes)).mean()

    def logged(self) -> dict[str, float]:
        """Return the discriminator's loss; 2 log 2 = 1.386 when it can tell nothing."""
        return {"discriminator": self.loss}
