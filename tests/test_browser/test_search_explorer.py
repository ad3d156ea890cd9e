"""SearchExplorer as a user meets it: mouse and keyboard."""

from collections.abc import Callable

import pytest

from .looks import eventually, picture, settled

pytestmark = [pytest.mark.browser, pytest.mark.slow]

CELLS = [
    """import numpy as np
import pandas as pd
from ipywidgets import IntSlider, jslink
from crfbench.search import SearchSpace, complexity
from crfbench.widgets import SearchExplorer
space = list(SearchSpace())
table = pd.DataFrame([(*hidden, 0, 0)[:3] for hidden in space], columns=["h1", "h2", "h3"])
table["mse"] = 1e-3 * (1 + np.random.default_rng(0).gamma(2.0, 0.1, size=156))
table = table.assign(mse_sd=1e-4, rmse=table["mse"] ** 0.5, complexity=list(map(complexity, space)), epochs=500)
table["rank"] = table["mse"].rank().astype(int)
explorer = SearchExplorer(table)
heard = []
explorer.observe(lambda change: heard.append(change.new), "m")
slider = IntSlider(min=1, max=156, layout={"width": "80%"})
linked = jslink((explorer, "m"), (slider, "value"))""",
    "explorer",
    "slider",
]


@pytest.fixture(scope="module")
def opened(open_notebook: Callable):
    page = open_notebook("search.ipynb", CELLS)
    page.wait_for_selector(".crf")
    return page


@pytest.fixture
def page(opened, run_python: Callable):
    """Return the page with M = 10 and the choice named."""
    run_python(opened, "explorer.m = 10; explorer.focus = explorer.chosen; heard.clear()")
    opened.wait_for_function("() => document.querySelector('.crf input').getAttribute('aria-valuetext') === '10'")
    chosen = run_python(opened, "print(explorer.chosen)").strip()
    wait_for_name(opened, chosen)
    return opened


def name(page) -> str:
    return page.locator(".crf-readouts dd").first.inner_text()


def wait_for_name(page, text: str) -> None:
    page.wait_for_function("(text) => document.querySelector('.crf-readouts dd').textContent === text", arg=text)
    settled(page)


def python_value(page, run_python: Callable, code: str, expected: str) -> None:
    """Wait until Python has heard of what the page did."""
    eventually(page, lambda: run_python(page, f"print({code})").strip(), lambda found: found == expected)


def test_dragging_m_moves_the_choice(page, run_python: Callable) -> None:
    before = picture(page)
    slider = page.get_by_role("slider", name="M, how many")
    box = slider.bounding_box()
    page.mouse.move(box["x"] + box["width"] * 10 / 156, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, steps=10)
    python_value(page, run_python, "heard[-1] > 60", "True")  # while the hand still drags
    page.mouse.move(box["x"] + box["width"] - 2, box["y"] + box["height"] / 2, steps=10)
    page.mouse.up()
    page.get_by_text("Choice: (10)").wait_for()
    settled(page)
    assert picture(page) != before
    python_value(page, run_python, "explorer.chosen", "(10,)")


def test_m_is_linked_to_a_slider_both_ways(page, run_python: Callable) -> None:
    thumb = page.locator(".widget-slider [role=slider], .widget-slider .noUi-handle").first
    run_python(page, "slider.value = 90")
    page.wait_for_function("() => document.querySelector('.crf input').getAttribute('aria-valuetext') === '90'")
    python_value(page, run_python, "explorer.m", "90")
    page.get_by_role("slider", name="M, how many").focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_function("() => document.querySelector('.widget-readout').textContent === '91'")
    python_value(page, run_python, "slider.value", "91")
    thumb.focus()
    page.keyboard.press("ArrowLeft")
    page.wait_for_function("() => document.querySelector('.crf input').getAttribute('aria-valuetext') === '90'")
    python_value(page, run_python, "explorer.m", "90")


def test_the_page_chooses_as_python_does(page, run_python: Callable) -> None:
    for m in (1, 3, 20, 90):
        run_python(page, f"explorer.m = {m}")
        expected = run_python(page, "print(explorer.chosen)").strip()
        page.wait_for_function(
            "(m) => document.querySelector('.crf input').getAttribute('aria-valuetext') === m", arg=str(m)
        )
        assert page.locator(".crf-status").inner_text() == f"Choice: {expected}"


def test_arrow_keys_move_m_and_not_the_notebook(page, run_python: Callable) -> None:
    page.get_by_role("slider", name="M, how many").focus()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    python_value(page, run_python, "explorer.m", "15")
    assert page.evaluate("getComputedStyle(document.activeElement).outlineWidth") == "3px"
    assert page.locator(".jp-CodeCell").count() == len(CELLS)


def test_every_candidate_is_reached_and_named_by_keyboard(page, run_python: Callable) -> None:
    candidates = page.get_by_label("Candidate, by rank")
    assert candidates.locator("option").count() == 156
    candidates.focus()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowDown")
    second = run_python(page, "print(tuple(explorer._candidates[1]['hidden']))").strip()
    wait_for_name(page, second)
    python_value(page, run_python, "explorer.focus", second)
    assert f"Named: {second}, MSE" in page.get_by_role("application").get_attribute("aria-label")


def test_pointing_at_a_candidate_names_it(page) -> None:
    before = name(page)
    box = page.locator(".crf canvas").bounding_box()
    seen = set()
    for share in (0.2, 0.4, 0.6, 0.8):
        page.mouse.move(box["x"] + box["width"] * share, box["y"] + box["height"] * 0.6)
        page.wait_for_timeout(80)
        seen.add(name(page))
    assert len(seen - {before}) >= 2
