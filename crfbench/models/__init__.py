"""The response models, one file each, and the table that lists them."""

from crfbench.models.base import Prior, ResponseModel
from crfbench.models.emor import EMoR
from crfbench.models.gamma import Gamma
from crfbench.models.ggcm import GGCM
from crfbench.models.polynomial import Polynomial
from crfbench.models.ppisp import PPISP
from crfbench.models.ready import load_model
from crfbench.models.slr import SLR
from crfbench.models.table import MODELS

__all__ = ["GGCM", "MODELS", "PPISP", "SLR", "EMoR", "Gamma", "Polynomial", "Prior", "ResponseModel", "load_model"]
