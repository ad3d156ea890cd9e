"""Every response model by its one name, such as ``SLR-ldl-1``, ``EMoR-3`` or ``GGCM-3-forward``.

A name is family, constraint (of networks: how the latent was shaped in training), number of parameters, and the
direction where it is not "inverse". It is spelled the same in Python, on the command line, in tables and records, and
as the name of a weights file. A new model gets its line in `MODELS` and joins the contract test and the fitting table.
"""

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from crfbench.curves import GRID, Direction, check_direction
from crfbench.datasets import load_emor_basis
from crfbench.errors import InputError
from crfbench.files import bundled, reading_npz
from crfbench.models.base import ClosedForm, Discrepancy, Prior, ResponseModel
from crfbench.models.emor import EMoR
from crfbench.models.gamma import Gamma
from crfbench.models.ggcm import GGCM
from crfbench.models.kernel import Kernel
from crfbench.models.polynomial import Polynomial
from crfbench.models.ppisp import PPISP
from crfbench.models.slr import SLR

#: Every model with a formula, and the numbers of parameters it is tabulated with.
MODELS: dict[type[ClosedForm], tuple[int, ...]] = {
    Gamma: (1,),
    Polynomial: (1, 2, 3, 4),
    GGCM: (1, 2, 3, 4),
    EMoR: (1, 2, 3, 4),
    PPISP: (4,),
    Kernel: (8,),
}

DEFAULT_MODEL = "Kernel-8"  # of all priors measured, the nearest to cameras that it has not seen

PRIORS = "data/dorf_priors.npz"
DISCREPANCIES = "data/discrepancies.npz"
WEIGHTS = "data/weights"

_NAME = re.compile(r"([a-z]+)(?:-([a-z]+))?-(\d+)(?:-(forward|inverse))?", re.IGNORECASE)


@dataclass(frozen=True, order=True)
class ModelKey:
    """What tells one model from all others; `str` gives its name.

    Parameters
    ----------
    family : str
        "Gamma", "Polynomial", "GGCM", "EMoR", "PPISP", "Kernel" or "SLR".
    constraint : str
        Of SLR: "baseline", "ldl", "auc", "aae", "vae", "monotone" (LDL with a monotone decoder) or "open" (the same
        trained on OpenCRF). Of EMoR: "published" for the basis of its authors. Empty for the others.
    n_params : int
    direction : {"inverse", "forward"}

    Examples
    --------
    >>> key = ModelKey.parse("slr-LDL-1")
    >>> key
    ModelKey(family='SLR', constraint='ldl', n_params=1, direction='inverse')
    >>> str(key), str(ModelKey("GGCM", "", 3, "forward"))
    ('SLR-ldl-1', 'GGCM-3-forward')
    """

    family: str
    constraint: str
    n_params: int
    direction: Direction = "inverse"

    def __str__(self) -> str:
        side = "" if self.direction == "inverse" else self.direction
        return "-".join(filter(None, (self.family, self.constraint, str(self.n_params), side)))

    @classmethod
    def parse(cls, name: object) -> "ModelKey":
        """Read a name in any case; whether such a model is bundled is not asked."""
        families = {family.lower(): family for family in (*(kind.name for kind in MODELS), SLR.name)}
        match = _NAME.fullmatch(name) if isinstance(name, str) else None
        if match is None or match[1].lower() not in families:
            raise InputError(f"name={name!r} is not a valid name of a model; use one such as 'SLR-ldl-1' or 'GGCM-3'")
        side = check_direction((match[4] or "inverse").lower())
        return cls(families[match[1].lower()], (match[2] or "").lower(), int(match[3]), side)

    @classmethod
    def of(cls, model: ResponseModel) -> "ModelKey":
        """Return the key of a model, which for a bundled one is that of its file or formula."""
        constraint = ""
        if isinstance(model, SLR):
            constraint = str(model.metadata_.get("constraint", "untrained"))
            if model.monotone:
                constraint = "open" if model.metadata_.get("data") == "opencrf" else "monotone"
        return cls(model.name, constraint, model.n_params, model.direction)

    def load(self) -> ResponseModel:
        """Load the model of this name, as `load_model` does; a damaged file is a `FormatError`."""
        if (self.family, self.constraint) == (EMoR.name, "published"):
            return EMoR(*load_emor_basis(self.direction), self.n_params, self.direction)
        if self not in bundled_models():
            same = [str(key) for key in bundled_models() if key.family == self.family] or map(str, bundled_models())
            raise InputError(f"no model {str(self)!r} is bundled; use one of {', '.join(same)}")
        if self.family == SLR.name:
            model: ResponseModel = SLR.load(bundled(WEIGHTS) / f"{self}.safetensors")
        else:
            model = self._formula()
        with reading_npz(bundled(DISCREPANCIES)) as missed:
            if f"{self}.factor" in missed:
                model.discrepancy_ = Discrepancy(missed[f"{self}.factor"], missed[f"{self}.scale_weight"])
        return model

    def _formula(self) -> ResponseModel:
        """Return a model with a formula; what EMoR and the kernel mixture learn lies beside the priors."""
        (kind,) = (kind for kind in MODELS if kind.name == self.family)
        with reading_npz(bundled(PRIORS)) as learned:
            if kind is EMoR or kind is Kernel:
                basis = learned[f"basis-{self.direction}" if kind is EMoR else f"{self}.basis"].astype(np.float64)
                model: ResponseModel = kind(basis[0], basis[1:], self.n_params, self.direction)
            else:  # the others learn nothing from curves, so any will do
                model = kind.from_curves(GRID, self.n_params, self.direction)
            if f"{self}.centres" in learned:
                model.prior_ = Prior.from_centres(learned[f"{self}.centres"], learned[f"{self}.weights"])
            elif f"{self}.mean" in learned:  # a model that is new in `MODELS` waits for scripts/build_priors.py
                model.prior_ = Prior(learned[f"{self}.mean"], learned[f"{self}.covariance"])
            return model


@cache
def channel_difference() -> Discrepancy:
    """Load how the channels of one camera differ from their mean."""
    with reading_npz(bundled(DISCREPANCIES)) as learned:
        return Discrepancy(learned["channels.factor"], learned["channels.scale_weight"])


def bundled_models() -> list[ModelKey]:
    """Return the keys of all models: the closed forms, which need a learned prior, then the pretrained networks."""
    sides: tuple[Direction, ...] = ("inverse", "forward")
    closed = [ModelKey(kind.name, "", k, side) for side in sides for kind, ks in MODELS.items() for k in ks]
    trained = sorted(ModelKey.parse(path.stem) for path in bundled(WEIGHTS).glob("*.safetensors"))
    return [*closed, *trained]


def pretrained_models(direction: Direction | None = None) -> list[ModelKey]:
    """Return the keys of the pretrained networks, of one direction or of both."""
    return [key for key in bundled_models() if key.family == SLR.name and direction in (None, key.direction)]


def load_model(name: str | ModelKey | Path) -> ResponseModel:
    """Load a bundled model with its prior, or a network of your own from a weights file.

    Its `prior_` is learned from the DoRF curves. "EMoR-3" has their principal components as crfbench computes them;
    "EMoR-published-3" has those that its authors publish (after ``crfbench fetch emor``, else a `MissingDataError`),
    without a prior. A weights file that is not there is a `MissingDataError`, a damaged one a `FormatError`.

    Parameters
    ----------
    name : str, ModelKey or Path
        Such as "SLR-ldl-1", "EMoR-3-forward", or a path that ends in ``.safetensors``.
    """
    if isinstance(name, ModelKey):
        return name.load()
    return SLR.load(name) if str(name).endswith(".safetensors") else ModelKey.parse(name).load()
