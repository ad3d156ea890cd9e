"""Real Chromium against a real JupyterLab, both started here and ended here by their own process."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

START_SECONDS = 60
# In the page's JavaScript, once the notebook is there.
KERNEL = "jupyterapp.shell.currentWidget?.sessionContext?.session?.kernel"
# Jupyter's first-run questions lie over the page, and answering them would ask the network.
NOTIFICATIONS = {"fetchNews": "false", "checkForUpdates": False}


@dataclass(frozen=True)
class Lab:
    """A running JupyterLab."""

    url: str
    token: str
    folder: Path

    def page(self, notebook: str) -> str:
        """Return the address that shows one notebook and little else."""
        return f"{self.url}doc/tree/{notebook}?token={self.token}"


@pytest.fixture(scope="session")
def chromium_path() -> str:
    """Find Chromium; without one the browser tests are skipped, or fail where CRFBENCH_REQUIRE_BROWSER is set."""
    found = os.environ.get("CRFBENCH_CHROMIUM") or next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
    )
    if found:
        return found
    reason = "no Chromium found; install it or set CRFBENCH_CHROMIUM"
    (pytest.fail if os.environ.get("CRFBENCH_REQUIRE_BROWSER") else pytest.skip)(reason)


# Playwright keeps an event loop running, which later tests must not find: hence "package", not "session".
@pytest.fixture(scope="package")
def browser(chromium_path: str) -> Iterator:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=chromium_path, args=["--no-sandbox", "--disable-gpu"])
        yield chromium
        chromium.close()


@pytest.fixture(scope="package")
def lab(chromium_path: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    home, folder = tmp_path_factory.mktemp("jupyter"), tmp_path_factory.mktemp("notebooks")
    with (home / "log").open("w") as log:
        process = subprocess.Popen(_command(folder), env=_environment(home), stdout=log, stderr=log)
    try:
        yield _wait_for_start(process, home, folder)
    finally:
        process.terminate()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def open_notebook(browser, lab: Lab) -> Iterator[Callable]:
    """Open a notebook of these cells, run it all, and return the page; ``width`` is the window's."""
    pages = []

    def opened(name: str, cells: list[str], width: int = 1100):
        (lab.folder / name).write_text(_notebook(cells), encoding="utf-8")
        page = browser.new_page(viewport={"width": width, "height": 900})
        pages.append(page)
        page.goto(lab.page(name))
        page.wait_for_selector(".jp-CodeCell", timeout=30_000)
        page.wait_for_function(
            "() => jupyterapp.shell.currentWidget?.sessionContext?.session?.kernel?.status === 'idle'"
        )
        page.evaluate("jupyterapp.commands.execute('notebook:run-all-cells')")
        return page

    yield opened
    for page in pages:
        page.close()


@pytest.fixture(scope="session")
def run_python() -> Callable:
    """Return a function that runs code in the page's kernel and gives what it prints."""

    def run(page, code: str) -> str:
        return page.evaluate(
            """async (code) => {
                const future = KERNEL.requestExecute({ code });
                let text = "";
                future.onIOPub = ({ content }) => (text += content.text ?? content.evalue ?? "");
                await future.done;
                return text;
            }""".replace("KERNEL", KERNEL),
            code,
        )

    return run


def _command(folder: Path) -> list[str]:
    options = {
        "ServerApp.ip": "127.0.0.1",
        "ServerApp.port": 0,
        "ServerApp.root_dir": folder,
        "ServerApp.allow_root": True,
        "LabApp.expose_app_in_browser": True,
    }
    return [sys.executable, "-m", "jupyterlab", "--no-browser", *(f"--{key}={value}" for key, value in options.items())]


def _environment(home: Path) -> dict[str, str]:
    """Point everything Jupyter reads and writes about a user to an empty home."""
    folders = {"JUPYTER_CONFIG_DIR": "config", "JUPYTER_DATA_DIR": "data", "JUPYTER_RUNTIME_DIR": "runtime"}
    folders |= {"JUPYTERLAB_SETTINGS_DIR": "settings", "JUPYTERLAB_WORKSPACES_DIR": "spaces", "IPYTHONDIR": "ipython"}
    settings = home / "settings" / "@jupyterlab" / "apputils-extension" / "notification.jupyterlab-settings"
    settings.parent.mkdir(parents=True)
    settings.write_text(json.dumps(NOTIFICATIONS), encoding="utf-8")
    return os.environ | {name: str(home / folder) for name, folder in folders.items()}


def _wait_for_start(process: subprocess.Popen, home: Path, folder: Path) -> Lab:
    """Return when the server has written where it listens, which it does once it does."""
    record = home / "runtime" / f"jpserver-{process.pid}.json"
    end = time.monotonic() + START_SECONDS
    while time.monotonic() < end and process.poll() is None:
        try:
            server = json.loads(record.read_text(encoding="utf-8"))
        except (FileNotFoundError, json.JSONDecodeError):  # not there, or half written
            time.sleep(0.05)
        else:
            return Lab(server["url"], server["token"], folder)
    pytest.fail(f"JupyterLab did not start:\n{(home / 'log').read_text(encoding='utf-8')[-2000:]}")


def _notebook(cells: list[str]) -> str:
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    code = [
        {"cell_type": "code", "id": f"c{i}", "metadata": {}, "source": cell, "outputs": [], "execution_count": None}
        for i, cell in enumerate(cells)
    ]
    return json.dumps({"cells": code, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5})
