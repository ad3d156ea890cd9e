"""Files of every format of a response, those that crfbench only reads too."""

import numpy as np

from crfbench.camera.formats import FORMATS
from crfbench.camera.passport import Passport
from crfbench.curves import GRID, evaluate


def rows(columns: np.ndarray, separator: str = " ") -> str:
    """Write an array (m, c) as lines of numbers, to the last digit."""
    return "".join(separator.join(map(repr, row)) + "\n" for row in columns.tolist())


def file_of(name: str, passport: Passport) -> bytes:
    """Write an inverse response in a format; where only reading is offered, as its program writes it."""
    curves = passport.in_direction("inverse")
    if name == "radiance":
        fits = [np.polyfit(GRID, curve, 5) for curve in curves]
        return "".join(f"5 {' '.join(map(repr, fit.tolist()))}\n" for fit in fits).encode()
    if name == "respfcns":
        table = np.broadcast_to(evaluate(curves, np.linspace(0, 1, 256)).T, (256, 3))
        return f"16400.0 0.0 0.0 0.0\n{rows(table)}".encode()
    return FORMATS[name].write(passport)
