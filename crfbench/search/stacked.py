"""Many small autoencoders trained as one: stacked matrices, and one batched product a layer for all of them.

Every network takes the steps that `crfbench.training.Trainer` would take with it, from the same start. Two things make
them cheap:

- Candidates of equal depth, and all their folds, are stacked; narrower ones are padded with neurons whose weights are
  zero, and these stay zero, for their gradients are. The gradients are written out, into arrays made once.
- The two wide ends are thinned: a curve is told by its means over blocks of neighbouring samples. Adam moves the
  weights of neighbouring samples alike, for it scales every gradient to the same size, so a first layer that acts on
  sums over blocks learns what the full one learns. Of the last layer, the weights start at zero (and its biases at
  the mean curve), so that neighbours start alike too.
"""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from crfbench.constraints.ldl import LDL
from crfbench.curves import N_SAMPLES, Direction
from crfbench.search.outcome import Outcome
from crfbench.search.space import Hidden
from crfbench.training import LEAST_CYCLE, Recipe, Trainer


@dataclass(frozen=True)
class Stack:
    """Candidates to train together on all folds, with all that a worker elsewhere needs for it.

    Parameters
    ----------
    curves : ndarray of float32, shape (n, 1024)
    direction : {"forward", "inverse"}
        Of the curves.
    folds : ndarray of int, shape (n,)
        Each fold in turn is held out.
    hidden : tuple of tuple of int
        The candidates, of equal depth.
    recipe : Recipe
        For all of them; LDL and one latent, full batches, no smoothness. Its `hidden` is not used.
    blocks : int
        How many means tell a curve; a divisor of 1024.
    """

    curves: np.ndarray
    direction: Direction
    folds: np.ndarray
    hidden: tuple[Hidden, ...]
    recipe: Recipe
    blocks: int


def train_stack(stack: Stack) -> list[Outcome]:
    """Train every candidate on every fold and measure it on the curves held out; one outcome a candidate."""
    start = time.perf_counter()
    with _one_thread():
        networks = StackedNetworks(stack)
        for _ in range(stack.recipe.epochs):
            networks.epoch()
        squared = networks.held_out_mse()
    share = (time.perf_counter() - start) / len(stack.hidden)
    return [
        Outcome(hidden, stack.recipe.epochs, _means(parts), _means(map(np.sqrt, parts)), share)
        for hidden, parts in zip(stack.hidden, squared, strict=True)
    ]


def initial_trainer(curves: np.ndarray, direction: Direction, recipe: Recipe) -> Trainer:
    """Return the trainer of one network as a search starts it: output weights zero, so that it starts at the mean."""
    trainer = Trainer(curves, direction, recipe)
    torch.nn.init.zeros_(trainer.network.decoder[-1].get_parameter("weight"))
    return trainer


class StackedNetworks:
    """S networks, candidate by candidate and in each fold by fold, of L layers in all.

    Parameters
    ----------
    stack : Stack

    Attributes
    ----------
    weights : list of Tensor, length L, shape (S, in, out)
    biases : list of Tensor, length L, shape (S, 1, out)
    """

    def __init__(self, stack: Stack) -> None:
        self.stack = stack
        starts = [_trainers(stack, hidden) for hidden in stack.hidden]
        self._trainers = [trainer for folds in starts for trainer in folds]
        layers = [list(_thinned(trainer, stack.blocks)) for trainer in self._trainers]
        self.weights = [_pad([layer[0] for layer in same]) for same in zip(*layers, strict=True)]
        self.biases = [_pad([layer[1] for layer in same]) for same in zip(*layers, strict=True)]
        self._latent = len(self.weights) // 2  # which activation is the latent
        self._prepare_curves()
        self._prepare_steps()

    def epoch(self) -> None:
        """Take one step with all curves of each network."""
        self._forward(self._activations)
        self._backward()
        self._adam.step()
        self._schedule.step()

    @torch.no_grad()
    def held_out_mse(self) -> list[list[np.ndarray]]:
        """Return the MSE of each held-out curve over its 1024 samples, candidate by candidate and fold by fold."""
        curves = torch.as_tensor(self.stack.curves, dtype=torch.float32)
        scaled = self._scaled(block_means(curves, self.stack.blocks))
        activations = [scaled, *(scaled.new_empty(*scaled.shape[:2], w.shape[2]) for w in self.weights)]
        self._forward(activations)
        decoded = _unblock(activations[-1], N_SAMPLES // self.stack.blocks)
        mse = (decoded - curves).square().mean(dim=-1).unflatten(0, (len(self.stack.hidden), -1)).numpy()
        folds = np.unique(self.stack.folds)
        return [[row[self.stack.folds == fold] for row, fold in zip(rows, folds, strict=True)] for rows in mse]

    def _prepare_curves(self) -> None:
        """Make the training curves (S, n, blocks) and each curve's share in its fold's means (S, n, 1)."""
        curves = [trainer.curves for trainer in self._trainers]
        self._target = _pad([block_means(c, self.stack.blocks) for c in curves])
        self._mass = _pad([c.new_full((len(c), 1), 1.0 / len(c)) for c in curves])
        scaled = self._scaled(self._target)
        self._activations = [scaled, *(scaled.new_empty(*scaled.shape[:2], w.shape[2]) for w in self.weights)]
        self._gradients = [torch.empty_like(activation) for activation in self._activations]

    def _prepare_steps(self) -> None:
        parameters = [*self.weights, *self.biases]
        for parameter in parameters:
            parameter.grad = torch.empty_like(parameter)
        rate, epochs = self.stack.recipe.learning_rate, self.stack.recipe.epochs
        self._adam = torch.optim.Adam(parameters, lr=rate, fused=True)
        one_cycle = torch.optim.lr_scheduler.OneCycleLR
        self._schedule = one_cycle(self._adam, rate, total_steps=max(epochs + 1, LEAST_CYCLE), pct_start=0.1)

    def _scaled(self, blocks: Tensor) -> Tensor:
        """Centre and scale as the encoder of each network wants it; sums over blocks, not means."""
        means = torch.stack([block_means(trainer._mean[None], self.stack.blocks) for trainer in self._trainers])
        scales = torch.stack([trainer._scale for trainer in self._trainers])[:, None, None]
        return (blocks - means) * (N_SAMPLES // self.stack.blocks / scales)

    def _forward(self, activations: Sequence[Tensor]) -> None:
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True), start=1):
            torch.baddbmm(bias, activations[i - 1], weight, out=activations[i])
            if i not in {self._latent, len(self.weights)}:
                activations[i].relu_()
        activations[-1].sigmoid_()

    def _backward(self) -> None:
        """Write the gradients of MSE + weight x KL by hand; activations that are done with are overwritten."""
        self._output_gradient()
        for i in range(len(self.weights), 0, -1):
            before, gradient = self._activations[i - 1], self._gradients[i]
            torch.bmm(before.mT, gradient, out=self.weights[i - 1].grad)
            torch.sum(gradient, dim=1, keepdim=True, out=self.biases[i - 1].grad)
            if i > 1:
                torch.bmm(gradient, self.weights[i - 1].mT, out=self._gradients[i - 1])
            if i - 1 == self._latent:
                self._gradients[i - 1].add_(self._constraint_gradient(before), alpha=LDL.weights[0])
            elif i > 1:
                self._gradients[i - 1].mul_(before.sign_())  # the slope of ReLU

    def _output_gradient(self) -> None:
        """d MSE / d raw output = 2 (y - x) y (1 - y) / blocks, times the curve's share."""
        y, gradient = self._activations[-1], self._gradients[-1]
        torch.sub(y, self._target, out=gradient)
        gradient.mul_(self._mass * (2.0 / self.stack.blocks)).mul_(y).mul_(y.neg_().add_(1.0))

    def _constraint_gradient(self, latents: Tensor) -> Tensor:
        """Differentiate LDL's KL divergence by each latent: share x (mean + (1 - 1 / variance) (z - mean))."""
        mean = (latents * self._mass).sum(dim=1, keepdim=True)
        off = latents - mean
        variance = (off.square() * self._mass).sum(dim=1, keepdim=True)
        return self._mass * (mean + (1.0 - 1.0 / variance) * off)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Keep PyTorch to one thread: each worker has one core, and the products are too small to share."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _trainers(stack: Stack, hidden: Hidden) -> list[Trainer]:
    recipe = replace(stack.recipe, hidden=hidden)
    training = [stack.curves[stack.folds != fold] for fold in np.unique(stack.folds)]
    return [initial_trainer(curves, stack.direction, recipe) for curves in training]


def _thinned(trainer: Trainer, blocks: int) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield weight (in, out) and bias (1, out) of each layer, the 1024-wide ends as means over blocks."""
    layers = [*trainer.network.encoder, *trainer.network.decoder]
    for i, layer in enumerate(layers):
        weight, bias = layer.get_parameter("weight").detach().T, layer.get_parameter("bias").detach()[None]
        if i == 0:
            weight = block_means(weight.T, blocks).T
        if i == len(layers) - 1:
            weight, bias = block_means(weight, blocks), block_means(bias, blocks)
        yield weight, bias


def block_means(curves: Tensor, blocks: int) -> Tensor:
    """Average (..., 1024) over blocks of neighbouring samples: (..., blocks)."""
    return curves.unflatten(-1, (blocks, -1)).mean(dim=-1)


def _unblock(means: Tensor, width: int) -> Tensor:
    """Draw straight lines through block means at the middle of their blocks, held at the ends."""
    if width == 1:
        return means
    return functional.interpolate(means, scale_factor=width, mode="linear", align_corners=False)


def _pad(matrices: Sequence[Tensor]) -> Tensor:
    """Stack matrices of different shapes, with zeros below and to the right of the smaller ones."""
    rows, columns = (max(matrix.shape[axis] for matrix in matrices) for axis in (0, 1))
    return torch.stack([functional.pad(m, (0, columns - m.shape[1], 0, rows - m.shape[0])) for m in matrices])


def _means(parts: Iterator[np.ndarray] | Sequence[np.ndarray]) -> tuple[float, ...]:
    return tuple(float(part.mean()) for part in parts)
