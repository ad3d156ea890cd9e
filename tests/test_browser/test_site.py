"""The site as its reader meets it: from a plain file server, with nothing else in reach."""

import threading
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from .looks import TWO_FRAMES, picture, screenshot, settled

pytestmark = [pytest.mark.browser, pytest.mark.slow]

SLIDER = "notebooks/2-latent-slider.html"


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format, *args):
        pass


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site))) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


@pytest.fixture
def page(new_context: Callable, address: str) -> Iterator:
    """Open the site's index; whatever a page asks of other servers, or says in the console, fails the test."""
    context = new_context(base_url=address, viewport={"width": 1100, "height": 900})
    troubles: list[str] = []

    def gate(route) -> None:
        if route.request.url.startswith(address):
            route.continue_()
        else:
            troubles.append(route.request.url)
            route.abort()

    context.route(lambda url: not url.startswith(("data:", "blob:")), gate)
    opened = context.new_page()
    opened.on("console", lambda message: message.type in {"error", "warning"} and troubles.append(message.text))
    opened.on("pageerror", lambda error: troubles.append(str(error)))
    opened.goto("index.html")
    yield opened
    context.close()
    assert troubles == []


def test_from_the_index_to_a_slider_that_moves(page):
    page.get_by_role("link", name="The latent slider").click()
    slider = page.get_by_role("slider", name="latent z")
    slider.wait_for()
    settled(page)
    before = picture(page)
    slider.press("ArrowRight")
    settled(page)
    assert picture(page) != before
    page.get_by_role("link", name="crfbench", exact=True).click()
    assert page.title() == "crfbench"


@pytest.mark.parametrize("name", ["notebooks/3-latent-distribution", "notebooks/4-architecture-search"])
def test_the_other_widgets_draw(page, name):
    page.goto(f"{name}.html")
    page.locator(".crf canvas").first.wait_for()
    settled(page)
    assert page.get_by_role("slider").count() > 0


def test_the_reference_is_searched_without_a_network(page):
    page.get_by_role("link", name="API reference").click()
    page.get_by_role("link", name="crfbench.models.gamma", exact=True).click()
    page.get_by_role("searchbox").fill("calibrate")
    page.locator(".search-result").first.wait_for()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1100, 400])
@pytest.mark.parametrize(
    "name", ["index.html", SLIDER, "own-model.html", "floors.html", "api/crfbench/models/base.html"]
)
def test_reads_well_everywhere(page, name, width, scheme):
    page.emulate_media(color_scheme=scheme)
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(name)
    page.wait_for_load_state()
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    screenshot(page, f"site-{Path(name).stem}-{scheme}-{width}", "body")


def test_no_page_scrolls_sideways_at_200_and_400_percent(page, site: Path):
    names = sorted(str(path.relative_to(site)) for path in site.rglob("*.html"))
    assert len(names) > 100
    pages, reference = ([name for name in names if name.startswith("api/") == made] for made in (False, True))
    wide = []
    for name in pages + reference[::6]:  # of the reference, one template makes all
        page.goto(name)
        if page.locator("script[type='application/json']").count():
            page.locator(".crf").first.wait_for()
        for width in (640, 320):
            page.set_viewport_size({"width": width, "height": 900})
            page.evaluate(TWO_FRAMES)  # in which canvases and what lies over them take the new width
            if page.evaluate("document.documentElement.scrollWidth") > width:
                wide.append((name, width))
    assert wide == []


def test_drawings_do_not_glare_on_a_dark_page(page):
    filters = "[...document.images].map((image) => [image.className, getComputedStyle(image).filter])"
    for scheme, turned in (("dark", True), ("light", False)):
        page.emulate_media(color_scheme=scheme)
        page.goto("notebooks/7-your-camera.html")
        seen = page.evaluate(filters)
        assert {kind for kind, _ in seen} == {"", "as-it-is"}
        assert all(("invert" in style) == (turned and kind == "") for kind, style in seen)
