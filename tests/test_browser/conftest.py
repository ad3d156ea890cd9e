"""Real Chromium against a real JupyterLab, both started here and ended here by their own process."""

import os
from collections.abc import Callable, Iterator

import pytest

from benchmarks.jupyter_page import CHROMIUM_OPTIONS, KERNEL, Lab, find_chromium, notebook_text, running_lab

from .looks import PATIENCE


@pytest.fixture(scope="session")
def chromium_path() -> str:
    """Find Chromium; without one the browser tests are skipped, or fail where CRFBENCH_REQUIRE_BROWSER is set."""
    if found := find_chromium():
        return found
    reason = "no Chromium found; install it or set CRFBENCH_CHROMIUM"
    (pytest.fail if os.environ.get("CRFBENCH_REQUIRE_BROWSER") else pytest.skip)(reason)


# Playwright keeps an event loop running, which later tests must not find: hence "package", not "session".
@pytest.fixture(scope="package")
def new_context(chromium_path: str) -> Iterator[Callable]:
    """Return a function that opens a context of Chromium with Playwright's options, and waits for what is slow."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=chromium_path, args=CHROMIUM_OPTIONS)

        def opened(**options: object):
            context = chromium.new_context(**options)
            context.set_default_timeout(1000 * PATIENCE)
            return context

        yield opened
        chromium.close()


@pytest.fixture(scope="package")
def lab(chromium_path: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with running_lab(tmp_path_factory.mktemp("jupyter"), tmp_path_factory.mktemp("notebooks")) as running:
        yield running


@pytest.fixture(scope="module")
def open_notebook(new_context: Callable, lab: Lab) -> Iterator[Callable]:
    """Open a notebook of these cells, run it all, and return the page; ``width`` is the window's."""
    contexts = []

    def opened(name: str, cells: list[str], width: int = 1100):
        (lab.folder / name).write_text(notebook_text(cells), encoding="utf-8")
        contexts.append(new_context(viewport={"width": width, "height": 900}))
        page = contexts[-1].new_page()
        page.goto(lab.page(name))
        page.wait_for_selector(".jp-CodeCell")
        page.wait_for_function(f"() => {KERNEL}?.status === 'idle'")
        page.evaluate("jupyterapp.commands.execute('notebook:run-all-cells')")
        return page

    yield opened
    for context in contexts:
        context.close()


@pytest.fixture(scope="session")
def run_python() -> Callable:
    """Return a function that runs code in the page's kernel and gives what it prints; an exception fails the test."""

    def run(page, code: str) -> str:
        return page.evaluate(
            """async (code) => {
                const future = KERNEL.requestExecute({ code });
                let text = "";
                let raised = "";
                future.onIOPub = ({ content }) => {
                    text += content.text ?? "";
                    raised += content.traceback?.join("\\n") ?? "";
                };
                await future.done;
                if (raised) throw new Error(raised);
                return text;
            }""".replace("KERNEL", KERNEL),
            code,
        )

    return run
