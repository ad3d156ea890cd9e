"""Measure the patch table from the modified Middlebury images and write data/middlebury_patches.csv.

Run: python scripts/build_patches.py (with CRFBENCH_DATA set, or after `crfbench fetch middlebury`).
"""

import os
from pathlib import Path

from crfbench.datasets.middlebury import measure_patches
from crfbench.datasets.registry import require

TARGET = Path(__file__).parents[1] / "data" / "middlebury_patches.csv"


def main() -> None:
    frame = measure_patches(require("middlebury/modified_Middlebury", "middlebury"))
    # Written aside and renamed, so that no reader ever sees half a table.
    partial = TARGET.with_suffix(".partial")
    try:
        frame.to_csv(partial, index=False, float_format="%.6f", lineterminator="\n")
        os.replace(partial, TARGET)
    finally:
        partial.unlink(missing_ok=True)
    print(f"{TARGET.name}: {frame['camera'].nunique()} cameras, {len(frame)} rows")


if __name__ == "__main__":
    main()
