"""The Python side of the widgets; tests/test_browser drives them on a page."""

import re
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import ipywidgets
import numpy as np
import pandas as pd
import pytest
import traitlets
from PIL import Image

from crfbench.curves import GRID
from crfbench.errors import InputError
from crfbench.metrics import rmse
from crfbench.models import GGCM, PPISP, Gamma, Polynomial
from crfbench.widgets import BeforeAfter, DotPlot, ModelExplorer, assets
from crfbench.widgets.assets import bundle

CURVES = np.stack([GRID**0.5, GRID**2.0, np.sin(GRID * np.pi / 2)])
NAMES = ["bright", "dark", "sine"]


@pytest.fixture
def explorer() -> ModelExplorer:
    return ModelExplorer(NAMES, CURVES, [GGCM(2), Polynomial(3), PPISP()])


def send(explorer: ModelExplorer, kind: str, value: object = None, request: str = "view:1") -> None:
    """Do what the page does: a custom message."""
    explorer._handle_custom_msg({"request": request, "kind": kind, "value": value}, [])


def samples(explorer: ModelExplorer, key: str) -> np.ndarray:
    return np.frombuffer(explorer._scene[key], dtype="<f4")


def test_starts_at_the_mean_of_the_first_model(explorer: ModelExplorer) -> None:
    assert (explorer.index, explorer.model, explorer.show_valid) == (0, "GGCM-2", False)
    np.testing.assert_allclose(explorer.params, GGCM(2).learn_prior(CURVES).prior_.mean)
    assert [slider["position"] for slider in explorer._scene["sliders"]] == [0, 0]


def test_axes_are_named_for_the_direction() -> None:
    inverse = ModelExplorer(NAMES, CURVES, [Gamma("inverse")])
    assert inverse._choices["xLabel"].startswith("brightness")
    assert inverse._choices["yLabel"].startswith("irradiance")


def test_params_decode_and_move_the_sliders(explorer: ModelExplorer) -> None:
    explorer.params = (2.0, 0.0)
    assert explorer.params == (2.0, 0.0)
    np.testing.assert_allclose(explorer.curve, GRID**2, atol=1e-12)
    np.testing.assert_allclose(samples(explorer, "decoded"), GRID**2, atol=1e-7)
    np.testing.assert_allclose(samples(explorer, "target"), GRID**0.5, atol=1e-7)
    assert [slider["param"] for slider in explorer._scene["sliders"]] == [2.0, 0.0]
    assert explorer._scene["sliders"][0]["position"] > 0
    assert explorer._scene["rmse"] == pytest.approx(float(rmse(GRID**2, GRID**0.5)))


def test_curve_is_a_copy(explorer: ModelExplorer) -> None:
    explorer.curve[:] = 7
    assert explorer.curve.max() <= 1


@pytest.mark.parametrize("model", [GGCM(2), Polynomial(3), PPISP()])
@pytest.mark.parametrize("index", range(3))
def test_fit_is_the_fit_of_the_model(explorer: ModelExplorer, model: GGCM | Polynomial | PPISP, index: int) -> None:
    explorer.index = index
    explorer.model = f"{model.name}-{model.n_params}"
    explorer.fit()
    np.testing.assert_array_equal(explorer.params, model.fit(CURVES[index])[0])
    assert explorer._scene["message"].startswith(f"Fitted {explorer.model} to {NAMES[index]}: RMSE ")


@pytest.mark.parametrize("model", [GGCM(2), Polynomial(3), PPISP(), PPISP("forward"), Gamma()])
def test_the_formula_is_that_of_the_curve(model: GGCM | Polynomial | PPISP | Gamma) -> None:
    explorer = ModelExplorer(NAMES, CURVES, [model])
    assert explorer._scene["equation"] == model.equation
    notes = [slider["note"] for slider in explorer._scene["sliders"]]
    assert len({*notes}) == model.n_params
    assert all(": " in note for note in notes)
    if isinstance(model, PPISP):  # an inverse response is written with the axes swapped
        assert model.equation.startswith("y" if model.direction == "forward" else "x")


def test_before_after_sends_a_small_photograph_and_its_curves() -> None:
    image = np.zeros((600, 960, 3))
    image[:, :480] = np.array((200, 100, 50)) / 255
    photo = BeforeAfter(image, CURVES)._photo
    shown = np.asarray(Image.open(BytesIO(photo["jpeg"])))
    assert shown.shape == (300, 480, 3)
    assert np.allclose(shown[150, [100, 400]], [(200, 100, 50), (0, 0, 0)], atol=4)
    np.testing.assert_allclose(np.frombuffer(photo["curves"], "<f4").reshape(photo["count"], -1), CURVES, atol=1e-6)
    for wrong in (image * 255, image[..., 0]):
        with pytest.raises(InputError, match="from 0 to 1"):
            BeforeAfter(wrong, CURVES)


def test_dots_keep_their_names_and_groups():
    table = pd.DataFrame({"stops": [1, 2, 3], "RMSE": [0.3, 0.2, 0.1], "kind": ["b", "a", "b"], "who": ["x", "y", "z"]})
    plot = DotPlot(table, "stops", "RMSE", by="kind", name="who")
    assert repr(plot) == "DotPlot(3 dots, 2 groups)"
    assert plot._dots["groups"] == [
        {"label": "a", "x": [2], "y": [0.2], "names": ["y"]},
        {"label": "b", "x": [1, 3], "y": [0.3, 0.1], "names": ["x", "z"]},
    ]
    with pytest.raises(InputError, match=r"no column \['colour'\]"):
        DotPlot(table, "stops", "RMSE", by="colour", name="who")
    with pytest.raises(InputError, match="0 rows"):
        DotPlot(table[:0], "stops", "RMSE", by="kind", name="who")
    with pytest.raises(InputError, match="RMSE"):
        DotPlot(table.assign(RMSE=np.nan), "stops", "RMSE", by="kind", name="who")


def test_reset_and_a_new_model_start_at_the_mean(explorer: ModelExplorer) -> None:
    start = explorer.params
    explorer.fit()
    explorer.reset()
    assert explorer.params == start
    explorer.model = "PPISP-4"
    np.testing.assert_allclose([slider["position"] for slider in explorer._scene["sliders"]], 0, atol=1e-9)


def test_a_new_curve_keeps_the_params(explorer: ModelExplorer) -> None:
    explorer.params = (1.2, -0.1)
    explorer.index = 2
    assert explorer.params == (1.2, -0.1)
    assert explorer._scene["index"] == 2


def test_the_callers_models_keep_their_priors() -> None:
    model = Gamma().learn_prior(CURVES[:2])
    prior = model.prior_
    ModelExplorer(NAMES, CURVES, [model])
    assert model.prior_ is prior


def test_slider_ends_are_what_the_model_can_decode() -> None:
    far = ModelExplorer(["a", "b"], [GRID**0.02, GRID**50.0], [PPISP()])
    for slider in far._scene["sliders"]:
        assert -4 <= slider["min"] < slider["position"] < slider["max"] <= 4
    assert min(slider["max"] for slider in far._scene["sliders"]) < 4, (
        "gamma reaches the end of from_unconstrained first"
    )


def test_a_parameter_that_never_varies_still_has_travel() -> None:
    same = ModelExplorer(["a", "b"], [GRID**2, GRID**2], [Gamma()])
    send(same, "positions", [4.0])
    assert same.params[0] > 2.01


def test_shape_is_judged(explorer: ModelExplorer) -> None:
    explorer.model = "Polynomial-3"
    explorer.params = (3.0, -2.0, 0.0)  # 3x - 2x^2 rises to 1.125 at x = 3/4, then falls
    assert explorer._scene["falls"] == np.sum(np.diff(explorer.curve) < 0) == 256
    assert explorer._scene["inRange"] is False
    explorer.params = (1.0, 0.0, 0.0)
    assert explorer._scene["falls"] == 0
    assert explorer._scene["inRange"] is True


def test_nearest_valid_curve_is_drawn_on_demand(explorer: ModelExplorer) -> None:
    explorer.model = "Polynomial-3"
    explorer.params = (3.0, -2.0, 0.0)
    assert explorer._scene["valid"] is None
    explorer.show_valid = True
    np.testing.assert_allclose(samples(explorer, "valid"), Polynomial(3).nearest_valid((3.0, -2.0, 0.0)), atol=1e-7)


def test_every_request_of_the_page_is_answered_in_one_scene(explorer: ModelExplorer) -> None:
    scenes: list[traitlets.Bunch] = []
    explorer.observe(scenes.append, "_scene")
    requests = [("index", 1), ("model", "Polynomial-3"), ("positions", [0.5, -0.5, 1.0]), ("show_valid", True)]
    for i, (kind, value) in enumerate([*requests, ("fit", None), ("reset", None)]):
        send(explorer, kind, value, f"view:{i}")
    assert [scene["new"]["answered"] for scene in scenes] == [f"view:{i}" for i in range(6)]
    assert (explorer.index, explorer.model, explorer.show_valid) == (1, "Polynomial-3", True)


def test_positions_are_standard_deviations_of_unconstrained_parameters(explorer: ModelExplorer) -> None:
    explorer.model = "PPISP-4"
    send(explorer, "positions", [0.5, -1.0, 0.0, 2.0])
    prior = PPISP().learn_prior(CURVES).prior_
    free = prior.mean + np.sqrt(np.diag(prior.covariance)) * [0.5, -1.0, 0.0, 2.0]
    np.testing.assert_allclose(explorer.params, PPISP().from_unconstrained(free))


def test_traits_are_heard_and_linked(explorer: ModelExplorer) -> None:
    heard: list[str] = []
    explorer.observe(lambda change: heard.append(change["name"]), ["index", "model", "params", "show_valid"])
    for kind, value in (("index", 1), ("show_valid", True), ("positions", [1.0, 0.0]), ("model", "PPISP-4")):
        send(explorer, kind, value)
    assert sorted(heard) == ["index", "model", "params", "params", "show_valid"]
    other = ModelExplorer(NAMES, CURVES, [GGCM(2)])
    ipywidgets.link((explorer, "index"), (other, "index"))
    other.index = 2
    assert explorer.index == explorer._scene["index"] == 2


def test_repr_is_the_same_every_time(explorer: ModelExplorer) -> None:
    assert repr(explorer) == "ModelExplorer(curve='bright', model='GGCM-2')"
    assert explorer._repr_mimebundle_()[0]["text/plain"] == repr(explorer)


STATIC = sorted(Path(assets.__file__).with_name("static").glob("*.js"))
ENTRIES = [path.name for path in STATIC if "export default" in path.read_text()] + ["page.js"]


@pytest.mark.parametrize("entry", ENTRIES)
def test_a_bundle_is_one_module_that_needs_nothing_from_elsewhere(entry: str) -> None:
    text = bundle(entry)
    names = re.findall(r"^(?:const|let|class|(?:async )?function) (\w+)", text, re.MULTILINE)
    assert [name for name in names if names.count(name) > 1] == []
    assert not re.search(r"^import ", text, re.MULTILINE)
    assert len(re.findall(r"^export ", text, re.MULTILINE)) == (entry != "page.js")
    assert "http" not in text


def test_every_module_is_used_and_imports_what_the_other_exports() -> None:
    exported = {path.name: set(re.findall(r"^export (?!default).*? (\w+)", path.read_text(), re.M)) for path in STATIC}
    imports = [
        (path.name, source, set(re.findall(r"\w+", names)))
        for path in STATIC
        for names, source in re.findall(r'^import \{([^}]*)\} from "\./(.+)";$', path.read_text(), re.M)
    ]
    assert [(by, source, names - exported[source]) for by, source, names in imports if names - exported[source]] == []
    assert set(exported) == {*ENTRIES, *(source for _, source, _ in imports)}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda e: setattr(e, "index", 3), "index=3 .*; use a whole number from 0 to 2"),
        (lambda e: setattr(e, "index", -1), "index=-1"),
        (lambda e: setattr(e, "index", "1"), "index='1'"),
        (lambda e: setattr(e, "model", "GGCM"), "use one of GGCM-2, Polynomial-3, PPISP-4"),
        (lambda e: setattr(e, "model", ["GGCM-2"]), "use one of GGCM-2"),
        (lambda e: setattr(e, "params", (1.0,)), r"params have shape \(1,\), wrong for GGCM.*use \(2,\)"),
        (lambda e: setattr(e, "params", [(1.0, 2.0)]), "params have shape"),
        (lambda e: setattr(e, "params", (1.0, np.nan)), "NaN"),
        (lambda e: setattr(e, "params", "ab"), "params='ab' holds text"),
        (lambda e: setattr(e, "show_valid", "yes"), "use True or False"),
    ],
)
def test_bad_values_are_refused_and_change_nothing(
    explorer: ModelExplorer, change: Callable[[ModelExplorer], None], message: str
) -> None:
    scene = explorer._scene
    with pytest.raises(InputError, match=message):
        change(explorer)
    assert explorer._scene == scene


def test_params_outside_the_domain_of_the_model_are_refused(explorer: ModelExplorer) -> None:
    explorer.model = "PPISP-4"
    with pytest.raises(InputError, match="centre between 0 and 1"):
        explorer.params = (1, 1, 1, 2)


@pytest.mark.parametrize(
    ("names", "curves", "models", "message"),
    [
        (NAMES[:2], CURVES, [Gamma()], "there are 2 names for 3 curves"),
        ("abc", CURVES, [Gamma()], "3 names for 3 curves"),
        (NAMES[:1], CURVES[:1], [Gamma()], "use two or more curves"),
        (NAMES, CURVES[:, :10], [Gamma()], "curves have shape"),
        (NAMES, CURVES, [], "use one or more"),
        (NAMES, CURVES, [Gamma(), Gamma()], "different ones"),
        (NAMES, CURVES, [Gamma(), GGCM(2, "forward")], "all of one direction"),
    ],
)
def test_arguments_that_do_not_belong_together(
    names: list[str], curves: np.ndarray, models: list, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        ModelExplorer(names, curves, models)


@pytest.mark.parametrize(
    "entry", [path.name for path in assets._STATIC.glob("*.js") if "export default" in path.read_text()]
)
def test_no_name_comes_twice_in_a_bundle(entry: str) -> None:
    names = re.findall(r"^(?:async )?(?:const|let|function|class) (\w+)", bundle(entry), flags=re.MULTILINE)
    assert [name for name in set(names) if names.count(name) > 1] == []
    assert len(names) > 3
