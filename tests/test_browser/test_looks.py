"""Every widget in one notebook, as it looks by light, by dark and in a narrow window."""

from collections.abc import Callable
from typing import NamedTuple

import pytest

from .looks import colours, overflowing, picture, screenshot, settled, switch_theme

pytestmark = [pytest.mark.browser, pytest.mark.slow]

FIRST = """import numpy as np
from crfbench import Gamma, load_history, load_responses
from crfbench.paper import load_recorded
from crfbench.widgets import *
opencrf = load_responses("opencrf")"""
WIDGETS = {
    "calibration": "CalibrationExplorer()",
    "labeller": """pixels = np.linspace(0, 255, 600 * 900 * 3).astype("u1").reshape(600, 900, 3)
labeller = ChartLabeller({"chart": pixels})
labeller.labels = {"chart": [(0.2, 0.2), (1.0, 0.1), (1.0, 0.9), (0.1, 0.8)]}
labeller""",
    "latent": """latent = LatentExplorer(["SLR-ldl-3", "SLR-ldl-1"], opencrf)
latent.latent = (0.5, -1.0, 1.0)
latent""",
    "model": """names = ["camera with a rather long name (red channel)", "film"]
model = ModelExplorer(names, opencrf.curves[:2], [Gamma("forward")])
model.fit()
model""",
    "player": """histories = {name: load_history(name.lower()) for name in ("LDL", "AUC", "AAE", "VAE", "baseline")}
player = EpochPlayer(histories)
player.epoch = 500
player""",
    "search": 'SearchExplorer(load_recorded("search_dorf")[0])',
    "training": "TrainingPanel(player, opencrf)",
}
# What draws one curve in blue, which is another blue by dark.
BLUE = ("calibration", "labeller", "latent", "model")
# Half of a corner at the edge, and the numbers, are cut; titles end in an ellipsis.
CUT = ("crf-stage", "crf-plot", "crf-corner", "crf-title")


class Seen(NamedTuple):
    """What each widget showed: a picture, and which blues are in it, by theme; what is too wide in a narrow window."""

    pictures: dict[str, dict[str, str]]
    blues: dict[str, dict[str, dict[str, bool]]]
    overflow: dict[str, list[str]]


@pytest.fixture(scope="module")
def seen(open_notebook: Callable) -> Seen:
    page = open_notebook("looks.ipynb", [FIRST, *WIDGETS.values()])
    page.set_viewport_size({"width": 1100, "height": 8000})  # JupyterLab leaves out what is far from the window
    page.wait_for_function("(n) => document.querySelectorAll('.jp-CodeCell .crf').length === n", arg=len(WIDGETS))
    page.evaluate(
        "(names) => names.forEach((name, i) => (document.querySelectorAll('.jp-CodeCell')[i + 1].id = name))",
        list(WIDGETS),
    )
    page.get_by_role("button", name="corner 2 of 4").focus()  # shows the loupe
    settled(page)
    drawn = [name for name in WIDGETS if page.locator(f"#{name} canvas").count()]
    pictures, blues = {}, {}
    for theme in ("Light", "Dark"):
        if theme == "Dark":
            switch_theme(page, "JupyterLab Dark", pictures["Light"]["calibration"])
        pictures[theme] = {name: picture(page, f"#{name}") for name in drawn}
        blues[theme] = {name: colours(page, f"#{name}") for name in BLUE}
        for name in WIDGETS:
            screenshot(page, f"{name}-{theme.lower()}", f"#{name}")
    switch_theme(page, "JupyterLab Light", pictures["Dark"]["calibration"])
    page.set_viewport_size({"width": 400, "height": 12000})
    page.wait_for_function(
        "() => [...document.querySelectorAll('.crf canvas')].every((canvas) => canvas.clientWidth < 340)"
    )
    page.get_by_role("button", name="corner 2 of 4").focus()
    settled(page)
    for name in WIDGETS:
        screenshot(page, f"{name}-narrow", f"#{name}")
    return Seen(pictures, blues, {name: overflowing(page, f"#{name}") for name in WIDGETS})


@pytest.mark.parametrize("name", WIDGETS)
def test_colours_follow_the_theme(seen: Seen, name: str) -> None:
    light, dark = (seen.pictures[theme].get(name) for theme in ("Light", "Dark"))
    assert (light == dark) == (name == "training"), "which alone has no canvas"
    if name in BLUE:
        assert seen.blues["Light"][name] == {"#0072B2": True, "#56B4E9": False}
        assert seen.blues["Dark"][name] == {"#0072B2": False, "#56B4E9": True}


@pytest.mark.parametrize("name", WIDGETS)
def test_fits_a_narrow_window(seen: Seen, name: str) -> None:
    assert [node for node in seen.overflow[name] if not any(cut in node for cut in CUT)] == []
