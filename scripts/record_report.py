"""Record what the report shows and takes minutes: leaderboard, stability and trainings by seed, near-copies in DoRF.

Run: python scripts/record_report.py (DoRF must be present), after record_tables.py.
"""

import crfbench
from crfbench.paper import CALIBRATION
from crfbench.tables.calibration import camera_rmse_table
from crfbench.tables.evidence import near_copy_counts, stability_by_seed, trainings_by_seed
from crfbench.tables.leaderboard import measured_leaderboard
from crfbench.tables.recorded import record


def _name(row: tuple[str, str, int]) -> str:
    return " ".join(map(str, filter(None, row)))


def main() -> None:
    provenance = {"crfbench": crfbench.__version__, "command": "python scripts/record_report.py"}
    print(record(near_copy_counts(), "dorf_copies", provenance).name)
    print(record(stability_by_seed(), "stability_paper", provenance).name)
    print(record(trainings_by_seed(), "slr_trainings_dorf", provenance).name)
    forward = trainings_by_seed(["ldl"], direction="forward")
    print(record(forward, "slr_forward_trainings_dorf", provenance).name)
    cameras = camera_rmse_table("3", "paper", rows=list(CALIBRATION))[list(map(_name, CALIBRATION))].reset_index()
    print(record(cameras, "calibration_paper_cameras", provenance).name)
    print(record(measured_leaderboard(), "leaderboard", provenance).name)


if __name__ == "__main__":
    main()
