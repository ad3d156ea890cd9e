"""The chart labeller: say where the colour chart lies in each photograph, by its four corners."""

import base64
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import traitlets
from numpy.typing import ArrayLike, NDArray

from crfbench.checks import check_count
from crfbench.curves import Array
from crfbench.datasets.chart import as_corners, chart_boxes, load_labels, save_labels
from crfbench.errors import FormatError, InputError, MissingDataError
from crfbench.files import check_new
from crfbench.widgets.assets import StoredWidget, SyncedTrait, bundle, join

_MOST_PIXELS = 1200  # along the longer side of the picture that the page gets
_STILL_PIXELS = 320  # of the one in a stored notebook
_JPEG_QUALITY = 90


class ChartLabeller(StoredWidget):
    """Drag the four corners of a chart of 6 x 4 patches in one photograph after the other.

    The patches are drawn in perspective and their means shown while you drag. The page gets one photograph at a time,
    scaled to at most 1200 pixels, so large ones do not slow it down. A photograph counts as labelled once its corners
    were moved, or copied from the one before. `index` and `labels` are traits: read them, set them, `observe` them, or
    `link` them to another widget.

    Parameters
    ----------
    images : mapping of str to array or path
        Photographs by name: uint8 red, green, blue, shape (h, w, 3), or an image file, upright as its EXIF says.

    Examples
    --------
    >>> labeller = ChartLabeller({"first": np.zeros((40, 60, 3), np.uint8), "second": np.zeros((40, 60, 3), np.uint8)})
    >>> labeller.labels = {"first": [(0.1, 0.1), (0.9, 0.1), (0.9, 0.8), (0.1, 0.8)]}
    >>> labeller
    ChartLabeller(2 photographs, 1 labelled)
    """

    _esm = bundle("chart_labeller.js")
    _css = join("widgets.css", "chart_labeller.css")
    _names: traitlets.List[str] = traitlets.List().tag(sync=True)
    _picture = traitlets.Dict().tag(sync=True)

    def __init__(self, images: Mapping[str, NDArray[np.uint8] | str | Path]) -> None:
        if not images:
            raise InputError("there are no images to label; use one or more")
        for name, image in images.items():
            _check_image(name, image)
        self._images = {str(name): image for name, image in images.items()}
        super().__init__(_names=list(self._images), labels={}, index=0)

    def _still(self) -> dict[str, str]:
        import cv2

        name = self._names[self.index]
        pixels = _pixels(name, self._images[name]).copy()
        boxes = chart_boxes(self.labels[name]) if name in self.labels else np.empty((0, 4, 2))
        outlines = np.round(boxes * pixels.shape[1::-1]).astype(np.int32)
        cv2.polylines(pixels, [*outlines], isClosed=True, color=(255, 255, 255), thickness=pixels.shape[1] // 200 + 1)
        return {"image/jpeg": base64.b64encode(_pack(pixels, _STILL_PIXELS)["jpeg"]).decode()}

    def __repr__(self) -> str:
        labelled = sum(name in self.labels for name in self._names)
        return f"ChartLabeller({len(self._names)} photographs, {labelled} labelled)"

    @SyncedTrait
    def index(self, index: object) -> int:
        """Which photograph is shown, from 0 in the order of `images`."""
        return check_count("index", index, least=0, most=len(self._images) - 1)

    @SyncedTrait
    def labels(self, labels: Mapping[str, ArrayLike]) -> Mapping[str, Array]:
        """Corners (x, y) by photograph, shape (4, 2), as shares of width and height.

        The outer corner of the dark skin patch comes first, then clockwise bluish green, black and white. Labels of
        photographs that are not here are kept, so that saving loses none. To change them, set another mapping.
        """
        # Writing into this one would reach neither the page nor any observer, so it is read-only.
        return MappingProxyType({str(name): _read_only(as_corners(corners)) for name, corners in labels.items()})

    labels.tag(to_json=lambda labels, _widget: {name: corners.tolist() for name, corners in labels.items()})

    def save(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the labels as JSON, complete or not at all; an existing file is replaced only with `overwrite`."""
        save_labels(check_new(path, overwrite), self.labels)

    def load(self, path: str | Path) -> None:
        """Replace the labels by those of a file that `save` wrote."""
        self.labels = load_labels(Path(path))

    @traitlets.observe("index")
    def _show(self, _change: object) -> None:
        name = self._names[self.index]
        self._picture = {"index": self.index, "name": name, **_pack(_pixels(name, self._images[name]))}


def _read_only(corners: Array) -> Array:
    corners.flags.writeable = False
    return corners


def _check_image(name: object, image: object) -> None:
    from PIL import Image

    if isinstance(image, str | Path):
        if not Path(image).is_file():
            raise MissingDataError(f"there is no file {image} for {name!r}; use the path of a photograph")
        try:
            Image.open(image).close()
        except OSError:
            raise FormatError(f"{image} is not an image that can be read; use JPEG, PNG or TIFF") from None
    elif not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        shape = f"{image.dtype} of shape {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
        raise InputError(f"image {name!r} is {shape}; use uint8 of shape (h, w, 3), or a path")
    elif not image.size:
        raise InputError(f"image {name!r} has shape {image.shape}; use one with pixels")


def _pixels(name: str, image: NDArray[np.uint8] | str | Path) -> NDArray[np.uint8]:
    """Return blue, green, red, which is what OpenCV reads and writes."""
    import cv2

    if isinstance(image, np.ndarray):
        return np.ascontiguousarray(image[..., ::-1])
    # By path, OpenCV finds no file on Windows whose name is not of the system's code page.
    pixels = cv2.imdecode(np.fromfile(image, np.uint8), cv2.IMREAD_COLOR)
    if pixels is None:
        raise FormatError(f"{image}, the photograph {name!r}, is damaged; use another copy")
    return np.asarray(pixels, dtype=np.uint8)


def _pack(pixels: NDArray[np.uint8], most: int = _MOST_PIXELS) -> dict[str, Any]:
    """Return the size of the photograph and a JPEG of it, scaled down where it is large."""
    import cv2

    height, width = pixels.shape[:2]
    scale = min(1.0, most / max(height, width))
    size = (max(1, round(scale * width)), max(1, round(scale * height)))
    small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA) if scale < 1.0 else pixels
    jpeg = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1]
    return {"width": width, "height": height, "jpeg": jpeg.tobytes()}
