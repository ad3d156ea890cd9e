"""The table of response models; a new model gets its line here and joins every test, figure and leaderboard."""

from crfbench.models.base import ResponseModel
from crfbench.models.emor import EMoR
from crfbench.models.gamma import Gamma
from crfbench.models.ggcm import GGCM
from crfbench.models.polynomial import Polynomial
from crfbench.models.ppisp import PPISP

#: Every model and the numbers of parameters it is tabulated with.
MODELS: dict[type[ResponseModel], tuple[int, ...]] = {
    Gamma: (1,),
    Polynomial: (1, 2, 3, 4),
    GGCM: (1, 2, 3, 4),
    EMoR: (1, 2, 3, 4),
    PPISP: (4,),
}
