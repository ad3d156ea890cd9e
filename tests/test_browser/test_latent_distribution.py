"""EpochPlayer and TrainingPanel as a user meets them: play, drag, train, stop."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from crfbench.history import latent_statistics, load_history
from crfbench.widgets import EpochPlayer

from .looks import drag, eventually, picture, screenshot, settled

pytestmark = [pytest.mark.browser, pytest.mark.slow]

NAMES = ("LDL", "AUC", "AAE", "VAE", "baseline")
CELLS = [
    f"""from crfbench import load_responses
from crfbench.history import load_history
from crfbench.widgets import EpochPlayer, TrainingPanel
player = EpochPlayer({{name: load_history(name.lower()) for name in {NAMES}}})
panel = TrainingPanel(player, load_responses("opencrf").select(range(0, 151, 12)))""",
    "player",
    "panel",
]
PANEL = ".crf-training"


@pytest.fixture(scope="module")
def opened(open_notebook: Callable):
    page = open_notebook("distribution.ipynb", CELLS)
    page.wait_for_selector(PANEL)
    return page


@pytest.fixture
def page(opened, run_python: Callable):
    """Return the page with the bundled histories alone, paused at the last epoch."""
    run_python(opened, "panel.stop(); panel.wait(); player._columns = player._columns[:5]")
    opened.wait_for_function("() => document.querySelectorAll('.crf-player .crf-column').length === 5")
    if opened.get_by_role("button", name="Pause").count():
        opened.get_by_role("button", name="Pause").click()
    slider(opened).press("End")
    settled(opened)
    return opened


def slider(page):
    return page.get_by_role("slider", name="Epoch")


def position(page) -> int:
    return int(slider(page).input_value())


def column(page, name: str):
    return page.locator(".crf-player").get_by_role("group", name=name, exact=True)


def figures(page, name: str) -> list[float]:
    return [float(text.replace("−", "-")) for text in column(page, name).locator("dd").all_inner_texts()]


def counts(page, name: str) -> list[int]:
    return [int(text) for text in column(page, name).locator("canvas").first.get_attribute("data-counts").split(",")]


def wait_for_status(page, start: str) -> str:
    page.wait_for_function(
        "(start) => document.querySelector('.crf-training .crf-status').textContent.startsWith(start)", arg=start
    )
    return page.locator(f"{PANEL} .crf-status").inner_text()


def ask_for_training(page, constraint: str, seed: int, epochs: int) -> None:
    page.get_by_label("Constraint", exact=True).select_option(constraint)
    page.get_by_label("Seed", exact=True).fill(str(seed))
    page.get_by_label("Epochs", exact=True).fill(str(epochs))
    page.get_by_role("button", name="Start", exact=True).click()


def test_play_moves_the_epoch_and_pause_holds_it(page) -> None:
    before = picture(page)
    page.get_by_role("button", name="Play").click()  # from the end it starts again
    page.wait_for_function(
        "() => { const at = document.querySelector('.crf-play input').valueAsNumber; return at > 4 && at < 100; }"
    )
    page.get_by_role("button", name="Pause").click()
    settled(page)
    held = position(page)
    assert picture(page) != before
    settled(page)
    assert position(page) == held
    epoch = load_history("ldl").epochs[held] + 1
    assert slider(page).get_attribute("aria-valuetext") == f"{epoch} of 1000"
    assert f"epoch {epoch}" in column(page, "LDL").inner_text()


def test_play_ends_at_the_last_epoch(page) -> None:
    for _ in range(3):
        slider(page).press("ArrowLeft")
    page.get_by_role("button", name="Play").click()
    page.wait_for_function("() => document.querySelector('.crf-play output').textContent === '1000 of 1000'")
    page.get_by_role("button", name="Play").wait_for()


def test_mouse_drag_goes_through_epochs_and_stops_the_player(page) -> None:
    page.get_by_role("button", name="Play").click()
    drag(page, slider(page), -0.25)
    assert page.get_by_role("button", name="Play").is_visible()
    assert position(page) == pytest.approx(0.25 * (len(load_history("ldl")) - 1), abs=4)


def test_keyboard_moves_the_epoch_and_not_the_notebook(page) -> None:
    slider(page).focus()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    assert position(page) == 1
    assert slider(page).get_attribute("aria-valuetext") == "2 of 1000"
    assert page.evaluate("getComputedStyle(document.activeElement).outlineWidth") == "3px"
    page.get_by_role("button", name="Play").focus()
    page.keyboard.press("Space")
    page.wait_for_function("() => document.querySelector('.crf-play input').valueAsNumber > 3")
    page.keyboard.press("Space")
    page.get_by_role("button", name="Play").wait_for()
    assert page.locator(".jp-CodeCell").count() == len(CELLS)


def test_python_moves_the_epoch_and_hears_of_it(page, run_python: Callable) -> None:
    page.get_by_role("button", name="Play").click()
    page.wait_for_function("() => document.querySelector('.crf-play input').valueAsNumber > 4")
    run_python(page, "player.epoch = 900")  # also ends the animation, whose last moves are still under way
    kept = max(epoch for epoch in load_history("ldl").epochs + 1 if epoch <= 900)
    page.locator(".crf-play output", has_text=f"{kept} of 1000").wait_for()
    page.get_by_role("button", name="Play").wait_for()
    settled(page)
    assert run_python(page, "print(player.epoch)").strip() == "900"
    run_python(page, "heard = []; hear = lambda change: heard.append(change['new']); player.observe(hear, 'epoch')")
    drag(page, slider(page), 0.1)
    settled(page)
    shown = slider(page).get_attribute("aria-valuetext").split()[0]
    eventually(page, lambda: run_python(page, "print(*heard)").split(), lambda heard: heard[-1:] == [shown])
    run_python(page, "player.unobserve(hear, 'epoch')")


@pytest.mark.parametrize("keys", [["End"], ["Home"], ["Home", *["PageUp"] * 4]])
def test_histogram_and_figures_are_those_of_numpy(page, keys: list[str]) -> None:
    for key in keys:
        slider(page).press(key)
    for name in NAMES:
        history = load_history(name.lower())
        row = history.latents[position(page)]
        expected = np.histogram(row.clip(-5, 5), bins=40, range=(-5, 5))[0]
        assert counts(page, name) == expected.tolist()
        np.testing.assert_allclose(figures(page, name), list(latent_statistics(row.astype(float)).values()), atol=6e-4)


def test_less_motion_means_one_step_a_second(page) -> None:
    page.emulate_media(reduced_motion="reduce")
    try:
        page.get_by_role("button", name="Play").click()
        page.wait_for_function("() => document.querySelector('.crf-play input').value === '12'")
        settled(page)
        assert position(page) == 12
    finally:
        page.emulate_media(reduced_motion="no-preference")


def test_a_training_shows_its_progress_and_joins_the_player(page, run_python: Callable) -> None:
    ask_for_training(page, "VAE", 4, 600)
    message = wait_for_status(page, "Training VAE")
    assert message == "Training VAE, seed 4 on 13 curves of OpenCRF."
    page.wait_for_function(
        "() => { const { value } = document.querySelector('.crf progress'); return value > 0.1 && value < 1; }"
    )
    assert page.get_by_role("button", name="Start", exact=True).is_disabled()
    assert page.evaluate("document.activeElement.textContent") == "Stop"
    assert run_python(page, "print(panel.running, panel.history)").split()[0] == "True", "the kernel must stay free"
    screenshot(page, "training-light", f".jp-OutputArea:has({PANEL})")
    wait_for_status(page, "Trained VAE")
    column(page, "VAE, seed 4").wait_for()
    assert page.evaluate("document.activeElement.textContent") == "Start"
    assert page.locator(PANEL).get_by_text("600 of 600").is_visible()
    assert run_python(page, "print(len(panel.history), panel.model.metadata_['constraint'])").split() == ["600", "vae"]
    assert sum(counts(page, "VAE, seed 4")) == 13
    assert "ended at 600, n = 13" in column(page, "VAE, seed 4").inner_text()
    slider(page).press("Home")
    assert "epoch 1, n = 13" in column(page, "VAE, seed 4").inner_text()


def test_stop_keeps_what_was_trained(page, run_python: Callable) -> None:
    ask_for_training(page, "LDL", 2, 5000)
    wait_for_status(page, "Training LDL")
    page.get_by_role("button", name="Stop", exact=True).click()
    message = wait_for_status(page, "Stopped LDL, seed 2 after")
    trained = int(run_python(page, "print(len(panel.history))"))
    assert 1 <= trained < 5000
    assert f"after {trained} of 5000 epochs" in message
    column(page, "LDL, seed 2").wait_for()
    assert run_python(page, "print(panel.model.metadata_['trained_epochs'], panel.running)").split() == [
        str(trained),
        "False",
    ]


def test_what_cannot_be_trained_is_said_in_one_sentence(page) -> None:
    ask_for_training(page, "LDL", 0, 0)
    assert wait_for_status(page, "epochs=0") == "epochs=0 is out of range; use a whole number from 1 to 5000"
    page.get_by_label("Epochs", exact=True).fill("300")


def test_a_saved_notebook_plays_without_python(new_context: Callable, tmp_path: Path) -> None:
    player = EpochPlayer({"AAE": load_history("aae")})
    (tmp_path / "page.html").write_text(f"<!doctype html><body>{player._repr_mimebundle_()[0]['text/html']}")
    context = new_context()
    alone = context.new_page()
    alone.goto((tmp_path / "page.html").as_uri())
    frame = alone.frame_locator("iframe")
    frame.get_by_role("slider").press("Home")
    frame.get_by_role("button", name="Play").click()
    frame.get_by_role("application", name="Histogram of the latents of AAE at epoch 4 ").wait_for()
    frame.get_by_role("button", name="Pause").click()
    context.close()
