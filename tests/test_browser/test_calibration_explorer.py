"""CalibrationExplorer as a user meets it: mouse and keyboard."""

from collections.abc import Callable

import pytest

from .looks import picture, readout, screenshot, settled

pytestmark = pytest.mark.browser

CELLS = [
    """from crfbench.widgets import CalibrationExplorer
explorer = CalibrationExplorer()
heard = []
explorer.observe(heard.append, "patches")""",
    "explorer",
]


START = {
    "camera": "CanonEOS1DsMarkII",
    "illumination": 1,
    "model": "SLR-ldl-1",
    "method": "posterior",
    "patches": [19, 21, 24],
}


@pytest.fixture(scope="module")
def complaints() -> list[str]:
    """Collect what the page writes to the console as an error."""
    return []


@pytest.fixture(scope="module")
def opened(open_notebook: Callable, complaints: list[str]):
    page = open_notebook("calibration.ipynb", CELLS)
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.wait_for_selector(".crf")
    return page


@pytest.fixture
def page(opened, run_python: Callable):
    """Return the page with the first camera, three greys, SLR-ldl-1 and its posterior."""
    run_python(opened, f"explorer.set_state({START}); heard.clear()")
    wait_for_pressed(opened, ["19", "21", "24"])
    settled(opened)
    return opened


def pressed(page) -> list[str]:
    return [name.lstrip("✓") for name in page.locator(".crf-chart [aria-pressed=true]").all_inner_texts()]


def wait_for_pressed(page, numbers: list[str]) -> None:
    page.wait_for_function(
        """(numbers) => String([...document.querySelectorAll(".crf-chart [aria-pressed=true]")]
            .map((node) => node.textContent)) === String(numbers)""",
        arg=numbers,
    )


def patch(page, number: int):
    return page.get_by_role("button", name=f"patch {number}, irradiance")


def status(page) -> str:
    return page.get_by_role("status").inner_text()


def tell(page, run_python: Callable, code: str) -> str:
    return run_python(page, f"print({code})").strip()


def test_a_click_takes_a_patch_in_or_out(page, run_python: Callable) -> None:
    before = picture(page)
    patch(page, 22).click()
    settled(page)
    assert pressed(page) == ["19", "21", "22", "24"]
    assert tell(page, run_python, "explorer.patches") == "(19, 21, 22, 24)"
    assert tell(page, run_python, "[change.new for change in heard]") == "[(19, 21, 22, 24)]"
    assert picture(page) != before
    error = float(tell(page, run_python, "explorer.rmse"))
    assert float(readout(page, "held-out RMSE")) == pytest.approx(error, rel=1e-3)
    assert status(page).startswith("4 patches: held-out RMSE")
    patch(page, 22).click()
    settled(page)
    assert pressed(page) == ["19", "21", "24"]
    assert picture(page) == before


def test_the_chart_is_reached_and_pressed_by_keyboard(page, run_python: Callable) -> None:
    page.get_by_label("Method").focus()
    in_order = page.locator(".crf-chart [tabindex='0']")
    assert in_order.count() == 1
    for _ in range(2):  # the plot comes first
        page.keyboard.press("Tab")
    assert in_order.evaluate("(node) => node === document.activeElement")
    patch(page, 1).focus()
    for key in ("ArrowDown", "ArrowRight", "ArrowRight", "ArrowUp", "ArrowLeft", "ArrowUp"):
        page.keyboard.press(key)
    assert page.evaluate("document.activeElement.textContent") == "2"
    assert page.evaluate("getComputedStyle(document.activeElement).outlineWidth") == "3px"
    page.keyboard.press("Space")
    settled(page)
    assert pressed(page) == ["2", "19", "21", "24"]
    page.keyboard.press("Enter")
    settled(page)
    assert tell(page, run_python, "explorer.patches") == "(19, 21, 24)"
    assert page.locator(".jp-CodeCell").count() == len(CELLS)


def test_shortcuts_press_their_patches(page, run_python: Callable) -> None:
    for name, count in {"6 greys": 6, "12 patches": 12, "all 24": 24, "3 greys": 3}.items():
        page.get_by_role("button", name=name).click()
        settled(page)
        assert len(pressed(page)) == count
        assert tell(page, run_python, "len(explorer.patches)") == str(count)


def test_quick_clicks_are_all_heard(page, run_python: Callable) -> None:
    for number in range(1, 13):
        patch(page, number).click(no_wait_after=True)
    settled(page)
    assert tell(page, run_python, "len(explorer.patches)") == "15"
    assert len(pressed(page)) == 15


def test_another_camera_and_light(page, run_python: Callable) -> None:
    before, chart = picture(page), patch(page, 4).get_attribute("style")
    page.get_by_label("Camera").select_option(label="PentaxK10D")
    settled(page)
    assert tell(page, run_python, "explorer.camera") == "PentaxK10D"
    assert picture(page) != before
    assert patch(page, 4).get_attribute("style") != chart
    before = picture(page)
    page.get_by_label("Calibrate on").select_option(label="illumination 2")
    settled(page)
    assert tell(page, run_python, "explorer.illumination") == "2"
    assert picture(page) != before
    assert "Inverse response of PentaxK10D" in page.locator(".crf canvas").first.get_attribute("aria-label")


def test_another_model_and_method(page, run_python: Callable) -> None:
    methods = page.get_by_label("Method").locator("option")
    assert any(text.startswith("grid") for text in methods.all_inner_texts())
    page.get_by_label("Model").select_option(label="EMoR-3")
    settled(page)
    assert tell(page, run_python, "explorer.model") == "EMoR-3"
    assert not page.locator(".crf-density-curve").is_visible()
    assert readout(page, "component 3")
    names = methods.all_inner_texts()
    assert any(text.startswith("lm") for text in names)
    assert not any(text.startswith("grid") for text in names)
    before = picture(page)
    page.get_by_label("Method").select_option(label=next(text for text in names if text.startswith("map")))
    settled(page)
    assert tell(page, run_python, "explorer.result.method") == "map"
    assert picture(page) != before


def test_the_papers_method_says_that_it_takes_time(page, run_python: Callable) -> None:
    names = page.get_by_label("Method").locator("option").all_inner_texts()
    paper = next(text for text in names if text.startswith("paper"))
    assert "seconds" in paper
    page.get_by_label("Model").select_option(label="Gamma-1")
    settled(page)
    page.get_by_label("Method").select_option(label=paper)
    settled(page)
    assert tell(page, run_python, "explorer.result.method") == "paper"


def test_one_patch_is_refused_in_words_and_the_last_curve_fades(page, run_python: Callable) -> None:
    patch(page, 19).click()
    settled(page)
    assert page.get_by_label("warnings").locator("li").all_inner_texts()
    patch(page, 21).click()
    page.get_by_text("use 2 or more").wait_for()
    settled(page)
    assert status(page) == tell(page, run_python, "explorer.error")
    assert "faded" in page.locator(".crf canvas").first.get_attribute("aria-label")
    assert float(page.locator(".crf-readouts").evaluate("(node) => getComputedStyle(node).opacity")) < 0.5
    screenshot(page, "calibration-error")
    patch(page, 22).click()
    page.get_by_text("2 patches: held-out RMSE").wait_for()
    assert "faded" not in page.locator(".crf canvas").first.get_attribute("aria-label")
    assert page.locator(".crf-readouts").evaluate("(node) => getComputedStyle(node).opacity") == "1"


def test_python_moves_the_page(page, run_python: Callable) -> None:
    run_python(page, "explorer.camera, explorer.patches, explorer.model = 'NikonD70', (1, 2, 23), 'PPISP-4'")
    wait_for_pressed(page, ["1", "2", "23"])
    page.wait_for_function("() => document.querySelector('.crf select').selectedOptions[0].text === 'NikonD70'")
    assert page.get_by_label("Model").locator("option:checked").inner_text() == "PPISP-4"


def test_the_console_stays_silent(page, complaints: list[str]) -> None:
    assert [text for text in complaints if "crf" in text.lower() or "anywidget" in text.lower()] == []
