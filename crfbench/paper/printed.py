"""The numbers of the paper's three tables, to compare with. What its text says stands in `crfbench.paper.claims`.

Zhao, Ferguson, Zhou and Rafferty, "Representing Camera Response Function by a Single Latent Variable and Fully
Connected Neural Network" (2022).
"""

from pathlib import Path

import pandas as pd

_HERE = Path(__file__).parent
#: Table 1, "DoRF curves fitting": mean RMSE as the paper calls it, of responses. Kept as text, for the digits printed
#: are part of the figure. SLR's constraint is not stated; LDL is the one that the paper recommends.
FITTING: dict[str, str] = pd.read_csv(_HERE / "table_1.csv", index_col="model", dtype=str)["mean_rmse"].to_dict()
#: Table 2, "Stability": total variance between inverse responses from 3, 6, 12 and 24 patches (Canon PowerShot G9).
STABILITY: dict[str, float] = {"SLR-ldl-1": 0.66, "Polynomial-3": 1.63, "GGCM-3": 8.11, "EMoR-3": 3.87}
_TABLE_3 = pd.read_csv(_HERE / "table_3.csv", index_col="model")
CALIBRATION_COLUMNS = tuple(_TABLE_3)
#: Table 3, "Camera radiometric calibration", of inverse responses.
CALIBRATION: dict[str, tuple[float, ...]] = {str(name): tuple(row) for name, row in _TABLE_3.T.items()}
SIGNIFICANT_RMSE = 0.005
