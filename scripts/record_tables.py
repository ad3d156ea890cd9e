"""Record the tables of data that may not be bundled, each with its provenance, in data/recorded."""

import hashlib
import platform

import numpy as np

import crfbench
from crfbench.datasets import registry
from crfbench.paper.fitting import fitting_tables
from crfbench.paper.results import record


def main() -> None:
    """Compute and write each record; DoRF and EMoR must be present."""
    files = [
        registry.require(path, key) for path, key in (("dorf/201_CRF_data.mat", "dorf"), ("dorf/emor.txt", "emor"))
    ]
    hashes = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    provenance = {
        "crfbench": crfbench.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
        "command": "python scripts/record_tables.py",
        **{f"sha256 of {name}": digest for name, digest in hashes.items()},
    }
    (table,) = fitting_tables("dorf").values()
    print(record(table, "fitting_dorf", provenance).name)


if __name__ == "__main__":
    main()
