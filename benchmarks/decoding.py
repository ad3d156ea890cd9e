"""Decoding latents to curves: crfbench in NumPy beside PyTorch's own forward pass, same weights, one thread each.

Run it with: make bench. The ratio is the claim; the rates are of this machine and this minute.
"""

import argparse
import os
from functools import partial

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import torch
from timing import median_seconds

from crfbench.models import SLR
from crfbench.training import to_torch


def main() -> None:
    """Print the rates and the ratio for the plain and the monotone model."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--curves", type=int, default=50_000)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    torch.set_num_threads(1)
    latents = np.random.default_rng(0).normal(size=(options.curves, 1))
    tensor = torch.as_tensor(latents, dtype=torch.float32)
    for name in ("ldl", "monotone"):
        model = SLR.load(name, 1, "inverse")
        network = to_torch(model)
        with torch.inference_mode():
            ours = median_seconds(partial(model.decode_float32, latents), options.repeats)
            other = median_seconds(partial(network.decode, tensor), options.repeats)
        rates = f"crfbench {options.curves / ours:9.0f} curves/s   PyTorch {options.curves / other:9.0f} curves/s"
        print(f"{name:<10}{rates}   {other / ours:5.2f} x")


if __name__ == "__main__":
    main()
