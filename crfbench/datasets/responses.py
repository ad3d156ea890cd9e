"""Sets of response curves with what is known of each, folds that keep related ones together, and OpenCRF.

OpenCRF is the set that may be shared. Folds keep near copies together, so that a test curve has none in training.
"""

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from crfbench.checks import check_choice, check_count, check_number
from crfbench.curves import N_SAMPLES, Array, as_curves, as_valid_curves, check_direction, invert
from crfbench.errors import InputError
from crfbench.files import bundled, reading_npz

TIERS = ("core", "hdr", "all")


@dataclass(frozen=True, repr=False, eq=False)
class Responses:
    """Measured or published responses and, one entry a curve, where each comes from.

    Examples
    --------
    >>> load_opencrf()
    151 responses from opencrf, 73 units
    """

    dataset: str  # name of the set, for example "opencrf"
    # shape (n, 1024); forward responses (irradiance to brightness), monotone, from (0, 0) to (1, 1); kept read-only
    curves: Array
    names: tuple[str, ...]
    # the film, camera or standard that each curve belongs to: curves of one unit are not independent, so no split may
    # part them
    units: tuple[str, ...]
    families: tuple[str, ...]  # kind of each curve, for example "film-negative"
    sources: tuple[str, ...]  # where each curve was taken from
    licences: tuple[str, ...]  # SPDX identifier of the licence of each curve, or "unknown"

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
            use = f"use a mask of {len(self)} or whole numbers below {len(self)}"
            raise InputError(f"which={which!r} is not a valid selection; {use}") from None
        columns = {column.name: tuple(getattr(self, column.name)[row] for row in rows) for column in fields(self)[2:]}
        return Responses(self.dataset, self.curves[rows], **columns)


def load_opencrf(tier: str = "core") -> Responses:
    """Load OpenCRF: curves of 49 film stocks and 40 transfer functions of cameras; no measured digital camera.

    The tier "core" holds 151 curves of films, and transfer functions no steeper than measured responses are; "hdr" 16
    logarithmic curves that spend more than 40 % of the brightness on the darkest 1 % of the irradiance; "all" both.
    `data/SOURCES.md` tells where the numbers come from, `scripts/build_opencrf.py` how they were made. A bundled file
    that is missing or damaged is a `FormatError`.
    """
    check_choice("tier", tier, TIERS)
    with reading_npz(bundled("data/opencrf.npz")) as file:
        columns = (tuple(file[key].tolist()) for key in ("name", "unit", "family", "source", "licence"))
        responses, tiers = Responses("opencrf", file["curves"], *columns), file["tier"]
    return responses if tier == "all" else responses.select(tiers == tier)


Labels = np.ndarray[tuple[int], np.dtype[np.intp]]


def near_copies(curves: ArrayLike, tolerance: float = 0.01) -> Labels:
    """Group curves (n, 1024) that chain within an RMSE of `tolerance` (single linkage).

    Returns the group of each curve, numbered by first appearance, shape (n,).
    """
    from scipy.spatial.distance import pdist, squareform

    check_number("tolerance", tolerance, 0.0)
    # An RMSE is a Euclidean distance divided by the root of the number of samples.
    return chained(squareform(pdist(as_curves(curves))) / np.sqrt(N_SAMPLES) < tolerance)


def chained(related: np.ndarray) -> Labels:
    """Group what is related, directly or through others: from bool (n, n) to numbers (n,) by first appearance."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    return connected_components(csr_array(related), directed=False)[1].astype(np.intp)


def grouped_folds(labels: ArrayLike, n_folds: int = 5) -> Labels:
    """Deal whole groups, numbers or names (n,), to folds of about equal size; returns the fold of each curve, (n,).

    The largest group goes first (of equals, the one that appears first), each to the fold that holds the fewest
    curves so far (of equals, the first). No chance is involved.
    """
    row = np.asarray(labels)
    if row.ndim != 1:
        raise InputError(f"labels have shape {row.shape}; use one a curve, (n,)")
    groups, first, group, sizes = np.unique(row, return_index=True, return_inverse=True, return_counts=True)
    check_count("n_folds", n_folds, least=2)
    if n_folds > len(groups):
        raise InputError(f"n_folds={n_folds} is out of range for {len(groups)} groups; use at most one a group")
    # Largest first is the usual rule of thumb for even loads: the small groups that come last fill the gaps.
    load, fold = np.zeros(n_folds, dtype=np.intp), np.zeros(len(groups), dtype=np.intp)
    for member in np.lexsort((first, -sizes)):
        fold[member] = np.argmin(load)
        load[fold[member]] += sizes[member]
    return fold[group]
