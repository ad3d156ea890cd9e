"""What a constraint is: it turns the encoder's output into latents and says how far they are from where they should be.

To add one, write a class with `penalty` in a file of its own, and give it a line in ``constraints/__init__.py``. It may
also have `prepare`, for what it learns from the training curves or trains beside the network, and `latents`, if the
encoder's output is not the latent itself.
"""

from abc import ABC, abstractmethod
from typing import ClassVar

import torch
from torch import Tensor


class Constraint(ABC):
    """A loss on the latents, built anew for each training.

    Parameters
    ----------
    curves : Tensor, shape (n, 1024)
        All training curves.
    n_latent : int
    generator : torch.Generator
        Every random number of the constraint comes from it.
    """

    #: How many numbers the encoder gives for each latent.
    codes_per_latent: ClassVar[int] = 1
    #: Weight of the penalty beside the reconstruction MSE, for one latent and for more.
    weights: ClassVar[tuple[float, float]]

    def __init__(self, curves: Tensor, n_latent: int, generator: torch.Generator) -> None:
        self.n_latent = n_latent
        self.generator = generator
        self.prepare(curves)

    def prepare(self, curves: Tensor) -> None:  # noqa: B027  most constraints need nothing
        """Set up what the penalty needs; `curves` (n, 1024) are all training curves."""

    def latents(self, codes: Tensor) -> Tensor:
        """Turn the encoder's output, (n, codes_per_latent x k), into the latents (n, k) to decode."""
        return codes

    @abstractmethod
    def penalty(self, codes: Tensor, curves: Tensor) -> Tensor:
        """Return the loss, a scalar, of the encoder's output for curves (n, 1024)."""

    def logged(self) -> dict[str, float]:
        """Return further figures of the last step, to be kept in the history."""
        return {}


def kl_to_standard_normal(mean: Tensor, variance: Tensor) -> Tensor:
    """KL divergence of N(mean, variance) to N(0, 1), summed over the last axis (the paper's closed form)."""
    return 0.5 * (mean**2 + variance - torch.log(variance) - 1.0).sum(dim=-1)
