"""The Python side of LatentExplorer and its exported page; tests/test_browser drives both on a page."""

import json
import re
import subprocess
import sys
import threading
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import ipywidgets
import numpy as np
import pytest

from crfbench.curves import GRID
from crfbench.datasets import Responses, load_opencrf
from crfbench.errors import InputError
from crfbench.models import ModelKey, load_model, pretrained_models
from crfbench.models.slr import SLR
from crfbench.widgets import LatentExplorer
from crfbench.widgets.page import page

OPENCRF = load_opencrf()


def model(constraint: str = "", data: str = "dorf", **options) -> SLR:
    slr = SLR(hidden=(6, 4), **{"direction": "inverse", **options})
    slr.metadata_ = {"constraint": constraint, "data": data} if constraint else {}
    return slr


MODELS = {
    "SLR-ldl-1": model("ldl"),
    "SLR-ldl-1-forward": model("ldl", direction="forward"),
    "SLR-ldl-3": model("ldl", n_latent=3),
    "SLR-monotone-1": model("ldl", monotone=True),
    "SLR-open-1": model("ldl", "opencrf", monotone=True, seed=1),
}


@pytest.fixture
def explorer() -> LatentExplorer:
    return LatentExplorer(MODELS, OPENCRF)


def content(html: str) -> dict:
    """Return the page's JSON."""
    return json.loads(re.search(r'id="content">(.*?)</script>', html)[1])


def facets(explorer: LatentExplorer) -> dict[str, list[str]]:
    return {facet["title"]: facet["values"] for facet in explorer._choices["facets"]}


def test_starts_with_the_first_model_at_zero(explorer: LatentExplorer) -> None:
    assert explorer.model == "SLR-ldl-1"
    assert explorer.latent == 0.0


@pytest.mark.parametrize("name", MODELS)
def test_curve_is_the_decoded_latent(explorer: LatentExplorer, name: str) -> None:
    explorer.model = name
    explorer.latent = np.linspace(-1.5, 7, MODELS[name].n_params)
    np.testing.assert_array_equal(explorer.curve, MODELS[name].decode(np.atleast_1d(explorer.latent)))
    assert explorer.curve.shape == (1024,)


def test_one_latent_is_a_plain_number_and_several_are_a_tuple(explorer: LatentExplorer) -> None:
    for given in (-2, [-2], np.array([-2.0])):
        explorer.latent = given
        assert explorer.latent == -2.0
    explorer.model = "SLR-ldl-3"
    explorer.latent = [1, 2, 3]
    assert explorer.latent == (1.0, 2.0, 3.0)


def test_the_page_moves_the_latent_and_observers_hear_of_it(explorer: LatentExplorer) -> None:
    heard = []
    explorer.observe(lambda change: heard.append((change["name"], change["new"])), ["model", "latent"])
    explorer.set_state({"model": "SLR-ldl-3", "latent": [0.5, 0, -1], "_page_moves": [explorer._python_moves, 1]})
    assert (explorer.model, explorer.latent) == ("SLR-ldl-3", (0.5, 0.0, -1.0))
    assert sorted(heard) == [("latent", (0.5, 0.0, -1.0)), ("model", "SLR-ldl-3")]


def test_what_the_page_sent_before_python_spoke_is_refused(explorer: LatentExplorer) -> None:
    before = explorer._python_moves
    explorer.latent = -3
    explorer.set_state({"latent": 1, "_page_moves": [before, 1]})
    assert explorer.latent == -3.0
    explorer.set_state({"latent": 1, "_page_moves": [explorer._python_moves, 2]})
    assert explorer.latent == 1.0
    explorer.set_state({"latent": 2})  # of a linked slider, which knows nothing of moves
    assert explorer.latent == 2.0


def test_one_message_tells_the_page_all_that_a_move_of_its_own_may_have_changed(
    explorer: LatentExplorer, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = []
    monkeypatch.setattr(explorer, "_send", lambda message, buffers: told.append(message["state"]))
    # Meanwhile the page has chosen a model of three latents, which is refused: its latent must go back to one.
    explorer.model = "SLR-ldl-1-forward"
    assert told == [{"model": "SLR-ldl-1-forward", "latent": 0.0, "_python_moves": explorer._python_moves}]


def test_python_counts_its_move_while_another_thread_takes_one_of_the_page(explorer: LatentExplorer) -> None:
    before = explorer._python_moves
    taking, said = threading.Event(), threading.Event()

    def stay(_change: object) -> None:
        taking.set()
        said.wait(0.2)

    explorer.observe(stay, "latent")
    page = threading.Thread(target=explorer.set_state, args=({"latent": 1, "_page_moves": [before, 1]},))
    page.start()
    assert taking.wait(60)
    explorer.latent = -3
    said.set()
    page.join()
    assert (explorer.latent, explorer._python_moves) == (-3.0, before + 1)


def test_links_with_a_slider_go_both_ways(explorer: LatentExplorer) -> None:
    slider = ipywidgets.FloatSlider(min=-4, max=4)
    ipywidgets.link((slider, "value"), (explorer, "latent"))
    slider.value = 1.5
    assert explorer.latent == 1.5
    explorer.latent = -0.5
    assert slider.value == -0.5


def test_a_model_of_as_many_latents_keeps_them(explorer: LatentExplorer) -> None:
    explorer.latent = 1.25
    explorer.model = "SLR-open-1"
    assert (explorer.model, explorer.latent) == ("SLR-open-1", 1.25)
    explorer.model = "SLR-ldl-3"
    assert explorer.latent == (0.0, 0.0, 0.0)


def test_models_are_told_apart_by_their_metadata(explorer: LatentExplorer) -> None:
    assert facets(explorer) == {
        "Constraint": ["LDL"] * 5,
        "Latents": ["1", "1", "3", "1", "1"],
        "Decoder": ["plain", "plain", "plain", "monotone", "monotone"],
        "Direction": ["inverse", "forward", "inverse", "inverse", "inverse"],
        "Trained on": ["DoRF", "DoRF", "DoRF", "DoRF", "OpenCRF"],
    }


def test_models_with_equal_metadata_are_told_apart_by_name() -> None:
    seeds = LatentExplorer({"seed 0": model("aae"), "seed 1": model("aae", seed=1)})
    assert facets(seeds)["Name"] == ["seed 0", "seed 1"]


def test_a_sequence_is_named_by_metadata() -> None:
    models = [model("vae"), model("vae", n_latent=3), model("ldl", monotone=True, direction="forward"), model()]
    assert list(LatentExplorer(models).models) == [
        "SLR-vae-1",
        "SLR-vae-3",
        "SLR-monotone-1-forward",
        "SLR-untrained-1",
    ]


def test_models_are_found_by_name() -> None:
    named = LatentExplorer(["slr-LDL-1", ModelKey.parse("SLR-open-1-forward"), model("vae")])
    assert list(named.models) == ["SLR-ldl-1", "SLR-open-1-forward", "SLR-vae-1"]
    alone = LatentExplorer("SLR-ldl-3")
    np.testing.assert_array_equal(alone.curve, load_model("SLR-ldl-3").decode(np.zeros(3)))


@pytest.mark.parametrize("name", MODELS)
def test_weights_reach_the_page_whole(explorer: LatentExplorer, name: str) -> None:
    entry = next(entry for entry in explorer._choices["models"] if entry["name"] == name)
    numbers = np.frombuffer(entry["weights"], "<f4")
    assert entry["sizes"] == [MODELS[name].n_params, 4, 6, 1024 - MODELS[name].monotone]
    assert len(numbers) == sum((fan_in + 1) * fan_out for fan_in, fan_out in pairwise(entry["sizes"]))
    np.testing.assert_array_equal(numbers[-entry["sizes"][-1] :], MODELS[name].weights_["decoder.2.bias"])
    np.testing.assert_array_equal(np.frombuffer(entry["latents"], "<f4"), MODELS[name].weights_["latents"].ravel())


def test_measured_curves_reach_the_page_thinned(explorer: LatentExplorer) -> None:
    for direction, curves in explorer._choices["curves"].items():
        samples = np.frombuffer(curves["samples"], "<u2").reshape(len(OPENCRF), 94) / 65535
        np.testing.assert_allclose(samples, OPENCRF.in_direction(direction)[:, ::11], atol=1e-5)
        assert curves["names"] == list(OPENCRF.names)
    assert set(LatentExplorer([model()], OPENCRF)._choices["curves"]) == {"inverse"}
    assert LatentExplorer([model()])._choices["curves"] is None


@pytest.mark.parametrize("name", ["SLR-ldl-1", "SLR-ldl-1-forward"])
def test_csv(explorer: LatentExplorer, tmp_path: Path, name: str) -> None:
    explorer.model = name
    explorer.to_csv(tmp_path / "new" / "curve.csv")
    header, *rows = (tmp_path / "new" / "curve.csv").read_text().splitlines()
    table = np.array([row.split(",") for row in rows], dtype=float)
    columns = [GRID, explorer.curve] if name.endswith("forward") else [explorer.curve, GRID]
    assert header == "irradiance,brightness"
    np.testing.assert_allclose(table.T, columns, atol=1e-8)


@pytest.mark.parametrize("write", [LatentExplorer.to_csv, LatentExplorer.to_html])
def test_files_are_replaced_on_demand_only(explorer: LatentExplorer, tmp_path: Path, write: Callable) -> None:
    path = tmp_path / "file"
    path.write_text("mine")
    with pytest.raises(InputError, match=r"file exists already; use another path or overwrite=True"):
        write(explorer, path)
    assert path.read_text() == "mine"
    write(explorer, path, overwrite=True)
    assert len(path.read_text()) > 1000


def test_page_holds_the_state_and_asks_for_nothing(explorer: LatentExplorer, tmp_path: Path) -> None:
    explorer.latent = 0.75
    explorer.to_html(str(tmp_path / "page.html"), title="Mine")
    html = (tmp_path / "page.html").read_text()
    assert "<title>Mine</title>" in html
    assert "default-src 'none'" in html
    assert "http://" not in html
    assert "https://" not in html
    state = content(html)["state"]
    assert set(state) == {"_choices", "_page_moves", "_python_moves", "latent", "model"}
    assert (state["model"], state["latent"]) == ("SLR-ldl-1", 0.75)
    assert [entry["name"] for entry in state["_choices"]["models"]] == list(MODELS)


def test_page_escapes_what_users_write() -> None:
    name = "</script><script>alert(1)</script>${x}"
    html = page(LatentExplorer({name: model()}), f"{name} & $title")
    assert "<script>alert" not in html
    assert "&lt;/script&gt;&lt;script&gt;alert(1)&lt;/script&gt;${x} &amp; $title</title>" in html
    assert content(html)["state"]["model"] == name


def test_curves_without_a_licence_stay_out_of_pages(tmp_path: Path) -> None:
    columns = [("a", "b"), ("a", "b"), ("film", "film"), ("here", "here"), ("unknown", "MIT")]
    explorer = LatentExplorer([model()], Responses("mixed", [GRID**0.5, GRID**0.7], *columns))
    assert explorer._choices["curves"]["inverse"]["names"] == ["a", "b"]
    explorer.to_html(tmp_path / "page.html")
    state = content((tmp_path / "page.html").read_text())["state"]
    assert state["_choices"]["curves"]["inverse"]["names"] == ["b"]
    columns[-1] = ("unknown", "unknown")
    explorer = LatentExplorer([model()], Responses("closed", [GRID**0.5, GRID**0.7], *columns))
    assert content(page(explorer, "", explorer._public(explorer.models)))["state"]["_choices"]["curves"] is None


def test_notebook_keeps_a_page_of_the_shown_model(explorer: LatentExplorer) -> None:
    explorer.model = "SLR-ldl-3"
    data, _ = explorer._repr_mimebundle_()
    assert set(data) == {"text/plain", "text/html", "application/vnd.jupyter.widget-view+json"}
    assert data["text/html"].startswith("<iframe srcdoc=")
    assert data["text/html"].endswith("latent=(0.0, 0.0, 0.0)): run this cell to see it.</iframe>")
    assert "&quot;SLR-ldl-3&quot;" in data["text/html"]
    assert "&quot;SLR-open-1&quot;" not in data["text/html"]


def test_repr_is_the_same_every_time(explorer: LatentExplorer) -> None:
    explorer.latent = 0.3
    assert repr(explorer) == "LatentExplorer(model='SLR-ldl-1', latent=0.3)"
    assert explorer._repr_mimebundle_()[0]["text/plain"] == repr(explorer)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda e: setattr(e, "latent", (1.0, 2.0)),
            r"latent=\(1.0, 2.0\) is not valid .*; use 1 finite number$",
        ),
        (lambda e: setattr(e, "latent", np.nan), "latent=nan is not valid"),
        (lambda e: setattr(e, "latent", "far"), "latent='far' holds text"),
        (lambda e: setattr(e, "model", "ldl"), "model='ldl' is not .*; use one of SLR-ldl-1, SLR-ldl-1-forward"),
        (lambda e: setattr(e, "model", ["SLR-ldl-1"]), "use one of SLR-ldl-1"),
    ],
)
def test_bad_values_are_refused_and_change_nothing(
    explorer: LatentExplorer, change: Callable[[LatentExplorer], None], message: str
) -> None:
    shown = (explorer.model, explorer.latent)
    with pytest.raises(InputError, match=message):
        change(explorer)
    assert (explorer.model, explorer.latent) == shown


@pytest.mark.parametrize(
    ("models", "message"),
    [
        ([], "use one or more"),
        ({}, "use one or more"),
        ([model(), model(seed=1)], "equal names; use one or more, and a mapping to name them"),
        ("GGCM-3", "has no latent; use one such as 'SLR-ldl-1'"),
        ("SLR-ldl-7", "no model 'SLR-ldl-7' is bundled"),
    ],
)
def test_models_that_cannot_be_shown(models: list | dict | str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        LatentExplorer(models)


def test_pretrained_models_start_with_ldl_and_keep_their_names() -> None:
    first, *others = LatentExplorer.pretrained().models.items()
    assert first[0] == "SLR-ldl-1"
    assert sorted([first[0], *(name for name, _ in others)]) == sorted(map(str, pretrained_models()))
    # Given without their names, they get the same ones.
    assert set(LatentExplorer([first[1], *(slr for _, slr in others)]).models) == {first[0], *dict(others)}


def test_only_what_it_needs_is_loaded() -> None:
    code = "import sys; from crfbench.widgets import LatentExplorer; LatentExplorer('SLR-ldl-1'); print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    heavy = ("torch", "pandas", "matplotlib", "cv2", "crfbench.paper", "crfbench.camera", "crfbench.search")
    assert [name for name in loaded if name.startswith(heavy)] == []
    ours = {name.rpartition(".")[2] for name in loaded if name.startswith("crfbench.widgets.")}
    assert ours == {"assets", "latent_explorer", "page"}
