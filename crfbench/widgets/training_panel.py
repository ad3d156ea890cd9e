"""Train it yourself: choose a constraint, watch the latents find their places, stop whenever you like."""

import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import traitlets

from crfbench.checks import check_choice, check_count
from crfbench.curves import Direction, check_direction
from crfbench.datasets import Responses, load_responses
from crfbench.errors import CrfbenchError, InputError
from crfbench.history import History
from crfbench.models.slr import SLR
from crfbench.widgets.assets import StoredWidget, bundle, join, table
from crfbench.widgets.epoch_player import EpochPlayer, pack

if TYPE_CHECKING:
    from crfbench.training import Trainer

#: As the page names them; in small letters they are those of `crfbench.constraints`, which needs PyTorch.
CONSTRAINTS = ("LDL", "AUC", "AAE", "VAE", "baseline")
_EPOCHS = 300
_MOST_EPOCHS = 5000
_MOST_SEED = 2**31 - 1
_UPDATE_SECONDS = 0.1
_NO_PROGRESS = {"epoch": 0, "epochs": 0, "live": None}
_DATASETS = {"dorf": "DoRF", "opencrf": "OpenCRF"}


class TrainingPanel(StoredWidget):
    """Train an SLR of one latent on the page or from Python, see its latents meanwhile, and add it to a player.

    The training runs in a thread of its own, with the config of the pretrained models but for what is chosen here, so
    other cells can be run meanwhile. There is one training at a time: to start one stops the one under way. What a
    stopped training has reached is kept.

    `status` and `running` are traits, for ``observe``; they change in the training's thread. `model` and `history` are
    what the last training gave, with every epoch.

    Parameters
    ----------
    player : EpochPlayer
        Gets the history of each training.
    responses : Responses, optional
        What to train on; by default DoRF where it is present, else OpenCRF.

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

    _esm = bundle("training_panel.js")
    _css = join("widgets.css", "latents.css")
    _choices = traitlets.Dict().tag(sync=True)
    #: What the form shows: what was last asked for, by the page or by Python.
    _asked = traitlets.Dict().tag(sync=True)
    #: How far the training has got; no epochs before the first.
    _progress = traitlets.Dict(_NO_PROGRESS).tag(sync=True)
    status = traitlets.Unicode(help="What the panel says, in a sentence.").tag(sync=True)
    running = traitlets.Bool(help="Whether a training is under way.").tag(sync=True)

    # Of all panels together, for there is one training at a time.
    _turn: ClassVar[threading.Lock] = threading.Lock()
    _latest: ClassVar["TrainingPanel | None"] = None

    def __init__(self, player: EpochPlayer, responses: Responses | None = None) -> None:
        self.player = player
        self.responses = responses if responses is not None else load_responses("auto")
        self.model: SLR | None = None
        self.history: History | None = None
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()
        choices = {
            "constraints": list(CONSTRAINTS),
            "directions": ["inverse", "forward"],
            "mostEpochs": _MOST_EPOCHS,
            "mostSeed": _MOST_SEED,
        }
        asked = {"constraint": "LDL", "direction": "inverse", "seed": 0, "epochs": _EPOCHS}
        super().__init__(_choices=choices, _asked=asked, status=f"Ready to train on {self._data}.")
        self.on_msg(self._receive)

    def _still(self) -> dict[str, str]:
        choices = (", ".join(self._choices[name]) for name in ("constraints", "directions"))
        return table(self.status, [("Constraint", "Direction", "Epochs"), (*choices, f"1 to {_MOST_EPOCHS}")])

    def __repr__(self) -> str:
        return f"TrainingPanel({self._data})"

    def start(
        self, constraint: str = "LDL", seed: int = 0, epochs: int = _EPOCHS, direction: Direction = "inverse"
    ) -> None:
        """Begin a training and return at once; `constraint` is one of `CONSTRAINTS`, epochs are 1 to 5000."""
        check_choice("constraint", constraint, CONSTRAINTS)
        check_direction(direction)
        check_count("seed", seed, least=0, most=_MOST_SEED)
        check_count("epochs", epochs, most=_MOST_EPOCHS)
        with TrainingPanel._turn:
            if TrainingPanel._latest is not None:
                TrainingPanel._latest.stop()
                TrainingPanel._latest.wait()
            TrainingPanel._latest = self
            self._stopping.clear()
            self._name = f"{constraint}, seed {seed}" + (", forward" if direction == "forward" else "")
            self._asked = {"constraint": constraint, "direction": direction, "seed": seed, "epochs": epochs}
            self._epochs, self._direction, self._began, self._told = epochs, direction, time.monotonic(), 0.0
            self._say("Getting ready.", running=True)
            arguments = (f"SLR-{constraint.lower()}-1", seed)
            self._thread = threading.Thread(target=self._work, args=arguments, name="crfbench training", daemon=True)
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
        if message["kind"] == "stop":
            self.stop()
            return
        try:
            self.start(**{name: message[name] for name in ("constraint", "seed", "epochs", "direction")})
        except InputError as error:
            self._say(str(error), running=self.running)

    def _say(self, status: str, running: bool, progress: dict[str, Any] | None = None) -> None:
        """Tell the page in one message; without progress there is no training to show."""
        with self.hold_sync():
            self._progress = progress or _NO_PROGRESS
            self.running = running
            self.status = status

    def _show(self, history: History, status: str, running: bool, left: str) -> None:
        progress = {
            "epoch": len(history),
            "epochs": self._epochs,
            "loss": f"{history.losses['total'][-1]:.3g}",
            "mse": f"{history.losses['mse'][-1]:.3g}",
            "left": left,
            "live": pack(history.select(np.array([-1])), self._name, self._direction),
        }
        self._say(status, running, progress)

    def _work(self, config: str, seed: int) -> None:
        """Train, and say how it ended, whatever happens."""
        try:
            # Only here, since PyTorch takes seconds to load and may be absent.
            from crfbench.training import CONFIGS, train

            chosen = replace(CONFIGS[config], seed=seed, epochs=self._epochs)
            curves, metadata = self.responses.in_direction(self._direction), {"data": self.responses.dataset}
            self.model, self.history = train(curves, self._direction, chosen, metadata, self._report)
            self.player.add(self.history, self._name, self._direction)
        except Exception as error:
            self._say(_sentence(error), running=False)
            if not isinstance(error, CrfbenchError | ModuleNotFoundError):
                raise
        else:
            trained, took = len(self.history), f"took {time.monotonic() - self._began:.1f} s"
            ending = f"Trained {self._name}: {trained} epochs; it is in the player now."
            if trained < self._epochs:
                ending = (
                    f"Stopped {self._name} after {trained} of {self._epochs} epochs; the player has what it reached."
                )
            self._show(self.history, ending, running=False, left=took)

    def _report(self, epoch: int, trainer: "Trainer") -> bool:
        """Tell the page some ten times a second how far the training is; return whether it shall end."""
        now = time.monotonic()
        if now - self._told >= _UPDATE_SECONDS:
            self._told = now
            left = (now - self._began) / (epoch + 1) * (self._epochs - epoch - 1)
            self._show(
                trainer.history(), f"Training {self._name} on {self._data}.", running=True, left=f"{left:.0f} s left"
            )
        return self._stopping.is_set()


def _sentence(error: Exception) -> str:
    if isinstance(error, ModuleNotFoundError) and error.name == "torch":
        return "Training needs PyTorch, which is not here: pip install torch"
    return f"The training failed: {' '.join(str(error).split())}"
