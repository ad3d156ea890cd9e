"""Decoding latents to curves: crfbench in NumPy beside PyTorch's own forward pass, same weights, one thread each.

Run it with: python -m crfbench.bench.decoding. The ratio is the claim; the rates are of this machine and this minute.
"""

import argparse
from functools import partial

import numpy as np
import torch

from crfbench.bench.timing import Row, median_seconds, row
from crfbench.models import SLR
from crfbench.training import to_torch


def rows(curves: int = 50_000, repeats: int = 5) -> list[Row]:
    """Time the plain and the monotone model."""
    torch.set_num_threads(1)
    return [_model(name, curves, repeats) for name in ("ldl", "monotone")]


def _model(name: str, curves: int, repeats: int) -> Row:
    model = SLR.load(name, 1, "inverse")
    network, latents = to_torch(model), np.random.default_rng(0).normal(size=(curves, 1))
    with torch.inference_mode():
        ours = median_seconds(partial(model.decode_float32, latents), repeats)
        other = median_seconds(partial(network.decode, torch.as_tensor(latents, dtype=torch.float32)), repeats)
    note = f"one thread each, median of {repeats}"
    return row(f"decode {curves} latents, SLR {name}", ours, "PyTorch, same weights", other, note)


def main() -> None:
    """Print the rates and the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--curves", type=int, default=50_000)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    for name, ours, _, other, ratio, _ in rows(options.curves, options.repeats):
        if ours and other:
            rates = f"crfbench {options.curves / ours:9.0f} curves/s   PyTorch {options.curves / other:9.0f} curves/s"
            print(f"{name:<36}{rates}   {ratio:5.2f} x")


if __name__ == "__main__":
    main()
