"""The Python side of TrainingPanel; tests/test_browser drives it on a page."""

import sys
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from crfbench.constraints import CONSTRAINTS as TRAINABLE
from crfbench.datasets import load_opencrf
from crfbench.errors import InputError
from crfbench.history import load_history
from crfbench.training import CONFIGS, Trainer, TrainingConfig, train
from crfbench.widgets import EpochPlayer, TrainingPanel
from crfbench.widgets.training_panel import CONSTRAINTS

RESPONSES = load_opencrf().select(range(0, 151, 12))


@pytest.fixture
def panel() -> Iterator[TrainingPanel]:
    made = TrainingPanel(EpochPlayer({"LDL": load_history("ldl")}), RESPONSES)
    yield made
    made.stop()
    made.wait()


def send(panel: TrainingPanel, **message: object) -> None:
    """Do what the page does: a custom message."""
    panel._handle_custom_msg(message, [])


def wait_until(condition) -> None:
    end = time.monotonic() + 240
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.01)


def test_offers_the_constraints_that_can_be_trained() -> None:
    assert {name.lower() for name in CONSTRAINTS} == set(TRAINABLE)


def test_says_what_it_trains_on(panel: TrainingPanel) -> None:
    assert panel.status == "Ready to train on 13 curves of OpenCRF."
    assert repr(panel) == "TrainingPanel(13 curves of OpenCRF)"
    assert (panel.model, panel.history, panel.running) == (None, None, False)


@pytest.mark.parametrize(("constraint", "direction"), [("baseline", "forward"), ("AAE", "inverse")])
def test_trains_as_train_does_and_adds_to_the_player(panel: TrainingPanel, constraint: str, direction: str) -> None:
    panel.start(constraint, seed=5, epochs=8, direction=direction)
    panel.wait()
    config = TrainingConfig(**{**CONFIGS[f"SLR-{constraint.lower()}-1"].__dict__, "seed": 5, "epochs": 8})
    model, history = train(RESPONSES.in_direction(direction), direction, config)
    assert all(np.array_equal(model.weights_[name], panel.model.weights_[name]) for name in model.weights_)
    np.testing.assert_array_equal(history.latents, panel.history.latents)
    assert (panel.model.direction, panel.model.metadata_["data"]) == (direction, "opencrf")
    name = f"{constraint}, seed 5" + (", forward" if direction == "forward" else "")
    assert panel.player.histories[name] is panel.history
    assert panel.status == f"Trained {name}: 8 epochs; it is in the player now."
    assert (panel.running, panel._progress["epoch"], panel._progress["epochs"]) == (False, 8, 8)


def test_the_page_starts_and_stops_and_what_was_trained_is_kept(panel: TrainingPanel) -> None:
    send(panel, kind="start", constraint="LDL", seed=1, epochs=5000, direction="inverse")
    wait_until(lambda: panel._progress["epoch"] > 2)
    shown = panel._progress
    assert panel.running
    assert shown["left"].endswith(" s left")
    assert len(np.frombuffer(shown["live"]["latents"], "<f2")) == 13
    send(panel, kind="stop")
    panel.wait()
    assert 2 < len(panel.history) < 5000
    assert panel.status.startswith(f"Stopped LDL, seed 1 after {len(panel.history)} of 5000 epochs")
    assert list(panel.player.histories) == ["LDL", "LDL, seed 1"]


def test_updates_are_some_ten_a_second(panel: TrainingPanel) -> None:
    seen: list[float] = []
    panel.observe(lambda change: seen.append(time.monotonic()), "_progress")
    panel.start("LDL", epochs=150)
    panel.wait()
    assert 3 <= len(seen) <= 10 * (seen[-1] - seen[0]) + 4


def test_one_training_at_a_time(panel: TrainingPanel) -> None:
    other = TrainingPanel(panel.player, RESPONSES)
    other.start("LDL", epochs=5000)
    wait_until(lambda: other._progress["epoch"] > 0)
    panel.start("AUC", epochs=3)
    assert not other.running
    panel.wait()
    assert len(other.history) < 5000
    assert list(panel.player.histories) == ["LDL", "LDL, seed 0", "AUC, seed 0"]


def test_closing_the_panel_ends_its_thread() -> None:
    panel = TrainingPanel(EpochPlayer({"LDL": load_history("ldl")}), RESPONSES)
    panel.start("LDL", epochs=5000)
    assert all(thread.daemon for thread in threading.enumerate() if thread.name == "crfbench training")
    panel.close()
    panel.wait()
    assert not panel.running
    assert len(panel.history) < 5000


def test_interrupting_the_wait_stops_the_training(panel: TrainingPanel, monkeypatch: pytest.MonkeyPatch) -> None:
    panel.start("LDL", epochs=5000)

    def interrupted(self: threading.Thread) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "join", interrupted)
        with pytest.raises(KeyboardInterrupt):
            panel.wait()
    panel.wait()
    assert panel.status.startswith("Stopped LDL")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"constraint": "GAN"}, "constraint='GAN' is not known; use one of LDL, AUC, AAE, VAE, baseline"),
        ({"seed": -1}, "seed=-1 is out of range; use a whole number from 0 to"),
        ({"epochs": 0}, "epochs=0 is out of range; use a whole number from 1 to 5000"),
        ({"epochs": 5001}, "epochs=5001"),
        ({"epochs": None}, "epochs=None"),
        ({"epochs": 2.5}, "epochs=2.5"),
        ({"direction": "up"}, "direction='up' is not known"),
    ],
)
def test_bad_requests_are_refused_in_a_sentence(panel: TrainingPanel, change: dict, message: str) -> None:
    request = {"constraint": "LDL", "seed": 0, "epochs": 2, "direction": "inverse", **change}
    with pytest.raises(InputError, match=message):
        panel.start(**request)
    send(panel, kind="start", **request)
    assert panel.status.startswith(message)
    assert not panel.running


def test_without_pytorch_it_says_how_to_get_it(panel: TrainingPanel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    for name in [
        name for name in sys.modules if name == "crfbench.training" or name.startswith("crfbench.constraints")
    ]:
        monkeypatch.delitem(sys.modules, name)
    panel.start("LDL", epochs=2)
    panel.wait()
    assert panel.status == "Training needs PyTorch, which is not here: pip install torch"
    assert panel.history is None
    assert not panel.running


def test_a_training_that_diverges_is_told_and_leaves_the_player_alone(
    panel: TrainingPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = Trainer.history

    def diverged(self: Trainer):
        history = original(self)
        history.latents[-1] = np.nan
        return history

    monkeypatch.setattr(Trainer, "history", diverged)
    panel.start("LDL", epochs=3)
    panel.wait()
    assert panel.status.startswith("The training failed: LDL, seed 0 holds latents or curves that are not finite")
    assert list(panel.player.histories) == ["LDL"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_unforeseen_error_is_told_in_a_sentence(panel: TrainingPanel, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(self: Trainer) -> None:
        raise RuntimeError("out of\n memory")

    monkeypatch.setattr(Trainer, "epoch", broken)
    panel.start("LDL", epochs=3)
    panel.wait()
    assert panel.status == "The training failed: out of memory"
