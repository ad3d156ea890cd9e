"""Files of every format of a response, those that crfbench only reads too."""

import io

import numpy as np

from crfbench.camera.formats import FORMATS
from crfbench.camera.passport import Passport
from crfbench.curves import GRID, evaluate


def rows(columns: np.ndarray, separator: str = " ") -> str:
    """Write an array (m, c) as lines of numbers, to the last digit."""
    return "".join(separator.join(map(repr, row)) + "\n" for row in columns.tolist())


def matrix_of_pfstools(name: str, samples: np.ndarray) -> str:
    """Write one channel as pfscalibration does, for Octave."""
    table = np.column_stack([np.log10(samples + 1e-9), np.arange(len(samples)), samples])
    head = f"# Camera response curve, channel {name}\n# data layout: log10(response) | camera output | response\n"
    return f"{head}# name: {name}\n# type: matrix\n# rows: {len(samples)}\n# columns: 3\n{rows(table)}\n"


def file_of(name: str, passport: Passport) -> bytes:
    """Write an inverse response in a format; where only reading is offered, as its program writes it."""
    curves = passport.in_direction("inverse")
    samples = evaluate(curves, np.linspace(0, 1, 256))
    before = "2\n0 1\n0 1\n" * 3
    texts = {
        "radiance": lambda: "".join(
            f"5 {' '.join(map(repr, fit.tolist()))}\n" for fit in (np.polyfit(GRID, curve, 5) for curve in curves)
        ),
        "respfcns": lambda: f"16400.0 0.0 0.0 0.0\n{rows(np.broadcast_to(samples.T, (256, 3)))}",
        "pfstools": lambda: "".join(
            map(matrix_of_pfstools, ("IR", "IG", "IB") if len(curves) == 3 else ("IY",), samples)
        ),
        "spi1d": lambda: f"Version 1\nFrom 0 1\nLength 1024\nComponents {len(curves)}\n{{\n{rows(curves.T)}}}\n",
        "csp": lambda: f"CSPLUTV100\n1D\n\n{before}\n1024\n{rows(np.broadcast_to(curves, (3, 1024)).T)}",
    }
    if name in texts:
        return texts[name]().encode()
    if name == "debevec":
        file = io.BytesIO()
        np.save(file, np.log(np.maximum(samples, samples[samples > 0].min())).T)
        return file.getvalue()
    return FORMATS[name].write(passport)
