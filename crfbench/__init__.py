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
    from crfbench import camera, paper, plots, widgets
    from crfbench.calibration import Observations, calibrate, learn_discrepancy
    from crfbench.camera.passport import linearise
    from crfbench.curves import invert
    from crfbench.datasets import load_patches, load_responses
    from crfbench.datasets.fetch import fetch
    from crfbench.history import load_history
    from crfbench.metrics import rmse
    from crfbench.models import GGCM, PPISP, SLR, EMoR, Gamma, Polynomial, load_model
    from crfbench.search import SearchSpace, search_architectures
    from crfbench.training import train

__version__ = "0.1.0"

# Names are found when first used, so that importing crfbench costs next to nothing. The last four are rooms.
_HOME = {
    "EMoR": "models",
    "GGCM": "models",
    "Gamma": "models",
    "Observations": "calibration",
    "PPISP": "models",
    "Polynomial": "models",
    "SLR": "models",
    "SearchSpace": "search",
    "calibrate": "calibration",
    "fetch": "datasets.fetch",
    "invert": "curves",
    "learn_discrepancy": "calibration",
    "linearise": "camera.passport",
    "load_history": "history",
    "load_model": "models",
    "load_patches": "datasets",
    "load_responses": "datasets",
    "rmse": "metrics",
    "search_architectures": "search",
    "train": "training",
}

__all__ = [
    "GGCM",
    "PPISP",
    "SLR",
    "EMoR",
    "Gamma",
    "Observations",
    "Polynomial",
    "SearchSpace",
    "calibrate",
    "camera",
    "fetch",
    "invert",
    "learn_discrepancy",
    "linearise",
    "load_history",
    "load_model",
    "load_patches",
    "load_responses",
    "paper",
    "plots",
    "rmse",
    "search_architectures",
    "train",
    "widgets",
]


def __getattr__(name: str) -> object:
    if name in _HOME:
        return getattr(import_module(f"crfbench.{_HOME[name]}"), name)
    if name in __all__:
        return import_module(f"crfbench.{name}")
    raise AttributeError(f"module 'crfbench' has no attribute {name!r}; it has {', '.join(__all__)}")


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
