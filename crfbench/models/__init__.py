"""The response models, one file each; a new model gets its line here and joins every test and table."""

from crfbench.models.base import Prior, ResponseModel
from crfbench.models.emor import EMoR
from crfbench.models.gamma import Gamma
from crfbench.models.ggcm import GGCM
from crfbench.models.polynomial import Polynomial
from crfbench.models.ppisp import PPISP
from crfbench.models.ready import load_model
from crfbench.models.slr import SLR

#: Every model and the numbers of parameters it is tabulated with.
MODELS: dict[type[ResponseModel], tuple[int, ...]] = {
    Gamma: (1,),
    Polynomial: (1, 2, 3, 4),
    GGCM: (1, 2, 3, 4),
    EMoR: (1, 2, 3, 4),
    PPISP: (4,),
}

__all__ = ["GGCM", "MODELS", "PPISP", "SLR", "EMoR", "Gamma", "Polynomial", "Prior", "ResponseModel", "load_model"]
