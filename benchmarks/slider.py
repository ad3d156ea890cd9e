"""From the input to the picture: our widgets against `interact` with inline matplotlib, by keyboard, drag and click.

All run in the same JupyterLab and the same real Chromium, one after the other. A move begins at the time stamp of its
key or mouse event, a click at the release of the button. It ends with the first task after the frame in which the last
stroke on a plot was made, or in which the last new image, decoded, was shown. A stroke made within an animation frame
belongs to that very frame, any other to the next one. The sketch of the network and the photograph, which `interact`
has not, follow the curve a frame later and are not waited for.
"""

import random
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Browser, Locator, Page, sync_playwright

from benchmarks.jupyter_page import CHROMIUM_OPTIONS, KERNEL, Lab, find_chromium, notebook_text, running_lab
from benchmarks.timing import Row, noted, row

SLIDER = """from crfbench import load_responses
from crfbench.widgets import LatentExplorer
LatentExplorer(["SLR-ldl-1"], load_responses("opencrf"))"""
INTERACT_SLIDER = """%matplotlib inline
import matplotlib.pyplot as plt
from ipywidgets import FloatSlider, interact
from crfbench import load_model
from crfbench.curves import GRID
model = load_model("SLR-ldl-1")
@interact(z=FloatSlider(min=-4, max=4, step=0.02))
def show(z):
    plt.plot(GRID, model.decode([[z]])[0])
    plt.show()"""
PATCHES = """from crfbench.widgets import CalibrationExplorer
explorer = CalibrationExplorer()
explorer.model = {model!r}
explorer"""
INTERACT_PATCHES = """%matplotlib inline
import matplotlib.pyplot as plt
from ipywidgets import interact
from crfbench import calibrate, load_model
from crfbench.calibration import decode_table
from crfbench.plots import plot_calibration
from crfbench.widgets import CalibrationExplorer
model = load_model("SLR-ldl-1")
table = decode_table(model)
explorer = CalibrationExplorer()
explorer.patches = (19, 21, 22, 24)
seen = explorer.result.observations
@interact(patch_22=False)
def show(patch_22):
    plot_calibration(calibrate(model, seen.take([0, 1, 2, 3] if patch_22 else [0, 1, 3]), "posterior", table=table))
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
        if (!this.canvas.matches(".crf-network")) painted();
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
Way = Callable[[Page, Locator, int], np.ndarray]


@dataclass(frozen=True)
class Variant:
    """A notebook cell that shows a slider, and how to find what takes the keys and the mouse."""

    name: str
    cell: str
    handle: str


SLIDERS = (
    Variant("LatentExplorer", SLIDER, ".crf input[type=range]"),
    Variant("interact + inline matplotlib", INTERACT_SLIDER, ".noUi-handle"),
)
CLICKED = ".crf-chart button:nth-child(22)"
CHARTS = (
    Variant("CalibrationExplorer, SLR-ldl-1", PATCHES.format(model="SLR-ldl-1"), CLICKED),
    Variant("CalibrationExplorer, EMoR-3", PATCHES.format(model="EMoR-3"), CLICKED),
    Variant("interact + inline matplotlib", INTERACT_PATCHES, ".jp-OutputArea input[type=checkbox]"),
)


def press_arrow(page: Page, step: int) -> None:
    """Move by one step of the keyboard."""
    page.keyboard.press("ArrowRight" if step > 0 else "ArrowLeft")


def click(page: Page, _step: int) -> None:
    """Press and release where the mouse is."""
    page.mouse.down()
    page.mouse.up()


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


def by_click(page: Page, handle: Locator, moves: int) -> np.ndarray:
    """Measure clicks on one patch of the chart, which take it out of the calibration or put it back."""
    handle.hover()
    return milliseconds(page, click, moves)


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


def rows(moves: int = 30, clicks: int = 20) -> list[Row]:
    """Time moves of the latent slider by keyboard and by mouse, and clicks on a patch; the medians."""
    if find_chromium() is None:
        return [noted("move of the latent slider", "skipped: Chromium is absent")]
    with tempfile.TemporaryDirectory() as home, running_lab(Path(home), Path(home)) as lab, sync_playwright() as run:
        browser = run.chromium.launch(executable_path=find_chromium(), args=CHROMIUM_OPTIONS)
        found = [
            *compare(browser, lab, SLIDERS, by_keyboard, moves),
            *compare(browser, lab, SLIDERS, by_mouse, moves),
            *compare(browser, lab, CHARTS, by_click, clicks),
        ]
        browser.close()
    return found


def compare(browser: Browser, lab: Lab, variants: tuple[Variant, ...], way: Way, moves: int) -> Iterator[Row]:
    """Measure all variants one way, and compare each with the last."""
    found = []
    for variant in variants:
        page = browser.new_page(viewport={"width": 1200, "height": 900})
        found.append(way(page, open_variant(page, lab, variant), moves))
        page.close()
    theirs = np.median(found[-1])
    what = "click on a patch" if way is by_click else f"move of the latent slider {way.__name__.replace('_', ' ')}"
    for variant, own in zip(variants[:-1], found, strict=False):
        note = f"median of {moves}, from input to picture in Chromium; 95 % within {np.percentile(own, 95):.0f} ms"
        yield row(f"{what}, {variant.name}", float(np.median(own)) / 1e3, variants[-1].name, float(theirs) / 1e3, note)
