"""Where no kernel runs: what HTML made from a stored notebook shows instead of each widget."""

import base64
import re
from collections.abc import Callable
from functools import cache

import cv2
import nbformat
import numpy as np
import pandas as pd
import pytest
from nbconvert import HTMLExporter

from crfbench import Gamma, load_history, load_responses, widgets
from crfbench.curves import GRID
from crfbench.plots import plt
from crfbench.widgets.assets import StoredWidget

GREY = np.full((400, 600, 3), 90, np.uint8)
CORNERS = [(0.1, 0.1), (0.9, 0.1), (0.9, 0.9), (0.1, 0.9)]


def labeller() -> widgets.ChartLabeller:
    made = widgets.ChartLabeller({"chart": GREY})
    made.labels = {"chart": CORNERS}
    return made


def search_explorer() -> widgets.SearchExplorer:
    columns = {"h1": [10, 50], "h2": 0, "h3": 0, "mse": [2.0, 1.0], "mse_sd": 0.1, "rmse": 1.0, "complexity": [10, 50]}
    return widgets.SearchExplorer(pd.DataFrame({**columns, "rank": [2, 1], "epochs": 9}), m=2)


def player() -> widgets.EpochPlayer:
    return widgets.EpochPlayer({"LDL": load_history("ldl")})


MAKE: dict[str, Callable[[], StoredWidget]] = {
    "BeforeAfter": lambda: widgets.BeforeAfter(GREY / 255, GRID**2),
    "CalibrationExplorer": widgets.CalibrationExplorer,
    "ChartLabeller": labeller,
    "DotPlot": lambda: widgets.DotPlot(
        pd.DataFrame({"a": [1, 2], "b": [3, 4], "c": "all", "d": ["A<B", "C"]}), *"abcd"
    ),
    "EpochPlayer": player,
    "LatentExplorer": lambda: widgets.LatentExplorer("SLR-ldl-1"),
    "ModelExplorer": lambda: widgets.ModelExplorer(["a", "b"], [GRID**2, GRID**0.5], [Gamma()]),
    "SearchExplorer": search_explorer,
    "SortableTable": lambda: widgets.SortableTable(pd.DataFrame({"model": ["A<B", "C"], "rmse": [0.25, 1]}), "Fits"),
    "TrainingPanel": lambda: widgets.TrainingPanel(player(), load_responses("opencrf")),
}


@cache
def bundle(name: str) -> dict[str, str]:
    return MAKE[name]()._repr_mimebundle_()[0]


def as_html(name: str) -> str:
    """Store the widget as the result of a cell, as Jupyter does, and convert the notebook without running it."""
    result = nbformat.v4.new_output("execute_result", bundle(name), execution_count=1)
    cell = nbformat.v4.new_code_cell("widget", outputs=[result], execution_count=1)
    notebook = nbformat.v4.new_notebook(cells=[cell])
    text = nbformat.writes(notebook)
    html, _ = HTMLExporter().from_notebook_node(nbformat.reads(text, as_version=4))
    return html[html.index("jp-OutputArea-output") :]


def test_every_widget_is_here() -> None:
    assert list(MAKE) == widgets.__all__


@pytest.mark.parametrize("name", MAKE)
def test_a_stored_notebook_shows_a_picture_a_table_or_a_page(name: str) -> None:
    html = as_html(name)
    shown = re.findall(r'<img[^>]*src="data:image/(?:png|jpeg);base64,[/\w]|<table>|<iframe srcdoc="&lt;!doctype', html)
    assert len(shown) == 1
    assert '"application/vnd.jupyter.widget-view+json"' not in html


@pytest.mark.parametrize("name", MAKE)
def test_what_is_stored_is_the_same_every_time(name: str) -> None:
    before = plt.get_fignums()
    data, _ = MAKE[name]()._repr_mimebundle_()
    assert {kind: text for kind, text in data.items() if kind.startswith("text")} == {
        kind: text for kind, text in bundle(name).items() if kind.startswith("text")
    }
    assert plt.get_fignums() == before, "a figure left open would be shown beside the widget"


def test_a_table_holds_the_cells_in_order_as_text() -> None:
    cells = re.findall("<(t[hd])>(.*?)</t[hd]>", bundle("SortableTable")["text/html"])
    words = [("th", "model"), ("th", "rmse"), ("td", "A&lt;B"), ("td", "0.25"), ("td", "C"), ("td", "1.0")]
    assert cells == words


def test_the_photograph_is_small_and_has_the_outlines() -> None:
    jpeg = base64.b64decode(bundle("ChartLabeller")["image/jpeg"])
    pixels = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert max(pixels.shape) == 320
    left, top = (np.flatnonzero((pixels > 150).any(axis=axis))[0] for axis in (0, 1))
    assert (left / pixels.shape[1], top / pixels.shape[0]) == pytest.approx((0.1, 0.1), abs=0.02)
