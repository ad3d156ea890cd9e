"""Run every notebook from a fresh kernel and store its outputs, so that what is stored is what the code gives."""

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

from crfbench.files import write_atomically

NOTEBOOKS = Path(__file__).resolve().parent.parent / "notebooks"


def execute(path: Path) -> None:
    """Run one notebook in place; a failing cell leaves the file as it was."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": path.parent}}
    ).execute()
    # Widget state repeats the widget's code and data; times and versions change with every run.
    notebook.metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
    nbformat.validate(notebook)
    write_atomically(path, (nbformat.writes(notebook) + "\n").encode())


if __name__ == "__main__":
    for notebook_path in map(Path, sys.argv[1:]) if sys.argv[1:] else sorted(NOTEBOOKS.glob("*.ipynb")):
        execute(notebook_path)
        print(f"{notebook_path.name}: {notebook_path.stat().st_size / 1024:.0f} KB")
