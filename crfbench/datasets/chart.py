"""The ColorChecker chart of 24 patches: their published colours, where they lie in a photograph, and marked corners.

Corners are the outer corners of the patches 1, 6, 24 and 19, in this order: clockwise from the dark skin patch. They
are fractions of the image's width and height, so that they hold for the RAW file and the JPEG alike.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from crfbench.checks import as_numbers, unique_names
from crfbench.curves import Array
from crfbench.errors import FormatError, InputError
from crfbench.files import write_atomically

# McCamy, Marcus and Davidson 1976, "A Color-Rendition Chart", Journal of Applied Photographic Engineering 2(3), 95-99:
# CIE 1931 x, y, Y of every patch under illuminant C, in chart order (row by row from dark skin to black), with Y = 1
# for a perfect reflector.
_XYY: Array = np.array(
    [
        [(0.4002, 0.3504, 0.1005), (0.3773, 0.3446, 0.3582), (0.2470, 0.2514, 0.1933)],
        [(0.3372, 0.4220, 0.1329), (0.2651, 0.2400, 0.2427), (0.2608, 0.3430, 0.4306)],
        [(0.5060, 0.4070, 0.3005), (0.2110, 0.1750, 0.1200), (0.4533, 0.3058, 0.1977)],
        [(0.2845, 0.2020, 0.0656), (0.3800, 0.4887, 0.4429), (0.4729, 0.4375, 0.4306)],
        [(0.1866, 0.1285, 0.0611), (0.3046, 0.4782, 0.2339), (0.5385, 0.3129, 0.1200)],
        [(0.4480, 0.4703, 0.5910), (0.3635, 0.2325, 0.1977), (0.1958, 0.2519, 0.1977)],
        [(0.3101, 0.3163, 0.9001), (0.3101, 0.3163, 0.5910), (0.3101, 0.3163, 0.3620)],
        [(0.3101, 0.3163, 0.1977), (0.3101, 0.3163, 0.0900), (0.3101, 0.3163, 0.0313)],
    ]
).reshape(-1, 3)
_WHITE_C, _WHITE_D65 = (0.31006, 0.31616), (0.3127, 0.3290)
_BRADFORD: Array = np.array([(0.8951, 0.2664, -0.1614), (-0.7502, 1.7135, 0.0367), (0.0389, -0.0685, 1.0296)])
_XYZ_TO_SRGB: Array = np.array([(3.2406, -1.5372, -0.4986), (-0.9689, 1.8758, 0.0415), (0.0557, -0.2040, 1.0570)])

COLUMNS, ROWS = 6, 4
N_PATCHES = COLUMNS * ROWS
CLIPPED_SHARE = 0.02  # of the pixels of a patch, from which on the whole patch counts as clipped
# In widths of a patch. Charts have gaps of 0.1 to 0.15; over the chart this moves no centre by 0.05.
GAP = 0.1
SIZE: Array = np.array([COLUMNS * (1 + GAP) - GAP, ROWS * (1 + GAP) - GAP])
UNIT: Array = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float64)

_LABELS_VERSION = 1


def chart_colours() -> Array:
    """Return linear sRGB of the 24 patches in chart order, shape (24, 3); 1 is a perfect reflector.

    The published colours, adapted to D65 after Bradford and made linear sRGB (IEC 61966-2-1). The red of the cyan
    patch lies outside sRGB and is negative.
    """
    sharpened = _xyz(_XYY) @ _BRADFORD.T
    white_c, white_d65 = (_xyz(np.array([*white, 1.0])) @ _BRADFORD.T for white in (_WHITE_C, _WHITE_D65))
    adapted = sharpened * (white_d65 / white_c) @ np.linalg.inv(_BRADFORD).T
    return adapted @ _XYZ_TO_SRGB.T


def _xyz(xyy: Array) -> Array:
    x, y, luminance = np.moveaxis(xyy, -1, 0)
    return np.stack([x, y, 1.0 - x - y], axis=-1) * (luminance / y)[..., None]


def as_corners(corners: ArrayLike) -> Array:
    """Return corners (4, 2), fractions of the image, as float64 if they run clockwise round a convex area in it."""
    points = as_numbers("corners", corners).copy()
    if points.shape != (4, 2) or not ((points >= 0) & (points <= 1)).all():
        pairs = "four pairs of x and y from 0 to 1; use fractions of the size"
        raise InputError(f"corners={points.tolist()} are not {pairs}")
    sides = np.roll(points, -1, axis=0) - points
    following = np.roll(sides, -1, axis=0)
    # Each corner turns right (y points down) exactly where this cross product is positive.
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
    """Return n x n positions in each patch as fractions of the image, shape (24, n * n, 2).

    They spread over an inner box of that share of the patch's width.
    """
    offsets = ((np.arange(n) + 0.5) / n - 0.5) * share
    inner = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    return project(homography(SIZE * UNIT, corners), _origins() + 0.5 + inner)


def chart_boxes(corners: Array) -> Array:
    """Return the outlines of the 24 patches as fractions of the image, shape (24, 4, 2)."""
    return project(homography(SIZE * UNIT, corners), _origins() + UNIT)


def within_margin(box: Array, margin: float) -> Array:
    """Return the corners (4, 2) of a chart from those of a box round it, some widths of a patch away."""
    return project(homography((SIZE + 2 * margin) * UNIT - margin, box), SIZE * UNIT)


def _origins() -> Array:
    """Return the top left corner of every patch of an upright chart, in widths of a patch; shape (24, 1, 2)."""
    rows, columns = np.divmod(np.arange(N_PATCHES), COLUMNS)
    return np.column_stack([columns, rows])[:, None] * (1 + GAP)


def load_labels(path: Path) -> dict[str, Array]:
    """Load the corners of every photograph that a person labelled, from JSON.

    ``{"version": 1, "labels": [{"photograph": "IMG_1", "corners": [[x, y], [x, y], [x, y], [x, y]]}]}``: the name of
    the file without its extension, and the corners, shape (4, 2), clockwise from any corner on. A file that is missing
    or holds anything else, or a photograph twice, is a `FormatError`.
    """
    path = Path(path)
    try:
        document = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=unique_names)
        if not isinstance(document, dict) or set(document) != {"version", "labels"}:
            raise ValueError("its top level is not version and labels")
        if document["version"] is not _LABELS_VERSION or not isinstance(document["labels"], list):
            raise ValueError(f"version {document['version']!r}")
        return unique_names([_label(entry) for entry in document["labels"]])
    except OSError as error:
        raise FormatError(f"{path.name} cannot be read ({error.strerror}); use a file that is there") from None
    except (ValueError, TypeError, RecursionError) as error:
        raise FormatError(f"{path.name} holds no labels of version {_LABELS_VERSION} ({error}); label again") from None


def save_labels(path: Path, labels: Mapping[str, ArrayLike]) -> None:
    """Save the corners of photographs, sorted by name, as `load_labels` reads them.

    Parameters
    ----------
    path : path
    labels : mapping of str to array_like, shape (4, 2)
    """
    if not all(isinstance(name, str) and name for name in labels):
        raise InputError(f"labels={list(labels)} have a name that is empty or not text; use the photographs' names")
    entries = [{"photograph": name, "corners": as_corners(labels[name]).tolist()} for name in sorted(labels)]
    # Escaped to ASCII: names of files may hold what UTF-8 cannot.
    document = json.dumps({"version": _LABELS_VERSION, "labels": entries}, indent=1)
    write_atomically(Path(path), document.encode("ascii"))


def _label(entry: Any) -> tuple[str, Array]:
    if not isinstance(entry, dict) or set(entry) != {"photograph", "corners"}:
        raise ValueError("an entry is not photograph and corners")
    name, corners = entry["photograph"], entry["corners"]
    if not (isinstance(name, str) and name):
        raise ValueError(f"photograph {name!r} is not a name")
    if not all(type(value) in (int, float) for point in corners for value in point):
        raise ValueError(f"the corners of {name!r} are not all numbers")
    return name, as_corners(corners)
