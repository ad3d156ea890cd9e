"""Every bundled notebook, opened as a user opens it, runs to its end without an error and shows its figures."""

import os
import shutil
from pathlib import Path

import pytest

from benchmarks.jupyter_page import KERNEL
from crfbench.files import bundled

pytestmark = [pytest.mark.browser, pytest.mark.slow]
NOTEBOOKS = sorted(bundled("notebooks").glob("*.ipynb"))
# Every code cell that is not folded has a number, none waits for its turn, and the kernel has nothing to do.
DONE = f"""() => {{
    const numbers = '.jp-CodeCell .jp-InputPrompt:not(.jp-Placeholder-prompt)';
    const prompts = [...document.querySelectorAll(numbers)].map((p) => p.textContent);
    return {KERNEL}?.status === 'idle' && prompts.every((p) => /\\[\\d+\\]/.test(p));
}}"""


@pytest.fixture
def page(new_context):
    context = new_context(viewport={"width": 1200, "height": 1000})
    yield context.new_page()
    context.close()


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_runs_from_a_fresh_kernel(notebook, lab, page):
    shutil.copyfile(notebook, lab.folder / notebook.name)
    page.goto(lab.page(notebook.name))
    page.wait_for_selector(".jp-CodeCell")
    page.wait_for_function(f"() => {KERNEL}?.status === 'idle'")
    page.evaluate("jupyterapp.commands.execute('notebook:clear-all-cell-outputs')")
    page.evaluate("jupyterapp.commands.execute('notebook:run-all-cells')")
    page.wait_for_function(DONE)
    assert (
        page.locator(
            "[data-mime-type='application/vnd.jupyter.error'], [data-mime-type='application/vnd.jupyter.stderr']"
        ).count()
        == 0
    )
    assert page.locator(".jp-OutputArea img, .jp-OutputArea canvas").count() >= 1
    if folder := os.environ.get("CRFBENCH_SHOTS"):
        Path(folder).mkdir(parents=True, exist_ok=True)
        whole = page.evaluate("document.querySelector('.jp-WindowedPanel-inner, .jp-Notebook')?.scrollHeight ?? 1000")
        page.set_viewport_size({"width": 1200, "height": min(int(whole) + 200, 9000)})
        page.screenshot(path=Path(folder) / f"notebook-{notebook.stem}.png")
