"""Record the calibration table by the paper's method, with 3 and with 24 patches; about three minutes.

Run: python scripts/record_calibration.py (with CRFBENCH_DATA set for the floor of DoRF's curves).
"""

import pandas as pd

import crfbench
from crfbench.paper.calibration import calibration_table
from crfbench.paper.results import record


def main() -> None:
    table = pd.concat([calibration_table(patches, "paper") for patches in ("3", "24")], ignore_index=True)
    provenance = {
        "crfbench": crfbench.__version__,
        "command": "python scripts/record_calibration.py",
        "data": "data/middlebury_patches.csv",
    }
    print(record(table, "calibration_paper", provenance).name, len(table), "rows")


if __name__ == "__main__":
    main()
