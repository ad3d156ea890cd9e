"""Open the notebooks in JupyterLab, in a folder of the user's."""

import os
import shutil
from importlib.metadata import requires, version
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
from packaging.requirements import Requirement

from crfbench.datasets import registry
from crfbench.files import bundled

if TYPE_CHECKING:
    from IPython.display import HTML

START = "0-start-here.ipynb"


def data_table() -> pd.DataFrame:
    """Return every known data set: key, what it is, licence, and whether it is here."""
    return pd.DataFrame(registry.status()).drop(columns="where")


def environment_table() -> pd.DataFrame:
    """Return the packages that crfbench needs: the version asked for, the version here, and whether it fits."""
    rows = []
    for line in requires("crfbench") or []:
        requirement = Requirement(line)
        if requirement.marker is None:  # the others belong to extras
            here = version(requirement.name)
            rows.append((requirement.name, str(requirement.specifier), here, requirement.specifier.contains(here)))
    return pd.DataFrame(rows, columns=["package", "wanted", "here", "fits"])


def show(table: pd.DataFrame) -> "HTML":
    """Return a table of words for a notebook: on the left of their columns, without row numbers."""
    from IPython.display import HTML
    from pandas.io.formats.style import Styler

    left = [{"selector": "th, td", "props": "text-align: left"}]
    return HTML(Styler(table, uuid="words", cell_ids=False).hide().set_table_styles(left).to_html())


def copy_notebooks(folder: Path) -> list[Path]:
    """Copy the bundled notebooks into `folder`, leave those already there as they are, and return the new ones."""
    folder.mkdir(parents=True, exist_ok=True)
    copied = []
    for notebook in sorted(bundled("notebooks").glob("*.ipynb")):
        target = folder / notebook.name
        if not target.exists():
            shutil.copyfile(notebook, target)
            copied.append(target)
    return copied


def open_lab(folder: Path, extra: list[str]) -> None:
    """Run JupyterLab on `folder`, with the `extra` options of ``jupyter lab``.

    It runs in this process, so whatever ends that ends JupyterLab, which listens on this machine only, keeps its token
    and prints the address with it.
    """
    from jupyterlab.labapp import main

    options = ["--ServerApp.ip=127.0.0.1", f"--ServerApp.root_dir={folder}"]
    options.append(f"--LabApp.default_url=/lab/tree/{START}")  # so that the address printed leads there too
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        options.append("--allow-root")  # containers run as root; the server still listens on this machine only
    main([*options, *extra])
