"""ModelExplorer as a user meets it: mouse and keyboard."""

from collections.abc import Callable

import numpy as np
import pytest

from crfbench.curves import GRID
from crfbench.metrics import rmse
from crfbench.models import GGCM

from .looks import drag, picture, readout, screenshot, settled

pytestmark = [pytest.mark.browser, pytest.mark.slow]

NAMES = ["film A", "film B", "camera with a rather long name (red channel)", "film C"]
CURVES = np.stack(
    [GRID**0.45, (GRID**0.5 + GRID) / 2, np.sin(GRID * np.pi / 2) ** 0.8, 1.2 * GRID**0.6 / (1 + 0.2 * GRID)]
)
CELLS = [
    """import json
import numpy as np
from crfbench.models import GGCM, PPISP, Polynomial
from crfbench.widgets import ModelExplorer
names = json.load(open("names.json"))
models = [GGCM(3, "forward"), Polynomial(4, "forward"), PPISP("forward")]
explorer = ModelExplorer(names, np.load("curves.npy"), models)""",
    "explorer",
]


@pytest.fixture(scope="module")
def opened(open_notebook: Callable, lab):
    np.save(lab.folder / "curves.npy", CURVES)
    (lab.folder / "names.json").write_text(str(NAMES).replace("'", '"'), encoding="utf-8")
    page = open_notebook("explorer.ipynb", CELLS)
    page.wait_for_selector(".crf")
    return page


@pytest.fixture
def page(opened, run_python: Callable):
    """Return the page with the first curve, GGCM-3-forward at its mean, and no nearest valid curve."""
    run_python(
        opened, "explorer.index, explorer.model, explorer.show_valid = 0, 'GGCM-3-forward', False; explorer.reset()"
    )
    opened.wait_for_function("() => document.querySelectorAll('.crf input[type=range]').length === 3")
    settled(opened)
    return opened


def wait_for_change(page, name: str, before: str) -> None:
    page.wait_for_function(
        """([name, before]) => [...document.querySelectorAll(".crf-readouts div")].some(
            (row) => row.firstChild.textContent === name && row.lastChild.textContent !== before)""",
        arg=[name, before],
    )
    settled(page)


def test_mouse_drag_changes_curve_and_errors(page, run_python: Callable) -> None:
    before, errors = picture(page), readout(page, "RMSE")
    slider = page.get_by_role("slider", name="w0, of x^0")
    drag(page, slider, 0.2)
    wait_for_change(page, "RMSE", errors)
    # The last position of the drag has arrived, however many were left out on the way.
    assert float(slider.input_value()) == pytest.approx(0.2 * 8, abs=0.2)
    held = float(run_python(page, "print(explorer.params[0])"))
    assert float(slider.get_attribute("aria-valuetext")) == pytest.approx(held, rel=1e-3)
    assert picture(page) != before
    assert readout(page, "RMSE") in page.get_by_role("application", name="Curve film A").get_attribute("aria-label")


def test_arrow_keys_move_the_slider_and_not_the_notebook(page, run_python: Callable) -> None:
    errors, params = readout(page, "RMSE"), run_python(page, "print(explorer.params[1])")
    page.get_by_role("slider", name="w1, of x^1").focus()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    wait_for_change(page, "RMSE", errors)
    assert float(run_python(page, "print(explorer.params[1])")) > float(params)
    assert page.evaluate("document.activeElement.type") == "range"
    assert page.evaluate("getComputedStyle(document.activeElement).outlineWidth") == "3px"


def test_keys_that_are_shortcuts_elsewhere_work_in_a_select(page, run_python: Callable) -> None:
    page.get_by_label("Curve", exact=True).focus()
    page.keyboard.press("ArrowDown")
    page.get_by_role("application", name=f"Curve {NAMES[1]} ").wait_for()
    assert run_python(page, "print(explorer.index)").strip() == "1"
    assert page.locator(".jp-CodeCell").count() == len(CELLS)


def test_fit_by_keyboard_gives_the_optimum(page) -> None:
    model = GGCM(3, "forward")
    best = float(rmse(model.decode(model.fit(CURVES[2])[0]), CURVES[2]))
    page.get_by_label("Curve", exact=True).select_option(label=NAMES[2])
    page.get_by_role("button", name="Fit").focus()
    page.keyboard.press("Enter")
    page.get_by_text(f"Fitted GGCM-3-forward to {NAMES[2]}: RMSE {best:.4g}").wait_for()
    assert float(readout(page, "RMSE")) == pytest.approx(best, rel=1e-3)
    assert float(readout(page, "MSE")) == pytest.approx(best**2, rel=1e-3)


def test_reset_returns_to_the_mean(page) -> None:
    start = readout(page, "RMSE")
    page.get_by_role("button", name="Fit").click()
    wait_for_change(page, "RMSE", start)
    fitted = readout(page, "RMSE")
    page.get_by_role("button", name="Reset").click()
    wait_for_change(page, "RMSE", fitted)
    assert readout(page, "RMSE") == start


def test_another_model_brings_its_sliders(page) -> None:
    sliders = page.get_by_role("slider")
    assert sliders.count() == 3
    page.get_by_label("Model", exact=True).select_option("Polynomial-4-forward")
    page.get_by_role("slider", name="w4, of x^4").wait_for()
    assert sliders.count() == 4


def test_curves_are_turned_round(page) -> None:
    curve = page.get_by_label("Curve", exact=True)
    page.get_by_role("button", name="previous curve").click()
    page.get_by_role("application", name=f"Curve {NAMES[-1]} ").wait_for()
    assert curve.evaluate("(node) => node.selectedOptions[0].text") == NAMES[-1]
    page.get_by_role("button", name="next curve").click()
    page.get_by_role("application", name=f"Curve {NAMES[0]} ").wait_for()


def test_a_curve_that_cannot_be_a_response_is_called_so(page, run_python: Callable) -> None:
    run_python(page, "explorer.model = 'Polynomial-4-forward'; explorer.params = (3.0, -2.0, 0.0, 0.0)")
    page.get_by_text("falls at 256 samples").wait_for()
    assert readout(page, "in [0, 1]") == "no"
    settled(page)
    before = picture(page)
    page.get_by_label("show nearest valid curve").check()
    page.wait_for_function("(before) => document.querySelector('.crf canvas').toDataURL() !== before", arg=before)
    assert run_python(page, "print(explorer.show_valid)").strip() == "True"
    screenshot(page, "invalid")


def test_python_moves_the_sliders(page, run_python: Callable) -> None:
    run_python(page, "explorer.params = (2.0, 0.0, 0.0)")
    page.wait_for_function("() => document.querySelector('.crf input').getAttribute('aria-valuetext') === '2.000'")
    assert run_python(page, "print(explorer.curve[512] - (512 / 1023) ** 2)").strip() == "0.0"


def test_the_best_by_hand_is_kept_and_told_beside_the_fit(page, run_python: Callable) -> None:
    run_python(page, "explorer.best = {}; explorer.index = 1")
    settled(page)
    assert readout(page, "your best RMSE") == "–"
    errors = []
    for key in ("ArrowRight", "ArrowRight", "PageDown"):
        before = readout(page, "RMSE")
        page.get_by_role("slider", name="w0, of x^0").press(key)
        wait_for_change(page, "RMSE", before)
        errors.append(float(readout(page, "RMSE")))
    assert float(readout(page, "your best RMSE")) == min(errors)
    run_python(page, "explorer.fit()")
    page.get_by_text("; your best: ").wait_for()
    assert float(readout(page, "your best RMSE")) == min(errors) > float(readout(page, "RMSE"))
    page.get_by_label("Model", exact=True).select_option("PPISP-4-forward")
    page.get_by_role("slider", name="toe").wait_for()
    assert readout(page, "your best RMSE") == "–"
    assert run_python(page, "print(*explorer.best)").strip() == f"{NAMES[1]}, GGCM-3-forward"


def test_formula_and_photograph_follow_the_model(page, run_python: Callable) -> None:
    assert page.locator(".crf-formula").inner_text().startswith("y = xP(x)")
    assert page.get_by_role("slider", name="w0, of x^0").evaluate(DESCRIPTION) == "w0: the exponent near black"
    photo = page.get_by_role("img", name="A photograph; left: film A; right: GGCM-3-forward")
    before = photo.evaluate("(canvas) => canvas.toDataURL()")
    halves = photo.evaluate(HALVES)
    run_python(page, "explorer.params = (0.2, 0.0, 0.0)")
    page.wait_for_function("([shown, before]) => shown.toDataURL() !== before", arg=[photo.element_handle(), before])
    after = photo.evaluate(HALVES)
    assert after[0] == halves[0], "the left half goes through the measured curve"
    assert after[1] > halves[1], "a lower exponent brightens"
    border = page.get_by_role("separator")
    border.press("Home")
    assert border.get_attribute("aria-valuenow") == "0"
    box = photo.bounding_box()
    page.mouse.click(box["x"] + 0.8 * box["width"], box["y"] + 20)
    assert border.get_attribute("aria-valuenow") == "80"
    screenshot(page, "photograph")


DESCRIPTION = "(node) => document.getElementById(node.getAttribute('aria-describedby')).innerText"
HALVES = """(canvas) => [0, canvas.width / 2 + 2].map((left) => {
    const { data } = canvas.getContext("2d").getImageData(left, 0, canvas.width / 2 - 2, canvas.height);
    return data.reduce((sum, value) => sum + value, 0);
})"""
