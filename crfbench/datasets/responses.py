"""Sets of response curves with what is known of each, and OpenCRF, the set that may be shared."""

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from crfbench.checks import check_choice
from crfbench.curves import Array, as_valid_curves, check_direction, invert
from crfbench.errors import FormatError, InputError
from crfbench.files import NPZ_DAMAGE, bundled, check_sums

TIERS = ("core", "hdr", "all")


@dataclass(frozen=True, repr=False, eq=False)
class Responses:
    """Measured or published responses and, one entry a curve, where each comes from.

    Parameters
    ----------
    dataset : str
        Name of the set, for example "opencrf".
    curves : array_like, shape (n, 1024)
        Forward responses (irradiance to brightness), monotone, from (0, 0) to (1, 1); kept read-only.
    names : tuple of str, length n
        Name of each curve.
    units : tuple of str, length n
        The film, camera or standard that each curve belongs to: curves of one unit are not independent,
        so no split may part them.
    families : tuple of str, length n
        Kind of each curve, for example "film-negative".
    sources : tuple of str, length n
        Where each curve was taken from.
    licences : tuple of str, length n
        SPDX identifier of the licence of each curve, or "unknown".

    Examples
    --------
    >>> load_opencrf()
    151 responses from opencrf, 73 units
    """

    dataset: str
    curves: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    families: tuple[str, ...]
    sources: tuple[str, ...]
    licences: tuple[str, ...]

    def __post_init__(self) -> None:
        # A copy that nobody can change: a split or a prior computed once stays right.
        curves = np.array(as_valid_curves(self.curves))
        curves.flags.writeable = False
        object.__setattr__(self, "curves", curves)
        for column in fields(self)[2:]:
            given = getattr(self, column.name)
            # Text would pass as one label a letter.
            if isinstance(given, str) or not isinstance(given, Iterable):
                raise InputError(f"{column.name}={given!r} is not a row of names; use one a curve")
            labels = tuple(given)
            if len(labels) != len(curves):
                raise InputError(f"{column.name} has {len(labels)} entries for {len(curves)} curves; use one a curve")
            object.__setattr__(self, column.name, labels)

    def __len__(self) -> int:
        """Return the number of curves."""
        return len(self.curves)

    def __repr__(self) -> str:
        return f"{len(self)} responses from {self.dataset}, {len(set(self.units))} units"

    def in_direction(self, direction: str) -> Array:
        """Return the curves as responses ("forward") or as inverse responses ("inverse"), shape (n, 1024)."""
        return self.curves if check_direction(direction) == "forward" else invert(self.curves)

    def select(self, which: ArrayLike) -> "Responses":
        """Return the chosen curves as a set of their own.

        Parameters
        ----------
        which : array_like of bool, shape (n,), or of int, shape (m,)
            A mask over the curves, or positions in the order wanted.
        """
        try:
            rows = np.atleast_1d(np.arange(len(self))[np.asarray(which)]).tolist()
        except (IndexError, ValueError):
            n = len(self)
            message = f"which={which!r} is not a valid selection; use a mask of {n} or whole numbers below {n}"
            raise InputError(message) from None
        columns = {column.name: tuple(getattr(self, column.name)[row] for row in rows) for column in fields(self)[2:]}
        return Responses(self.dataset, self.curves[rows], **columns)


def load_opencrf(tier: str = "core") -> Responses:
    """Load OpenCRF: curves of 49 film stocks and 40 transfer functions of cameras; no measured digital camera.

    `data/SOURCES.md` tells where the numbers come from, `scripts/build_opencrf.py` how they were made.

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
    FormatError
        If the bundled file is missing or damaged.
    """
    check_choice("tier", tier, TIERS)
    path = bundled("data/opencrf.npz")
    try:
        check_sums(path)  # NumPy would read altered numbers without a word
        with np.load(path, allow_pickle=False) as file:
            columns = (tuple(file[key].tolist()) for key in ("name", "unit", "family", "source", "licence"))
            responses, tiers = Responses("opencrf", file["curves"], *columns), file["tier"]
    except NPZ_DAMAGE as error:
        raise FormatError(f"{path} is missing or damaged ({error}); install crfbench again to restore it") from error
    return responses if tier == "all" else responses.select(tiers == tier)
