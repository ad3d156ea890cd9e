"""Models ready to calibrate with: their basis and prior learned from the DoRF curves beforehand."""

import numpy as np

from crfbench.curves import GRID, Direction, check_direction
from crfbench.errors import FormatError, InputError
from crfbench.files import NPZ_DAMAGE
from crfbench.models.base import Prior, ResponseModel
from crfbench.models.emor import EMoR
from crfbench.models.slr import SLR
from crfbench.models.table import MODELS
from crfbench.models.weights import shipped_weights
from crfbench.resources import shipped

LEARNED = "data/dorf_priors.npz"


def load_model(name: str, n_params: int = 1, direction: Direction = "inverse") -> ResponseModel:
    """Load a model with its prior.

    Parameters
    ----------
    name : str
        "Gamma", "Polynomial", "GGCM", "EMoR", "PPISP", or "SLR-" and the name of shipped weights, as "SLR-ldl".
    n_params : int
        Numbers of parameters that are shipped: 1 for Gamma, 4 for PPISP, 1 or 3 for SLR, 1 to 4 for the others.
    direction : {"forward", "inverse"}

    Returns
    -------
    ResponseModel
        With `prior_`. EMoR has the principal components of the DoRF curves, as crfbench computes them.

    Raises
    ------
    InputError
        For a name or number of parameters that is not shipped.
    FormatError
        When the shipped file is damaged.
    """
    check_direction(direction)
    if not isinstance(name, str):
        raise InputError(f"name={name!r} is no name of a model; use one such as 'Gamma' or 'SLR-ldl'")
    if name.startswith("SLR-"):
        return SLR.load(name.removeprefix("SLR-"), n_params, direction)
    key = f"{name}-{n_params}-{direction}"
    try:
        with shipped(LEARNED).open("rb") as file, np.load(file, allow_pickle=False) as learned:
            if f"{key}.mean" not in learned:
                raise InputError(f"no {name!r} with {n_params} parameters is shipped; there are {_offer(learned)}")
            model = _bare(name, n_params, direction, learned)
            model.prior_ = Prior(learned[f"{key}.mean"], learned[f"{key}.covariance"])
    except InputError:  # also a ValueError
        raise
    except NPZ_DAMAGE as error:
        raise FormatError(f"{LEARNED} is damaged ({error}); install crfbench again to restore it") from None
    return model


def _offer(learned: "np.lib.npyio.NpzFile") -> str:
    """List the names and numbers of parameters that `load_model` takes."""
    keys = [entry.removesuffix("-inverse.mean") for entry in learned if entry.endswith("-inverse.mean")]
    keys += [f"SLR-{name.removesuffix('-inverse')}" for name in shipped_weights() if name.endswith("-inverse")]
    counts: dict[str, list[str]] = {}
    for name, k in sorted(key.rsplit("-", 1) for key in keys):
        counts.setdefault(name, []).append(k)
    return ", ".join(f"{name} ({', '.join(ks)})" for name, ks in counts.items())


def _bare(name: str, n_params: int, direction: Direction, learned: "np.lib.npyio.NpzFile") -> ResponseModel:
    if name == EMoR.name:
        basis = learned[f"basis-{direction}"].astype(np.float64)
        return EMoR(basis[0], basis[1:], n_params, direction)
    (kind,) = [kind for kind in MODELS if kind.name == name]
    return kind.from_curves(GRID, n_params, direction)
