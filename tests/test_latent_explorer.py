"""The Python side of LatentExplorer and its exported page; tests/test_browser drives both on a page."""

import json
import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from crfbench.curves import GRID
from crfbench.datasets import Responses, load_opencrf
from crfbench.errors import InputError
from crfbench.models.slr import SLR
from crfbench.widgets import LatentExplorer
from crfbench.widgets.page import page

OPENCRF = load_opencrf()


def model(constraint: str = "", data: str = "dorf", **options) -> SLR:
    slr = SLR(hidden=(6, 4), **{"direction": "inverse", **options})
    slr.card_ = {"constraint": constraint, "data": data} if constraint else {}
    return slr


MODELS = {
    "ldl-1-inverse": model("ldl"),
    "ldl-1-forward": model("ldl", direction="forward"),
    "ldl-3-inverse": model("ldl", n_latent=3),
    "monotone-1-inverse": model("ldl", monotone=True),
    "open-1-inverse": model("ldl", "opencrf", monotone=True, seed=1),
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
    assert explorer.model_name == "ldl-1-inverse"
    assert explorer.model is MODELS["ldl-1-inverse"]
    assert explorer.latent == (0.0,)


@pytest.mark.parametrize("name", MODELS)
def test_curve_is_the_decoded_latent(explorer: LatentExplorer, name: str) -> None:
    explorer.model_name = name
    explorer.latent = np.linspace(-1.5, 7, explorer.model.n_params)
    np.testing.assert_array_equal(explorer.curve, MODELS[name].decode(explorer.latent))
    assert explorer.curve.shape == (1024,)


def test_one_latent_may_be_a_plain_number(explorer: LatentExplorer) -> None:
    explorer.latent = -2
    assert explorer.latent == (-2.0,)


def test_the_page_moves_the_latent(explorer: LatentExplorer) -> None:
    explorer.set_state({"_shown": {**explorer._shown, "model": "ldl-3-inverse", "latent": [0.5, 0, -1]}})
    assert explorer.latent == (0.5, 0.0, -1.0)
    assert explorer.model is MODELS["ldl-3-inverse"]


def test_what_the_page_sent_before_python_spoke_is_refused(explorer: LatentExplorer) -> None:
    before = explorer._shown
    explorer.latent = -3
    explorer.set_state({"_shown": {**before, "latent": [1.0]}})
    assert explorer.latent == (-3.0,)
    explorer.set_state({"_shown": {**explorer._shown, "latent": [1.0]}})
    assert explorer.latent == (1.0,)


def test_a_model_of_as_many_latents_keeps_them(explorer: LatentExplorer) -> None:
    explorer.latent = 1.25
    explorer.model = MODELS["open-1-inverse"]
    assert (explorer.model_name, explorer.latent) == ("open-1-inverse", (1.25,))
    explorer.model_name = "ldl-3-inverse"
    assert explorer.latent == (0.0, 0.0, 0.0)


def test_models_are_told_apart_by_their_cards(explorer: LatentExplorer) -> None:
    assert facets(explorer) == {
        "Constraint": ["LDL"] * 5,
        "Latents": ["1", "1", "3", "1", "1"],
        "Decoder": ["plain", "plain", "plain", "monotone", "monotone"],
        "Direction": ["inverse", "forward", "inverse", "inverse", "inverse"],
        "Trained on": ["DoRF", "DoRF", "DoRF", "DoRF", "OpenCRF"],
    }


def test_models_with_equal_cards_are_told_apart_by_name() -> None:
    seeds = LatentExplorer({"seed 0": model("aae"), "seed 1": model("aae", seed=1)})
    assert facets(seeds)["Name"] == ["seed 0", "seed 1"]


def test_a_sequence_is_named_by_cards() -> None:
    models = [model("vae"), model("vae", n_latent=3), model("ldl", monotone=True, direction="forward"), model()]
    names = ["vae-1-inverse", "vae-3-inverse", "ldl-monotone-1-forward", "untrained-1-inverse"]
    assert [entry["name"] for entry in LatentExplorer(models)._choices["models"]] == names


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


@pytest.mark.parametrize("name", ["ldl-1-inverse", "ldl-1-forward"])
def test_csv(explorer: LatentExplorer, tmp_path: Path, name: str) -> None:
    explorer.model_name = name
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
    assert set(state) == {"_choices", "_shown"}
    assert (state["_shown"]["model"], state["_shown"]["latent"]) == ("ldl-1-inverse", [0.75])
    assert [entry["name"] for entry in state["_choices"]["models"]] == list(MODELS)


def test_page_escapes_what_users_write() -> None:
    name = "</script><script>alert(1)</script>${x}"
    html = page(LatentExplorer({name: model()}), f"{name} & $title")
    assert "<script>alert" not in html
    assert "&lt;/script&gt;&lt;script&gt;alert(1)&lt;/script&gt;${x} &amp; $title</title>" in html
    assert content(html)["state"]["_shown"]["model"] == name


def test_curves_without_a_licence_stay_out_of_pages(tmp_path: Path) -> None:
    columns = [("a", "b"), ("a", "b"), ("film", "film"), ("here", "here"), ("unknown", "MIT")]
    explorer = LatentExplorer([model()], Responses("mixed", [GRID**0.5, GRID**0.7], *columns))
    assert explorer._choices["curves"]["inverse"]["names"] == ["a", "b"]
    explorer.to_html(tmp_path / "page.html")
    state = content((tmp_path / "page.html").read_text())["state"]
    assert state["_choices"]["curves"]["inverse"]["names"] == ["b"]
    columns[-1] = ("unknown", "unknown")
    explorer = LatentExplorer([model()], Responses("closed", [GRID**0.5, GRID**0.7], *columns))
    assert content(page(explorer, "", explorer._public(explorer._models)))["state"]["_choices"]["curves"] is None


def test_notebook_keeps_a_page_of_the_shown_model(explorer: LatentExplorer) -> None:
    explorer.model_name = "ldl-3-inverse"
    data, _ = explorer._repr_mimebundle_()
    assert set(data) == {"text/plain", "text/html", "application/vnd.jupyter.widget-view+json"}
    assert data["text/html"].startswith("<iframe srcdoc=")
    assert data["text/html"].endswith("latent=(0.0, 0.0, 0.0)): run this cell to see it.</iframe>")
    assert "&quot;ldl-3-inverse&quot;" in data["text/html"]
    assert "&quot;open-1-inverse&quot;" not in data["text/html"]


def test_repr_is_the_same_every_time(explorer: LatentExplorer) -> None:
    explorer.latent = 0.3
    assert repr(explorer) == "LatentExplorer(model='ldl-1-inverse', latent=(0.3,))"
    assert explorer._repr_mimebundle_()[0]["text/plain"] == repr(explorer)


def test_front_end_needs_nothing_from_elsewhere() -> None:
    assert "import " not in LatentExplorer._esm
    assert "http" not in LatentExplorer._esm + LatentExplorer._css


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda e: setattr(e, "latent", (1.0, 2.0)), r"latent=\(1.0, 2.0\) does not fit; use 1 finite numbers"),
        (lambda e: setattr(e, "latent", np.nan), "latent=nan does not fit"),
        (lambda e: setattr(e, "latent", "far"), "latent='far' holds text"),
        (lambda e: setattr(e, "model_name", "ldl"), "model_name='ldl' is not here; use one of ldl-1-inverse, ldl-1-f"),
        (lambda e: setattr(e, "model_name", ["ldl-1-inverse"]), "is not here"),
        (lambda e: setattr(e, "model", SLR()), r"model=SLR\(.*\) is not among those given; use one of ldl-1-inverse"),
    ],
)
def test_bad_values_are_refused_and_change_nothing(
    explorer: LatentExplorer, change: Callable[[LatentExplorer], None], message: str
) -> None:
    shown = dict(explorer._shown)
    with pytest.raises(InputError, match=message):
        change(explorer)
    assert explorer._shown == shown


@pytest.mark.parametrize("models", [[], {}, [model(), model(seed=1)]])
def test_models_that_cannot_be_shown(models: list | dict) -> None:
    with pytest.raises(InputError, match="use one or more, and a mapping where their cards agree"):
        LatentExplorer(models)


def test_shipped_models_start_with_ldl(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from crfbench.models import weights

    monkeypatch.setattr(weights, "shipped", lambda name: tmp_path)
    for name in ("auc-1-inverse", "ldl-1-inverse"):
        MODELS["ldl-1-inverse"].save(tmp_path / f"{name}.safetensors")
    explorer = LatentExplorer.shipped()
    assert [entry["name"] for entry in explorer._choices["models"]] == ["ldl-1-inverse", "auc-1-inverse"]
