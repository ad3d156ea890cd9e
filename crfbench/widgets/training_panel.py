"""Train it yourself: choose a constraint, watch the latents find their places, stop whenever you like."""

import threading
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import anywidget
import numpy as np
import traitlets

from crfbench.checks import check_choice
from crfbench.curves import Direction, check_direction
from crfbench.datasets import Responses, load_responses
from crfbench.errors import CrfbenchError, InputError
from crfbench.history import History
from crfbench.models.slr import SLR
from crfbench.widgets.assets import join
from crfbench.widgets.epoch_player import EpochPlayer, pack

if TYPE_CHECKING:
    from crfbench.training import Trainer

#: As the page names them; in small letters they are those of `crfbench.constraints`, which needs PyTorch.
CONSTRAINTS = ("LDL", "AUC", "AAE", "VAE", "baseline")
_EPOCHS = 300
_MOST_EPOCHS = 5000
_MOST_SEED = 2**31 - 1
_UPDATE_SECONDS = 0.1
_DATASETS = {"dorf": "DoRF", "opencrf": "OpenCRF"}


@dataclass(frozen=True)
class _Wish:
    """What to train."""

    constraint: str
    seed: int
    epochs: int
    direction: Direction

    def __post_init__(self) -> None:
        check_choice("constraint", self.constraint, CONSTRAINTS)
        check_direction(self.direction)
        _check_whole("seed", self.seed, 0, _MOST_SEED)
        _check_whole("epochs", self.epochs, 1, _MOST_EPOCHS)

    @property
    def name(self) -> str:
        return f"{self.constraint}, seed {self.seed}" + (", forward" if self.direction == "forward" else "")


def _check_whole(name: str, value: object, least: int, most: int) -> None:
    if not isinstance(value, int | np.integer) or not least <= value <= most:
        raise InputError(f"{name}={value!r} does not fit; use a whole number from {least} to {most}")


class TrainingPanel(anywidget.AnyWidget):
    """Train an SLR of one latent on the page or from Python, see its latents meanwhile, and add it to a player.

    The training runs in a thread of its own, with the recipe of the shipped models but for what is chosen here, so
    other cells can be run meanwhile. There is one training at a time: to start one stops the one under way. What a
    stopped training has reached is kept.

    Parameters
    ----------
    player : EpochPlayer
        Gets the history of each training.
    responses : Responses, optional
        What to train on; by default DoRF where it is present, else OpenCRF.

    Attributes
    ----------
    model : SLR or None
        What the last training gave.
    history : History or None
        Of the last training, every epoch.

    Examples
    --------
    >>> from crfbench.history import load_history
    >>> panel = TrainingPanel(EpochPlayer({"LDL": load_history("ldl")}), load_responses("opencrf"))
    >>> panel
    TrainingPanel(151 curves of OpenCRF)
    >>> panel.start("VAE", seed=3, epochs=20)
    >>> panel.wait()
    >>> panel.status
    'Trained VAE, seed 3: 20 epochs; it is in the player now.'
    >>> panel.history.constraint, len(panel.history)
    ('vae', 20)
    """

    _esm = join("controls.js", "plot.js", "latent_column.js", "training_panel.js")
    _css = join("widgets.css", "latents.css")
    #: What can be chosen; set once.
    _choices = traitlets.Dict().tag(sync=True)
    #: How far the training has got, in one trait, so that the page never sees half of a change.
    _shown = traitlets.Dict().tag(sync=True)

    _turn: ClassVar[threading.Lock] = threading.Lock()
    _latest: ClassVar["TrainingPanel | None"] = None

    def __init__(self, player: EpochPlayer, responses: Responses | None = None) -> None:
        super().__init__()
        self.player = player
        self.responses = responses if responses is not None else load_responses("auto")
        self.model: SLR | None = None
        self.history: History | None = None
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()
        self._choices = {
            "constraints": list(CONSTRAINTS),
            "directions": ["inverse", "forward"],
            "epochs": _EPOCHS,
            "mostEpochs": _MOST_EPOCHS,
            "mostSeed": _MOST_SEED,
        }
        self._say(f"Ready to train on {self._data}.")
        self.on_msg(self._receive)

    def __repr__(self) -> str:
        return f"TrainingPanel({self._data})"

    @property
    def status(self) -> str:
        """What the panel says, in a sentence."""
        return str(self._shown["message"])

    @property
    def running(self) -> bool:
        """Whether a training is under way."""
        return self._thread is not None and self._thread.is_alive()

    def start(
        self, constraint: str = "LDL", seed: int = 0, epochs: int = _EPOCHS, direction: Direction = "inverse"
    ) -> None:
        """Begin a training and return at once.

        Parameters
        ----------
        constraint : {"LDL", "AUC", "AAE", "VAE", "baseline"}
        seed : int
        epochs : int
            From 1 to 5000.
        direction : {"inverse", "forward"}

        Raises
        ------
        InputError
            For values that do not fit.
        """
        wish = _Wish(constraint, seed, epochs, direction)
        with TrainingPanel._turn:
            if TrainingPanel._latest is not None:
                TrainingPanel._latest.stop()
                TrainingPanel._latest.wait()
            TrainingPanel._latest = self
            self._stopping.clear()
            self._thread = threading.Thread(target=self._work, args=(wish,), name="crfbench training", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Ask the training to end after the epoch it is in; what it has reached is kept."""
        self._stopping.set()

    def wait(self) -> None:
        """Return when the training has ended; interrupting the wait stops the training."""
        try:
            if self._thread is not None:
                self._thread.join()
        except KeyboardInterrupt:
            self.stop()
            raise

    def close(self) -> None:
        """Stop the training and take the panel off the page."""
        self.stop()
        super().close()

    @property
    def _data(self) -> str:
        return f"{len(self.responses)} curves of {_DATASETS.get(self.responses.dataset, self.responses.dataset)}"

    def _receive(self, _widget: object, message: dict[str, Any], _buffers: object) -> None:
        """Do what the page asks."""
        if message["kind"] == "stop":
            self.stop()
            return
        try:
            self.start(**{name: message[name] for name in ("constraint", "seed", "epochs", "direction")})
        except InputError as error:
            self._say(str(error))

    def _say(self, message: str, training: bool = False) -> None:
        """Say something, without a training to show."""
        self._shown = {"training": training, "message": message, "epoch": 0, "epochs": 0, "live": None}

    def _work(self, wish: _Wish) -> None:
        """Train, and say how it ended, whatever happens."""
        self._say("Getting ready.", training=True)
        began = time.monotonic()
        try:
            self.model, self.history = self._train(wish)
            self.player.add(self.history, wish.name, wish.direction)
        except Exception as error:
            self._say(_sentence(error))
            if not isinstance(error, CrfbenchError | ModuleNotFoundError):
                raise
        else:
            self._show(wish, self.history, False, _ending(wish, len(self.history)), f"took {_time(began)}")

    def _train(self, wish: _Wish) -> tuple[SLR, History]:
        from crfbench.training import RECIPES, train

        recipe = replace(RECIPES[f"{wish.constraint.lower()}-1"], seed=wish.seed, epochs=wish.epochs)
        curves = self.responses.in_direction(wish.direction)
        return train(curves, wish.direction, recipe, {"data": self.responses.dataset}, _Report(self, wish))

    def _show(self, wish: _Wish, history: History, training: bool, message: str, left: str) -> None:
        """Show the last epoch of a history."""
        self._shown = {
            "training": training,
            "message": message,
            "epoch": len(history),
            "epochs": wish.epochs,
            "loss": f"{history.losses['total'][-1]:.3g}",
            "mse": f"{history.losses['mse'][-1]:.3g}",
            "left": left,
            "live": pack(history.select(np.array([-1])), wish.name, wish.direction),
        }


class _Report:
    """Shows a training some ten times a second, and ends it when asked to."""

    def __init__(self, panel: TrainingPanel, wish: _Wish) -> None:
        self.panel, self.wish = panel, wish
        self.message = f"Training {wish.name} on {panel._data}."
        self.began, self.last = time.monotonic(), 0.0

    def __call__(self, epoch: int, trainer: "Trainer") -> bool:
        now = time.monotonic()
        if now - self.last >= _UPDATE_SECONDS:
            self.last = now
            left = (now - self.began) / (epoch + 1) * (self.wish.epochs - epoch - 1)
            self.panel._show(self.wish, trainer.history(), True, self.message, f"{left:.0f} s")
        return self.panel._stopping.is_set()


def _time(began: float) -> str:
    return f"{time.monotonic() - began:.1f} s"


def _ending(wish: _Wish, trained: int) -> str:
    if trained < wish.epochs:
        return f"Stopped {wish.name} after {trained} of {wish.epochs} epochs; what it reached is in the player now."
    return f"Trained {wish.name}: {trained} epochs; it is in the player now."


def _sentence(error: Exception) -> str:
    if isinstance(error, ModuleNotFoundError) and error.name == "torch":
        return "Training needs PyTorch, which is not here: pip install 'crfbench[train]'"
    return f"The training failed: {' '.join(str(error).split())}"
