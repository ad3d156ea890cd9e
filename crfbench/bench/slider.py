"""From a move of the latent slider to the picture: LatentExplorer against `interact` with inline matplotlib.

Both run in the same JupyterLab and the same real Chromium, one after the other, with the same model and the same
moves by keyboard and by mouse. Run it with: python -m crfbench.bench.slider. The ratio is the claim; the milliseconds
are of this machine and this minute.

A move begins at the time stamp of its key or mouse event. It ends with the first task after the frame in which the
last stroke on a canvas was made, or in which the last new image, decoded, was shown. A stroke made within an animation
frame belongs to that very frame, any other to the next one.
"""

import argparse
import random
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Locator, Page, sync_playwright

from crfbench.bench.jupyter_page import CHROMIUM_OPTIONS, KERNEL, Lab, find_chromium, notebook_text, running_lab
from crfbench.bench.timing import Row, row, skipped

OURS = """from crfbench import load_responses
from crfbench.models.slr import SLR
from crfbench.widgets import LatentExplorer
LatentExplorer([SLR.load("ldl", 1, "inverse")], load_responses("opencrf"))"""
INTERACT = """%matplotlib inline
import matplotlib.pyplot as plt
from ipywidgets import FloatSlider, interact
from crfbench.curves import GRID
from crfbench.models.slr import SLR
model = SLR.load("ldl", 1, "inverse")
@interact(z=FloatSlider(min=-4, max=4, step=0.02))
def show(z):
    plt.plot(GRID, model.decode([z]))
    plt.show()"""
TURN = 15  # moves to one side before turning round
WARM_UP = 5
WATCH = """
(() => {
    const seen = window.seen = { began: null, ended: null, strokes: 0 };
    let inFrame = false;
    const nextFrame = window.requestAnimationFrame.bind(window);
    window.requestAnimationFrame = (callback) => nextFrame((now) => {
        inFrame = true;
        try { callback(now); } finally { inFrame = false; }
    });
    const afterThisFrame = () => {
        const { port1, port2 } = new MessageChannel();
        port1.onmessage = () => (seen.ended = performance.now());
        port2.postMessage(null);
    };
    const painted = () => (inFrame ? afterThisFrame() : nextFrame(afterThisFrame));
    for (const kind of ["keydown", "pointermove", "pointerup"]) {
        window.addEventListener(kind, (event) => (seen.began ??= event.timeStamp), true);
    }
    const { stroke } = CanvasRenderingContext2D.prototype;
    CanvasRenderingContext2D.prototype.stroke = function (...path) {
        stroke.apply(this, path);
        painted();
    };
    const whenDecoded = (image) => image.decode().then(painted, () => {}); // an image that is gone again is no picture
    new MutationObserver((changes) => {
        for (const { addedNodes } of changes) for (const node of addedNodes) {
            if (node.nodeType !== Node.ELEMENT_NODE || !node.closest(".jp-OutputArea")) continue;
            for (const image of node.matches("img") ? [node] : node.querySelectorAll("img")) whenDecoded(image);
        }
    }).observe(document, { subtree: true, childList: true });
})();
"""
QUIET = """
() => new Promise((done) => {
    const look = () => {
        const still = seen.ended !== null && performance.now() - seen.ended > 150;
        still ? done(seen.ended - seen.began) : setTimeout(look, 10);
    };
    look();
})
"""

Move = Callable[[Page, int], None]


@dataclass(frozen=True)
class Variant:
    """A notebook cell that shows a slider, and how to find what takes the keys and the mouse."""

    name: str
    cell: str
    handle: str


VARIANTS = (
    Variant("LatentExplorer", OURS, ".crf input[type=range]"),
    Variant("interact + inline matplotlib", INTERACT, ".noUi-handle"),
)


def press_arrow(page: Page, step: int) -> None:
    """Move by one step of the keyboard."""
    page.keyboard.press("ArrowRight" if step > 0 else "ArrowLeft")


def mouse_from(x: float, y: float) -> Move:
    """Return moves of a mouse that has the slider at that place."""
    place = [x]

    def move(page: Page, step: int) -> None:
        place[0] += 2 * step
        page.mouse.move(place[0], y)

    return move


def milliseconds(page: Page, move: Move, moves: int) -> np.ndarray:
    """Make the moves one by one and return how long each took."""
    pause = random.Random(0)  # noqa: S311  a seed, so that every run pauses alike
    times = []
    for i in range(moves + WARM_UP):
        page.evaluate("() => { seen.began = seen.ended = null; }")
        move(page, 1 if i // TURN % 2 == 0 else -1)
        times.append(page.evaluate(QUIET))
        page.wait_for_timeout(30 * pause.random())  # so that moves meet the screen's frames at all phases
    return np.array(times[WARM_UP:])


def by_keyboard(page: Page, handle: Locator, moves: int) -> np.ndarray:
    """Measure moves by the arrow keys."""
    handle.focus()
    return milliseconds(page, press_arrow, moves)


def by_mouse(page: Page, handle: Locator, moves: int) -> np.ndarray:
    """Measure one long drag from the middle of the slider, where both start."""
    box: Any = handle.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    times = milliseconds(page, mouse_from(x, y), moves)
    page.mouse.up()
    return times


def open_variant(page: Page, lab: Lab, variant: Variant) -> Locator:
    """Run the variant's notebook and return the slider's handle."""
    (lab.folder / "slider.ipynb").write_text(notebook_text([variant.cell]), encoding="utf-8")
    page.add_init_script(WATCH)
    page.goto(lab.page("slider.ipynb"))
    page.wait_for_selector(".jp-CodeCell", timeout=60_000)  # until JupyterLab is there, its name is an error
    page.wait_for_function(f"() => {KERNEL}?.status === 'idle'")
    page.evaluate("jupyterapp.commands.execute('notebook:run-all-cells')")
    handle = page.locator(variant.handle).first
    handle.wait_for(timeout=60_000)
    page.wait_for_timeout(3000)  # JupyterLab settles
    return handle


def main() -> None:
    """Print median and 95th percentile of both, by keyboard and by mouse, and how many times faster ours is."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--moves", type=int, default=120, help="of each kind")
    moves = parser.parse_args().moves
    ours, theirs = compare(moves)
    print("ratio of the medians:", ", ".join(f"{b / a:.1f} x" for a, b in zip(ours, theirs, strict=True)))


def rows(moves: int = 30) -> list[Row]:
    """Time moves by keyboard and by mouse; the medians."""
    if find_chromium() is None:
        return [skipped("move of the latent slider", "Chromium is absent")]
    ours, theirs = compare(moves)
    note = f"median of {moves} moves, from input to picture in Chromium"
    return [
        row(f"move of the latent slider by {way}", own / 1e3, VARIANTS[1].name, other / 1e3, note)
        for way, own, other in zip(("keyboard", "mouse"), ours, theirs, strict=True)
    ]


def compare(moves: int) -> list[list[float]]:
    """Measure all variants in one browser; return milliseconds, by keyboard and by mouse, of each."""
    with tempfile.TemporaryDirectory() as home, running_lab(Path(home), Path(home)) as lab, sync_playwright() as run:
        browser = run.chromium.launch(executable_path=find_chromium(), args=CHROMIUM_OPTIONS)
        print(f"{moves} moves by keyboard and by mouse each, Chromium {browser.version}, milliseconds")
        medians = []
        for variant in VARIANTS:
            page = browser.new_page(viewport={"width": 1200, "height": 900})
            medians.append(measure(page, open_variant(page, lab, variant), variant, moves))
            page.close()
        browser.close()
    return medians


def measure(page: Page, handle: Locator, variant: Variant, moves: int) -> list[float]:
    """Print a row for each way to move and return the medians."""
    medians = []
    for way, run in (("keyboard", by_keyboard), ("mouse", by_mouse)):
        times = run(page, handle, moves)
        medians.append(float(np.median(times)))
        print(f"{variant.name:<30}{way:<10}median {medians[-1]:6.1f}   p95 {np.percentile(times, 95):6.1f}")
    return medians


if __name__ == "__main__":
    main()
