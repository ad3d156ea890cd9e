"""Single latent representation: a small fully connected autoencoder whose decoder is the response model.

Zhao, Ferguson, Zhou and Rafferty 2022, "Representing Camera Response Function by a Single Latent Variable and Fully
Connected Neural Network". With W_l, b_l the layers of the decoder and h_0 = z the latent,

    h_l = max(0, W_l h_{l-1} + b_l),    f = sigmoid(W_L h_{L-1} + b_L)

The encoder mirrors it, 1024 -> hidden -> latent. Here both run in NumPy; `crfbench.training` trains the weights.
The monotone variant is ours: f = cumulative sum of softplus(W_L h_{L-1} + b_L), divided by its last value, rises from
(0, 0) to (1, 1) for every latent.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.checks import check_count, check_seed
from crfbench.curves import N_SAMPLES, Array, Direction, as_scaled_curves
from crfbench.errors import InputError
from crfbench.models.base import Prior, ResponseModel, nearest_in_table, refine
from crfbench.models.weights import load_weights, save_weights

LEAST_STEP = 1e-6  #: Added to every step of a monotone curve, which keeps it strictly rising.
_TABLE_SIZE = 4096
_ROWS_IN_CACHE = 128  # decoded together in single precision
_REACH = 1.25  # the table reaches this much farther from the mean than the training latents do


class SLR(ResponseModel):
    """Decoder of `n_latent` numbers to a curve, with its encoder.

    Parameters
    ----------
    hidden : sequence of int
        Neurons of the encoder's one to three hidden layers; the decoder has them in reverse.
    n_latent : int
    direction : {"forward", "inverse"}
    monotone : bool
        Whether decoded curves are monotone from (0, 0) to (1, 1) by construction.
    seed : int
        Of the random weights that a new model has.

    Attributes
    ----------
    weights_ : dict of ndarray
        ``encoder.0.weight`` of shape (out, in), ``encoder.0.bias``, ..., ``decoder.0.weight``, ...; and ``latents``,
        shape (n, n_latent), those of the curves it was trained on. float32.
    card_ : dict
        What the weights were trained on, and how; empty for a new model.
    """

    name = "SLR"
    learns = True

    def __init__(
        self,
        hidden: Sequence[int] = (50, 20),
        n_latent: int = 1,
        direction: Direction = "forward",
        monotone: bool = False,
        seed: int = 0,
    ) -> None:
        super().__init__(n_latent, direction)
        self.hidden = _check_hidden(hidden)
        self.monotone = bool(monotone)
        self.weights_ = self._initial(np.random.default_rng(check_seed(seed)))
        self.card_: dict[str, Any] = {}
        self._learn_prior_from_latents()

    def __repr__(self) -> str:
        kind = ", monotone=True" if self.monotone else ""
        return f"SLR(hidden={self.hidden}, n_latent={self.n_params}, direction={self.direction!r}{kind})"

    @property
    def param_names(self) -> tuple[str, ...]:
        """The names of the parameters, in order."""
        return ("latent z",) if self.n_params == 1 else tuple(f"latent z{i + 1}" for i in range(self.n_params))

    @classmethod
    def from_curves(cls, curves: ArrayLike, n_params: int, direction: Direction) -> Self:
        """Refuse: an SLR learns by `crfbench.training.train`.

        Raises
        ------
        InputError
            Always.
        """
        raise InputError("an SLR learns by gradient descent; use crfbench.training.train or SLR.load")

    @classmethod
    def from_weights(cls, weights: Mapping[str, np.ndarray], card: Mapping[str, Any]) -> Self:
        """Build a model from trained weights and their card, which names hidden, n_latent, direction and monotone.

        Raises
        ------
        InputError
            When the weights are not those of the network that the card describes.
        """
        model = cls(card["hidden"], card["n_latent"], card["direction"], card["monotone"])
        expected = {name: array.shape for name, array in model.weights_.items() if name != "latents"}
        given = {name: array.shape for name, array in weights.items() if name != "latents"}
        if given != expected:
            raise InputError(f"weights of shapes {given} do not fit {model!r}; use {expected}")
        model.weights_ = {name: np.asarray(array, dtype=np.float32) for name, array in weights.items()}
        model.card_ = dict(card)
        model._learn_prior_from_latents()
        return model

    @classmethod
    def load(cls, name: str | Path, n_latent: int = 1, direction: Direction = "inverse") -> Self:
        """Load shipped weights by constraint, or a weights file by its path.

        Parameters
        ----------
        name : str or Path
            "baseline", "ldl", "auc", "aae", "vae", "monotone" or "open" (the monotone one trained on OpenCRF), a whole
            name such as "ldl-1-inverse", or a path that ends in ``.safetensors``.
        n_latent : int
        direction : {"forward", "inverse"}
            Both choose among the shipped weights and do nothing for a whole name or a path. Inverse responses are
            what calibration uses.

        Raises
        ------
        InputError
            For weights that are not shipped; the message lists those that are.
        FormatError
            For a file that is truncated, altered or no SLR.
        """
        return cls.from_weights(*load_weights(name, n_latent, direction))

    def save(self, path: str | Path) -> None:
        """Write weights and card to a ``.safetensors`` file, complete or not at all."""
        shape = {
            "hidden": list(self.hidden),
            "n_latent": self.n_params,
            "direction": self.direction,
            "monotone": self.monotone,
        }
        save_weights(path, self.weights_, {**self.card_, **shape})

    def decode(self, params: ArrayLike) -> Array:
        """Turn latents (..., k) into curves (..., 1024)."""
        *hidden, (weight, bias) = self._layers("decoder")
        h = self._params(params)
        for w, b in hidden:
            h = np.maximum(h @ w.T + b, 0.0)
        return self._output(h @ weight.T + bias)

    def decode_float32(self, params: ArrayLike) -> NDArray[np.float32]:
        """Decode latents (n, k) in single precision, for dense tables, where speed counts.

        Within 1e-5 of `decode` for latents up to 30, farther than any table reaches, and finite for all.
        """
        latents = np.atleast_2d(self._params(params)).astype(np.float32)
        curves = np.empty((len(latents), N_SAMPLES), dtype=np.float32)
        for first in range(0, len(latents), _ROWS_IN_CACHE):
            rows = slice(first, first + _ROWS_IN_CACHE)
            self._decode_rows(latents[rows], curves[rows])
        return curves

    def _decode_rows(self, h: NDArray[np.float32], out: NDArray[np.float32]) -> None:
        for i in range(len(self.hidden)):
            h = np.maximum(h @ self.weights_[f"decoder.{i}.weight"].T + self.weights_[f"decoder.{i}.bias"], 0.0)
        last = len(self.hidden)
        raw = h @ self.weights_[f"decoder.{last}.weight"].T
        raw += self.weights_[f"decoder.{last}.bias"]
        np.clip(raw, -80.0, 80.0, out=raw)  # beyond, exp leaves single precision
        if self.monotone:
            steps = np.log1p(np.exp(raw, out=raw), out=raw)
            np.cumsum(steps + np.float32(LEAST_STEP), axis=1, out=out[:, 1:])
            out[:, 0] = 0.0
            out /= out[:, -1:]
        else:
            np.exp(np.negative(raw, out=raw), out=raw)
            raw += 1.0
            np.reciprocal(raw, out=out)

    def encode(self, curves: ArrayLike) -> Array:
        """Turn curves (n, 1024) into the latents (n, k) that the encoder gives them; `fit` finds better ones."""
        *hidden, (weight, bias) = self._layers("encoder")
        h = as_scaled_curves(curves)
        for w, b in hidden:
            h = np.maximum(h @ w.T + b, 0.0)
        return np.asarray((h @ weight.T + bias)[:, : self.n_params])

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
            h, slope = np.maximum(raw, 0.0), (w @ slope) * (raw > 0)[..., None]
        raw = h @ weight.T + bias
        curves = self._output(raw)
        return curves, self._output_slope(raw, curves, weight @ slope)

    def fit(self, curves: ArrayLike) -> Array:
        """Search a dense table of latents, then polish the nearest few; keep the best."""
        batch, table = as_scaled_curves(curves), self._table()
        nearest = nearest_in_table(batch, table, self.decode_float32(table), n_best=2 + self.n_params)
        return refine(self, batch, nearest, max_steps=30)  # the table is dense, and the bends of ReLU stop Newton

    def _table(self) -> Array:
        """Latents that cover those of the training curves: even steps for one, spread draws for more."""
        latents = self.weights_["latents"].astype(np.float64)
        centre = latents.mean(axis=0)
        if self.n_params == 1:
            reach = _REACH * np.abs(latents - centre).max() + 0.5
            return (centre + np.linspace(-reach, reach, _TABLE_SIZE))[:, None]
        rng = np.random.default_rng(0)
        pairs = rng.integers(len(latents), size=(2, _TABLE_SIZE))
        share = rng.uniform(-0.25, 1.25, size=(_TABLE_SIZE, 1))
        return np.concatenate([latents, latents[pairs[0]] * share + latents[pairs[1]] * (1.0 - share)])

    def _layers(self, half: str) -> list[tuple[Array, Array]]:
        """Weights and biases of "encoder" or "decoder", in order, float64."""
        count = len(self.hidden) + 1
        pairs = ((self.weights_[f"{half}.{i}.weight"], self.weights_[f"{half}.{i}.bias"]) for i in range(count))
        return [(w.astype(np.float64), b.astype(np.float64)) for w, b in pairs]

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
        outputs = N_SAMPLES - self.monotone
        sizes = {
            "encoder": (N_SAMPLES, *self.hidden, self.n_params),
            "decoder": (self.n_params, *self.hidden[::-1], outputs),
        }
        weights: dict[str, np.ndarray] = {"latents": rng.normal(size=(64, self.n_params)).astype(np.float32)}
        for half, widths in sizes.items():
            for i, (fan_in, fan_out) in enumerate(pairwise(widths)):
                limit = 1.0 / np.sqrt(fan_in)
                weights[f"{half}.{i}.weight"] = rng.uniform(-limit, limit, (fan_out, fan_in)).astype(np.float32)
                weights[f"{half}.{i}.bias"] = rng.uniform(-limit, limit, fan_out).astype(np.float32)
        return weights

    def _learn_prior_from_latents(self) -> None:
        self.prior_ = Prior.from_samples(self.weights_["latents"].astype(np.float64))


def _sigmoid(x: Array) -> Array:
    return 0.5 * (1.0 + np.tanh(0.5 * x))


def _check_hidden(hidden: Sequence[int]) -> tuple[int, ...]:
    widths = tuple(check_count("hidden", width) for width in hidden) if np.iterable(hidden) else ()
    if not 1 <= len(widths) <= 3:
        raise InputError(f"hidden={hidden!r} is no architecture; use one to three layers of one or more neurons")
    return widths
