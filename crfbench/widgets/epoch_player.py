"""The epoch player: how latents and decoded curves change as training goes on, several trainings side by side."""

from collections.abc import Mapping
from typing import Any

import anywidget
import numpy as np
import traitlets

from crfbench.curves import Direction, axis_labels, check_direction
from crfbench.errors import InputError
from crfbench.history import PROBE_SAMPLES, PROBES, History
from crfbench.tables.latents import latent_figures
from crfbench.widgets.assets import join
from crfbench.widgets.page import frame, page

_MOST_EPOCHS = 150  # kept of a history; more would make the page heavy and show no more


class EpochPlayer(anywidget.AnyWidget):
    """Play, pause and drag through the epochs of trainings; each is a column of pictures and figures.

    A column shows the histogram of the training curves' latents, the curves decoded from latents of -2 to 2, and of
    the latents the mean, the standard deviation (sd), the KL divergence of N(mean, sd) to N(0, 1) and the
    Kolmogorov-Smirnov distance (KS) to N(0, 1), computed in Python. The page gets all epochs at once, some 75 KB a
    training, and needs no Python to play them: latents in half precision, curves as 33 samples in steps of 1/255, and
    of a history of more than 150 epochs as many as `History.thin` keeps.

    Parameters
    ----------
    histories : mapping of str to History
        One or more, by the names to show; of one latent each.
    direction : {"inverse", "forward"}
        Of the curves they were trained on.

    Raises
    ------
    InputError
        For no history, and for one of several latents or with values that are not finite.

    Examples
    --------
    >>> from crfbench.history import load_history
    >>> player = EpochPlayer({"LDL": load_history("ldl")})
    >>> player.add(load_history("vae"), "VAE")
    >>> player
    EpochPlayer(LDL, VAE)
    """

    _esm = join("controls.js", "plot.js", "latent_column.js", "epoch_player.js")
    _css = join("widgets.css", "latents.css")
    #: All that the page draws; replaced as a whole.
    _columns: traitlets.List[dict[str, Any]] = traitlets.List().tag(sync=True)

    def __init__(self, histories: Mapping[str, History], direction: Direction = "inverse") -> None:
        if not histories:
            raise InputError("there are no histories to play; use one or more")
        super().__init__()
        self._histories = dict(histories)
        self._columns = [pack(history, name, direction) for name, history in histories.items()]

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

    def _repr_mimebundle_(self, **kwargs: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """Add a page of its own, which is what HTML made from a saved notebook can still play."""
        data, metadata = super()._repr_mimebundle_(**kwargs) or ({}, {})
        alone = page(self, "Latents over epochs")
        return {**data, "text/html": frame(alone, f"{self!r}: run this cell to see it.")}, metadata


def pack(history: History, name: str, direction: Direction) -> dict[str, object]:
    """Return what the page draws of a history; numbers as little-endian bytes."""
    _check(history, name)
    kept = history.thin(_MOST_EPOCHS) if len(history) > _MOST_EPOCHS else history
    x_label, y_label = (label.split(" (")[0] for label in axis_labels(check_direction(direction)))
    return {
        "name": name,
        "epochs": (kept.epochs + 1).tolist(),  # people count from 1
        "xLabel": x_label,
        "yLabel": y_label,
        "latents": kept.latents.astype("<f2").tobytes(),
        "probes": np.round(255 * kept.probes[:, :, ::2].clip(0.0, 1.0)).astype(np.uint8).tobytes(),
        "figures": np.array([_figures(latents) for latents in kept.latents], dtype="<f4").tobytes(),
    }


def _figures(latents: np.ndarray) -> list[float]:
    """Return mean, sd, KL and KS; KL is infinite where all latents are one."""
    with np.errstate(divide="ignore"):
        return list(latent_figures(latents.astype(np.float64)).values())


def _check(history: History, name: str) -> None:
    if history.latents.shape[2] != 1:
        raise InputError(f"{name} has {history.latents.shape[2]} latents; use a history of one latent")
    if not (np.isfinite(history.latents).all() and np.isfinite(history.probes).all()):
        raise InputError(f"{name} holds latents or curves that are not finite; use a training that did not diverge")
    if history.probes.shape[1:] != (len(PROBES), len(PROBE_SAMPLES)):
        raise InputError(f"{name} has decoded curves of shape {history.probes.shape[1:]}; use a history from train()")
