"""A one-dimensional lookup table in Adobe's (IRIDAS) cube format: applied to an image, it makes it linear.

Cube LUT Specification 1.0, Adobe Systems 2013. Keeps the channels, red first, a single curve three times, to nine
decimals, and the camera as its title. The direction is always inverse; loses the rest, such as the band.
"""

import re

import numpy as np

from crfbench.camera.formats.text import decode_text, merged, numbers, on_grid
from crfbench.camera.passport import Passport
from crfbench.curves import N_SAMPLES
from crfbench.errors import FormatError

SUFFIX = ".cube"

_SIZE = re.compile(r"^LUT_1D_SIZE[ \t]+(\d{1,5})[ \t]*$", re.MULTILINE)
_TITLE = re.compile(r'^TITLE[ \t]+"([^"]*)"[ \t]*$', re.MULTILINE)
_WORD = re.compile(r"[A-Z#]")
_DOMAIN = re.compile(r"^DOMAIN_(MIN|MAX)[ \t]+(.*)$", re.MULTILINE)


def write(passport: Passport) -> bytes:
    """Write the inverse response on its grid."""
    title = " ".join(passport.camera.replace('"', "'").split()) or "inverse response"
    columns = np.broadcast_to(passport.in_direction("inverse"), (3, N_SAMPLES)).T
    head = [f'TITLE "{title}"', f"LUT_1D_SIZE {N_SAMPLES}", "DOMAIN_MIN 0.0 0.0 0.0", "DOMAIN_MAX 1.0 1.0 1.0"]
    rows = [f"{r:.9f} {g:.9f} {b:.9f}" for r, g, b in columns.tolist()]
    return ("\n".join(head + rows) + "\n").encode()


def read(data: bytes) -> Passport:
    """Read a table of any size over the domain from 0 to 1; anything else is a `FormatError`."""
    text = "\n".join(decode_text(data).splitlines())
    size, title = _SIZE.findall(text), _TITLE.search(text)
    if len(size) != 1:
        raise FormatError("it has no single line LUT_1D_SIZE; use a one-dimensional table")
    _check_domain(text)
    rows = [line.split() for line in text.splitlines() if line.strip() and not _WORD.match(line.strip())]
    table = numbers(rows, "the table")
    if table.shape != (int(size[0]), 3):
        raise FormatError(f"its table has shape {table.shape}; its head says ({size[0]}, 3)")
    return Passport("inverse", merged(on_grid(table)), camera=title.group(1) if title else "")


def _check_domain(text: str) -> None:
    for end, words in _DOMAIN.findall(text):
        if (numbers([words.split()], f"DOMAIN_{end}") != (end == "MAX")).any():
            raise FormatError(f"its domain has the {end} {words[:40]!r}; use one from 0 to 1")
