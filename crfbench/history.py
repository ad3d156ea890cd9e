"""What happened during a training: losses, learning rate and latents, epoch by epoch."""

import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from crfbench.checks import check_count
from crfbench.errors import InputError, MissingDataError
from crfbench.files import bundled, reading_npz, write_atomically

#: Latents whose decoded curves are kept, and the samples kept of each: every 16th, and the last.
PROBES = np.linspace(-2.0, 2.0, 9)
PROBE_SAMPLES = np.append(np.arange(0, 1023, 16), 1023)


@dataclass
class History:
    """One training, a row an epoch; columns of unequal length are refused."""

    constraint: str
    epochs: np.ndarray  # shape (e,); numbers of the epochs kept, from 0
    losses: dict[str, np.ndarray] = field(repr=False)  # shape (e,); terms, unweighted, and the "learning rate"
    latents: np.ndarray = field(repr=False)  # shape (e, n, k); of all `n` training curves, in order
    # shape (e, 9, 65); curves of the latents `PROBES` (the other latents at 0) at the samples `PROBE_SAMPLES`
    probes: np.ndarray = field(repr=False)

    def __post_init__(self) -> None:
        lengths = {len(self.epochs), len(self.latents), len(self.probes), *(len(v) for v in self.losses.values())}
        if len(lengths) != 1 or self.latents.ndim != 3 or self.probes.ndim != 3:
            raise InputError(f"a history has columns of lengths {sorted(lengths)}; use one row an epoch in each")

    def __len__(self) -> int:
        """Return the number of epochs kept."""
        return len(self.epochs)

    def select(self, rows: np.ndarray) -> "History":
        """Return some of the epochs, by position."""
        losses = {name: values[rows] for name, values in self.losses.items()}
        return History(self.constraint, self.epochs[rows], losses, self.latents[rows], self.probes[rows])

    def thin(self, count: int) -> "History":
        """Return about `count` epochs, close together at the start where most happens, and the last."""
        check_count("count", count)
        steps = np.geomspace(1, len(self), min(count, len(self))).round().astype(int) - 1
        return self.select(np.unique(np.append(steps, len(self) - 1)))

    def save(self, path: str | Path) -> None:
        """Write a compressed ``.npz``, complete or not at all; latents and probes in half precision."""
        arrays: dict[str, Any] = {f"loss:{name}": values.astype(np.float32) for name, values in self.losses.items()}
        # Half precision is finer than a pixel of the player, and halves what is bundled.
        arrays |= {"latents": self.latents.astype(np.float16), "probes": self.probes.astype(np.float16)}
        buffer = io.BytesIO()
        np.savez_compressed(buffer, constraint=np.array(self.constraint), epochs=self.epochs, **arrays)
        write_atomically(path, buffer.getvalue())

    @classmethod
    def load(cls, path: str | Path) -> "History":
        """Read what `save` wrote; no file is a `MissingDataError`, one that holds no history a `FormatError`."""
        path = Path(path)
        if not path.is_file():
            raise MissingDataError(f"there is no history {path}; use one that History.save wrote")
        with reading_npz(path, "is not a training history", "use one that History.save wrote") as file:
            losses = {name.removeprefix("loss:"): file[name] for name in file.files if name.startswith("loss:")}
            latents, probes = file["latents"].astype(np.float32), file["probes"].astype(np.float32)
            return cls(str(file["constraint"]), file["epochs"], losses, latents, probes)


def load_history(constraint: str) -> History:
    """Load the bundled history of a constraint: one latent, inverse responses, DoRF, thinned to some 150 epochs.

    Parameters
    ----------
    constraint : {"baseline", "ldl", "auc", "aae", "vae"}
    """
    return History.load(bundled("data/histories") / f"{constraint}.npz")


def latent_statistics(latents: np.ndarray) -> dict[str, float]:
    """Say how near latents (n, k) come to N(0, 1); of several latents, the one that is farthest from it in each figure.

    ``mean`` and ``sd`` (of the population), ``kl``: KL divergence of N(mean, sd) to N(0, 1), ``ks``: Kolmogorov-Smirnov
    distance of the latents themselves to N(0, 1), which sees their shape too.
    """
    from scipy.stats import kstest

    mean, sd = latents.mean(axis=0), latents.std(axis=0)
    kl = 0.5 * (mean**2 + sd**2 - 2 * np.log(sd) - 1)
    ks = max(float(kstest(column, "norm").statistic) for column in latents.T)
    farthest_mean, farthest_sd = mean[np.argmax(np.abs(mean))], sd[np.argmax(np.abs(sd - 1))]
    return {"mean": float(farthest_mean), "sd": float(farthest_sd), "kl": float(kl.max()), "ks": ks}
