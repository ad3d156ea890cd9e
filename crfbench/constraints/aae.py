"""Adversarial autoencoder: a discriminator learns to tell latents from N(0, 1), the encoder to deceive it.

The paper's eq. on adversarial training; Makhzani et al. 2015, arXiv:1511.05644. The discriminator has two hidden
layers of 100. The encoder's loss is the non-saturating one, -log D(z).
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from crfbench.constraints.base import Constraint


class AAE(Constraint):
    """One step of the discriminator goes with each step of the autoencoder.

    Parameters
    ----------
    curves : Tensor, shape (n, 1024)
        All training curves.
    n_latent : int
    generator : torch.Generator
    """

    weights = (3e-3, 1e-4)

    def __init__(self, curves: Tensor, n_latent: int, generator: torch.Generator) -> None:
        super().__init__(curves, n_latent, generator)
        layers = [nn.Linear(n_latent, 100), nn.ReLU(), nn.Linear(100, 100), nn.ReLU(), nn.Linear(100, 1)]
        self.discriminator = nn.Sequential(*layers)
        self.optimiser = torch.optim.Adam(self.discriminator.parameters(), lr=1e-3, betas=(0.5, 0.999))
        self.loss = float("nan")

    def penalty(self, codes: Tensor, curves: Tensor) -> Tensor:
        """Train the discriminator by one step, then return the encoder's loss, -log D(z)."""
        drawn = torch.randn(codes.shape, generator=self.generator)
        loss = functional.softplus(-self.discriminator(drawn)) + functional.softplus(self.discriminator(codes.detach()))
        self.optimiser.zero_grad()
        torch.autograd.backward(loss.mean())
        self.optimiser.step()
        self.loss = float(loss.mean().detach())
        return functional.softplus(-self.discriminator(codes)).mean()

    def logged(self) -> dict[str, float]:
        """Return the discriminator's loss; 2 log 2 = 1.386 when it can tell nothing."""
        return {"discriminator": self.loss}
