"""The report as its reader meets it: a file, no network, by mouse and by keyboard, light, dark and narrow."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from crfbench.paper.report import write_report

from .looks import drag, picture, readout, screenshot, settled

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(tmp_path_factory.mktemp("report") / "report.html")


@pytest.fixture(scope="module")
def opened(new_context: Callable, file: Path) -> Iterator:
    """Open the page, which notes whatever it asks of the network or says in the console."""
    context = new_context(offline=True)
    page = context.new_page()
    page.troubles = []
    page.on("console", lambda message: page.troubles.append(message.text))
    page.on("pageerror", lambda error: page.troubles.append(str(error)))
    page.on("request", lambda request: request.url.startswith(("file:", "blob:")) or page.troubles.append(request.url))
    page.goto(file.as_uri())
    page.wait_for_selector(".crf-sortable")
    yield page
    context.close()


@pytest.fixture
def page(opened) -> Iterator:
    """Return the page, light and wide; any trouble fails the test. Each test sorts by headings of its own."""
    opened.set_viewport_size({"width": 1100, "height": 900})
    opened.emulate_media(color_scheme="light")
    settled(opened)
    yield opened
    settled(opened)
    assert opened.troubles == []


def column(page, number: int) -> list[str]:
    return page.locator(f".crf-sortable tbody tr > :nth-child({number})").all_inner_texts()


def numbers(texts: list[str]) -> list[float]:
    return [float(text.replace(",", "").rstrip("%")) for text in texts if text != "–"]


def sort_of(page, number: int) -> str:
    return page.locator(f".crf-sortable thead th:nth-child({number})").get_attribute("aria-sort")


def test_the_slider_moves_the_curve(page):
    before, gamma = picture(page), readout(page, "gamma-equivalent")
    slider = page.get_by_role("slider", name="latent")
    slider.scroll_into_view_if_needed()
    drag(page, slider, 0.3)
    settled(page)
    assert picture(page) != before
    assert readout(page, "gamma-equivalent") != gamma
    dragged = picture(page)
    slider.focus()
    page.keyboard.press("ArrowLeft")
    settled(page)
    assert picture(page) != dragged


def test_a_press_sorts_and_another_turns_it_round(page):
    heading = page.get_by_role("button", name="calibration, 3 patches")
    heading.click()
    values = numbers(column(page, 9))
    assert values == sorted(values)
    assert len(set(values)) > 5
    assert sort_of(page, 9) == "ascending"
    heading.click()
    assert numbers(column(page, 9)) == values[::-1]
    assert sort_of(page, 9) == "descending"
    assert sort_of(page, 1) == "none"
    assert page.locator(".crf-sortable [role=status]").inner_text() == "Sorted by calibration, 3 patches, descending."


def test_headings_are_reached_and_pressed_by_keyboard(page):
    page.get_by_role("button", name="model", exact=True).focus()
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    values = numbers(column(page, 3))
    assert values == sorted(values)
    page.keyboard.press("Space")
    assert numbers(column(page, 3)) == values[::-1]
    assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"


def test_missing_values_come_last_either_way(page):
    heading = page.get_by_role("button", name="RMSE in sample")
    for _ in range(2):
        heading.click()
        texts = column(page, 4)
        assert texts[-1] == "–"
        assert "–" not in texts[:-1]


def test_rows_stay_whole(page):
    def rows() -> set[str]:
        return set(page.locator(".crf-sortable tbody tr").all_inner_texts())

    before = rows()
    page.get_by_role("button", name="ms a fit").click()
    assert rows() == before


def test_claims_are_a_table_for_everyone(page):
    page.set_viewport_size({"width": 400, "height": 900})
    table = page.get_by_role("table", name="Statements outside the tables")
    assert table.get_by_role("columnheader").all_inner_texts() == ["claim", "paper", "ours", "verdict", "why"]
    assert table.get_by_role("rowheader").count() == table.get_by_role("row").count() - 1 > 30


def test_a_folded_table_opens_by_keyboard(page):
    page.get_by_text("78 numbers").focus()
    page.keyboard.press("Enter")
    assert page.get_by_text("mean RMSE, SLR-ldl-1", exact=True).is_visible()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1100, 400])
def test_reads_well_everywhere(page, scheme, width):
    page.emulate_media(color_scheme=scheme)
    page.set_viewport_size({"width": width, "height": 900})
    settled(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    ink = page.evaluate("getComputedStyle(document.querySelector('figure svg')).fill")
    assert ink == ("rgb(0, 0, 0)" if scheme == "light" else "rgb(255, 255, 255)")
    screenshot(page, f"report-{scheme}-{width}", "body")
