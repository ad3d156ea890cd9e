"""Weights files: safetensors with the model's metadata, and a checksum that tells a damaged or altered file."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from crfbench.errors import FormatError, MissingDataError
from crfbench.files import write_atomically

FORMAT = "crfbench-slr-1"
_NEEDED = {"hidden": list, "n_latent": int, "direction": str, "monotone": bool}


def read_weights(path: str | Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Read a ``.safetensors`` file: its weights, float32 by name, and its metadata.

    A path that leads nowhere is a `MissingDataError`; a damaged, altered or other file is a `FormatError`.
    """
    from safetensors import SafetensorError, safe_open

    path = Path(path)
    if not path.is_file():
        raise MissingDataError(f"there is no weights file {path}; use one that SLR.save wrote")
    try:
        with safe_open(path, framework="numpy") as file:
            entries = file.metadata() or {}
            weights = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  not a dict
    except (SafetensorError, OSError, ValueError) as error:
        raise FormatError(
            f"{path.name} is damaged or not a safetensors file ({error}); use one that SLR.save wrote"
        ) from None
    return weights, _checked_metadata(path.name, entries, weights)


def save_weights(path: str | Path, weights: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> None:
    """Write weights and metadata with their checksum, complete or not at all."""
    from safetensors.numpy import save

    text = json.dumps(dict(metadata), sort_keys=True)
    arrays = {name: np.ascontiguousarray(array, dtype=np.float32) for name, array in sorted(weights.items())}
    # safetensors keeps text only; "card" is what the format has always called the metadata, as one JSON object.
    write_atomically(path, save(arrays, {"format": FORMAT, "card": text, "sha256": _checksum(text, arrays)}))


def _checksum(metadata: str, weights: Mapping[str, np.ndarray]) -> str:
    # Over text, names and shapes too: an edited claim about a model is as bad as an edited weight.
    digest = hashlib.sha256(metadata.encode())
    for name, array in sorted(weights.items()):
        digest.update(f"{name} {array.shape} {array.dtype}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _checked_metadata(name: str, entries: Mapping[str, str], weights: Mapping[str, np.ndarray]) -> dict[str, Any]:
    if entries.get("format") != FORMAT:
        raise FormatError(f"{name} is of format {entries.get('format')!r}; use a weights file of format {FORMAT!r}")
    text = entries.get("card", "")
    if entries.get("sha256") != _checksum(text, weights):
        raise FormatError(f"{name} was altered after it was written (its checksum differs); fetch or train it again")
    try:
        metadata = json.loads(text)
    except (ValueError, RecursionError):
        metadata = None
    complete = isinstance(metadata, dict) and all(isinstance(metadata.get(key), kind) for key, kind in _NEEDED.items())
    if not complete or "latents" not in weights:
        raise FormatError(f"{name} lacks latents or one of {', '.join(_NEEDED)}; use a file that SLR.save wrote")
    return metadata
