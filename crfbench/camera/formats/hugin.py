"""Hugin's five EMoR coefficients, ``Ra`` to ``Re`` of an image line of its project files (``.pto``).

Hugin's response is f0 + Ra h1 + ... + Re h5, of the published forward basis (no logarithm; irradiance and brightness
from 0 to 1), made monotone. That basis is not bundled: ``crfbench fetch emor`` gets it. What is written is an image
line with the five alone: put them into the image lines of your project. Projects are read as they are, the first image.

Keeps one curve, as near as five components come. The direction is always forward; loses the rest, such as the band.
"""

import re

import numpy as np

from crfbench.camera.formats.text import decode_text, numbers, single
from crfbench.camera.passport import Passport
from crfbench.curves import Array
from crfbench.datasets import load_emor_basis
from crfbench.errors import FormatError
from crfbench.models.emor import EMoR

SUFFIX = ".pto"

_LETTERS = "abcde"
_NUMBER = r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)"


def write(passport: Passport) -> bytes:
    """Write the coefficients with the least MSE to the response."""
    coefficients = _model().fit(single(passport, "Hugin").in_direction("forward"))[0]
    words = [f"R{letter}{value:.9g}" for letter, value in zip(_LETTERS, coefficients.tolist(), strict=True)]
    return f"# EMoR response: put these five into the image lines of a project\ni {' '.join(words)}\n".encode()


def read(data: bytes) -> Passport:
    """Read the first image line's coefficients; the curve is the nearest monotone one to what they give."""
    coefficients = _coefficients(decode_text(data))
    model = _model()
    return Passport("forward", model.nearest_valid(coefficients), model="EMoR", params=coefficients[None])


def _coefficients(text: str) -> Array:
    line = next((line for line in text.splitlines() if line.startswith("i ")), "")
    found = [re.findall(rf"(?<= )R{letter}{_NUMBER}(?= |$)", line) for letter in _LETTERS]
    if not all(len(values) == 1 for values in found):
        raise FormatError("it has no image line with Ra, Rb, Rc, Rd and Re; use a project of Hugin")
    return numbers([[values[0] for values in found]], "the image line")[0]


def _model() -> EMoR:
    mean, components = load_emor_basis("forward")
    return EMoR(mean, np.asarray(components), n_params=len(_LETTERS), direction="forward")
