"""Data sets: load them as arrays, know where they are, fetch the ones that are not bundled."""

from crfbench.checks import check_choice
from crfbench.datasets.dorf import load_dorf, load_emor_basis
from crfbench.datasets.middlebury import load_patches
from crfbench.datasets.responses import Responses, load_opencrf
from crfbench.errors import MissingDataError

__all__ = ["Responses", "load_dorf", "load_emor_basis", "load_opencrf", "load_patches", "load_responses"]


def load_responses(which: str = "auto") -> Responses:
    """Load measured responses; the set that was chosen stands in `Responses.dataset`.

    Parameters
    ----------
    which : {"auto", "dorf", "opencrf"}
        "auto": DoRF where it is present, else the core of OpenCRF, which is always there. "dorf" is a
        `MissingDataError` where it is absent.
    """
    loaders = {"dorf": load_dorf, "opencrf": load_opencrf}
    if check_choice("which", which, ("auto", *loaders)) != "auto":
        return loaders[which]()
    try:
        return load_dorf()  # a damaged file is told, not passed over
    except MissingDataError:
        return load_opencrf()
