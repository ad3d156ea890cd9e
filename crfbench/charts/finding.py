"""Find a colour chart in a photograph with OpenCV's detector, and judge what it proposes by the patches' colours.

The detector's own judgement supposes sRGB colours and drops charts in dark or tinted photographs, so it is asked for
every candidate; `crfbench.charts.measuring` accepts or refuses them.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.charts.geometry import SIZE, UNIT, homography, project
from crfbench.charts.measuring import Orientation, check_image, orient
from crfbench.curves import Array
from crfbench.errors import InputError

# Larger photographs are reduced to it: more pixels find no more charts.
_LONGEST_SIDE, _SHORTEST_SIDE = 1000, 32
_CANDIDATES = 30
# The detector's box has a margin of this many widths of a patch round the patches.
_MARGIN = 0.1


def find_chart(image: ArrayLike) -> Orientation:
    """Find a chart of 24 patches (ColorChecker Classic), whichever way round it lies.

    Parameters
    ----------
    image : array_like, shape (height, width, 3)
        A developed photograph, for example a JPEG; values in [0, 1].

    Returns
    -------
    Orientation
        The corners in chart order, as fractions of the image, and the `chart_confidence`.

    Raises
    ------
    InputError
        If there is none, or the image has another shape.
    """
    pixels = _reduced(check_image(image).astype(np.float32))
    # The detector enlarges the shorter side to 1000 pixels, so a strip would become huge.
    proposed = _candidates(_stretched(pixels)) if min(pixels.shape[:2]) >= _SHORTEST_SIDE else ()
    found = [judged for corners in proposed for judged in _judged(pixels, corners)]
    if not found:
        raise InputError("no chart of 24 patches was found in the photograph; label its four corners by hand")
    return max(found, key=lambda orientation: orientation.confidence)


def _reduced(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    import cv2

    scale = min(1.0, _LONGEST_SIDE / max(pixels.shape[:2]))
    width, height = (max(2, round(scale * length)) for length in pixels.shape[1::-1])
    return np.asarray(cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA), dtype=np.float32)


def _stretched(pixels: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the photograph in 8 bits, each channel stretched to the full range, blue first."""
    white = np.maximum(np.percentile(pixels, 99.5, axis=(0, 1)), 1e-3)
    return np.rint(255 * np.clip(pixels / white, 0, 1)).astype(np.uint8)[..., ::-1].copy()


def _candidates(image: NDArray[np.uint8]) -> Iterator[Array]:
    """Yield the corners of the patches of all that may be a chart, as fractions of the image."""
    import cv2

    detector = cv2.mcc.CCheckerDetector.create()
    detector.setColorChartType(cv2.mcc.MCC24)  # must be said: OpenCV 5.0 leaves it uninitialised
    detector.setUseDnnModel(False)
    settings = detector.getDetectionParams()
    settings.maxError, settings.minInterCheckerDistance = 1e9, 0
    detector.setDetectionParams(settings)
    detector.process(image, _CANDIDATES)
    frame = (SIZE + 2 * _MARGIN) * UNIT - _MARGIN
    for checker in detector.getListColorChecker():
        box = homography(frame, np.array(checker.getBox()))
        yield (project(box, SIZE * UNIT) + 0.5) / image.shape[1::-1]


def _judged(pixels: NDArray[np.float32], corners: Array) -> Iterator[Orientation]:
    """Yield the corners in chart order if the patches between them are a chart's."""
    try:
        yield orient(pixels, corners)
    except InputError:
        return
