"""Weights files: safetensors with a model card in the metadata, and a checksum that tells a damaged or altered one."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from crfbench.errors import FormatError, InputError, MissingDataError
from crfbench.files import write_atomically
from crfbench.resources import shipped

FORMAT = "crfbench-slr-1"
_NEEDED = {"hidden": list, "n_latent": int, "direction": str, "monotone": bool}


def shipped_weights() -> list[str]:
    """Return the names of the shipped weights files, such as "ldl-1-inverse"."""
    return sorted(path.stem for path in shipped("data/weights").glob("*.safetensors"))


def load_weights(name: str | Path, n_latent: int, direction: str) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Read shipped weights by name, number of latents and direction, or a ``.safetensors`` file by its path.

    Returns
    -------
    weights : dict of ndarray, float32
    card : dict

    Raises
    ------
    InputError
        For weights that are not shipped; the message lists those that are.
    MissingDataError
        For a path that leads nowhere.
    FormatError
        For a file that is truncated, altered or of another kind.
    """
    if str(name).endswith(".safetensors"):
        return read_weights(Path(name))
    stem = str(name).lower()
    stem = stem if stem in shipped_weights() else f"{stem}-{n_latent}-{direction}"
    if stem not in shipped_weights():
        raise InputError(f"there are no shipped weights {stem!r}; there are: {', '.join(shipped_weights()) or 'none'}")
    return read_weights(shipped("data/weights") / f"{stem}.safetensors")


def read_weights(path: str | Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Read one weights file; see `load_weights`.

    Raises
    ------
    MissingDataError
        For a path that leads nowhere.
    FormatError
        For a file that is damaged, altered or of another kind.
    """
    from safetensors import SafetensorError, safe_open

    path = Path(path)
    if not path.is_file():
        raise MissingDataError(f"there is no weights file {path}; use one that SLR.save wrote")
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            weights = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  not a dict
    except (SafetensorError, OSError, ValueError) as error:
        raise FormatError(
            f"{path.name} is damaged or no safetensors file ({error}); use one that SLR.save wrote"
        ) from None
    return weights, _checked_card(path.name, metadata, weights)


def save_weights(path: str | Path, weights: Mapping[str, np.ndarray], card: Mapping[str, Any]) -> None:
    """Write weights and card with their checksum, complete or not at all."""
    from safetensors.numpy import save

    text = json.dumps(dict(card), sort_keys=True)
    arrays = {name: np.ascontiguousarray(array, dtype=np.float32) for name, array in sorted(weights.items())}
    metadata = {"format": FORMAT, "card": text, "sha256": _checksum(text, arrays)}
    write_atomically(path, save(arrays, metadata))


def _checksum(card: str, weights: Mapping[str, np.ndarray]) -> str:
    digest = hashlib.sha256(card.encode())
    for name, array in sorted(weights.items()):
        digest.update(f"{name} {array.shape} {array.dtype}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _checked_card(name: str, metadata: Mapping[str, str], weights: Mapping[str, np.ndarray]) -> dict[str, Any]:
    if metadata.get("format") != FORMAT:
        raise FormatError(f"{name} is of format {metadata.get('format')!r}; use a weights file of format {FORMAT!r}")
    text = metadata.get("card", "")
    if metadata.get("sha256") != _checksum(text, weights):
        raise FormatError(f"{name} was altered after it was written (its checksum differs); fetch or train it again")
    card = _parsed(text)
    if not all(isinstance(card.get(key), kind) for key, kind in _NEEDED.items()) or "latents" not in weights:
        raise FormatError(f"{name} lacks latents or one of {', '.join(_NEEDED)}; use a file that SLR.save wrote")
    return card


def _parsed(card: str) -> dict[str, Any]:
    """Return the card, empty where it is no JSON object."""
    try:
        content = json.loads(card)
    except (ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}
