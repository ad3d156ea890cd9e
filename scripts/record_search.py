"""Record the architecture search on DoRF, and how much its figures move with the seed, in data/recorded."""

import argparse
import hashlib
import platform
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
import torch

import crfbench
from crfbench.datasets import Responses, load_dorf, registry
from crfbench.paper.results import record
from crfbench.search import SearchResult, search_architectures

SEEDS = range(5)


def main() -> None:
    """Search by grid with every seed and by halving; journals in a folder make it go on after an interruption."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--journals", type=Path, default=Path(tempfile.gettempdir()) / "crfbench-search")
    folder = parser.parse_args().journals
    responses, provenance = load_dorf(), _provenance()
    grids = {seed: _search(responses, "grid", seed, folder) for seed in SEEDS}
    print(record(grids[0].table, "search_dorf", provenance).name, grids[0].chosen)
    seeds = pd.concat([result.table.assign(seed=seed) for seed, result in grids.items()], ignore_index=True)
    print(record(seeds[["seed", "h1", "h2", "h3", "mse", "rank", "chosen"]], "search_seeds_dorf", provenance).name)
    halved = _search(responses, "halving", 0, folder)
    print(record(halved.table, "search_halving_dorf", provenance).name, halved.chosen)


def _search(responses: Responses, strategy: str, seed: int, folder: Path) -> SearchResult:
    start = time.perf_counter()
    journal = folder / f"{strategy}-{seed}.jsonl"
    result = search_architectures(responses, strategy=strategy, seed=seed, journal=journal, progress=True)
    print(f"{strategy}, seed {seed}: {(time.perf_counter() - start) / 60:.1f} min, {result.chosen}")
    return result


def _provenance() -> dict[str, str]:
    curves = registry.require("dorf/201_CRF_data.mat", "dorf")
    return {
        "crfbench": crfbench.__version__,
        "numpy": np.__version__,
        "torch": torch.__version__,
        "python": platform.python_version(),
        "command": "python scripts/record_search.py",
        f"sha256 of {curves.name}": hashlib.sha256(curves.read_bytes()).hexdigest(),
    }


if __name__ == "__main__":
    main()
