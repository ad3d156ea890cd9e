"""Patch table of the modified Middlebury set: a colour chart of 24 patches before 14 cameras, as JPEG and as RAW.

Each camera took 8 photographs: 2 illuminations x 4 exposures, one stop apart. The images come as 8-bit PNG files,
``wb1i{illumination}e{exposure}-{jpg,raw}.png``, with the 24 boxes in ``tags.json``. Chakrabarti, Scharstein and
Zickler 2009, "An empirical camera model for internet color vision", doi:10.5244/C.23.51; images as modified by
Zhao et al. (Apache-2.0). The table is bundled; the images are needed only to measure it again, which
``scripts/build_patches.py`` does.
"""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crfbench.curves import Array
from crfbench.datasets.chart import CLIPPED_SHARE, N_PATCHES
from crfbench.errors import FormatError
from crfbench.files import bundled

if TYPE_CHECKING:
    import pandas as pd

N_PHOTOGRAPHS = 14 * 8
ILLUMINATIONS = (1, 2)
EXPOSURES = (1, 2, 3, 4)

# Irradiance of the 24 patches in chart order (row by row), in an arbitrary unit common to all.
REFERENCE_IRRADIANCE: Array = np.array(
    [
        (81, 228, 116, 69, 153, 184),
        (211, 103, 166, 65, 174, 213),
        (68, 100, 134, 290, 186, 111),
        (503, 328.3, 205.7, 112.7, 57, 27),
    ]
).ravel()
REFERENCE_IRRADIANCE.flags.writeable = False
THREE_GREYS = (19, 21, 24)  # white, a middle grey and black: the patches (from 1) that the paper calibrates with
#: The patches (from 1) in the order in which the stated subsets grow: the greys, then every other row by row.
PATCH_ORDER = (19, 21, 24, 20, 22, 23, 2, 4, 7, 9, 14, 18, 1, 3, 5, 6, 8, 10, 11, 12, 13, 15, 16, 17)

KEYS = ("camera", "illumination", "exposure", "patch")
_KINDS = ("jpeg", "raw")
COLUMNS = (*KEYS, "jpeg_r", "jpeg_g", "jpeg_b", "raw_r", "raw_g", "raw_b", "jpeg_clipped", "raw_clipped")
_DTYPES = dict.fromkeys(COLUMNS, "float64") | {"camera": "str"} | dict.fromkeys(KEYS[1:], "int64")


class PatchArrays(NamedTuple):
    """The patch table as arrays: c cameras x 2 illuminations x 4 exposures, one stop apart, x 24 patches."""

    cameras: tuple[str, ...]
    jpeg: Array  # shape (c, 2, 4, 24, 3), as raw; red, green and blue in [0, 1]
    raw: Array
    clipped: np.ndarray  # shape (c, 2, 4, 24); where the JPEG patch is clipped

    def sets(self) -> tuple[Array, np.ndarray]:
        """Return jpeg and clipped of each camera and illumination, shapes (2 c, 4, 24, 3) and (2 c, 4, 24)."""
        return np.concatenate(self.jpeg), np.concatenate(self.clipped)


def load_patches() -> "pd.DataFrame":
    """Load the bundled patch table: 14 cameras x 8 photographs x 24 patches = 2688 rows.

    Sorted by camera, illumination (1, 2), exposure (1 to 4) and patch (1 to 24); ``{jpeg,raw}_{r,g,b}`` are the means
    over the patch's box in [0, 1]; ``{jpeg,raw}_clipped`` is the share of its pixels with any channel at 0 (too dark to
    count) or at 254 or more (saturated), of 255. 6 digits. A damaged file is a `FormatError`.
    """
    import pandas as pd

    path = bundled("data/middlebury_patches.csv")
    try:
        frame = pd.read_csv(path, dtype=_DTYPES)
    except ValueError as error:
        raise FormatError(f"{path} is damaged ({error}); install crfbench again to restore it") from error
    _check(frame, path)
    # Some releases of pandas read the last binary digit inexactly.
    return frame.round(6)


def _check(frame: "pd.DataFrame", path: Path) -> None:
    """Refuse a table with other columns, photographs that lack patches, or values outside [0, 1]."""
    if tuple(frame.columns) != COLUMNS:
        raise FormatError(f"{path} has the columns {', '.join(map(str, frame.columns))}; use {', '.join(COLUMNS)}")
    sizes = frame.drop_duplicates(list(KEYS)).groupby(list(KEYS[:3])).size()
    if not (len(sizes) == N_PHOTOGRAPHS and (sizes == N_PATCHES).all() and len(frame) == sizes.sum()):
        use = f"use {N_PATCHES} patches of each of {N_PHOTOGRAPHS} photographs"
        raise FormatError(f"{path} has {len(frame)} rows; {use}")
    values = frame[list(COLUMNS[len(KEYS) :])]
    if not ((values >= 0) & (values <= 1)).all(axis=None):
        raise FormatError(f"{path} holds values outside [0, 1]; use intensities and shares from 0 to 1")


def patch_intensity(frame: "pd.DataFrame") -> "pd.DataFrame":
    """Return the table with the columns ``jpeg`` and ``raw``: the mean of red, green and blue, in [0, 1]."""
    return frame.assign(**{kind: frame[[f"{kind}_{channel}" for channel in "rgb"]].mean(axis=1) for kind in _KINDS})


def patch_arrays(frame: "pd.DataFrame") -> PatchArrays:
    """Return the patch table as arrays, cameras in alphabetical order."""
    frame = frame.sort_values(list(KEYS))
    cameras = tuple(frame["camera"].unique())
    shape = (len(cameras), len(ILLUMINATIONS), len(EXPOSURES), N_PATCHES)
    jpeg, raw = (
        frame[[f"{kind}_{channel}" for channel in "rgb"]].to_numpy(float).reshape(*shape, 3) for kind in _KINDS
    )
    return PatchArrays(cameras, jpeg, raw, frame["jpeg_clipped"].to_numpy().reshape(shape) >= CLIPPED_SHARE)
