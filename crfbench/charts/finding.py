"""Find a colour chart in a photograph with OpenCV's detector, and judge what it proposes by the patches' colours.

The detector's own judgement supposes sRGB colours and misses charts under other responses and lights, so it is asked
for every candidate, at several sizes and brightnesses; `crfbench.charts.measuring` accepts or refuses them.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.charts.geometry import SIZE, homography, project
from crfbench.charts.measuring import Orientation, orient
from crfbench.curves import Array
from crfbench.errors import InputError

# Longest side in pixels and exponent of the tries, in this order: those that find most come first.
_TRIES = tuple((side, exponent) for exponent in (0.8, 0.4, 1.3, 0.6) for side in (640, 420, 1000, 260))
_CANDIDATES = 30
# The detector's box has a margin of this many widths of a patch round the patches.
_MARGIN = 0.1
_UNIT: Array = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float64)


def find_chart(image: ArrayLike) -> Orientation:
    """Find a chart of 24 patches (ColorChecker Classic), whichever way round it lies.

    Parameters
    ----------
    image : array_like, shape (height, width, 3)
        A developed photograph, for example a JPEG; values in [0, 1].

    Returns
    -------
    Orientation
        The corners in chart order, as fractions of the image; see `crfbench.charts.chart_confidence`.

    Raises
    ------
    InputError
        If there is none, or the image has another shape.
    """
    pixels = np.asarray(image, dtype=np.float32)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or min(pixels.shape[:2]) < 2:
        raise InputError(f"the image has shape {pixels.shape}; use (height, width, 3)")
    for side, exponent in _TRIES:
        found = [judged for box in _candidates(_prepared(pixels, side, exponent)) for judged in _judged(pixels, box)]
        if found:
            return max(found, key=lambda orientation: orientation.confidence)
    raise InputError("no chart of 24 patches was found in the photograph; label its four corners by hand")


def _prepared(pixels: NDArray[np.float32], side: int, exponent: float) -> NDArray[np.uint8]:
    """Return the photograph in 8 bits, blue first, resized, each channel stretched and brightened or darkened."""
    import cv2

    scale = side / max(pixels.shape[:2])
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    small = cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=way)
    white = np.maximum(np.percentile(small, 99.5, axis=(0, 1)), 1e-3)
    return np.rint(255 * np.clip(small / white, 0, 1) ** exponent).astype(np.uint8)[..., ::-1].copy()


def _candidates(image: NDArray[np.uint8]) -> Iterator[Array]:
    """Yield the corners of the patches of everything that may be a chart, as fractions of the image."""
    import cv2

    detector = cv2.mcc.CCheckerDetector.create()
    settings = detector.getDetectionParams()
    settings.findCandidatesApproxPolyDPEpsMultiplier = 0.08
    settings.maxError, settings.minInterCheckerDistance = 1e9, 0
    detector.setDetectionParams(settings)
    detector.process(image, _CANDIDATES)
    frame = (SIZE + 2 * _MARGIN) * _UNIT - _MARGIN
    for checker in detector.getListColorChecker():
        box = np.array(checker.getBox(), dtype=np.float64)
        yield (project(homography(frame, box), SIZE * _UNIT) + 0.5) / image.shape[1::-1]


def _judged(pixels: NDArray[np.float32], corners: Array) -> Iterator[Orientation]:
    """Yield the corners in chart order if the patches between them are a chart's."""
    try:
        yield orient(pixels, corners)
    except InputError:
        return
