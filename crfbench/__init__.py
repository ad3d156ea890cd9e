"""crfbench: a workbench for camera response functions.

>>> import crfbench
>>> responses = crfbench.load_responses("opencrf")
>>> model = crfbench.EMoR.from_curves(responses.curves, n_params=3, direction="forward")
>>> model.fit(responses.curves).shape
(151, 3)
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from crfbench.calibration import Calibration, Observations, calibrate
    from crfbench.datasets import Responses, load_patches, load_responses
    from crfbench.datasets.fetch import fetch
    from crfbench.models import GGCM, PPISP, SLR, EMoR, Gamma, Polynomial, ResponseModel, load_model
    from crfbench.tables.fitting import fitting_table

__version__ = "0.1.0"

# Names are found when first used, so that importing crfbench costs next to nothing.
_HOME = {
    "Calibration": "calibration",
    "EMoR": "models",
    "GGCM": "models",
    "Gamma": "models",
    "Observations": "calibration",
    "PPISP": "models",
    "Polynomial": "models",
    "ResponseModel": "models",
    "SLR": "models",
    "Responses": "datasets",
    "calibrate": "calibration",
    "fetch": "datasets.fetch",
    "fitting_table": "tables.fitting",
    "load_model": "models",
    "load_patches": "datasets",
    "load_responses": "datasets",
}

__all__ = [
    "GGCM",
    "PPISP",
    "SLR",
    "Calibration",
    "EMoR",
    "Gamma",
    "Observations",
    "Polynomial",
    "ResponseModel",
    "Responses",
    "calibrate",
    "fetch",
    "fitting_table",
    "load_model",
    "load_patches",
    "load_responses",
]


def __getattr__(name: str) -> object:
    if name in _HOME:
        return getattr(import_module(f"crfbench.{_HOME[name]}"), name)
    raise AttributeError(f"module 'crfbench' has no attribute {name!r}; it has {', '.join(__all__)}")


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
