"""Patch table of the modified Middlebury set: a colour chart of 24 patches before 14 cameras, as JPEG and as RAW.

Each camera took 8 photographs: 2 illuminations x 4 exposures, one stop apart. The images come as 8-bit PNG files,
``wb1i{illumination}e{exposure}-{jpg,raw}.png``, with the 24 boxes in ``tags.json``. Chakrabarti, Scharstein and
Zickler 2009, "An empirical camera model for internet color vision", doi:10.5244/C.23.51; images as modified by
Zhao et al. (Apache-2.0). The table is shipped; the images are needed only to measure it again.
"""

import json
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crfbench.curves import Array
from crfbench.errors import FormatError, MissingDataError
from crfbench.resources import shipped

if TYPE_CHECKING:
    import pandas as pd

N_PATCHES = 24
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

KEYS = ("camera", "illumination", "exposure", "patch")
_KINDS = {"jpeg": "jpg", "raw": "raw"}
_MEANS = tuple(f"{kind}_{channel}" for kind in _KINDS for channel in "rgb")
COLUMNS = (*KEYS, *_MEANS, *(f"{kind}_clipped" for kind in _KINDS))

_DTYPES = dict.fromkeys(COLUMNS, "float64") | {"camera": "str"} | dict.fromkeys(KEYS[1:], "int64")

# Saturated areas read 255 or, after scaling and compression, 254; dark ones pile up at 0 only.
_BLACK, _WHITE = 0, 254


#: Shares of a patch box that are clipped, from which on the whole patch counts as clipped.
CLIPPED_SHARE = 0.02


class PatchArrays(NamedTuple):
    """The patch table as arrays: c cameras x 2 illuminations x 4 exposures x 24 patches.

    Parameters
    ----------
    cameras : tuple of str, length c
    jpeg, raw : ndarray, shape (c, 2, 4, 24, 3)
        Red, green and blue in [0, 1]; photographs of one illumination lie one stop apart.
    clipped : ndarray of bool, shape (c, 2, 4, 24)
        Where the JPEG patch is clipped.
    """

    cameras: tuple[str, ...]
    jpeg: Array
    raw: Array
    clipped: np.ndarray


class Box(NamedTuple):
    """A patch box in pixels: left edge, top edge, width, height.

    Parameters
    ----------
    x, y : int
    width, height : int
    """

    x: int
    y: int
    width: int
    height: int


def load_patches(images: Path | None = None) -> "pd.DataFrame":
    """Load the patch table.

    Parameters
    ----------
    images : path, optional
        Folder ``modified_Middlebury``; the table is then measured from its images, not read.

    Returns
    -------
    DataFrame
        See `measure_patches`; the shipped table has 14 cameras x 8 photographs x 24 patches = 2688 rows.

    Raises
    ------
    FormatError
        If the table is damaged.
    """
    import pandas as pd

    if images is not None:
        return measure_patches(images)
    path = shipped("data/middlebury_patches.csv")
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
        raise FormatError(
            f"{path} has {len(frame)} rows; use {N_PATCHES} patches of each of {N_PHOTOGRAPHS} photographs"
        )
    values = frame[list(COLUMNS[len(KEYS) :])]
    if not ((values >= 0) & (values <= 1)).all(axis=None):
        raise FormatError(f"{path} holds values outside [0, 1]; use intensities and shares from 0 to 1")


def measure_patches(folder: Path) -> "pd.DataFrame":
    """Measure all patches of all cameras.

    Parameters
    ----------
    folder : path
        ``modified_Middlebury``: one folder a camera, and ``tags.json``.

    Returns
    -------
    DataFrame
        One row a patch, sorted by camera, illumination (1, 2), exposure (1 to 4) and patch (1 to 24);
        ``{jpeg,raw}_{r,g,b}`` are the means over the box in [0, 1]; ``{jpeg,raw}_clipped`` is the share of its
        pixels with any channel at 0 (too dark to count) or at 254 or more (saturated), of 255. 6 digits.

    Raises
    ------
    MissingDataError
        If the folder, a photograph or ``tags.json`` is missing.
    FormatError
        If one of them cannot be read.
    """
    import pandas as pd

    folder = Path(folder)
    tags = _existing(folder / "tags.json").read_text(encoding="utf-8", errors="replace")
    cameras = sorted(path for path in folder.iterdir() if path.is_dir())
    if not cameras:
        raise MissingDataError(f"{folder} holds no camera; run 'crfbench fetch middlebury' to complete the images")
    rows = [row for camera in cameras for row in _measure_camera(camera, tags)]
    return pd.DataFrame(rows, columns=list(COLUMNS)).round(6)


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


def parse_boxes(tags: str, width: int, height: int) -> list[Box]:
    """Turn ``tags.json`` into pixel boxes for an image of that size.

    ``position`` is the top left corner as a fraction of the image, ``rect`` the size in thousandths of it;
    parts of a pixel are dropped.

    Raises
    ------
    FormatError
        If the text is no JSON of 24 boxes inside the image.
    """
    try:
        references = json.loads(tags)[0]["references"]
        boxes = [_box(entry["position"], entry["rect"], width, height) for entry in references]
    except (ValueError, TypeError, KeyError, IndexError, OverflowError, RecursionError):
        raise FormatError("tags.json is no list of boxes with position and rect; fetch it again") from None
    if len(boxes) != N_PATCHES or not all(_inside(box, width, height) for box in boxes):
        raise FormatError(f"tags.json has {len(boxes)} boxes; use {N_PATCHES} that lie inside the image")
    return boxes


def _box(position: dict[str, float], rect: dict[str, float], width: int, height: int) -> Box:
    return Box(
        _pixels(position["x"] * width),
        _pixels(position["y"] * height),
        _pixels(rect["x"] * width / 1000),
        _pixels(rect["y"] * height / 1000),
    )


def _pixels(length: float) -> int:
    # 0.35 * 260 must give 91 whatever the last binary digit.
    return int(np.floor(length + 1e-6))


def _inside(box: Box, width: int, height: int) -> bool:
    fits = box.x + box.width <= width and box.y + box.height <= height
    return fits and min(box.x, box.y) >= 0 and min(box.width, box.height) > 0


def _measure_camera(camera: Path, tags: str) -> list[tuple[str | int | float, ...]]:
    return [
        (camera.name, illumination, exposure, patch + 1, *values)
        for illumination in ILLUMINATIONS
        for exposure in EXPOSURES
        for patch, values in enumerate(_measure_photograph(camera / f"wb1i{illumination}e{exposure}", tags).tolist())
    ]


def _measure_photograph(stem: Path, tags: str) -> Array:
    """Return the measured columns of one photograph, shape (24, 8)."""
    images = [_measure_image(stem.with_name(f"{stem.name}-{kind}.png"), tags) for kind in _KINDS.values()]
    return np.column_stack([means for means, _ in images] + [clipped for _, clipped in images])


def _measure_image(path: Path, tags: str) -> tuple[Array, Array]:
    """Return the mean red, green, blue (24, 3) in [0, 1] and the clipped share (24,) of one image."""
    import cv2

    image = cv2.imread(str(_existing(path)), cv2.IMREAD_COLOR)
    if image is None:
        raise FormatError(f"{path} is no readable image; fetch it again")
    boxes = parse_boxes(tags, image.shape[1], image.shape[0])
    crops = [image[box.y : box.y + box.height, box.x : box.x + box.width, ::-1] for box in boxes]
    means = np.array([crop.mean(axis=(0, 1)) for crop in crops]) / 255.0
    clipped = np.array([((crop <= _BLACK) | (crop >= _WHITE)).any(axis=2).mean() for crop in crops])
    return means, clipped


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise MissingDataError(f"{path} is missing; run 'crfbench fetch middlebury' to complete the images")
    return path
