"""Train the SLR models that crfbench ships, each with a card that says what it was trained on and how well it does."""

import hashlib
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args

import numpy as np

import crfbench
from crfbench.curves import Array, Direction
from crfbench.datasets import Responses, load_responses
from crfbench.errors import InputError
from crfbench.history import History
from crfbench.metrics import mse, nonmonotone
from crfbench.models.slr import SLR
from crfbench.tables.latents import latent_figures
from crfbench.training import RECIPES, train

DIRECTIONS: tuple[Direction, ...] = get_args(Direction)
_SEED_OF_VALIDITY = 1


def shipped_names() -> list[str]:
    """Return the names of all models that are shipped, such as "ldl-1-inverse"."""
    return [f"{name}-{direction}" for name in RECIPES for direction in DIRECTIONS]


def train_shipped(names: Iterable[str], folder: Path, progress: bool = True) -> Iterator[Path]:
    """Train models by name and write their weights, and the histories of the one-latent inverse ones, under `folder`.

    Parameters
    ----------
    names : iterable of str
        Of `shipped_names`. "open" models learn from OpenCRF alone, all others from DoRF.
    folder : Path
        Gets ``weights/NAME.safetensors`` and ``histories/CONSTRAINT.npz``.
    progress : bool

    Yields
    ------
    Path
        Each file when it is written.

    Raises
    ------
    InputError
        For an unknown name.
    MissingDataError
        Where DoRF is needed and absent.
    """
    wanted = list(names)
    for name in wanted:
        if name not in shipped_names():
            raise InputError(f"{name!r} is no shipped model; use --all or some of: {', '.join(shipped_names())}")
    data = {key: load_responses(key) for key in sorted({_dataset(name) for name in wanted})}
    for name in wanted:
        model, history = _train_one(name, data[_dataset(name)], progress)
        model.save(folder / "weights" / f"{name}.safetensors")
        yield folder / "weights" / f"{name}.safetensors"
        if name in {f"{constraint}-1-inverse" for constraint in ("baseline", "ldl", "auc", "aae", "vae")}:
            history.thin(150).save(folder / "histories" / f"{model.card_['constraint']}.npz")
            yield folder / "histories" / f"{model.card_['constraint']}.npz"


def _dataset(name: str) -> str:
    return "opencrf" if name.startswith("open-") else "dorf"


def _train_one(name: str, responses: Responses, progress: bool) -> tuple[SLR, History]:
    recipe_name, direction = name.rsplit("-", 1)
    side: Direction = "forward" if direction == "forward" else "inverse"
    curves = responses.in_direction(side)
    start = time.perf_counter()
    model, history = train(curves, side, RECIPES[recipe_name], _data_card(responses), progress=progress)
    seconds = time.perf_counter() - start
    model.card_["figures"] = {**_figures(model, curves), "training_seconds": round(seconds, 1)}
    return model, history


def _data_card(responses: Responses) -> dict[str, Any]:
    digest = hashlib.sha256(np.ascontiguousarray(responses.curves, dtype="<f4").tobytes()).hexdigest()
    return {
        "data": responses.dataset,
        "n_curves": len(responses),
        "sha256 of the curves (float32)": digest,
        "crfbench": crfbench.__version__,
        "licence": "MIT",
    }


def _figures(model: SLR, curves: Array) -> dict[str, float]:
    best = mse(model.decode(model.fit(curves)), curves)
    encoder = mse(model.decode(model.encode(curves)), curves)
    drawn = model.decode(np.random.default_rng(_SEED_OF_VALIDITY).normal(size=(10_000, model.n_params)))
    return {
        "best_mse": float(best.mean()),
        "best_rmse": float(np.sqrt(best).mean()),
        "encoder_mse": float(encoder.mean()),
        "nonmonotone_of_10000": int(nonmonotone(drawn).sum()),
        **latent_figures(model.weights_["latents"].astype(float)),
    }
