"""Importing crfbench is light, and what it promises is there."""

import json
import subprocess
import sys

import pytest

import crfbench

HEAVY = ("torch", "cv2", "rawpy", "matplotlib", "pandas", "scipy", "IPython", "ipywidgets")


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


def test_every_public_name_is_there():
    assert set(crfbench.__all__) <= set(dir(crfbench))
    assert all(getattr(crfbench, name) is not None for name in crfbench.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'Gama'; it has"):
        crfbench.Gama  # noqa: B018
