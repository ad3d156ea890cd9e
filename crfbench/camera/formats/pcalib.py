"""The photometric calibration ``pcalib.txt`` of the TUM monoVO data set and of DSO: one line of 256 values.

Value i is the irradiance of 8-bit brightness i, from 0 to 255. Engel, Usenko and Cremers 2016, "A photometrically
calibrated benchmark for monocular visual odometry", arXiv:1607.02555. DSO refuses values that do not rise strictly, so
each is at least 0.0001 above the one before.

Keeps one curve, to 4e-7 where it rises. The direction is always inverse, and curves are straight between the 256
samples; loses the rest, such as the band.
"""

import numpy as np

from crfbench.camera.formats.text import decode_text, numbers, on_grid, single
from crfbench.camera.passport import Passport
from crfbench.curves import evaluate
from crfbench.errors import FormatError

SUFFIX = "pcalib.txt"

_LEVELS = 256
_LEAST_STEP = 1e-4  # six times what single precision, which DSO reads with, can tell at 255


def write(passport: Passport) -> bytes:
    """Write the inverse response at the 256 brightnesses."""
    curve = single(passport, "pcalib.txt").in_direction("inverse")[0]
    ramp = _LEAST_STEP * np.arange(_LEVELS)
    values = np.maximum.accumulate(255.0 * evaluate(curve, np.linspace(0.0, 1.0, _LEVELS)) - ramp) + ramp
    return (" ".join(f"{value:.6f}" for value in values) + "\n").encode()


def read(data: bytes) -> Passport:
    """Read the first line, shifted and scaled to run from 0 to 1 as DSO does, or raise `FormatError`."""
    lines = decode_text(data).splitlines() or [""]
    values = numbers([lines[0].split()], "the first line")[0]
    if len(values) != _LEVELS or not (np.diff(values) > 0).all():
        raise FormatError(f"its first line has {len(values)} values; use {_LEVELS} that rise strictly")
    return Passport("inverse", on_grid(((values - values[0]) / (values[-1] - values[0]))[:, None]))
