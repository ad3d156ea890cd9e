"""What arguments and files must hold: numbers, a whole number, a seed, a known name; else a sentence says what fits."""

import reprlib
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crfbench.errors import FormatError, InputError

MOST = 1e30  # where nothing else bounds an argument


def refuse_masked(name: str, values: object) -> None:
    """Raise `InputError` where an array, or one of a list, has masked values or is a tensor with gradients."""
    # NumPy drops masks without a word.
    parts = values if isinstance(values, list | tuple) else [values]
    masked = sum(int(np.ma.count_masked(part)) for part in parts if isinstance(part, np.ma.MaskedArray))
    if masked:
        raise InputError(f"{name} holds {masked} masked values; fill them, or leave them out")
    if any(getattr(part, "requires_grad", False) for part in parts):
        raise InputError(f"{name} is a tensor that requires gradients; use {name}.detach()")


def as_numbers(name: str, values: object) -> NDArray[np.float64]:
    """Return `values`, which messages call `name`, as float64; NaN may be among them.

    Text, complex numbers, masked values and rows of unequal length are refused; generators are read.
    """
    values = list(values) if isinstance(values, Iterator) else values
    refuse_masked(name, values)
    wrong = "rows of unequal length"
    try:
        array = np.asarray(values)
        wrong = "something that is not a number"
        if values is not None and array.dtype.kind in "biufO":  # objects may be numbers: fractions, large integers
            return np.asarray(array, dtype=np.float64)
        wrong = {"U": "text", "S": "text", "c": "complex numbers"}.get(array.dtype.kind, wrong)
    except (TypeError, ValueError, OverflowError, RuntimeError):
        pass
    raise InputError(f"{name}={reprlib.repr(values)} holds {wrong}; use real numbers")


def as_finite(name: str, values: object) -> NDArray[np.float64]:
    """Return `values` as `as_numbers` does, and refuse NaN and infinite ones too."""
    array = as_numbers(name, values)
    if not np.isfinite(array).all():
        raise InputError(f"{name} of shape {array.shape} holds NaN or infinite values; use finite numbers")
    return array


def check_number(name: str, value: object, least: float, most: float = MOST) -> float:
    """Return `value` if it is a number from `least` to `most`; NaN is outside."""
    # To Python a bool is an int, but nobody means True by a number.
    if (
        isinstance(value, int | float | np.integer | np.floating)
        and not isinstance(value, bool)
        and least <= value <= most
    ):
        return float(value)
    raise InputError(f"{name}={value!r} is out of range; use a number from {least:g} to {most:g}")


def check_count(name: str, value: object, least: int = 1, most: int | None = None) -> int:
    """Return `value` if it is a whole number from `least` to `most`; a float is not, even a whole one."""
    limit = np.inf if most is None else most
    if isinstance(value, int | np.integer) and not isinstance(value, bool) and least <= value <= limit:
        return int(value)
    upto = "" if most is None else f" to {most}"
    raise InputError(f"{name}={value!r} is out of range; use a whole number from {least}{upto}")


def check_seed(seed: object) -> int:
    """Return `seed` if it is a whole number from 0; None is refused, for without a seed no result comes twice."""
    return check_count("seed", seed, least=0)


def check_choice(name: str, value: object, choices: Iterable[str]) -> str:
    """Return `value` if it is one of `choices`."""
    known = list(choices)
    if isinstance(value, str) and value in known:
        return value
    raise InputError(f"{name}={value!r} is not known; use one of {', '.join(known)}")


def counted(number: int, what: str) -> str:
    """Name so many of something: "1 photograph", "2 photographs"."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def unique_names(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a dict of pairs, as JSON's `object_pairs_hook`; a name that comes twice is a `ValueError`."""
    # JSON allows a name twice and readers differ in which one they take.
    names = [name for name, _ in pairs]
    if len(set(names)) < len(names):
        raise ValueError(f"{next(name for name in names if names.count(name) > 1)!r} occurs twice")
    return dict(pairs)


def parse_numbers(words: Sequence[object], where: str) -> NDArray[np.float64]:
    """Turn words of a file, or rows of them of one length, into finite numbers, or raise `FormatError`."""
    try:
        values = np.array(words, dtype=np.float64)
    except ValueError as error:
        raise FormatError(f"{where} holds something that is not a number: {str(error)[:80]}") from None
    if not np.isfinite(values).all():
        raise FormatError(f"{where} holds NaN or infinite values; use finite numbers")
    return values
