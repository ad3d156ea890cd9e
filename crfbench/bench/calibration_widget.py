"""From a click to the picture of a new calibration: CalibrationExplorer against `interact` with inline matplotlib.

Both run in the same JupyterLab and the same real Chromium, one after the other; each click takes a patch out of
the same calibration or puts it back. Run it with: python -m crfbench.bench.calibration_widget. The ratio is the
claim; the milliseconds are of this machine and this minute. A click begins at the release of the button; see slider.py.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

from crfbench.bench.jupyter_page import CHROMIUM_OPTIONS, Lab, find_chromium, running_lab
from crfbench.bench.slider import Variant, milliseconds, open_variant
from crfbench.bench.timing import Row, row, skipped

OURS = """from crfbench.widgets import CalibrationExplorer
explorer = CalibrationExplorer()
explorer.model = {model!r}
explorer"""
INTERACT = """%matplotlib inline
import matplotlib.pyplot as plt
from ipywidgets import interact
from crfbench.calibration import calibrate, decode_table
from crfbench.models.ready import load_model
from crfbench.plots import plot_calibration
from crfbench.widgets import CalibrationExplorer
model = load_model("SLR-ldl", 1)
table = decode_table(model)
explorer = CalibrationExplorer()
explorer.patches = (19, 21, 22, 24)
seen = explorer.result.observations
@interact(patch_22=False)
def show(patch_22):
    plot_calibration(calibrate(model, seen.take([0, 1, 2, 3] if patch_22 else [0, 1, 3]), "posterior", table=table))
    plt.show()"""

VARIANTS = (
    Variant("CalibrationExplorer, SLR-ldl(1)", OURS.format(model="SLR-ldl(1)"), ".crf-chart button:nth-child(22)"),
    Variant("CalibrationExplorer, EMoR(3)", OURS.format(model="EMoR(3)"), ".crf-chart button:nth-child(22)"),
    Variant("interact + inline matplotlib", INTERACT, ".jp-OutputArea input[type=checkbox]"),
)


def click(page: Page, _step: int) -> None:
    """Press and release where the mouse is."""
    page.mouse.down()
    page.mouse.up()


def measure(page: Page, lab: Lab, variant: Variant, clicks: int) -> float:
    """Print a row and return the median."""
    open_variant(page, lab, variant).hover()
    times = milliseconds(page, click, clicks)
    print(f"{variant.name:<34}median {np.median(times):6.1f}   p95 {np.percentile(times, 95):6.1f}")
    return float(np.median(times))


def main() -> None:
    """Print median and 95th percentile of all, and how many times faster ours are."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clicks", type=int, default=60)
    *ours, theirs = compare(parser.parse_args().clicks)
    print("ratio of the medians:", ", ".join(f"{theirs / own:.1f} x" for own in ours))


def rows(clicks: int = 20) -> list[Row]:
    """Time clicks; the medians."""
    if find_chromium() is None:
        return [skipped("click on a patch", "Chromium is absent")]
    *ours, theirs = compare(clicks)
    note = f"median of {clicks} clicks, from release to picture in Chromium"
    return [
        row(f"click on a patch, {variant.name}", own / 1e3, VARIANTS[-1].name, theirs / 1e3, note)
        for variant, own in zip(VARIANTS, ours, strict=False)
    ]


def compare(clicks: int) -> list[float]:
    """Measure all variants in one browser; return the median milliseconds of each."""
    with tempfile.TemporaryDirectory() as home, running_lab(Path(home), Path(home)) as lab, sync_playwright() as run:
        browser = run.chromium.launch(executable_path=find_chromium(), args=CHROMIUM_OPTIONS)
        print(f"{clicks} clicks each, Chromium {browser.version}, milliseconds")
        pages = [browser.new_page(viewport={"width": 1200, "height": 900}) for _ in VARIANTS]
        medians = [measure(page, lab, variant, clicks) for page, variant in zip(pages, VARIANTS, strict=True)]
        browser.close()
    return medians


if __name__ == "__main__":
    main()
