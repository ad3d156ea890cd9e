"""Where the 24 patches lie between the four corners of a chart, in perspective.

Corners are the outer corners of the patches 1, 6, 24 and 19, in this order: clockwise from the dark skin patch. They
are fractions of the image's width and height, so that they hold for the RAW file and the JPEG alike.
"""

import numpy as np
from numpy.typing import ArrayLike

from crfbench.checks import as_numbers
from crfbench.curves import Array
from crfbench.datasets.middlebury import N_PATCHES
from crfbench.errors import InputError

COLUMNS, ROWS = 6, 4
# In widths of a patch. Charts have gaps of 0.1 to 0.15; over the chart this moves no centre by 0.05.
GAP = 0.1
SIZE: Array = np.array([COLUMNS * (1 + GAP) - GAP, ROWS * (1 + GAP) - GAP])
UNIT: Array = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float64)


def as_corners(corners: ArrayLike) -> Array:
    """Return `corners` as a float64 array if they can be those of a chart.

    Parameters
    ----------
    corners : array_like, shape (4, 2)
        x and y as fractions of the image, clockwise as seen.

    Raises
    ------
    InputError
        For another shape, positions outside the image, or corners that do not run clockwise round a convex area.
    """
    points = as_numbers("corners", corners).copy()
    if points.shape != (4, 2) or not ((points >= 0) & (points <= 1)).all():
        raise InputError(
            f"corners={points.tolist()} are not four pairs of x and y from 0 to 1; use fractions of the size"
        )
    sides = np.roll(points, -1, axis=0) - points
    following = np.roll(sides, -1, axis=0)
    if (sides[:, 0] * following[:, 1] - sides[:, 1] * following[:, 0] <= 1e-9).any():
        raise InputError(f"corners={points.tolist()} do not run clockwise round a convex area; list them clockwise")
    return points


def homography(source: Array, target: Array) -> Array:
    """Return the 3 x 3 projective map that takes four points, shape (4, 2), to four others."""
    import cv2

    return np.asarray(cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32)))


def project(matrix: Array, points: Array) -> Array:
    """Map points, shape (..., 2), by a homography."""
    mapped = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1) @ matrix.T
    return np.asarray(mapped[..., :2] / mapped[..., 2:])


def sample_positions(corners: Array, n: int, share: float) -> Array:
    """Return n x n positions in each patch, as fractions of the image.

    Parameters
    ----------
    corners : ndarray, shape (4, 2)
    n : int
        Positions a row and column.
    share : float
        Width of the inner box over which they spread, of the patch's width.

    Returns
    -------
    ndarray, shape (24, n * n, 2)
    """
    rows, columns = np.divmod(np.arange(N_PATCHES), COLUMNS)
    origins = np.column_stack([columns, rows]) * (1 + GAP) + 0.5
    offsets = ((np.arange(n) + 0.5) / n - 0.5) * share
    inner = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    return project(homography(SIZE * UNIT, corners), origins[:, None] + inner)


def chart_boxes(corners: Array) -> Array:
    """Return the outlines of the 24 patches, shape (24, 4, 2), as fractions of the image.

    Parameters
    ----------
    corners : ndarray, shape (4, 2)
    """
    rows, columns = np.divmod(np.arange(N_PATCHES), COLUMNS)
    origins = np.column_stack([columns, rows]) * (1 + GAP)
    return project(homography(SIZE * UNIT, corners), origins[:, None] + UNIT)
