"""Measure the patch table from the modified Middlebury images and write data/middlebury_patches.csv.

Run: python scripts/build_patches.py (with CRFBENCH_DATA set, or after `crfbench fetch middlebury`).
"""

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from crfbench.curves import Array
from crfbench.datasets.chart import N_PATCHES
from crfbench.datasets.middlebury import COLUMNS, EXPOSURES, ILLUMINATIONS
from crfbench.datasets.registry import require
from crfbench.errors import FormatError, MissingDataError

TARGET = Path(__file__).parents[1] / "data" / "middlebury_patches.csv"
# Saturated areas read 255 or, after scaling and compression, 254; dark ones pile up at 0 only.
_BLACK, _WHITE = 0, 254


def main() -> None:
    frame = measure_patches(require("middlebury/modified_Middlebury", "middlebury"))
    # Written aside and renamed, so that no reader ever sees half a table.
    partial = TARGET.with_suffix(".partial")
    try:
        frame.to_csv(partial, index=False, float_format="%.6f", lineterminator="\n")
        os.replace(partial, TARGET)
    finally:
        partial.unlink(missing_ok=True)
    print(f"{TARGET.name}: {frame['camera'].nunique()} cameras, {len(frame)} rows")


def measure_patches(folder: Path) -> pd.DataFrame:
    """Measure all patches of all cameras.

    Parameters
    ----------
    folder : path
        ``modified_Middlebury``: one folder a camera, and ``tags.json``.

    A missing photograph is a `MissingDataError`, an unreadable one a `FormatError`.
    """
    folder = Path(folder)
    tags = _existing(folder / "tags.json").read_text(encoding="utf-8", errors="replace")
    cameras = sorted(path for path in folder.iterdir() if path.is_dir())
    if not cameras:
        raise MissingDataError(f"{folder} holds no camera; run 'crfbench fetch middlebury' to complete the images")
    rows = [row for camera in cameras for row in _measure_camera(camera, tags)]
    return pd.DataFrame(rows, columns=list(COLUMNS)).round(6)


def parse_boxes(tags: str, width: int, height: int) -> list[tuple[int, int, int, int]]:
    """Turn ``tags.json`` into the 24 boxes of an image of that size: left and top edge, width and height in pixels.

    ``position`` is the top left corner as a fraction of the image, ``rect`` the size in thousandths of it;
    parts of a pixel are dropped. A text that holds anything else is a `FormatError`.
    """
    try:
        boxes = [_box(reference, width, height) for reference in json.loads(tags)[0]["references"]]
        if len(boxes) != N_PATCHES:
            raise ValueError(f"{len(boxes)} boxes")
    except (ValueError, TypeError, KeyError, IndexError, OverflowError, RecursionError) as error:
        message = f"tags.json does not hold {N_PATCHES} boxes inside the image ({error}); fetch it again"
        raise FormatError(message) from None
    return boxes


def _box(reference: dict[str, dict[str, float]], width: int, height: int) -> tuple[int, int, int, int]:
    corner, size = reference["position"], reference["rect"]
    lengths = (corner["x"] * width, corner["y"] * height, size["x"] * width / 1000, size["y"] * height / 1000)
    # 0.35 * 260 must give 91 whatever the last binary digit.
    x, y, w, h = (int(np.floor(length + 1e-6)) for length in lengths)
    if min(x, y) < 0 or min(w, h) <= 0 or x + w > width or y + h > height:
        raise ValueError(f"one from {x}, {y} of {w} x {h} pixels")
    return x, y, w, h


def _measure_camera(camera: Path, tags: str) -> list[tuple[str | int | float, ...]]:
    return [
        (camera.name, illumination, exposure, patch + 1, *values)
        for illumination in ILLUMINATIONS
        for exposure in EXPOSURES
        for patch, values in enumerate(_measure_photograph(camera / f"wb1i{illumination}e{exposure}", tags).tolist())
    ]


def _measure_photograph(stem: Path, tags: str) -> Array:
    """Return the measured columns of one photograph, shape (24, 8)."""
    images = [_measure_image(stem.with_name(f"{stem.name}-{kind}.png"), tags) for kind in ("jpg", "raw")]
    return np.column_stack([means for means, _ in images] + [clipped for _, clipped in images])


def _measure_image(path: Path, tags: str) -> tuple[Array, Array]:
    """Return the mean red, green, blue (24, 3) in [0, 1] and the clipped share (24,) of one image."""
    image = cv2.imread(str(_existing(path)), cv2.IMREAD_COLOR)
    if image is None:
        raise FormatError(f"{path} is not a readable image; fetch it again")
    # OpenCV gives blue, green, red.
    crops = [image[y : y + h, x : x + w, ::-1] for x, y, w, h in parse_boxes(tags, image.shape[1], image.shape[0])]
    means = np.array([crop.mean(axis=(0, 1)) for crop in crops]) / 255.0
    clipped = np.array([((crop <= _BLACK) | (crop >= _WHITE)).any(axis=2).mean() for crop in crops])
    return means, clipped


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise MissingDataError(f"{path} is missing; run 'crfbench fetch middlebury' to complete the images")
    return path


if __name__ == "__main__":
    main()
