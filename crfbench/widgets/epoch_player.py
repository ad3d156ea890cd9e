"""The epoch player: how latents and decoded curves change as training goes on, several trainings side by side."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import traitlets

from crfbench.checks import check_count
from crfbench.curves import Direction, axis_labels, check_direction
from crfbench.errors import InputError
from crfbench.history import PROBE_SAMPLES, PROBES, History, latent_statistics
from crfbench.widgets.assets import SyncedTrait, bundle, join
from crfbench.widgets.page import LivingWidget

_MOST_EPOCHS = 150  # kept of a history; more would make the page heavy and show no more


class EpochPlayer(LivingWidget):
    """Play, pause and drag through the epochs of trainings; each is a column of pictures and figures.

    A column shows the histogram of the training curves' latents, the curves decoded from latents of -2 to 2, and of
    the latents the mean, the standard deviation (sd), the KL divergence of N(mean, sd) to N(0, 1) and the
    Kolmogorov-Smirnov distance (KS) to N(0, 1), computed in Python. The page gets all epochs at once, some 75 KB a
    training, and needs no Python to play them: latents in half precision, curves as 33 samples in steps of 1/255, and
    of a history of more than 150 epochs as many as `History.thin` keeps.

    `epoch` is a trait that Python and the page share, for ``observe``, ``link`` and ``jslink``; it starts at the first.

    Parameters
    ----------
    histories : mapping of str to History
        One or more, by the names to show; of one latent each.
    direction : {"inverse", "forward"}
        Of the curves they were trained on.

    Examples
    --------
    >>> from crfbench.history import load_history
    >>> player = EpochPlayer({"LDL": load_history("ldl")})
    >>> player.add(load_history("vae"), "VAE")
    >>> player.epoch = 20
    >>> player
    EpochPlayer(LDL, VAE)
    """

    _title = "Latents over epochs"
    _esm = bundle("epoch_player.js")
    _css = join("widgets.css", "latents.css")
    _columns: traitlets.List[dict[str, Any]] = traitlets.List().tag(sync=True)
    _moved_by_both = frozenset({"epoch"})

    @SyncedTrait
    def epoch(self, epoch: object) -> int:
        """Epoch that is shown, counted from 1; where it was not kept, the page shows the one kept before it."""
        return check_count("epoch", epoch)

    def __init__(self, histories: Mapping[str, History], direction: Direction = "inverse") -> None:
        if not histories:
            raise InputError("there are no histories to play; use one or more")
        self._histories = dict(histories)
        columns = [pack(history, name, direction) for name, history in histories.items()]
        super().__init__(epoch=min(column["epochs"][0] for column in columns), _columns=columns)

    def __repr__(self) -> str:
        return f"EpochPlayer({', '.join(self._histories)})"

    @property
    def histories(self) -> dict[str, History]:
        """The histories, by the names shown."""
        return dict(self._histories)

    def add(self, history: History, name: str | None = None, direction: Direction = "inverse") -> None:
        """Show one more history as the last column, at once; one that had the same name gives way to it.

        Parameters
        ----------
        history : History
        name : str, optional
            By default the history's constraint.
        direction : {"inverse", "forward"}
            Of the curves it was trained on.
        """
        label = name or history.constraint
        column = pack(history, label, direction)
        self._histories.pop(label, None)
        self._histories[label] = history
        self._columns = [*(old for old in self._columns if old["name"] != label), column]


def pack(history: History, name: str, direction: Direction) -> dict[str, Any]:
    """Return what the page draws of a history; numbers as little-endian bytes."""
    _check(history, name)
    kept = history.thin(_MOST_EPOCHS) if len(history) > _MOST_EPOCHS else history
    x_label, y_label = (label.split(" (")[0] for label in axis_labels(check_direction(direction)))
    with np.errstate(divide="ignore"):  # KL is infinite where all latents are one
        figures = [list(latent_statistics(latents.astype(np.float64)).values()) for latents in kept.latents]
    return {
        "name": name,
        "epochs": (kept.epochs + 1).tolist(),  # people count from 1
        "xLabel": x_label,
        "yLabel": y_label,
        "latents": kept.latents.astype("<f2").tobytes(),
        "probes": np.round(255 * kept.probes[:, :, ::2].clip(0.0, 1.0)).astype(np.uint8).tobytes(),
        "figures": np.array(figures, dtype="<f4").tobytes(),
    }


def _check(history: History, name: str) -> None:
    if history.latents.shape[2] != 1:
        raise InputError(f"{name} has {history.latents.shape[2]} latents; use a history of one latent")
    if not (np.isfinite(history.latents).all() and np.isfinite(history.probes).all()):
        raise InputError(f"{name} holds latents or curves that are not finite; use a training that did not diverge")
    if history.probes.shape[1:] != (len(PROBES), len(PROBE_SAMPLES)):
        raise InputError(f"{name} has decoded curves of shape {history.probes.shape[1:]}; use a history from train()")
