"""Training an SLR: one loop for every constraint, plain or monotone, in PyTorch; and the trainings that are bundled.

Three things make it fast and change nothing of the network that comes out: the encoder sees centred and scaled
curves (folded into its first layer afterwards), the output starts at the mean curve, and the step size goes through
one cosine cycle (Smith and Topin 2017, arXiv:1708.07120).
"""

import hashlib
import math
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn
from torch.nn import functional
from tqdm.auto import tqdm

from crfbench.checks import check_choice, check_count, check_number, check_seed
from crfbench.constraints import CONSTRAINTS, Constraint
from crfbench.curves import N_SAMPLES, Direction, as_valid_curves
from crfbench.datasets import Responses, load_responses
from crfbench.errors import InputError
from crfbench.history import PROBE_SAMPLES, PROBES, History, latent_statistics
from crfbench.metrics import mse, nonmonotone
from crfbench.models import ModelKey
from crfbench.models.slr import LEAST_STEP, SLR

LEAST_CYCLE = 12  # steps; PyTorch divides by zero where the first tenth of a cycle is one step
_SEED_OF_VALIDITY = 1

OnEpoch = Callable[[int, "Trainer"], bool | None]


@dataclass(frozen=True)
class TrainingConfig:
    """Everything that decides the weights, besides the curves."""

    hidden: tuple[int, ...] = (50, 20)  # neurons of the encoder's hidden layers
    n_latent: int = 1
    monotone: bool = False
    constraint: str = "ldl"
    smoothness: float = 1e-5  # weight of the l2-norm of the decoded curves' first derivative
    dropout: float = 0.0  # share of hidden neurons left out at random in each step; none at inference
    epochs: int = 1000
    learning_rate: float = 1e-2  # the highest of the cycle
    # curves a step; by default all, which the constraints on the whole distribution like best
    batch_size: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        check_choice("constraint", self.constraint, CONSTRAINTS)
        check_count("n_latent", self.n_latent)
        check_count("epochs", self.epochs)
        if self.batch_size is not None:
            check_count("batch_size", self.batch_size, 2)
        check_number("smoothness", self.smoothness, 0.0)
        check_number("dropout", self.dropout, 0.0, 0.99)
        check_number("learning_rate", self.learning_rate, 1e-9)
        check_seed(self.seed)


class Autoencoder(nn.Module):
    """The network in PyTorch, with the names and shapes of an SLR's weights.

    It takes the widths of `model`, not its weights; `generator` draws the neurons that dropout leaves out.
    """

    def __init__(
        self, model: SLR, codes_per_latent: int = 1, dropout: float = 0.0, generator: torch.Generator | None = None
    ) -> None:
        super().__init__()
        widths = (N_SAMPLES, *model.hidden, codes_per_latent * model.n_params)
        self.encoder = _layers(widths)
        self.decoder = _layers((model.n_params, *model.hidden[::-1], N_SAMPLES - model.monotone))
        self.monotone, self.keep, self.generator = model.monotone, 1.0 - dropout, generator

    def encode(self, curves: Tensor) -> Tensor:
        """Turn curves (n, 1024) into codes."""
        return self._run(self.encoder, curves)

    def decode(self, latents: Tensor) -> Tensor:
        """Turn latents (n, k) into curves (n, 1024)."""
        raw = self._run(self.decoder, latents)
        if not self.monotone:
            return torch.sigmoid(raw)
        total = (functional.softplus(raw) + LEAST_STEP).cumsum(dim=-1)
        return functional.pad(total / total[..., -1:], (1, 0))

    def _run(self, layers: nn.ModuleList, h: Tensor) -> Tensor:
        for i in range(len(layers) - 1):
            h = functional.relu(layers[i](h))
            if self.training and self.keep < 1.0:
                h = h * torch.bernoulli(torch.full_like(h, self.keep), generator=self.generator) / self.keep
        return cast(Tensor, layers[-1](h))


def _layers(widths: tuple[int, ...]) -> nn.ModuleList:
    return nn.ModuleList(nn.Linear(fan_in, fan_out) for fan_in, fan_out in pairwise(widths))


def to_torch(model: SLR) -> Autoencoder:
    """Return the PyTorch network with the weights of a trained SLR, for checks and comparisons."""
    network = Autoencoder(model)
    network.load_state_dict({n: torch.as_tensor(w) for n, w in model.weights_.items() if n != "latents"})
    return network.eval()


def train(
    curves: ArrayLike,
    direction: Direction = "inverse",
    config: TrainingConfig | None = None,
    metadata: dict[str, Any] | None = None,
    on_epoch: OnEpoch | None = None,
    progress: bool = False,
) -> tuple[SLR, History]:
    """Train an SLR on curves of one direction.

    The weights returned are those with the lowest loss; so they are after a stop by `on_epoch` or Ctrl-C too.
    Same curves, config and machine: same weights.

    Parameters
    ----------
    curves : array_like, shape (n, 1024), n > 1
    direction : {"inverse", "forward"}
        Of the curves.
    config : TrainingConfig, optional
    metadata : dict, optional
        What to keep with the model beside the config, such as the name and hash of the data.
    on_epoch : callable, optional
        Called after each epoch with its number and the trainer; training stops when it returns True.
    progress : bool
        Whether to show a bar with the time left.
    """
    batch = as_valid_curves(curves)
    if len(batch) < 2:
        raise InputError(f"{len(batch)} curve cannot train an SLR; use two or more")
    trainer = Trainer(batch, direction, config or TrainingConfig())
    bar = tqdm(range(trainer.config.epochs), desc=trainer.config.constraint, unit="epoch", disable=not progress)
    with one_thread():
        try:
            for epoch in bar:
                trainer.epoch()
                if on_epoch is not None and on_epoch(epoch, trainer):
                    break
        except KeyboardInterrupt:
            if not trainer.losses:
                raise
    return trainer.model(metadata), trainer.history()


@contextmanager
def one_thread() -> Iterator[None]:
    """Compute in one thread: as fast for matrices this small, and the same sums in the same order on every run."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


class Trainer:
    """The state of one training of valid curves (n, 1024); `train` drives it, and a page that shows one can too."""

    def __init__(self, curves: np.ndarray, direction: Direction, config: TrainingConfig) -> None:
        self.config, self.curves = config, torch.tensor(curves, dtype=torch.float32)
        self.losses: list[dict[str, float]] = []
        self._latents: list[Tensor] = []
        self._probes: list[Tensor] = []
        self._best = math.inf
        # PyTorch draws first weights from its global generator; fork_rng gives the caller's state back.
        with torch.random.fork_rng():
            torch.manual_seed(config.seed)
            self.generator = torch.Generator().manual_seed(config.seed)
            self.constraint: Constraint = CONSTRAINTS[config.constraint](self.curves, config.n_latent, self.generator)
            self.slr = SLR(config.hidden, config.n_latent, direction, config.monotone, config.seed)
            self.network = Autoencoder(self.slr, self.constraint.codes_per_latent, config.dropout, self.generator)
            self._start_near_the_data()
        steps = config.epochs * len(self._batches(shuffle=False))
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=config.learning_rate, fused=True)
        self.schedule = torch.optim.lr_scheduler.OneCycleLR(
            self.optimiser, config.learning_rate, total_steps=max(steps + 1, LEAST_CYCLE), pct_start=0.1
        )

    def epoch(self) -> None:
        """Take one step for each batch, then keep losses, latents and probes."""
        self.network.train()
        terms = [self._step(rows) for rows in self._batches(shuffle=True)]
        self.network.eval()
        with torch.no_grad():
            self._latents.append(self.network.encode(self._scaled(self.curves))[:, : self.config.n_latent])
            probes = functional.pad(
                torch.as_tensor(PROBES, dtype=torch.float32)[:, None], (0, self.config.n_latent - 1)
            )
            self._probes.append(self.network.decode(probes)[:, PROBE_SAMPLES])
        self.losses.append({name: float(np.mean([term[name] for term in terms])) for name in terms[0]})
        if self.losses[-1]["total"] < self._best:
            self._best = self.losses[-1]["total"]
            self._best_state = {name: w.clone() for name, w in self.network.state_dict().items()}
            self._best_latents = self._latents[-1]

    def model(self, metadata: dict[str, Any] | None = None) -> SLR:
        """Return the best model so far, with `metadata` beside the config's."""
        state = {name: w.numpy().copy() for name, w in self._best_state.items()}
        last = f"encoder.{len(self.config.hidden)}"
        for part in ("weight", "bias"):  # of a VAE's encoder, only the half that gives the means is kept
            state[f"{last}.{part}"] = state[f"{last}.{part}"][: self.config.n_latent]
        weight = state["encoder.0.weight"] / float(self._scale)
        state["encoder.0.bias"] -= weight @ self._mean.numpy()
        state |= {"encoder.0.weight": weight, "latents": self._best_latents.numpy().copy()}
        kind = {"direction": self.slr.direction, "trained_epochs": len(self.losses)}
        return SLR.from_weights(state, {**asdict(self.config), **(metadata or {}), **kind})

    def history(self) -> History:
        """Return what was kept of the epochs so far."""
        losses = {name: np.array([term[name] for term in self.losses]) for name in self.losses[0]}
        latents, probes = torch.stack(self._latents).numpy(), torch.stack(self._probes).numpy()
        return History(self.config.constraint, np.arange(len(self.losses)), losses, latents, probes)

    def _step(self, rows: Tensor) -> dict[str, float]:
        x, config = self.curves[rows], self.config
        codes = self.network.encode(self._scaled(x))
        y = self.network.decode(self.constraint.latents(codes))
        fit, rough = functional.mse_loss(y, x), roughness(y)
        penalty = self.constraint.penalty(codes, x)
        total = fit + self.constraint.weights[config.n_latent > 1] * penalty + config.smoothness * rough
        self.optimiser.zero_grad()
        torch.autograd.backward(total)
        self.optimiser.step()
        rate = float(self.schedule.get_last_lr()[0])
        self.schedule.step()
        terms = {"total": total, "mse": fit, "constraint": penalty, "smoothness": rough}
        return {**{k: float(v.detach()) for k, v in terms.items()}, "learning rate": rate, **self.constraint.logged()}

    def _batches(self, shuffle: bool) -> list[Tensor]:
        """Rows of each batch; a last batch of one curve joins the one before, for it has no distribution."""
        n, size = len(self.curves), self.config.batch_size or len(self.curves)
        if size >= n:
            return [torch.arange(n)]  # in order, so that no random number is spent
        order = torch.randperm(n, generator=self.generator) if shuffle else torch.arange(n)
        return list(order.tensor_split(max(n // size, 1)))

    def _scaled(self, curves: Tensor) -> Tensor:
        return (curves - self._mean) / self._scale

    @torch.no_grad()
    def _start_near_the_data(self) -> None:
        """Start the output at the mean curve and the first bends evenly over the range that the latent will have."""
        self._mean = self.curves.mean(dim=0)
        self._scale = (self.curves - self._mean).std()
        steps = self._mean.diff().clamp_min(1e-5) * (N_SAMPLES - 1)
        start = torch.log(torch.expm1(steps)) if self.config.monotone else torch.logit(self._mean, 1e-3)
        cast(nn.Linear, self.network.decoder[-1]).bias.copy_(start)
        if self.config.n_latent == 1:
            first = cast(nn.Linear, self.network.decoder[0])
            sign = torch.where(torch.rand_like(first.bias) < 0.5, -1.0, 1.0)
            first.weight[:, 0] = sign * (0.5 + torch.rand_like(first.bias))
            first.bias.copy_(-first.weight[:, 0] * torch.linspace(-2.5, 2.5, len(first.bias)))


def roughness(curves: Tensor) -> Tensor:
    """Mean over the curves of the l2-norm of their first derivative over [0, 1]."""
    return (curves.diff(dim=1) * (N_SAMPLES - 1)).pow(2).mean(dim=1).sqrt().mean()


#: What is bundled was trained with these, by the name of the inverse model; the forward ones are trained alike.
CONFIGS: dict[str, TrainingConfig] = {
    **{f"SLR-{name}-1": TrainingConfig(constraint=name) for name in CONSTRAINTS},
    **{
        f"SLR-{name}-3": TrainingConfig(constraint=name, n_latent=3, learning_rate=5e-3, epochs=1500)
        for name in CONSTRAINTS
        if name != "auc"  # whose label is one number
    },
}
CONFIGS |= {f"SLR-monotone-{k}": replace(CONFIGS[f"SLR-ldl-{k}"], monotone=True) for k in (1, 3)}
CONFIGS |= {"SLR-open-1": CONFIGS["SLR-monotone-1"]}


def pretrained_keys() -> list[str]:
    """Return the names of all models that `train_pretrained` trains, such as "SLR-ldl-1-forward"."""
    return [name + side for name in CONFIGS for side in ("-forward", "")]


def train_pretrained(names: Iterable[str], folder: Path, progress: bool = True) -> Iterator[Path]:
    """Train models by name and write their weights, and the histories of the one-latent inverse ones, under `folder`.

    Names are those of `pretrained_keys`; "open" models learn from OpenCRF alone, all others from DoRF, which must be
    there. Yields ``weights/NAME.safetensors`` and ``histories/CONSTRAINT.npz`` once each is written.
    """
    keys = [ModelKey.parse(name) for name in names]
    for key in keys:
        if str(key) not in pretrained_keys():
            known = ", ".join(pretrained_keys())
            raise InputError(f"{str(key)!r} is not a bundled network; use --all or some of: {known}")
    # Data that are missing are told before the first training, not after it.
    sources = ["opencrf" if key.constraint == "open" else "dorf" for key in keys]
    data = {which: load_responses(which) for which in sorted(set(sources))}
    for key, which in zip(keys, sources, strict=True):
        model, history = _train_one(key, data[which], progress)
        model.save(path := folder / "weights" / f"{key}.safetensors")
        yield path
        if key in (ModelKey("SLR", constraint, 1) for constraint in CONSTRAINTS):
            history.thin(150).save(path := folder / "histories" / f"{key.constraint}.npz")
            yield path


def _train_one(key: ModelKey, responses: Responses, progress: bool) -> tuple[SLR, History]:
    curves, config = responses.in_direction(key.direction), CONFIGS[str(replace(key, direction="inverse"))]
    digest = hashlib.sha256(np.ascontiguousarray(responses.curves, dtype="<f4").tobytes()).hexdigest()
    metadata = {
        "data": responses.dataset,
        "n_curves": len(responses),
        "sha256 of the curves (float32)": digest,
        "crfbench": version("crfbench"),
        "licence": "MIT",
    }
    start = time.perf_counter()
    model, history = train(curves, key.direction, config, metadata, progress=progress)
    seconds = time.perf_counter() - start
    best, encoder = (mse(model.decode(latents), curves) for latents in (model.fit(curves), model.encode(curves)))
    drawn = model.decode(np.random.default_rng(_SEED_OF_VALIDITY).normal(size=(10_000, model.n_params)))
    model.metadata_["figures"] = {
        "best_mse": float(best.mean()),
        "best_rmse": float(np.sqrt(best).mean()),
        "encoder_mse": float(encoder.mean()),
        "nonmonotone_of_10000": int(nonmonotone(drawn).sum()),
        **latent_statistics(model.weights_["latents"].astype(float)),
        "training_seconds": round(seconds, 1),
    }
    return model, history
