"""A plot under the hand: zoom, read-out, legend and keyboard, and the walk through Algorithm 1, on a page by itself."""

import re
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from crfbench.search import SearchSpace, complexity
from crfbench.widgets import DotPlot, SearchExplorer
from crfbench.widgets.page import page as page_of

from .looks import picture

pytestmark = pytest.mark.browser

SPACE = SearchSpace(h1=(10, 20, 50), h2=(0, 10), h3=(0,))
MSE = [6e-3, 5e-3, 4e-3, 3e-3, 2e-3, 1e-3]


@pytest.fixture
def page(new_context: Callable, tmp_path: Path):
    rows = [(*hidden, 0, 0)[:3] for hidden in SPACE]
    table = pd.DataFrame(rows, columns=["h1", "h2", "h3"]).assign(mse=MSE, mse_sd=1e-4, rmse=0.05, epochs=9)
    table["complexity"], table["rank"] = list(map(complexity, SPACE)), range(len(SPACE), 0, -1)
    (tmp_path / "page.html").write_text(page_of(SearchExplorer(table, m=3), "Search"), encoding="utf-8")
    opened = new_context(viewport={"width": 1000, "height": 900}).new_page()
    opened.goto((tmp_path / "page.html").as_uri())
    opened.get_by_text("Choice: (20, 10)").wait_for()
    painted(opened)
    yield opened
    opened.context.close()


def painted(page) -> None:
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def canvas(page):
    return page.get_by_role("application")


def read(page) -> str:
    painted(page)
    return page.locator(".crf-readout").inner_text()


def drag_box(page, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Drag from one place to another, in shares of the canvas."""
    box = canvas(page).bounding_box()
    places = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in (start, end)]
    page.mouse.move(*places[0])
    page.mouse.down()
    page.mouse.move(*places[1], steps=5)
    page.mouse.up()


def shown(page) -> list[float]:
    """Return the ends of what is shown, as the plot says them after a zoom."""
    return [float(number.replace(",", "")) for number in re.findall(r"[\d.,]+(?:e-\d)?(?= to|;|$)", read(page))]


def test_a_box_zooms_and_a_double_click_shows_all(page) -> None:
    whole = picture(page)
    drag_box(page, (0.4, 0.5), (0.7, 0.8))
    left, right, low, high = shown(page)
    assert 10_000 < left < right < 54_000
    assert 8e-4 < low < high < 3e-3
    assert picture(page) != whole
    drag_box(page, (0.4, 0.4), (0.6, 0.6))
    deeper = shown(page)
    assert left < deeper[0] < deeper[1] < right
    page.mouse.dblclick(*middle(page))
    assert read(page) == "All is shown."
    assert picture(page) == whole


def middle(page) -> tuple[float, float]:
    box = canvas(page).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def test_a_button_shows_all_too(page) -> None:
    show_all = page.get_by_text("Show all")
    assert not show_all.is_visible()
    page.mouse.dblclick(*middle(page))  # a finger has no other way
    show_all.click()
    assert read(page) == "All is shown."
    assert not show_all.is_visible()


def test_a_click_is_no_box(page) -> None:
    whole = picture(page)
    page.mouse.click(*middle(page))
    painted(page)
    assert picture(page) == whole


def test_the_keyboard_zooms_moves_and_returns(page) -> None:
    canvas(page).focus()
    page.keyboard.press("+")
    left, right, low, high = shown(page)
    page.keyboard.press("Shift+ArrowRight")
    moved = shown(page)
    assert moved[0] > left
    assert moved[1] / moved[0] == pytest.approx(right / left, rel=1e-3), "the axis is logarithmic"
    assert moved[2:] == [low, high]
    page.keyboard.press("-")
    page.keyboard.press("-")
    assert read(page) == "All is shown."
    page.keyboard.press("+")
    page.keyboard.press("Escape")
    assert read(page) == "All is shown."


def test_pointing_names_the_candidate_with_its_numbers(page) -> None:
    whole = picture(page)
    page.get_by_label("Candidate, by rank").select_option(label="6. (10)")  # puts a note there, to point at
    assert read(page) == "(10)"
    note = page.locator(".crf-readout").bounding_box()
    page.mouse.move(note["x"] - 12, note["y"] + note["height"] + 12)
    assert read(page) == f"(10), rank 6: complexity {complexity((10,)):,}, held-out MSE 6.00e-3"
    page.mouse.move(1, 1)
    assert read(page) == "(10)", "no longer read, but still named"
    assert picture(page) != whole


def test_arrow_keys_go_from_candidate_to_candidate(page) -> None:
    canvas(page).focus()
    seen = []
    for key in ("ArrowDown", "ArrowDown", "ArrowRight", "ArrowRight"):
        page.keyboard.press(key)
        seen.append(read(page))
    assert seen[0].startswith("Pareto front: complexity ")
    assert [text.split(":")[0] for text in seen[1:]] == ["(10), rank 6", "(10, 10), rank 5", "(20), rank 4"]
    assert "(20)" in page.locator(".crf-readouts dd").first.inner_text()
    page.keyboard.press("ArrowUp")
    assert read(page).startswith("Pareto front")


def test_an_entry_of_the_legend_makes_its_marks_stand_out(page) -> None:
    whole = picture(page)
    box = canvas(page).bounding_box()
    place = box["x"] + 48 + 10, box["y"] + 9  # the first entry
    page.mouse.move(*place)
    painted(page)
    lit = picture(page)
    assert lit != whole
    page.mouse.move(1, 1)
    painted(page)
    assert picture(page) == whole
    page.mouse.click(*place)
    page.mouse.move(1, 1)
    painted(page)
    assert picture(page) == lit, "a click makes it stay"
    page.mouse.click(*place)
    page.mouse.move(1, 1)
    painted(page)
    assert picture(page) == whole


def test_algorithm_1_is_walked_through_by_keyboard(page) -> None:
    done = picture(page)
    status, current = page.locator(".crf-status"), page.locator("[aria-current=step]")
    page.get_by_role("button", name="Step").focus()
    said = []
    for _ in range(4 * len(SPACE) + 5):
        page.keyboard.press("Enter")
        said.append(status.inner_text())
        assert said[-1].startswith(f"Line {line_of(current)}: ")
    assert said[0] == "Line 1: nothing is known yet of the 6 candidates."
    assert said[1:5] == [
        "Line 3: candidate 1 of 6 is (10).",
        "Line 4: its held-out MSE is 6.00e-3.",
        f"Line 5: its complexity is {complexity((10,)):,}.",
        "Line 6: (10) is stored, 1 of 6.",
    ]
    stored = [text for text in said if text.startswith("Line 6")]
    assert [text.split(": ")[1].split(" is")[0] for text in stored] == [
        "(10)",
        "(10, 10)",
        "(20)",
        "(20, 10)",
        "(50)",
        "(50, 10)",
    ]
    assert said[-4:] == [
        "Line 8: the most accurate is (50, 10).",
        "Line 9: the 3 most accurate are kept.",
        "Line 10: the least complex of them is (20, 10).",
        "Line 11: the choice is (20, 10).",
    ]
    page.keyboard.press("Enter")
    painted(page)
    assert status.inner_text() == "Choice: (20, 10)"
    assert current.count() == 0
    assert picture(page) == done


def line_of(current) -> int:
    return 1 + current.evaluate("(node) => [...node.parentNode.children].indexOf(node)")


@pytest.mark.slow
def test_algorithm_1_plays_by_itself_and_pauses(page) -> None:
    paused_at = page.evaluate(
        """async () => {
            const [play, status] = [".crf-toggle", ".crf-status"].map((name) => document.querySelector(name));
            play.click();
            // On a slow machine all lines may pass between two frames: then it has ended by itself.
            const going = () => play.textContent === "Pause" && !status.textContent.startsWith("Line");
            while (going()) await new Promise(requestAnimationFrame);
            if (play.textContent === "Pause") play.click();
            return status.textContent;
        }"""
    )
    painted(page)
    assert page.locator(".crf-status").inner_text() == paused_at
    page.get_by_role("button", name="Play").click()
    page.get_by_text("Choice: (20, 10)").wait_for()
    page.get_by_role("button", name="Play").click()
    page.get_by_role("button", name="To the end").click()
    assert page.locator(".crf-status").inner_text() == "Choice: (20, 10)"
    assert page.get_by_role("button", name="Play").count() == 1


def test_a_legend_lights_the_dots_of_one_entry_and_dots_say_their_names(new_context, tmp_path) -> None:
    rows = [(camera, 0.1 * i, 0.2 * (i % 5), f"patch {i}") for camera in ("Canon", "Nikon", "Sony") for i in range(9)]
    table = pd.DataFrame(rows, columns=["camera", "RAW (share)", "JPEG (share)", "dot"])
    plot = DotPlot(table, "RAW (share)", "JPEG (share)", by="camera", name="dot")
    (tmp_path / "dots.html").write_text(page_of(plot, "Cameras"), encoding="utf-8")
    page = new_context(viewport={"width": 700, "height": 800}).new_page()
    page.goto((tmp_path / "dots.html").as_uri())
    painted(page)
    box, all_alike = canvas(page).bounding_box(), picture(page)
    page.mouse.move(box["x"] + 60, box["y"] + 9)  # on the first entry
    painted(page)
    alone = picture(page)
    assert alone != all_alike
    page.mouse.click(box["x"] + 60, box["y"] + 9)
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] + 40)
    painted(page)
    assert picture(page) == alone  # pressed, it stays
    canvas(page).focus()
    page.keyboard.press("ArrowDown")
    assert read(page).startswith("Canon, patch 0: RAW 0")
    page.keyboard.press("ArrowDown")
    assert read(page).startswith("Nikon, patch 0")
    page.context.close()
