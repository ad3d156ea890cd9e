"""Notebooks are tests however pytest is called: from any folder, with any options of nbval, over several workers."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOKS = ROOT / "notebooks"
SHORT = "2-latent-slider.ipynb"
NAMED = ("--nbval", "--nbval-kernel-name=python3")


def collected(folder: Path, *options: str) -> str:
    command = [sys.executable, "-m", "pytest", "-q", "--color=no", *options]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    return done.stdout


@pytest.mark.slow
def test_without_a_path_notebooks_are_collected_beside_the_tests():
    found = collected(ROOT, "--nbval", "--collect-only")
    assert all(f"notebooks/{path.name}::Cell 0" in found for path in NOTEBOOKS.glob("*.ipynb"))
    assert "tests/test_metrics.py::" in found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("folder", "options"),
    [
        (ROOT, ("--nbval", f"notebooks/{SHORT}")),
        (ROOT, ("--nbval-lax", f"notebooks/{SHORT}")),
        (ROOT, ("--nbval", "-n", "2", "notebooks/1-response-curves.ipynb", f"notebooks/{SHORT}")),
        (NOTEBOOKS, ("--nbval", SHORT)),
        (ROOT.parent, (*NAMED, str(NOTEBOOKS.relative_to(ROOT.parent) / SHORT))),
    ],
    ids=["root", "lax", "workers", "notebooks", "parent and kernel"],
)
def test_a_notebook_passes_as_people_call_pytest(folder, options):
    assert " passed" in collected(folder, *options)


@pytest.mark.slow
def test_copied_notebooks_pass_without_the_project(tmp_path):
    for path in NOTEBOOKS.glob("[28]-*.ipynb"):
        shutil.copy(path, tmp_path)
    assert " passed" in collected(tmp_path, "--nbval")
