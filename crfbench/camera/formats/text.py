"""What the formats share: words that must be numbers, evenly spaced samples, and passports of one curve."""

import numpy as np

from crfbench.camera.passport import Passport
from crfbench.curves import GRID, Array
from crfbench.errors import FormatError, InputError


def decode_text(data: bytes) -> str:
    """Decode UTF-8, with or without a byte order mark; other bytes are a `FormatError`."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError(f"it is not UTF-8 text ({error.reason} at byte {error.start})") from None


def numbers(rows: list[list[str]], where: str) -> Array:
    """Turn rows of words, all of one length, into finite numbers, shape (rows, words), or raise `FormatError`."""
    lengths = {len(row) for row in rows}
    if len(lengths) != 1:
        raise FormatError(f"{where} has rows of {sorted(lengths) or 'no'} values; use rows of one length")
    try:
        values = np.array(rows, dtype=np.float64)
    except ValueError as error:
        raise FormatError(f"{where} holds something that is not a number: {str(error)[:80]}") from None
    if not np.isfinite(values).all():
        raise FormatError(f"{where} holds NaN or infinite values; use finite numbers")
    return values


def on_grid(samples: Array) -> Array:
    """Bring two or more even samples of [0, 1], shape (m, c), onto the grid, (c, 1024); one is a `FormatError`."""
    if len(samples) < 2:
        raise FormatError(f"it has {len(samples)} samples; use two or more")
    x = np.linspace(0.0, 1.0, len(samples))
    return np.array([np.interp(GRID, x, column) for column in samples.T])


def merged(curves: Array) -> Array:
    """Return one curve for three equal ones, which is how formats of three columns hold one."""
    return curves[:1] if (curves == curves[:1]).all() else curves


def single(passport: Passport, name: str) -> Passport:
    """Return the passport if it has one curve."""
    if len(passport.curves) != 1:
        raise InputError(f"{name} holds one curve and this passport has 3; use passport.channel('green'), for example")
    return passport
