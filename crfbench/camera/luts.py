"""Read lookup tables of colour programs, and what every reader needs: numbers out of text, and valid curves."""

import re
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from crfbench.camera.passport import Passport
from crfbench.checks import parse_numbers
from crfbench.curves import GRID, Array, Direction, repair
from crfbench.errors import FormatError

END_TOLERANCE = 1e-6
# Debevec's method leaves small falls where few pixels were seen, and log tables a small rest at black.
_MOST_REPAIR = 0.01
_WHITES = (255.0, 1023.0, 4095.0, 16383.0, 65535.0)  # of inputs that count levels from 0


def decode_text(data: bytes) -> str:
    r"""Decode UTF-16 by its mark, UTF-8, or else Windows-1252 (and Latin-1), of old programs; lines end in \\n."""
    try:
        text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("cp1252", "replace")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def rows_of(text: str) -> list[list[str]]:
    """Return the words of every line that has some; what follows ``#`` is a comment."""
    rows = [line.partition("#")[0].split() for line in text.split("\n")]
    return [row for row in rows if row]


def numbers(rows: list[list[str]], where: str) -> Array:
    """Turn rows of words, all of one length, into finite numbers, shape (rows, words), or raise `FormatError`."""
    lengths = {len(row) for row in rows}
    if len(lengths) != 1:
        raise FormatError(f"{where} has rows of {str(sorted(lengths) or 'no')[:40]} values; use rows of one length")
    return parse_numbers(rows, where)


def on_grid(samples: Array, low: ArrayLike = 0.0, high: ArrayLike = 1.0) -> Array:
    """Bring two or more even samples from `low` to `high`, shape (m, c), onto the grid, (c, 1024).

    The ends are one number, or one a channel. From 0 to 255, 1023, 4095, 16383 or 65535 they count levels, the last of
    which is white. A table that does not cover 0 to 1, or with too few samples of it, is a `FormatError`.
    """
    if len(samples) < 2:
        raise FormatError(f"it has {len(samples)} samples; use two or more")
    low, high = np.broadcast_to(low, samples.shape[1]), np.broadcast_to(high, samples.shape[1])
    if low.max() > END_TOLERANCE or high.min() < 1.0 - END_TOLERANCE:
        raise FormatError(f"its input runs from {low.max():.4g} to {high.min():.4g}; use a table that covers 0 to 1")
    axes = _as_brightness(np.linspace(low, high, len(samples)), len(samples))
    return np.array([np.interp(GRID, x, column) for x, column in zip(axes.T, samples.T, strict=True)])


def _as_brightness(inputs: Array, n: int) -> Array:
    """Return the rising inputs of a table of `n` samples as brightness, or refuse too few samples from 0 to 1."""
    inputs = inputs / np.where((inputs[0] == 0) & np.isin(inputs[-1], _WHITES), inputs[-1], 1.0)
    if (part := 1 / np.ptp(inputs, axis=0).max()) < 0.25 and part * n < 16:
        raise FormatError(f"0 to 1 holds {part * n:.2g} of its {n} samples; use a table that has 16 or more there")
    return inputs


def scaled(curves: Array, direction: Direction = "inverse", **known: Any) -> Passport:
    """Make the passport of curves (c, 1024) of any scale, of which noise may have spoilt the shape.

    Irradiance has no scale of its own, so each curve is divided by its last value. The nearest valid curve takes its
    place; where a sample would move by more than 0.01 this is a `FormatError`, and a warning tells the most that one
    moved.
    """
    if not (curves[:, -1] > 0).all():
        raise FormatError(f"its last values are {curves[:, -1].round(4).tolist()}; use values above 0")
    curves = curves / curves[:, -1:]
    valid = repair(curves)
    moved = float(np.abs(valid - curves).max())
    if moved > _MOST_REPAIR:
        use = f"use one that does by {_MOST_REPAIR:g} or less"
        raise FormatError(f"a curve falls or begins off 0, by {moved:.2g} of its end; {use}")
    said = [f"made valid as it was read: no sample moved by more than {moved:.1e}"] if moved > END_TOLERANCE else []
    return Passport(direction, merged(valid), warnings=tuple(said), **known)


def merged(curves: Array) -> Array:
    """Return one curve for three equal ones, which is how formats of three columns hold one."""
    return curves[:1] if (curves == curves[:1]).all() else curves


_TITLE = re.compile(r'^[ \t]*TITLE\b[ \t]*"?([^"\n]*).*$', re.MULTILINE | re.IGNORECASE)
_KEYWORD = re.compile(r"[A-Z]+_\w+")
_ENDS = {"DOMAIN_MIN": 3, "DOMAIN_MAX": 3, "LUT_1D_INPUT_RANGE": 2}


def read_cube(data: bytes) -> Passport:
    """Read a one-dimensional lookup table in the cube format of Adobe (IRIDAS) and Resolve: it makes an image linear.

    Cube LUT Specification 1.0, Adobe Systems 2013; ``LUT_1D_INPUT_RANGE``, one range for all channels, is Resolve's
    (LUT format of DaVinci Resolve, Blackmagic Design). A table of any size, whose input covers 0 to 1 as `on_grid` has
    it. One for video levels is a `FormatError`. Keeps the camera as its title.
    """
    text = decode_text(data)
    title = _TITLE.search(text)
    rows = [[row[0].upper(), *row[1:]] for row in rows_of(_TITLE.sub("", text))]  # a title may hold "#"
    heads = [row for row in rows if _KEYWORD.match(row[0])]
    sizes = [row[1:] for row in heads if row[0].endswith("D_SIZE")]
    if len(sizes) != 1 or ["LUT_1D_SIZE", *sizes[0]] not in heads:
        raise FormatError("it has no single line LUT_1D_SIZE; use a one-dimensional table")
    low, high = _cube_domain(heads)
    table = numbers([row for row in rows if row not in heads], "the table")
    if sizes[0] != [str(len(table))] or table.shape[1] != 3:
        raise FormatError(f"its table has shape {table.shape}; its head says ({' '.join(sizes[0])[:20]}, 3)")
    return scaled(on_grid(table, low, high), camera=title.group(1) if title else "")


def _cube_domain(heads: list[list[str]]) -> tuple[Array, Array]:
    if video := [name for name, *_ in heads if "VIDEO_RANGE" in name]:
        raise FormatError(f"it says {video[0][:40]}; write the table for full-range values, from 0 to 1, instead")
    ends = {name: numbers([words], name)[0] for name, *words in heads if name in _ENDS}
    sizes = {name: len(values) for name, values in ends.items()}
    if sizes.items() - _ENDS.items() or ("LUT_1D_INPUT_RANGE" in ends and len(ends) > 1):
        use = "use DOMAIN_MIN and DOMAIN_MAX of 3, or LUT_1D_INPUT_RANGE of 2"
        raise FormatError(f"its input range has {sizes}; {use}")
    low, high = ends.get("LUT_1D_INPUT_RANGE", np.array([0.0, 1.0]))
    return ends.get("DOMAIN_MIN", np.full(3, low)), ends.get("DOMAIN_MAX", np.full(3, high))


def read_spi1d(data: bytes) -> Passport:
    """Read a lookup table of Sony Imageworks, ``.spi1d``, of one or three components, whose range covers 0 to 1.

    OpenColorIO, file format ``spi1d`` (https://opencolorio.readthedocs.io): version, range of the input (``From``),
    length, number of components, and between braces a row a sample. Where these disagree it is a `FormatError`.
    """
    head, _, body = decode_text(data).partition("{")
    told = {name.lower(): words for name, *words in rows_of(head)}
    ends = numbers([told.get("from", [])], "the line From")[0]
    table = numbers(rows_of(body.partition("}")[0]), "the table")
    said = [told.get(name) for name in ("version", "length", "components")]
    if said != [["1"], *([str(size)] for size in table.shape)] or table.shape[1] not in (1, 3) or len(ends) != 2:
        raise FormatError(f"its table has shape {table.shape} and its head says {str(said)[:60]}; let them agree")
    return scaled(on_grid(table, *ends))


_METADATA = re.compile(r"^BEGIN METADATA.*?^END METADATA", re.MULTILINE | re.DOTALL)


def read_csp(data: bytes) -> Passport:
    """Read a lookup table of cineSpace, ``.csp``, with a pre-LUT a channel that shapes its input and covers 0 to 1.

    Rising Sun Research's description, in appendix G of the manual of Open RV (https://aswf-openrv.readthedocs.io). A
    pre-LUT is taken as straight between its points. Other bytes are a `FormatError`.
    """
    rows = rows_of(_METADATA.sub("", decode_text(data)))
    if rows[:2] != [["CSPLUTV100"], ["1D"]]:
        raise FormatError("it does not begin with CSPLUTV100 and 1D; use a one-dimensional table")
    red, rows = _pre_lut(rows[2:])
    green, rows = _pre_lut(rows)
    blue, rows = _pre_lut(rows)
    table = numbers(rows[1:], "the table")
    if rows[0] != [str(len(table))] or table.shape[1] != 3:
        raise FormatError(f"its table has shape {table.shape} below the size {' '.join(rows[0])[:20]}")
    x = np.linspace(0.0, 1.0, len(table))
    shapes = ((_as_brightness(inputs, len(table)), outputs) for inputs, outputs in (red, green, blue))
    shaped = zip(shapes, table.T, strict=True)
    return scaled(np.array([np.interp(np.interp(GRID, *before), x, column) for before, column in shaped]))


def _pre_lut(rows: list[list[str]]) -> tuple[Array, list[list[str]]]:
    """Return the first pre-LUT, inputs and outputs (2, n), and the rows below it."""
    if rows[:1] in ([["0"]], [["1"]]):  # too few points for a shape: it changes nothing
        return np.array([[0.0, 1.0], [0.0, 1.0]]), rows[1:]
    before = numbers(rows[1:3], "a pre-LUT")
    rises = (np.diff(before[0]) > 0).all() and before[0, 0] <= 0 and before[0, -1] >= 1
    if rows[0] != [str(before.shape[1])] or len(before) != 2 or not rises:
        use = "use so many inputs, rising, that cover 0 to 1, and outputs"
        raise FormatError(f"a pre-LUT says {str(rows[0])[:20]}; {use}")
    return before, rows[3:]
