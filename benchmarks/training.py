"""Training one SLR beside a plain PyTorch loop: same network, same loss, same curves, one thread each.

The plain loop sees the curves as they are, starts from PyTorch's own first weights and takes steps of Adam with
PyTorch's settings. It stops at the loss that crfbench reaches, or at ten times as many epochs.
"""

from functools import partial

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from benchmarks.timing import Row, row, seconds_of
from crfbench import load_responses
from crfbench.constraints.ldl import LDL
from crfbench.curves import Array
from crfbench.models import SLR
from crfbench.training import Autoencoder, TrainingConfig, roughness, train

EPOCHS, PATIENCE = 300, 10  # of crfbench, and how many times as many the plain loop gets


def plain_loop(curves: Array, config: TrainingConfig, target: float, most: int) -> list[float]:
    """Train until the loss is `target`, for `most` epochs at the most; return the losses."""
    torch.manual_seed(config.seed)
    x, network = torch.tensor(curves, dtype=torch.float32), Autoencoder(SLR(config.hidden))
    constraint = LDL(x, 1, torch.Generator())
    optimiser = torch.optim.Adam(network.parameters())
    losses: list[float] = []
    while len(losses) < most and min(losses, default=np.inf) > target:
        loss = _loss(network, constraint, x, config)
        optimiser.zero_grad()
        torch.autograd.backward(loss)
        optimiser.step()
        losses.append(float(loss.detach()))
    return losses


def _loss(network: Autoencoder, constraint: LDL, x: Tensor, config: TrainingConfig) -> Tensor:
    codes = network.encode(x)
    y = network.decode(codes)
    penalty = constraint.weights[0] * constraint.penalty(codes, x)
    return functional.mse_loss(y, x) + penalty + config.smoothness * roughness(y)


def rows() -> list[Row]:
    """Time both to the same loss."""
    torch.set_num_threads(1)
    responses = load_responses("auto")
    curves, config = responses.in_direction("inverse"), TrainingConfig(epochs=EPOCHS)
    train(curves, "inverse", TrainingConfig(epochs=5))  # PyTorch's first steps take seconds
    ours_s, (_, history) = seconds_of(partial(train, curves, "inverse", config))
    target = float(history.losses["total"].min())
    plain_s, losses = seconds_of(partial(plain_loop, curves, config, target, PATIENCE * EPOCHS))
    note = (
        f"SLR-ldl-1 on {len(curves)} curves of {responses.dataset}; {EPOCHS} epochs to a loss of {target:.2e} "
        f"against {len(losses)} to {min(losses):.2e}"
    )
    if min(losses) > target:
        note += ", stopped there: the ratio is a lower bound"
    return [row("train one SLR", ours_s, "plain PyTorch loop, Adam", plain_s, note)]
