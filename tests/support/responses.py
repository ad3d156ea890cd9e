"""Files of every format of a response, those that crfbench only reads too."""

import io

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
    if name == "debevec":
        samples = evaluate(curves, np.linspace(0, 1, 256)).T
        file = io.BytesIO()
        np.save(file, np.log(np.maximum(samples, samples[samples > 0].min())))
        return file.getvalue()
    if name == "spi1d":
        return f"Version 1\nFrom 0 1\nLength 1024\nComponents {len(curves)}\n{{\n{rows(curves.T)}}}\n".encode()
    if name == "csp":
        table = rows(np.broadcast_to(curves, (3, 1024)).T)
        before = "2\n0 1\n0 1\n" * 3
        return f"CSPLUTV100\n1D\n\n{before}\n1024\n{table}".encode()
    return FORMATS[name].write(passport)
