"""Importing crfbench is light, what it promises is there, and the notebooks need nothing else."""

import ast
import json
import subprocess
import sys
from importlib import import_module

import nbformat
import pytest

import crfbench
from crfbench.files import bundled

HEAVY = ("torch", "cv2", "rawpy", "matplotlib", "pandas", "scipy", "IPython", "ipywidgets")


ROOMS = ("crfbench.camera", "crfbench.paper", "crfbench.plots", "crfbench.widgets")


def modules_after(code):
    run = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport json, sys\nprint(json.dumps(sorted(sys.modules)))"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(run.stdout.splitlines()[-1])


def test_import_leaves_heavy_modules_out():
    loaded = modules_after("import crfbench")
    assert not set(HEAVY) & set(loaded)


def test_fitting_a_model_needs_no_torch_opencv_or_matplotlib():
    loaded = modules_after("import crfbench; crfbench.Gamma().fit(crfbench.Gamma().decode([[2.0]]))")
    assert not {"torch", "cv2", "rawpy", "matplotlib"} & set(loaded)


def test_a_widget_loads_no_room_beside_its_own():
    loaded = modules_after("from crfbench.widgets import LatentExplorer")
    assert not {"torch", "cv2", "rawpy", "matplotlib"} & set(loaded)
    assert [name for name in loaded if name.startswith(("crfbench.camera", "crfbench.paper", "crfbench.search"))] == []


@pytest.mark.parametrize("package", ["crfbench", "crfbench.paper", "crfbench.search", "crfbench.widgets"])
def test_every_public_name_is_there(package):
    module = import_module(package)
    assert all(getattr(module, name) is not None for name in module.__all__)
    with pytest.raises(
        AttributeError, match=f"module '{package}' has no attribute 'Gama'; it has .*{module.__all__[-1]}"
    ):
        module.Gama  # noqa: B018


def test_the_door_lists_what_it_has():
    assert set(crfbench.__all__) <= set(dir(crfbench))


@pytest.mark.parametrize("path", sorted(bundled("notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_import_from_the_door_and_its_rooms_only(path):
    cells = [cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    code = "\n".join(line for cell in cells for line in cell.splitlines() if not line.startswith(("%", "!")))
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            assert [name.name for name in node.names if name.name.startswith("crfbench.")] == []
        if isinstance(node, ast.ImportFrom) and node.module.startswith("crfbench."):
            assert node.module in ROOMS, f"from {node.module} import {node.names[0].name}"
