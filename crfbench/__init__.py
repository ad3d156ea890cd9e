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
    from crfbench import camera as camera
    from crfbench import paper as paper
    from crfbench import plots as plots
    from crfbench import widgets as widgets
    from crfbench.calibration import Observations as Observations
    from crfbench.calibration import calibrate as calibrate
    from crfbench.calibration import learn_discrepancy as learn_discrepancy
    from crfbench.calibration.colour import calibrate_colour as calibrate_colour
    from crfbench.camera.passport import linearise as linearise
    from crfbench.curves import invert as invert
    from crfbench.datasets import load_patches as load_patches
    from crfbench.datasets import load_responses as load_responses
    from crfbench.datasets.fetch import fetch as fetch
    from crfbench.history import load_history as load_history
    from crfbench.metrics import rmse as rmse
    from crfbench.models import GGCM as GGCM
    from crfbench.models import PPISP as PPISP
    from crfbench.models import SLR as SLR
    from crfbench.models import EMoR as EMoR
    from crfbench.models import Gamma as Gamma
    from crfbench.models import Polynomial as Polynomial
    from crfbench.models import load_model as load_model
    from crfbench.search import SearchSpace as SearchSpace
    from crfbench.search import search_architectures as search_architectures
    from crfbench.training import train as train

__version__ = "0.2.0"

_NAMES = {
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
}

__all__ = sorted(" ".join(_NAMES.values()).split())  # noqa: PLE0605  a list, though not a literal one

__getattr__ = found_when_used(__name__, _NAMES)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
