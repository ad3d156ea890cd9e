"""Decoding latents to curves: crfbench in NumPy beside PyTorch's own forward pass, same weights, one thread each."""

from functools import partial

import numpy as np
import torch

from benchmarks.timing import Row, median_seconds, row
from crfbench.models import SLR, load_model
from crfbench.training import to_torch


def rows(curves: int = 50_000, repeats: int = 5) -> list[Row]:
    """Time the plain and the monotone model."""
    torch.set_num_threads(1)
    return [_model(name, curves, repeats) for name in ("SLR-ldl-1", "SLR-monotone-1")]


def _model(name: str, curves: int, repeats: int) -> Row:
    model = load_model(name)
    assert isinstance(model, SLR)  # noqa: S101  for the type checker
    network, latents = to_torch(model), np.random.default_rng(0).normal(size=(curves, 1))
    with torch.inference_mode():
        ours = median_seconds(partial(model.decode, latents, np.float32), repeats)
        other = median_seconds(partial(network.decode, torch.as_tensor(latents, dtype=torch.float32)), repeats)
    note = f"one thread each, median of {repeats}"
    return row(f"decode {curves} latents, {name}", ours, "PyTorch, same weights", other, note)
