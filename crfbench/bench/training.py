"""Training one SLR beside a plain PyTorch loop: same network, same loss, same curves, one thread each.

The plain loop sees the curves as they are, starts from PyTorch's own first weights and takes steps of
Adam, as PyTorch sets it. It stops at the loss that crfbench reaches, or at ten times as many epochs.
Run it with: python -m crfbench.bench.training.
"""

import time
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from crfbench import load_responses
from crfbench.bench.timing import Row, row
from crfbench.constraints.ldl import LDL
from crfbench.curves import Array
from crfbench.models import SLR
from crfbench.training import Autoencoder, Recipe, roughness, train

EPOCHS, PATIENCE = 300, 10  # of crfbench, and how many times as many the plain loop gets


class Trained(NamedTuple):
    """How long, how many epochs, and the lowest loss."""

    seconds: float
    epochs: int
    loss: float


def ours(curves: Array, recipe: Recipe) -> Trained:
    """Train as `crfbench.training.train` does."""
    start = time.perf_counter()
    history = train(curves, "inverse", recipe)[1]
    return Trained(time.perf_counter() - start, recipe.epochs, float(history.losses["total"].min()))


def plain_loop(curves: Array, recipe: Recipe, target: float, most: int) -> Trained:
    """Train until the loss is `target`, for `most` epochs at the most."""
    torch.manual_seed(recipe.seed)
    x, network = torch.tensor(curves, dtype=torch.float32), Autoencoder(SLR(recipe.hidden))
    constraint = LDL(x, 1, torch.Generator())
    optimiser = torch.optim.Adam(network.parameters())
    losses: list[float] = []
    start = time.perf_counter()
    while len(losses) < most and min(losses, default=np.inf) > target:
        loss = _loss(network, constraint, x, recipe)
        optimiser.zero_grad()
        torch.autograd.backward(loss)
        optimiser.step()
        losses.append(float(loss.detach()))
    return Trained(time.perf_counter() - start, len(losses), min(losses))


def _loss(network: Autoencoder, constraint: LDL, x: Tensor, recipe: Recipe) -> Tensor:
    codes = network.encode(x)
    y = network.decode(codes)
    penalty = constraint.weights[0] * constraint.penalty(codes, x)
    return functional.mse_loss(y, x) + penalty + recipe.smoothness * roughness(y)


def rows() -> list[Row]:
    """Time both to the same loss."""
    torch.set_num_threads(1)
    responses = load_responses("auto")
    curves, recipe = responses.in_direction("inverse"), Recipe(epochs=EPOCHS)
    ours(curves, Recipe(epochs=5))  # PyTorch's first steps take seconds
    mine = ours(curves, recipe)
    plain = plain_loop(curves, recipe, mine.loss, PATIENCE * EPOCHS)
    note = (
        f"SLR-ldl on {len(curves)} curves of {responses.dataset}; {mine.epochs} epochs to a loss of {mine.loss:.2e} "
        f"against {plain.epochs} to {plain.loss:.2e}"
    )
    if plain.loss > mine.loss:
        note += ", stopped there: the ratio is a lower bound"
    return [row("train one SLR", mine.seconds, "plain PyTorch loop, Adam", plain.seconds, note)]


def main() -> None:
    """Print the row."""
    for name, seconds, other, other_seconds, ratio, note in rows():
        print(f"{name}: {seconds:.1f} s; {other}: {other_seconds:.1f} s; {ratio:.1f} x; {note}")


if __name__ == "__main__":
    main()
