"""OpenCRF: response curves that may be shared, from makers' film data sheets and published camera standards.

127 curves of 49 film stocks and 40 transfer functions of cameras. It holds no measured digital camera.
`data/SOURCES.md` tells where the numbers come from, `scripts/build_opencrf.py` how they were made.
"""

from pathlib import Path

import numpy as np

from crfbench.checks import check_choice
from crfbench.datasets.responses import Responses
from crfbench.errors import FormatError
from crfbench.files import NPZ_DAMAGE, check_sums
from crfbench.resources import shipped

TIERS = ("core", "hdr", "all")

_LABELS = {"names": "name", "units": "unit", "families": "family", "sources": "source", "licences": "licence"}


def load_opencrf(tier: str = "core") -> Responses:
    """Load OpenCRF.

    Parameters
    ----------
    tier : {"core", "hdr", "all"}
        "core": films, and transfer functions no steeper than measured responses are. "hdr": logarithmic
        curves that spend more than 40 % of the brightness on the darkest 1 % of the irradiance.

    Returns
    -------
    Responses
        151, 16 or 167 curves.

    Raises
    ------
    InputError
        For another tier.
    FormatError
        If the shipped file is missing or damaged.
    """
    check_choice("tier", tier, TIERS)
    responses, tiers = _read(shipped("data/opencrf.npz"))
    return responses if tier == "all" else responses.select(tiers == tier)


def _read(path: Path) -> tuple[Responses, np.ndarray]:
    """Read the whole file: the curves and the tier of each."""
    try:
        check_sums(path)
        with np.load(path, allow_pickle=False) as file:
            labels = {column: tuple(file[key].tolist()) for column, key in _LABELS.items()}
            return Responses("opencrf", file["curves"], **labels), file["tier"]
    except NPZ_DAMAGE as error:
        raise FormatError(f"{path} is missing or damaged ({error}); install crfbench again to restore it") from error
