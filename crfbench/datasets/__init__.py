"""Data sets: load them as arrays, know where they are, fetch the ones that are not shipped."""

from crfbench.checks import check_choice
from crfbench.datasets.dorf import load_dorf
from crfbench.datasets.emor_basis import load_emor_basis
from crfbench.datasets.middlebury import load_patches
from crfbench.datasets.opencrf import load_opencrf
from crfbench.datasets.responses import Responses
from crfbench.errors import MissingDataError

__all__ = ["Responses", "load_dorf", "load_emor_basis", "load_opencrf", "load_patches", "load_responses"]


def load_responses(which: str = "auto") -> Responses:
    """Load measured responses; the set that was chosen stands in `Responses.dataset`.

    Parameters
    ----------
    which : {"auto", "dorf", "opencrf"}
        "auto": DoRF where it is present, else the core of OpenCRF, which is always there.

    Returns
    -------
    Responses

    Raises
    ------
    InputError
        For another name.
    MissingDataError
        For "dorf" where it is absent.
    """
    if which == "auto":
        try:
            return load_dorf()
        except MissingDataError:
            return load_opencrf()
    loaders = {"dorf": load_dorf, "opencrf": load_opencrf}
    return loaders[check_choice("which", which, ("auto", *loaders))]()
