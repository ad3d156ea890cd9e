"""ChartLabeller as a user meets it: mouse, keyboard, undo and the next photograph."""

import json
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from .looks import eventually, picture, settled

pytestmark = [pytest.mark.browser, pytest.mark.slow]

SIZE = (900, 600)
# Where the chart lies in the photographs, as shares: from the dark skin patch clockwise.
CORNERS = np.array([(0.21, 0.24), (0.80, 0.17), (0.86, 0.78), (0.15, 0.70)])
PATCHES = np.random.default_rng(3).integers(20, 236, size=(4, 6, 3), dtype=np.uint8)
CELLS = [
    """import cv2, numpy as np
from crfbench.widgets import ChartLabeller
photos = {name: cv2.imread(f"{name}.png")[..., ::-1] for name in ("first", "second", "third")}
labeller = ChartLabeller(photos)""",
    "labeller",
]


def photograph() -> np.ndarray:
    """Return a chart of black gaps between patches before a shaded wall, in perspective, BGR."""
    chart = np.zeros((400, 600, 3), np.uint8)
    for row in range(4):
        for column in range(6):
            chart[100 * row + 6 : 100 * row + 94, 100 * column + 6 : 100 * column + 94] = PATCHES[row, column, ::-1]
    flat = np.array([(0, 0), (600, 0), (600, 400), (0, 400)], np.float32)
    matrix = cv2.getPerspectiveTransform(flat, (CORNERS * SIZE).astype(np.float32))
    wall = np.linspace(90, 200, SIZE[0]).astype(np.uint8)[None, :, None] * np.ones((SIZE[1], 1, 3), np.uint8)
    return cv2.warpPerspective(chart, matrix, SIZE, dst=wall, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_TRANSPARENT)


@pytest.fixture(scope="module")
def opened(open_notebook: Callable, lab):
    for i, name in enumerate(("first", "second", "third")):
        assert cv2.imwrite(str(lab.folder / f"{name}.png"), photograph() // (i + 1))
    page = open_notebook("labeller.ipynb", CELLS)
    page.errors = []
    page.on("pageerror", lambda error: page.errors.append(str(error)))
    page.on("console", lambda message: page.errors.append(message.text) if message.type == "error" else None)
    page.wait_for_selector(".crf[aria-busy=false]")
    return page


@pytest.fixture
def page(opened, run_python: Callable):
    """Return the page with the first photograph and no labels; no test may leave an error in the console."""
    opened.evaluate("document.activeElement.blur()")
    run_python(opened, f"labeller.labels = {{'other': {CORNERS.tolist()}}}; labeller.labels = {{}}; labeller.index = 0")
    opened.wait_for_function("() => document.querySelector('.crf select').value === '0'")
    opened.wait_for_function("() => document.querySelector('.crf [role=status]').textContent.includes('0 of 3')")
    settled(opened)
    yield opened
    assert opened.errors == []


def corner(page, number: int):
    return page.get_by_role("button", name=f"corner {number} of 4")


def place(page, number: int) -> list[float]:
    """Return where the page says that a corner is, as shares."""
    words = corner(page, number).get_attribute("aria-label").replace(",", "").split()
    return [float(words[words.index(axis) + 1]) / size for axis, size in zip("xy", SIZE, strict=True)]


def drag_corner(page, number: int, to: np.ndarray) -> None:
    """Drag by the middle of the handle, in many small moves, to a share of the photograph."""
    handle, photo = corner(page, number).bounding_box(), page.locator(".crf-photo").bounding_box()
    page.mouse.move(handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2)
    page.mouse.down()
    page.mouse.move(photo["x"] + to[0] * photo["width"], photo["y"] + to[1] * photo["height"], steps=15)
    page.mouse.up()
    settled(page)


def labels(page, run_python: Callable) -> dict[str, list]:
    code = "import json; print(json.dumps({name: corners.tolist() for name, corners in labeller.labels.items()}))"
    return json.loads(run_python(page, code))


def wait_for_labels(page, run_python: Callable, names: list[str]) -> dict[str, list]:
    """Wait until Python has heard of what the page did."""
    return eventually(page, lambda: labels(page, run_python), lambda found: sorted(found) == names)


def wait_for_corner(page, run_python: Callable, number: int, expected: np.ndarray) -> None:
    """Wait until Python has the last of several moves, of which the page may send some together."""
    eventually(
        page,
        lambda: labels(page, run_python).get("first", np.zeros((4, 2)))[number - 1],
        lambda found: np.allclose(found, expected, atol=1e-9),
    )


def label_the_first(page, run_python: Callable) -> None:
    for number, to in enumerate(CORNERS, start=1):
        drag_corner(page, number, to)
    wait_for_corner(page, run_python, 4, place(page, 4))


def test_dragging_the_corners_labels_the_photograph(page, run_python: Callable) -> None:
    before = picture(page)
    label_the_first(page, run_python)
    assert picture(page) != before
    found = wait_for_labels(page, run_python, ["first"])["first"]
    np.testing.assert_allclose(found, CORNERS, atol=2 / SIZE[1])
    assert page.get_by_role("status").inner_text() == "This photograph is labelled; 1 of 3 labelled."


def test_the_preview_shows_the_means_of_the_patches(page, run_python: Callable) -> None:
    run_python(page, f"labeller.labels = {{'first': {CORNERS.tolist()}}}")
    page.get_by_text("1 of 3 labelled").wait_for()
    said = page.locator(".crf-swatches").get_attribute("aria-label").split(": ")[1]
    found = np.array([[float(word) for word in patch.split()] for patch in said.split(", ")])
    assert np.abs(found - PATCHES.reshape(24, 3)).max() < 6, "JPEG takes some"
    shown = page.locator(".crf-swatches span").nth(23).evaluate("(node) => getComputedStyle(node).backgroundColor")
    assert shown == f"rgb({', '.join(str(int(value)) for value in found[23])})"


def test_arrow_keys_nudge_by_a_pixel_and_shift_by_ten(page, run_python: Callable) -> None:
    before = place(page, 2)
    page.get_by_role("button", name="Undo").focus()
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    assert "corner 2 of 4, bluish green" in page.evaluate("document.activeElement.getAttribute('aria-label')")
    assert page.evaluate("getComputedStyle(document.activeElement).outlineWidth") == "3px"
    for key in ("ArrowRight", "ArrowRight", "ArrowUp", "Shift+ArrowDown"):
        page.keyboard.press(key)
    expected = np.add(before, [2 / SIZE[0], 9 / SIZE[1]])
    np.testing.assert_allclose(place(page, 2), expected, atol=1e-9)
    wait_for_corner(page, run_python, 2, expected)
    assert page.locator(".jp-CodeCell").count() == len(CELLS)


def test_the_loupe_shows_while_a_corner_is_held(page) -> None:
    loupe = page.locator(".crf-loupe")
    assert not loupe.is_visible()
    corner(page, 3).focus()
    assert loupe.is_visible()
    handle, glass = corner(page, 3).bounding_box(), loupe.bounding_box()
    assert not (
        glass["x"] < handle["x"] + 14 < glass["x"] + glass["width"]
        and glass["y"] < handle["y"] + 14 < glass["y"] + glass["height"]
    ), "it must not lie over the corner it shows"
    page.get_by_role("button", name="Undo").focus()
    assert not loupe.is_visible()


def test_undo_by_button_and_by_key(page, run_python: Callable) -> None:
    start = place(page, 1)
    drag_corner(page, 1, CORNERS[0])
    corner(page, 4).press("Shift+ArrowLeft")
    once = place(page, 4)
    corner(page, 4).press("Control+z")
    assert place(page, 4) != once
    np.testing.assert_allclose(place(page, 1), CORNERS[0], atol=2 / SIZE[1])
    page.get_by_role("button", name="Undo").click()
    assert place(page, 1) == start
    wait_for_labels(page, run_python, [])
    page.get_by_role("button", name="Undo").click()
    assert page.get_by_role("status").inner_text() == "There is nothing to undo."
    assert page.locator(".jp-CodeCell").count() == len(CELLS)


def test_corners_are_copied_to_the_next_photograph(page, run_python: Callable) -> None:
    copy = page.get_by_role("button", name="Copy corners to next")
    copy.click()
    assert page.get_by_role("status").inner_text() == "Place the corners before you copy them."
    label_the_first(page, run_python)
    copy.click()
    page.get_by_text("2 of 3 labelled").wait_for()
    settled(page)
    assert page.get_by_label("Photograph", exact=True).input_value() == "1"
    found = wait_for_labels(page, run_python, ["first", "second"])
    assert found["first"] == found["second"]
    copy.click()
    page.get_by_text("3 of 3 labelled").wait_for()
    copy.click()
    assert page.get_by_role("status").inner_text().startswith("This is the last photograph")
    page.get_by_role("button", name="Undo").click()
    wait_for_labels(page, run_python, ["first", "second"])


def test_undo_goes_to_the_photograph_it_changes(page, run_python: Callable) -> None:
    drag_corner(page, 1, CORNERS[0])
    page.get_by_role("button", name="next photograph").click()
    page.wait_for_function("() => document.querySelector('.crf select').value === '1'")
    settled(page)
    page.get_by_role("button", name="Undo").click()
    page.wait_for_function("() => document.querySelector('.crf select').value === '0'")
    wait_for_labels(page, run_python, [])


def test_previous_next_and_the_list_show_photographs(page) -> None:
    seen = [picture(page)]
    for _ in range(2):
        page.get_by_role("button", name="next photograph").click()
        page.wait_for_function("(before) => document.querySelector('.crf canvas').toDataURL() !== before", arg=seen[-1])
        settled(page)
        seen.append(picture(page))
    assert len(set(seen)) == 3
    page.get_by_label("Photograph", exact=True).select_option("second")
    page.wait_for_function("(before) => document.querySelector('.crf canvas').toDataURL() === before", arg=seen[1])
    page.get_by_role("button", name="previous photograph").click()
    page.wait_for_function("(before) => document.querySelector('.crf canvas').toDataURL() === before", arg=seen[0])


def test_crossed_corners_are_said_and_never_a_label(page, run_python: Callable) -> None:
    start = place(page, 1)
    drag_corner(page, 1, np.array([0.95, 0.3]))
    assert page.get_by_role("status").inner_text().startswith("The corners cross or run anticlockwise")
    assert page.get_by_role("img", name="no patches").count() == 1
    assert labels(page, run_python) == {}
    drag_corner(page, 2, np.array([0.97, 0.2]))
    assert page.get_by_role("status").inner_text().startswith("The corners cross"), "they stay where they were put"
    page.get_by_role("button", name="Undo").click()
    assert place(page, 1) == start
    drag_corner(page, 1, CORNERS[0])
    wait_for_labels(page, run_python, ["first"])


def test_python_hears_of_a_drag_and_shows_another_photograph(page, run_python: Callable) -> None:
    code = "heard = []; hear = lambda change: heard.append(change.name); labeller.observe(hear, ['labels', 'index'])"
    run_python(page, code)
    drag_corner(page, 1, CORNERS[0])
    wait_for_labels(page, run_python, ["first"])
    run_python(page, "labeller.index = 2")
    page.wait_for_function("() => document.querySelector('.crf select').value === '2'")
    page.get_by_role("button", name="previous photograph").click()
    page.wait_for_function("() => document.querySelector('.crf select').value === '1'")
    assert run_python(page, "print(heard, labeller.index)").strip() == "['labels', 'index', 'index'] 1"
    run_python(page, "labeller.unobserve(hear, ['labels', 'index'])")


def test_a_corner_stays_in_the_photograph(page, run_python: Callable) -> None:
    drag_corner(page, 3, np.array([1.2, 0.9]))
    found = wait_for_labels(page, run_python, ["first"])["first"]
    assert found[2][0] == 1.0


def test_what_is_saved_is_shown_by_a_fresh_labeller(page, run_python: Callable, open_notebook: Callable, lab) -> None:
    label_the_first(page, run_python)
    expected = [place(page, number) for number in range(1, 5)]
    run_python(page, "labeller.save('labels.json', overwrite=True)")
    fresh = open_notebook("fresh.ipynb", [*CELLS[:1], "labeller.load('labels.json')\nlabeller"])
    fresh.wait_for_selector(".crf[aria-busy=false]")
    assert [place(fresh, number) for number in range(1, 5)] == expected
    assert fresh.get_by_role("status").inner_text() == "This photograph is labelled; 1 of 3 labelled."
