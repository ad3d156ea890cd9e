"""Many small autoencoders trained as one: stacked matrices, and one batched product a layer for all of them.

Every network takes the steps that `crfbench.training.Trainer` would take with it, from the same start. Two things make
the steps cheap:

- Candidates of equal depth, and all their folds, are stacked. Narrower ones are padded with neurons whose weights are
  zero; these stay zero, because their gradients are. The gradients are written by hand, into arrays made once.
- The two wide ends are thinned: a curve is represented by its means over blocks of neighbouring samples. Adam scales
  every gradient to the same size and so moves the weights of neighbouring samples alike; therefore a first layer that
  acts on sums over blocks learns what the full one learns. In the last layer the weights start at zero (and the biases
  at the mean curve), so that neighbours start alike too.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from crfbench.constraints.ldl import LDL
from crfbench.curves import N_SAMPLES, Direction
from crfbench.search.space import Hidden, Outcome
from crfbench.training import LEAST_CYCLE, Trainer, TrainingConfig, one_thread


@dataclass(frozen=True)
class Stack:
    """Candidates to train together on all folds, with everything that a worker needs to do so."""

    curves: np.ndarray  # shape (n, 1024)
    direction: Direction
    folds: np.ndarray  # shape (n,); each fold in turn is held out
    hidden: tuple[Hidden, ...]  # the candidates, of equal depth
    config: TrainingConfig  # for all of them; LDL and one latent, full batches, no smoothness. Its `hidden` is not used
    blocks: int  # how many means represent a curve; a divisor of 1024


def train_stack(stack: Stack) -> list[Outcome]:
    """Train every candidate on every fold and measure it on the curves held out; one outcome a candidate."""
    start = time.perf_counter()
    with one_thread():  # each worker has one core, and the products are too small to share
        networks = StackedNetworks(stack)
        for _ in range(stack.config.epochs):
            networks.epoch()
        squared = networks.held_out_mse()
    share = (time.perf_counter() - start) / len(stack.hidden)
    outcomes = []
    for hidden, folds in zip(stack.hidden, squared, strict=True):
        mse, rmse = tuple(float(fold.mean()) for fold in folds), tuple(float(np.sqrt(fold).mean()) for fold in folds)
        outcomes.append(Outcome(hidden, stack.config.epochs, mse, rmse, share))
    return outcomes


def initial_trainer(curves: np.ndarray, direction: Direction, config: TrainingConfig) -> Trainer:
    """Return the trainer of one network as a search starts it: output weights zero, so that it starts at the mean."""
    trainer = Trainer(curves, direction, config)
    torch.nn.init.zeros_(trainer.network.decoder[-1].get_parameter("weight"))
    return trainer


class StackedNetworks:
    """S networks, candidate by candidate and for each fold by fold, of L layers in all.

    For each layer `weights` hold a Tensor (S, in, out) and `biases` one of (S, 1, out).
    """

    def __init__(self, stack: Stack) -> None:
        self.stack = stack
        training = [stack.curves[stack.folds != fold] for fold in np.unique(stack.folds)]
        configs = [replace(stack.config, hidden=hidden) for hidden in stack.hidden]
        self._trainers = [initial_trainer(curves, stack.direction, each) for each in configs for curves in training]
        layers = [list(_thinned(trainer, stack.blocks)) for trainer in self._trainers]
        self.weights = [_pad([layer[0] for layer in same]) for same in zip(*layers, strict=True)]
        self.biases = [_pad([layer[1] for layer in same]) for same in zip(*layers, strict=True)]
        self._latent = len(self.weights) // 2
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
        activations = self._activations_of(block_means(curves, self.stack.blocks))
        self._forward(activations)
        decoded, width = activations[-1], N_SAMPLES // self.stack.blocks
        if width > 1:  # straight lines through block means at the middle of their blocks, held at the ends
            decoded = functional.interpolate(decoded, scale_factor=width, mode="linear", align_corners=False)
        mse = (decoded - curves).square().mean(dim=-1).unflatten(0, (len(self.stack.hidden), -1)).numpy()
        folds = np.unique(self.stack.folds)
        return [[row[self.stack.folds == fold] for row, fold in zip(rows, folds, strict=True)] for rows in mse]

    def _prepare_curves(self) -> None:
        """Make the training curves (S, n, blocks) and each curve's share in its fold's means (S, n, 1)."""
        curves = [trainer.curves for trainer in self._trainers]
        self._target = _pad([block_means(c, self.stack.blocks) for c in curves])
        self._mass = _pad([c.new_full((len(c), 1), 1.0 / len(c)) for c in curves])
        self._activations = self._activations_of(self._target)
        self._gradients = [torch.empty_like(activation) for activation in self._activations]

    def _prepare_steps(self) -> None:
        parameters = [*self.weights, *self.biases]
        for parameter in parameters:
            parameter.grad = torch.empty_like(parameter)
        rate, epochs = self.stack.config.learning_rate, self.stack.config.epochs
        self._adam = torch.optim.Adam(parameters, lr=rate, fused=True)
        one_cycle = torch.optim.lr_scheduler.OneCycleLR
        self._schedule = one_cycle(self._adam, rate, total_steps=max(epochs + 1, LEAST_CYCLE), pct_start=0.1)

    def _activations_of(self, blocks: Tensor) -> list[Tensor]:
        """Centre and scale curves as the encoder of each network wants them, and make arrays for what follows."""
        means = torch.stack([block_means(trainer._mean[None], self.stack.blocks) for trainer in self._trainers])
        scales = torch.stack([trainer._scale for trainer in self._trainers])[:, None, None]
        scaled = (blocks - means) * (N_SAMPLES // self.stack.blocks / scales)  # sums over blocks, not means
        return [scaled, *(scaled.new_empty(*scaled.shape[:2], w.shape[2]) for w in self.weights)]

    def _forward(self, activations: Sequence[Tensor]) -> None:
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True), start=1):
            torch.baddbmm(bias, activations[i - 1], weight, out=activations[i])
            if i not in {self._latent, len(self.weights)}:
                activations[i].relu_()
        activations[-1].sigmoid_()

    def _backward(self) -> None:
        """Write the gradients of MSE + weight x KL; activations that are not needed any more are overwritten."""
        y, out = self._activations[-1], self._gradients[-1]
        # d MSE / d raw output = 2 (y - x) y (1 - y) / blocks, times the curve's share.
        torch.sub(y, self._target, out=out)
        out.mul_(self._mass * (2.0 / self.stack.blocks)).mul_(y).mul_(y.neg_().add_(1.0))
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

    def _constraint_gradient(self, latents: Tensor) -> Tensor:
        """Differentiate LDL's KL divergence by each latent: share x (mean + (1 - 1 / variance) (z - mean))."""
        mean = (latents * self._mass).sum(dim=1, keepdim=True)
        off = latents - mean
        variance = (off.square() * self._mass).sum(dim=1, keepdim=True)
        return self._mass * (mean + (1.0 - 1.0 / variance) * off)


def _thinned(trainer: Trainer, blocks: int) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield weight (in, out) and bias (1, out) of each layer, the ends of width 1024 as means over blocks."""
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


def _pad(matrices: Sequence[Tensor]) -> Tensor:
    """Stack matrices of different shapes, with zeros below and to the right of the smaller ones."""
    rows, columns = (max(matrix.shape[axis] for matrix in matrices) for axis in (0, 1))
    return torch.stack([functional.pad(m, (0, columns - m.shape[1], 0, rows - m.shape[0])) for m in matrices])
