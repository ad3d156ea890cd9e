"""Folds that keep related curves together, so that a test curve has no near copy in the training set."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from crfbench.checks import as_finite, check_count, check_number
from crfbench.curves import N_SAMPLES, as_curves
from crfbench.errors import InputError

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


def group_labels(units: Sequence[str]) -> Labels:
    """Return the number of each curve's unit, counted by first appearance; shape (n,)."""
    number = {unit: position for position, unit in enumerate(dict.fromkeys(units))}
    return np.array([number[unit] for unit in units], dtype=np.intp)


def grouped_folds(labels: ArrayLike, n_folds: int = 5) -> Labels:
    """Deal whole groups, labels (n,), to folds of about equal size and return the fold of each curve, shape (n,).

    The largest group goes first (of equals, the one that appears first), each to the fold that holds the fewest
    curves so far (of equals, the first). No chance is involved.
    """
    row = as_finite("labels", labels)
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
