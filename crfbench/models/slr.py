"""Single latent representation: a small fully connected autoencoder whose decoder is the response model.

Zhao, Ferguson, Zhou and Rafferty 2022, "Representing Camera Response Function by a Single Latent Variable and Fully
Connected Neural Network". With W_l, b_l the layers of the decoder and h_0 = z the latent,

    h_l = max(0, W_l h_{l-1} + b_l),    f = sigmoid(W_L h_{L-1} + b_L)

The encoder mirrors it, 1024 -> hidden -> latent. Here both run in NumPy; `crfbench.training` trains the weights.
The monotone variant is ours: f = cumulative sum of softplus(W_L h_{L-1} + b_L), divided by its last value, rises from
(0, 0) to (1, 1) for every latent.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from crfbench.checks import check_count, check_seed
from crfbench.curves import N_SAMPLES, Array, Direction, as_scaled_curves
from crfbench.errors import FormatError, InputError, MissingDataError
from crfbench.files import write_atomically
from crfbench.models.base import Prior, ResponseModel, nearest_in_table, refine

LEAST_STEP = 1e-6  #: Added to every step of a monotone curve, which keeps it strictly rising.
_TABLE_SIZE = 4096
_ROWS_IN_CACHE = 128  # decoded together in single precision, as many as the processor's cache holds
_REACH = 1.25  # the table reaches this much farther from the mean than the training latents do


class SLR(ResponseModel):
    """Decoder of `n_latent` numbers to a curve, with its encoder.

    Parameters
    ----------
    hidden : sequence of int
        Neurons of the encoder's one to three hidden layers; the decoder has them in reverse.
    n_latent : int
    direction : {"inverse", "forward"}
    monotone : bool
        Whether decoded curves are monotone from (0, 0) to (1, 1) by construction.
    seed : int
        Of the random weights that a new model has.

    Attributes
    ----------
    weights_ : dict of ndarray
        ``encoder.0.weight`` of shape (out, in), ``encoder.0.bias``, ..., ``decoder.0.weight``, ...; and ``latents``,
        shape (n, n_latent), those of the curves it was trained on. float32.
    metadata_ : dict
        What the weights were trained on, and how; empty for a new model.
    """

    name = "SLR"

    def __init__(
        self,
        hidden: Sequence[int] = (50, 20),
        n_latent: int = 1,
        direction: Direction = "inverse",
        monotone: bool = False,
        seed: int = 0,
    ) -> None:
        super().__init__(n_latent, direction)
        self.param_names = ("latent z",) if n_latent == 1 else tuple(f"latent z{i + 1}" for i in range(n_latent))
        self.hidden = tuple(check_count("hidden", width) for width in hidden) if np.iterable(hidden) else ()
        if not 1 <= len(self.hidden) <= 3:
            raise InputError(f"hidden={hidden!r} is not a valid architecture; use one to three layers of neurons")
        self.monotone = bool(monotone)
        self.weights_ = self._initial(np.random.default_rng(check_seed(seed)))
        self.metadata_: dict[str, Any] = {}
        self.prior_ = Prior.from_samples(self.weights_["latents"].astype(np.float64))

    def __repr__(self) -> str:
        kind = ", monotone=True" if self.monotone else ""
        return f"SLR(hidden={self.hidden}, n_latent={self.n_params}, direction={self.direction!r}{kind})"

    @classmethod
    def from_weights(cls, weights: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> Self:
        """Build a model from trained weights; their metadata name hidden, n_latent, direction and monotone."""
        model = cls(*(metadata[name] for name in ("hidden", "n_latent", "direction", "monotone")))
        expected = {name: array.shape for name, array in model.weights_.items() if name != "latents"}
        given = {name: array.shape for name, array in weights.items() if name != "latents"}
        if given != expected:
            raise InputError(f"weights have the wrong shapes {given} for {model!r}; use {expected}")
        model.weights_ = {name: np.asarray(array, dtype=np.float32) for name, array in weights.items()}
        model.metadata_ = dict(metadata)
        model.prior_ = Prior.from_samples(model.weights_["latents"].astype(np.float64))
        return model

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Load a ``.safetensors`` file that `save` wrote; pretrained models are loaded by `crfbench.load_model`."""
        return cls.from_weights(*read_weights(path))

    def save(self, path: str | Path) -> None:
        """Write weights and metadata to a ``.safetensors`` file, complete or not at all."""
        shape = {"hidden": list(self.hidden), "n_latent": self.n_params, "monotone": self.monotone}
        save_weights(path, self.weights_, {**self.metadata_, **shape, "direction": self.direction})

    def decode(self, params: ArrayLike, dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """Turn latents (..., k) into curves (..., 1024).

        In float32 the arithmetic is single precision too, for dense tables, where speed counts: within 1e-5 of float64
        for latents up to 5 and 1e-4 up to 10, farther than any table reaches, and finite for all.
        """
        latents = self._params(params)
        if np.dtype(dtype) != np.float32:
            return self._output(self._run("decoder", latents)).astype(dtype, copy=False)
        flat = latents.astype(np.float32).reshape(-1, self.n_params)
        curves = np.empty((len(flat), N_SAMPLES), dtype=np.float32)
        for first in range(0, len(flat), _ROWS_IN_CACHE):
            rows = slice(first, first + _ROWS_IN_CACHE)
            self._output_single(self._run("decoder", flat[rows], np.float32), curves[rows])
        return curves.reshape(*latents.shape[:-1], N_SAMPLES)

    def _output_single(self, raw: NDArray[np.float32], out: NDArray[np.float32]) -> None:
        """Do what `_output` does, in single precision and in place: every further array would leave the cache."""
        np.clip(raw, -80.0, 80.0, out=raw)  # beyond, exp leaves single precision
        if self.monotone:
            steps = np.log(1.0 + np.exp(raw, out=raw), out=raw)  # in a sum as exact as log1p, and twice as fast
            np.cumsum(steps + np.float32(LEAST_STEP), axis=1, out=out[:, 1:])
            out[:, 0] = 0.0
            out /= out[:, -1:]
        else:
            np.exp(np.negative(raw, out=raw), out=raw)
            raw += 1.0
            np.reciprocal(raw, out=out)

    def encode(self, curves: ArrayLike) -> Array:
        """Turn curves (n, 1024) into the latents (n, k) that the encoder gives them; `fit` finds better ones."""
        return self._run("encoder", as_scaled_curves(curves))[:, : self.n_params]

    def jacobian(self, params: ArrayLike) -> Array:
        """Differentiate the decoder by the latents: (..., k) gives (..., 1024, k)."""
        return self.decode_with_jacobian(params)[1]

    def decode_with_jacobian(self, params: ArrayLike) -> tuple[Array, Array]:
        """Return curves (..., 1024) and their derivatives (..., 1024, k) from one pass."""
        *hidden, (weight, bias) = self._layers("decoder")
        h = self._params(params)
        slope = np.broadcast_to(np.eye(self.n_params), (*h.shape, self.n_params))
        for w, b in hidden:
            raw = h @ w.T + b
            # The derivative of ReLU: what it cuts off passes nothing on.
            h, slope = np.maximum(raw, 0.0), (w @ slope) * (raw > 0)[..., None]
        raw = h @ weight.T + bias
        curves = self._output(raw)
        return curves, self._output_slope(raw, curves, weight @ slope)

    def fit(self, curves: ArrayLike) -> Array:
        """Search a dense table of latents, then polish the nearest few; keep the best.

        The table lies near the latents of the training curves; of curves unlike them a better fit may lie far off.
        """
        batch, table = as_scaled_curves(curves), self._table()
        nearest = nearest_in_table(batch, table, self.decode(table, np.float32), n_best=2 + self.n_params)
        return refine(self, batch, nearest, max_steps=30)  # the table is dense, and the bends of ReLU stop Newton

    def _table(self) -> Array:
        """Return latents that cover those of the training curves: even steps for one, spread draws for more."""
        latents = self.weights_["latents"].astype(np.float64)
        centre = latents.mean(axis=0)
        if self.n_params == 1:
            reach = _REACH * np.abs(latents - centre).max() + 0.5
            return (centre + np.linspace(-reach, reach, _TABLE_SIZE))[:, None]
        rng = np.random.default_rng(0)
        pairs = rng.integers(len(latents), size=(2, _TABLE_SIZE))
        share = rng.uniform(-0.25, 1.25, size=(_TABLE_SIZE, 1))
        return np.concatenate([latents, latents[pairs[0]] * share + latents[pairs[1]] * (1.0 - share)])

    def _run(self, half: str, h: NDArray[Any], dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """Run "encoder" or "decoder" up to what its last layer gives."""
        *hidden, (weight, bias) = self._layers(half, dtype)
        for w, b in hidden:
            h = np.maximum(h @ w.T + b, 0.0)
        raw = h @ weight.T
        raw += bias
        return raw

    def _layers(self, half: str, dtype: DTypeLike = np.float64) -> list[tuple[NDArray[Any], NDArray[Any]]]:
        """Return weights and biases of "encoder" or "decoder", in order."""
        names = (f"{half}.{i}" for i in range(len(self.hidden) + 1))
        pairs = ((self.weights_[f"{name}.weight"], self.weights_[f"{name}.bias"]) for name in names)
        return [(weight.astype(dtype, copy=False), bias.astype(dtype, copy=False)) for weight, bias in pairs]

    def _output(self, raw: Array) -> Array:
        if not self.monotone:
            return _sigmoid(raw)
        total = np.cumsum(np.logaddexp(raw, 0.0) + LEAST_STEP, axis=-1)
        return np.concatenate([np.zeros((*raw.shape[:-1], 1)), total / total[..., -1:]], axis=-1)

    def _output_slope(self, raw: Array, curves: Array, slope: Array) -> Array:
        """Carry the derivative of the last layer, (..., m, k), through the output function to `curves`."""
        if not self.monotone:
            return (curves * (1.0 - curves))[..., None] * slope
        total = (np.logaddexp(raw, 0.0) + LEAST_STEP).sum(axis=-1)[..., None, None]
        rise = np.cumsum(_sigmoid(raw)[..., None] * slope, axis=-2)
        inner = (rise - curves[..., 1:, None] * rise[..., -1:, :]) / total
        return np.concatenate([np.zeros_like(inner[..., :1, :]), inner], axis=-2)

    def _initial(self, rng: np.random.Generator) -> dict[str, np.ndarray]:
        decoder = (self.n_params, *self.hidden[::-1], N_SAMPLES - self.monotone)
        sizes = {"encoder": (N_SAMPLES, *self.hidden, self.n_params), "decoder": decoder}
        weights: dict[str, np.ndarray] = {"latents": rng.normal(size=(64, self.n_params)).astype(np.float32)}
        for half, widths in sizes.items():
            for i, (fan_in, fan_out) in enumerate(pairwise(widths)):
                limit = 1.0 / np.sqrt(fan_in)
                weights[f"{half}.{i}.weight"] = rng.uniform(-limit, limit, (fan_out, fan_in)).astype(np.float32)
                weights[f"{half}.{i}.bias"] = rng.uniform(-limit, limit, fan_out).astype(np.float32)
        return weights


def _sigmoid(x: Array) -> Array:
    return 0.5 * (1.0 + np.tanh(0.5 * x))


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
        reason = f"is damaged or not a safetensors file ({error})"
        raise FormatError(f"{path.name} {reason}; use one that SLR.save wrote") from None
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
