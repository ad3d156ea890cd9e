"""crfbench: a workbench for camera response functions.

>>> import crfbench
>>> responses = crfbench.load_responses("opencrf")
>>> model = crfbench.EMoR.from_curves(responses.curves, n_params=3, direction="forward")
>>> model.fit(responses.curves).shape
(151, 3)
"""

from typing import TYPE_CHECKING

from crfbench.lazy import found_when_used

if TYPE_CHECKING:
    from crfbench import camera, paper, plots, widgets
    from crfbench.calibration import Observations, calibrate, learn_discrepancy
    from crfbench.calibration.colour import calibrate_colour
    from crfbench.camera.passport import linearise
    from crfbench.curves import invert
    from crfbench.datasets import load_patches, load_responses
    from crfbench.datasets.fetch import fetch
    from crfbench.history import load_history
    from crfbench.metrics import rmse
    from crfbench.models import GGCM, PPISP, SLR, EMoR, Gamma, Polynomial, load_model
    from crfbench.search import SearchSpace, search_architectures
    from crfbench.training import train

__version__ = "0.2.0"

__getattr__ = found_when_used(
    __name__,
    {
        "calibration": "Observations calibrate learn_discrepancy",
        "calibration.colour": "calibrate_colour",
        "camera.passport": "linearise",
        "curves": "invert",
        "datasets": "load_patches load_responses",
        "datasets.fetch": "fetch",
        "history": "load_history",
        "metrics": "rmse",
        "models": "EMoR GGCM Gamma PPISP Polynomial SLR load_model",
        "search": "SearchSpace search_architectures",
        "training": "train",
        "": "camera paper plots widgets",  # rooms
    },
)

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
    "calibrate_colour",
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


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
