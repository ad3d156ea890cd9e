"""Records of the DoRF text, six lines a curve, as `crfbench.datasets.dorf.parse_dorf_text` reads them.

Keeps the camera's name, the channels (a record each, named Red, Green, Blue) and every digit. The direction is always
forward; loses the rest, such as the band.
"""

import numpy as np

from crfbench.camera.passport import Passport
from crfbench.curves import GRID, resample
from crfbench.datasets.dorf import parse_dorf_text

SUFFIX = ".dorf.txt"

_ENDINGS = {1: ("",), 3: ("Red", "Green", "Blue")}
_LABEL = "graph lin-lin"


def write(passport: Passport) -> bytes:
    """Write the response; letters outside Latin-1 become question marks."""
    name = " ".join(passport.camera.split()) or "camera"
    curves = passport.in_direction("forward")
    records = zip(_ENDINGS[len(curves)], curves.tolist(), strict=True)
    lines = [line for ending, curve in records for line in _record(name + ending, curve)]
    return ("\n".join(lines) + "\n").encode("latin-1", "replace")


def read(data: bytes) -> Passport:
    """Read one record, or three, red first; irradiance and brightness may have any unit."""
    names, irradiance, brightness = parse_dorf_text(data.decode("latin-1"))
    curves = np.array([resample(x, y) for x, y in zip(irradiance, brightness, strict=True)])
    ending = _ENDINGS.get(len(curves), ("",))[0]
    return Passport("forward", curves, camera=names[0].removesuffix(ending))


def _record(name: str, curve: list[float]) -> tuple[str, ...]:
    return name, _LABEL, "I =", " ".join(map(repr, GRID.tolist())), "B =", " ".join(map(repr, curve))
