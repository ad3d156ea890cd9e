"""The response of OpenCV's HDR merging: a NumPy file of float32, shape (256, 1, 3), blue, green, red.

``cv2.createMergeDebevec().process(images, times, numpy.load(path))`` takes it as it is, and what
``cv2.createCalibrateDebevec()`` gives can be saved as it is (https://docs.opencv.org, module photo). An entry is the
irradiance of an 8-bit brightness up to a scale common to all, not its logarithm: the merging takes that itself.
Irradiance 0 has none, so what is 0 takes the first value above it, as in OpenCV's own default response.

Keeps the channels, a single curve three times. The direction is always inverse, and curves are straight between the
256 samples; loses the rest, such as the band.
"""

import numpy as np

from crfbench.camera.formats.npy import load_array, save_array
from crfbench.camera.formats.text import merged, on_grid
from crfbench.camera.passport import Passport
from crfbench.curves import evaluate
from crfbench.errors import FormatError

SUFFIX = ".opencv.npy"

_SHAPE = (256, 1, 3)


def write(passport: Passport) -> bytes:
    """Write the inverse response at the 256 brightnesses."""
    samples = evaluate(passport.in_direction("inverse"), np.linspace(0.0, 1.0, _SHAPE[0])).astype(np.float32)
    least = np.where(samples > 0, samples, np.float32(np.inf)).min(axis=1, keepdims=True)
    blue_first = np.broadcast_to(np.maximum(samples, least)[::-1], (3, _SHAPE[0]))
    return save_array(np.ascontiguousarray(blue_first.T[:, None, :]))


def read(data: bytes) -> Passport:
    """Read a response of any scale, and let it begin at 0; anything else is a `FormatError`."""
    response = load_array(data).astype(np.float64)
    if response.shape != _SHAPE or not (response > 0).all():
        raise FormatError(f"it has shape {response.shape}; use {_SHAPE} and values above 0")
    samples = response[:, 0, ::-1] / response[-1, 0, ::-1]
    samples[0] = 0.0
    return Passport("inverse", merged(on_grid(samples)))
