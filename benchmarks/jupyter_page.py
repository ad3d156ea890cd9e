"""A real JupyterLab, started here and ended here by its own process, for whatever drives it in a real Chromium."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

SILENT_SECONDS = 120
CHROMIUM_OPTIONS = ["--no-sandbox", "--disable-gpu"]
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


def find_chromium() -> str | None:
    """Return the path of Chromium, from CRFBENCH_CHROMIUM or PATH."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return os.environ.get("CRFBENCH_CHROMIUM") or next(filter(None, map(shutil.which, names)), None)


@contextmanager
def running_lab(home: Path, folder: Path) -> Iterator[Lab]:
    """Run JupyterLab on `folder`, with `home` for all that Jupyter keeps about a user."""
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


def notebook_text(cells: Sequence[str]) -> str:
    """Return a notebook of these code cells, not yet run."""
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    empty: dict[str, object] = {"cell_type": "code", "metadata": {}, "outputs": [], "execution_count": None}
    code = [{**empty, "id": f"c{i}", "source": cell} for i, cell in enumerate(cells)]
    return json.dumps({"cells": code, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5})


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


def _wait_for_start(process: subprocess.Popen[bytes], home: Path, folder: Path) -> Lab:
    """Return when the server has written where it listens; give up when it ends, or writes no log for two minutes."""
    record, log = home / "runtime" / f"jpserver-{process.pid}.json", home / "log"
    while process.poll() is None and time.time() - log.stat().st_mtime < SILENT_SECONDS:
        try:
            server = json.loads(record.read_text(encoding="utf-8"))
        except (FileNotFoundError, json.JSONDecodeError):  # not there, or half written
            time.sleep(0.05)
        else:
            return Lab(server["url"], server["token"], folder)
    raise RuntimeError(f"JupyterLab did not start:\n{log.read_text(encoding='utf-8')[-2000:]}")
