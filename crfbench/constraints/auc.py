"""Area under curve: the latent is taught to be the area between the curve and the diagonal.

The paper's label is iota = sum over the N = 1024 samples of (x_i - i/N), tens to hundreds in size. Here it is shifted
and scaled by its mean and standard deviation over the training curves, so that the latent compares with N(0, 1).
"""

import torch
from torch import Tensor
from torch.nn import functional

from crfbench.constraints.base import Constraint
from crfbench.errors import InputError


class AUC(Constraint):
    """Mean squared distance of the latent to the scaled label; for one latent only."""

    weights = (1e-2, 1e-2)

    def prepare(self, curves: Tensor) -> None:
        """Learn the scale of the labels."""
        if self.n_latent != 1:
            raise InputError(f"n_latent={self.n_latent} is out of range for 'auc', whose label is one number; use 1")
        areas = area(curves)
        self.mean, self.sd = areas.mean(), areas.std(unbiased=False)

    def penalty(self, codes: Tensor, curves: Tensor) -> Tensor:
        """Return the MSE of the latents to the labels."""
        return functional.mse_loss(codes, ((area(curves) - self.mean) / self.sd)[:, None])


def area(curves: Tensor) -> Tensor:
    """Return the paper's label of each curve, sum over i of (x_i - i/N); shape (n,)."""
    n = curves.shape[1]
    return (curves - torch.arange(1, n + 1) / n).sum(dim=1)
