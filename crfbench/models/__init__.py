"""The response models, one file each, and the registry that names them."""

from crfbench.models.base import ClosedForm, Prior, ResponseModel
from crfbench.models.emor import EMoR
from crfbench.models.gamma import Gamma
from crfbench.models.ggcm import GGCM
from crfbench.models.kernel import Kernel
from crfbench.models.polynomial import Polynomial
from crfbench.models.ppisp import PPISP
from crfbench.models.registry import DEFAULT_MODEL, MODELS, ModelKey, bundled_models, load_model, pretrained_models
from crfbench.models.slr import SLR

__all__ = [
    "DEFAULT_MODEL",
    "GGCM",
    "MODELS",
    "PPISP",
    "SLR",
    "ClosedForm",
    "EMoR",
    "Gamma",
    "Kernel",
    "ModelKey",
    "Polynomial",
    "Prior",
    "ResponseModel",
    "bundled_models",
    "load_model",
    "pretrained_models",
]
