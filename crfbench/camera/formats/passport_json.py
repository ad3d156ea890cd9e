"""The passport itself as JSON, version 1: carries everything, exactly."""

import json
from dataclasses import fields
from typing import Any

import numpy as np

from crfbench.camera.passport import Passport
from crfbench.errors import FormatError

SUFFIX = ".json"

_KIND = "crfbench response passport"
_VERSION = 1
_NAMES = tuple(field.name for field in fields(Passport))


def write(passport: Passport) -> bytes:
    """Write every field under its name; the bytes depend on the passport alone."""
    values = {name: getattr(passport, name) for name in _NAMES}
    return json.dumps(
        {"format": _KIND, "schema": _VERSION, **values}, default=np.ndarray.tolist, allow_nan=False
    ).encode()


def read(data: bytes) -> Passport:
    """Read a passport; an entry that is missing, unknown or there twice is a `FormatError`."""
    content = _parse(data)
    if not isinstance(content, dict) or content.get("format") != _KIND:
        raise FormatError(f"it does not say that its format is {_KIND!r}; use a passport that crfbench wrote")
    if content.get("schema") != _VERSION:
        raise FormatError(f"its schema is {str(content.get('schema'))[:20]!r}; this crfbench reads {_VERSION}")
    values = {name: value for name, value in content.items() if name not in ("format", "schema")}
    if odd := set(values) ^ set(_NAMES):
        raise FormatError(f"these entries are missing or unknown: {', '.join(sorted(odd))[:100]}")
    return Passport(**values)


def _parse(data: bytes) -> object:
    try:
        return json.loads(data, parse_constant=_refuse, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"it is not JSON ({str(error)[:80]})") from None


def _refuse(constant: str) -> float:
    raise FormatError(f"it holds {constant}; use finite numbers")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    # JSON allows a name twice and readers differ in which one they take.
    content = dict(pairs)
    if len(content) != len(pairs):
        raise FormatError("it has two entries of one name")
    return content
