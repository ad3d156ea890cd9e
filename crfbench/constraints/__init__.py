"""What shapes the latent during training; a new constraint is one file here and one line below."""

from crfbench.constraints.aae import AAE
from crfbench.constraints.auc import AUC
from crfbench.constraints.base import Constraint
from crfbench.constraints.baseline import Baseline
from crfbench.constraints.ldl import LDL
from crfbench.constraints.vae import VAE

CONSTRAINTS: dict[str, type[Constraint]] = {
    "baseline": Baseline,
    "ldl": LDL,
    "auc": AUC,
    "aae": AAE,
    "vae": VAE,
}

__all__ = ["AAE", "AUC", "CONSTRAINTS", "LDL", "VAE", "Baseline", "Constraint"]
