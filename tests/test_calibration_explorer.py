"""The Python side of CalibrationExplorer; tests/test_browser drives it on a page."""

import ipywidgets
import numpy as np
import pytest

from crfbench.calibration import Observations, calibrate
from crfbench.curves import GRID, evaluate
from crfbench.datasets.middlebury import REFERENCE_IRRADIANCE, load_patches, patch_intensity
from crfbench.errors import InputError
from crfbench.models.registry import ModelKey, load_model
from crfbench.widgets import CalibrationExplorer, calibration_explorer
from crfbench.widgets.calibration_explorer import MODELS


@pytest.fixture
def explorer() -> CalibrationExplorer:
    return CalibrationExplorer()


def samples(data: bytes) -> np.ndarray:
    return np.frombuffer(data, dtype="<f4")


def photographs(camera: str, illumination: int):
    return patch_intensity(load_patches()).query("camera == @camera and illumination == @illumination")


def test_calibrates_what_is_chosen(explorer: CalibrationExplorer) -> None:
    explorer.camera, explorer.illumination, explorer.patches = "NikonD70", 2, (24, 2, 19, 2)
    explorer.model, explorer.method = "GGCM-3", "map"
    rows = photographs("NikonD70", 2)
    rgb = rows[["jpeg_r", "jpeg_g", "jpeg_b"]].to_numpy().reshape(4, 24, 3)
    clipped = rows["jpeg_clipped"].to_numpy().reshape(4, 24) >= 0.02
    seen = Observations.from_rgb(rgb, REFERENCE_IRRADIANCE, clipped=clipped).take([1, 18, 23])
    expected = calibrate(load_model("GGCM-3"), seen, "map")
    np.testing.assert_allclose(explorer.result.params, expected.params)
    assert explorer.patches == (2, 19, 24)
    np.testing.assert_allclose(samples(explorer._scene["shown"]["curve"]), expected.curves[0, ::3], atol=1e-7)


@pytest.mark.parametrize("illumination", [1, 2])
def test_judged_by_raw_of_the_other_illumination(explorer: CalibrationExplorer, illumination: int) -> None:
    explorer.camera, explorer.illumination = "PentaxK10D", illumination
    rows = photographs("PentaxK10D", 3 - illumination)
    decoded = evaluate(explorer.result.curves, rows["jpeg"].to_numpy()[None])[0]
    expected = np.sqrt(np.mean((decoded - rows["raw"].to_numpy()) ** 2))
    assert explorer.rmse == pytest.approx(expected)
    assert explorer._scene["shown"]["rmse"] == explorer.rmse
    np.testing.assert_allclose(samples(explorer._scene["truth"]), np.concatenate([rows["jpeg"], rows["raw"]]), 1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_every_model_is_offered_the_methods_that_fit(explorer: CalibrationExplorer, model: str) -> None:
    explorer.model = model
    offered = next(each for each in explorer._options["models"] if each["name"] == model)["methods"]
    assert set(offered) <= set(explorer._options["methods"])
    assert ("grid" in offered) == (explorer.result.model.n_params == 1)
    for method in offered[:4]:
        explorer.method = method
        assert explorer.result.method == ("posterior" if method == "family" else method)
        key = ModelKey.parse(model)
        assert (explorer.result.model.name, explorer.result.model.n_params) == (key.family, key.n_params)


def test_the_papers_method_is_offered_too(explorer: CalibrationExplorer) -> None:
    explorer.model, explorer.method = "Gamma-1", "paper"
    assert explorer.result.method == "paper"
    assert explorer._scene["shown"]["bands"] == {}


def test_least_loss_stays_chosen_when_the_model_changes(explorer: CalibrationExplorer) -> None:
    explorer.method = "grid"
    explorer.model = "EMoR-3"
    assert explorer.method == "lm"
    explorer.model = "Gamma-1"
    assert explorer.method == "grid"


def test_bands_enclose_the_curve_and_each_other(explorer: CalibrationExplorer) -> None:
    explorer.patches = (19, 24)
    shown = explorer._scene["shown"]
    (low90, high90), (low50, high50) = (samples(shown["bands"][level]).reshape(2, 342) for level in ("0.9", "0.5"))
    assert (low90 <= low50).all()
    assert (high50 <= high90).all()
    curve = samples(shown["curve"])
    assert ((curve >= low90) & (curve <= high90)).mean() > 0.99
    assert (high90 - low90).max() > 0.1


def test_densities_are_over_the_unconstrained_parameter(explorer: CalibrationExplorer) -> None:
    density = explorer._scene["shown"]["density"]
    prior, posterior = map(samples, density["densities"])
    z = np.linspace(*density["ends"], len(prior))
    assert np.trapezoid(prior, z) == pytest.approx(1, abs=0.01)
    assert np.trapezoid(posterior, z) == pytest.approx(1, abs=0.01)
    learned = load_model("SLR-ldl-1").prior_
    assert np.trapezoid(prior * z, z) == pytest.approx(learned.mean[0], abs=0.02)
    assert density["best"] == pytest.approx(explorer.result.params[0, 0])
    assert density["name"] == "latent z"


def test_density_of_gamma_is_over_its_logarithm(explorer: CalibrationExplorer) -> None:
    explorer.model = "Gamma-1"
    density = explorer._scene["shown"]["density"]
    assert density["name"] == "log gamma"
    assert density["best"] == pytest.approx(np.log(explorer.result.params[0, 0]))


def test_no_density_without_a_single_parameter_and_no_posterior_without_its_method(
    explorer: CalibrationExplorer,
) -> None:
    explorer.method = "map"
    assert len(explorer._scene["shown"]["density"]["densities"]) == 1
    explorer.model = "EMoR-3"
    assert explorer._scene["shown"]["density"] is None


def test_what_is_told_of_the_result(explorer: CalibrationExplorer) -> None:
    explorer.patches = (19, 21)
    shown = explorer._scene["shown"]
    np.testing.assert_allclose(samples(shown["dots"]).reshape(2, -1), np.stack(explorer.result.dots(0)), 1e-6)
    assert shown["range"] == explorer.result.brightness_range[0].tolist()
    assert shown["params"] == {"latent z": explorer.result.params[0, 0]}
    assert shown["warnings"] == list(explorer.result.warnings[0])
    assert any("only 2 patches" in text for text in shown["warnings"])
    assert shown["label"] == "SLR-ldl-1, posterior"


def test_the_chart_has_the_colours_of_the_third_photograph(explorer: CalibrationExplorer) -> None:
    rows = photographs(explorer.camera, 1).query("exposure == 3").sort_values("patch")
    expected = 255 * rows[["jpeg_r", "jpeg_g", "jpeg_b"]].to_numpy()
    found = np.frombuffer(explorer._scene["colours"], dtype=np.uint8).reshape(24, 3)
    assert np.abs(found - expected).max() <= 0.5


@pytest.mark.parametrize("patches", [(), (24,)])
def test_too_few_patches_say_so_and_keep_the_last_curve(explorer: CalibrationExplorer, patches: tuple) -> None:
    before = explorer._scene["shown"]
    explorer.set_state({"patches": list(patches)})
    assert explorer.patches == patches
    assert explorer.error.endswith("2 or more")
    assert explorer._scene["error"] == explorer.error
    assert explorer._scene["shown"] == before
    with pytest.raises(InputError, match="2 or more"):
        _ = explorer.result
    with pytest.raises(InputError, match="2 or more"):
        _ = explorer.rmse
    explorer.patches = (19, 24)
    assert explorer.error == "" == explorer._scene["error"]


def test_every_choice_of_the_page_is_answered(explorer: CalibrationExplorer) -> None:
    choices = {"camera": "NikonD200", "illumination": 2, "model": "EMoR-3", "method": "lm", "patches": [3, 20]}
    for name, value in choices.items():
        explorer.set_state({name: value})
        assert explorer._scene["choice"][name] == (tuple(value) if name == "patches" else value)
    assert repr(explorer) == "CalibrationExplorer('NikonD200', illumination=2, 'EMoR-3', 'lm', patches=(3, 20))"


def test_choices_that_come_together_are_calibrated_once(
    explorer: CalibrationExplorer, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = []
    monkeypatch.setattr(calibration_explorer, "calibrate", lambda *a, **k: runs.append(a) or calibrate(*a, **k))
    explorer.set_state({"model": "GGCM-3", "method": "lm", "patches": [1, 2, 19]})
    assert (explorer.model, explorer.method, explorer.patches) == ("GGCM-3", "lm", (1, 2, 19))
    explorer.model = "Gamma-1"  # changes the method too
    assert len(runs) == 2


def test_observers_hear_of_every_choice_and_find_its_result(explorer: CalibrationExplorer) -> None:
    heard = []
    explorer.observe(lambda change: heard.append((change.name, change.new, explorer.rmse)), ["patches", "camera"])
    explorer.set_state({"patches": [19, 24]})
    explorer.patches = [24, 19]  # the same
    explorer.camera = "NikonD70"
    assert [each[:2] for each in heard] == [("patches", (19, 24)), ("camera", "NikonD70")]
    assert heard[0][2] != heard[1][2] == explorer.rmse


def test_choices_are_linked_to_other_widgets(explorer: CalibrationExplorer) -> None:
    other = CalibrationExplorer()
    dropdown = ipywidgets.Dropdown(options=explorer._options["cameras"], value="NikonD70")
    ipywidgets.link((dropdown, "value"), (explorer, "camera"))
    ipywidgets.link((explorer, "patches"), (other, "patches"))
    assert explorer.camera == "NikonD70"
    explorer.camera = "PentaxK10D"
    other.patches = (1, 2, 3)
    assert (dropdown.value, explorer.patches) == ("PentaxK10D", (1, 2, 3))


def test_a_value_that_the_page_may_not_send_is_not_kept(explorer: CalibrationExplorer) -> None:
    with pytest.raises(InputError, match="patches=25"):
        explorer.set_state({"patches": [1, 25]})
    assert explorer.patches == (19, 21, 24)


def test_shortcuts_are_patches(explorer: CalibrationExplorer) -> None:
    sizes = []
    for shortcut in explorer._options["shortcuts"]:
        explorer.patches = shortcut["patches"]
        assert list(explorer.patches) == shortcut["patches"]
        sizes.append(len(explorer.patches))
        assert explorer.error == ""
    assert sizes == [3, 6, 12, 24]


def test_a_message_is_small(explorer: CalibrationExplorer) -> None:
    explorer.patches = range(1, 25)
    scene = explorer._scene
    shown = scene["shown"]
    packed = [scene["colours"], scene["truth"], shown["curve"], shown["dots"], *shown["bands"].values()]
    assert sum(map(len, [*packed, *shown["density"]["densities"]])) < 16_384


def test_front_end_needs_nothing_from_elsewhere() -> None:
    assert "import " not in CalibrationExplorer._esm
    assert "http" not in CalibrationExplorer._esm + CalibrationExplorer._css


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("camera", "Leica", "camera='Leica' is not known; use one of CanonEOS1DsMarkII"),
        ("illumination", 3, "illumination=3 is out of range; use a whole number from 1 to 2"),
        ("illumination", True, "illumination=True"),
        ("method", "lm", "method='lm' is not known; use one of posterior, family, map, grid, paper"),
        ("model", "SLR-ldl", "model='SLR-ldl' is not known; use one of SLR-ldl-1"),
        ("patches", (0, 3), "patches=0 is out of range; use a whole number from 1 to 24"),
        ("patches", (1, 25), "whole number from 1 to 24"),
        ("patches", (1, 2.5), "whole number"),
        ("patches", (True, 2), "whole number"),
        ("patches", 19, "patches=19 is not a list"),
        ("patches", "ab", "patches='a'"),
    ],
)
def test_bad_values_are_refused_and_change_nothing(
    explorer: CalibrationExplorer, name: str, value: object, message: str
) -> None:
    scene = explorer._scene
    with pytest.raises(InputError, match=message):
        setattr(explorer, name, value)
    assert explorer._scene == scene


def test_curves_stay_within_the_picture(explorer: CalibrationExplorer) -> None:
    assert np.allclose(samples(explorer._scene["shown"]["curve"])[[0, -1]], GRID[[0, -1]], atol=0.05)
