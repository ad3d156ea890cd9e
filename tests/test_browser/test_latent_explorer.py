"""LatentExplorer as a user meets it: in JupyterLab, in a page of its own, and in a notebook made into HTML."""

import re
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import nbformat
import numpy as np
import pytest

from crfbench.curves import GRID
from crfbench.datasets import load_opencrf
from crfbench.metrics import rmse
from crfbench.models import Gamma, ModelKey
from crfbench.models.slr import SLR
from crfbench.widgets import LatentExplorer

from .looks import colours, drag, eventually, overflowing, picture, readout, screenshot, settled

pytestmark = pytest.mark.browser

CELLS = [
    """import json
from crfbench import SLR, load_responses
from crfbench.widgets import LatentExplorer
models = {name: SLR.load(f"{name}.safetensors") for name in json.load(open("models.json"))}
explorer = LatentExplorer(models, load_responses("opencrf"))""",
    "explorer",
    "import ipywidgets; holder = ipywidgets.VBox(); holder",
]
LATENTS = {1: (-1.37,), 3: (0.9, -2.15, 0.4)}


def smooth_model(n_latent: int, direction: str, monotone: bool) -> SLR:
    """Return a model whose weights are random, but whose curves are smooth enough to look at."""
    model = SLR((8, 5), n_latent, direction, monotone)
    x = GRID[1:] if monotone else np.clip(GRID, 1e-3, 1 - 1e-3)
    shift = np.log(x) if monotone else np.log(x**2 / (1 - x**2))
    model.weights_["decoder.0.weight"] *= 2
    model.weights_["decoder.2.weight"] = np.stack([3 / i * np.sin(np.pi * x * i) for i in range(1, 9)], 1).astype("f4")
    model.weights_["decoder.2.bias"] = (shift if direction == "inverse" else -shift[::-1]).astype("f4")
    model.metadata_ = {"constraint": "ldl", "data": "opencrf"}
    return model


MODELS = {
    str(ModelKey("SLR", "monotone" if monotone else "ldl", k, direction)): smooth_model(k, direction, monotone)
    for monotone, k, direction in product((False, True), (1, 3), ("inverse", "forward"))
}
MODELS["SLR-baseline-1"] = smooth_model(1, "inverse", False)
MODELS["SLR-baseline-1"].metadata_["constraint"] = "baseline"


@pytest.fixture(scope="module")
def opened(open_notebook: Callable, lab):
    for name, model in MODELS.items():
        model.save(lab.folder / f"{name}.safetensors")
    (lab.folder / "models.json").write_text(str(list(MODELS)).replace("'", '"'), encoding="utf-8")
    page = open_notebook("latent.ipynb", CELLS)
    page.wait_for_selector(".crf")
    return page


@pytest.fixture
def page(opened, run_python: Callable):
    """Return the page with the one-latent inverse LDL model at 0."""
    show(opened, run_python, "SLR-ldl-1", (0.0,))
    return opened


def show(page, run_python: Callable, name: str, latent: tuple[float, ...]) -> None:
    # By way of another model, so that Python moves in any case, and what the page has under way does not count.
    other = next(model for model in MODELS if model != name)
    run_python(page, f"explorer.model = {other!r}; explorer.model = {name!r}; explorer.latent = {latent}")
    wait_for_label(page, name, latent)


def wait_for_label(page, name: str, latent: tuple[float, ...]) -> None:
    at = ", ".join(f"{z:.2f}".replace("-", "−") for z in latent)
    page.get_by_role("application", name=f"Curve of {name} at {at}:").wait_for()


def wait_for_python(page, run_python: Callable, latent: tuple[float, ...]) -> None:
    """Wait until the last move has reached Python; Jupyter sends the next one only when Python has taken the last."""
    code = "import numpy as np; print(*np.atleast_1d(explorer.latent))"
    eventually(page, lambda: tuple(map(float, run_python(page, code).split())), lambda held: held == latent)


def saved_curve(page, where: Path) -> np.ndarray:
    """Press "Save CSV" and return irradiance and brightness as rows."""
    with page.expect_download() as download:
        page.get_by_role("button", name="Save CSV").click()
    download.value.save_as(where)
    assert where.read_text().startswith("irradiance,brightness\n")
    return np.loadtxt(where, delimiter=",", skiprows=1).T


@pytest.mark.parametrize("name", MODELS)
def test_the_page_decodes_as_numpy_does(page, run_python: Callable, tmp_path: Path, name: str) -> None:
    model = MODELS[name]
    latent = LATENTS[model.n_params]
    show(page, run_python, name, latent)
    irradiance, brightness = saved_curve(page, tmp_path / "curve.csv")
    x, y = (irradiance, brightness) if model.direction == "forward" else (brightness, irradiance)
    np.testing.assert_allclose(x, GRID, atol=1e-8)
    np.testing.assert_allclose(y, model.decode(latent), atol=1e-7)
    assert np.ptp(y - model.decode(np.zeros(model.n_params))) > 0.01, "the latent must matter for this test to tell"


def test_mouse_drag_moves_curve_and_python(page, run_python: Callable) -> None:
    before = picture(page)
    slider = page.get_by_role("slider", name="latent z")
    drag(page, slider, 0.2)
    settled(page)
    reached = float(slider.input_value())
    assert reached == pytest.approx(0.2 * 8, abs=0.2)
    wait_for_python(page, run_python, (reached,))
    assert picture(page) != before
    wait_for_label(page, "SLR-ldl-1", (reached,))


def test_keyboard_moves_the_slider_and_not_the_notebook(page, run_python: Callable) -> None:
    slider = page.get_by_role("slider", name="latent z")
    slider.focus()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    wait_for_python(page, run_python, (0.1,))
    page.keyboard.press("PageDown")
    assert float(slider.input_value()) < -0.5
    for key, end in (("Home", -4.0), ("End", 4.0)):
        page.keyboard.press(key)
        wait_for_python(page, run_python, (end,))
    assert slider.get_attribute("aria-valuetext") == "4.00"
    assert page.evaluate("document.activeElement.type") == "range"
    assert page.evaluate("getComputedStyle(document.activeElement).outlineWidth") == "3px"
    assert page.locator(".jp-CodeCell").count() == len(CELLS)


def test_only_models_that_exist_are_offered(page, run_python: Callable) -> None:
    def offered(label: str) -> list[str]:
        return page.get_by_label(label, exact=True).locator("option").all_inner_texts()

    page.get_by_label("Decoder", exact=True).select_option("monotone")
    wait_for_label(page, "SLR-monotone-1", (0.0,))
    assert run_python(page, "print(explorer.model)").strip() == "SLR-monotone-1"
    assert [offered(label) for label in ("Constraint", "Latents")] == [["LDL", "baseline"], ["1", "3"]]
    page.get_by_label("Constraint", exact=True).select_option("baseline")
    wait_for_label(page, "SLR-baseline-1", (0.0,))
    assert [offered(label) for label in ("Latents", "Decoder", "Direction")] == [["1"], ["plain"], ["inverse"]]
    assert page.get_by_label("Direction", exact=True).is_disabled()
    page.get_by_label("Constraint", exact=True).select_option("LDL")
    page.get_by_label("Latents", exact=True).select_option("3")
    assert page.get_by_role("slider").count() == 3


def test_another_model_of_as_many_latents_keeps_them(page, run_python: Callable) -> None:
    show(page, run_python, "SLR-ldl-3", (0.5, -1.0, 2.0))
    page.get_by_label("Direction", exact=True).select_option("forward")
    wait_for_label(page, "SLR-ldl-3-forward", (0.5, -1.0, 2.0))
    page.get_by_role("button", name="Reset").click()
    wait_for_label(page, "SLR-ldl-3-forward", (0.0, 0.0, 0.0))
    wait_for_python(page, run_python, (0.0, 0.0, 0.0))


def test_python_moves_the_slider(page, run_python: Callable) -> None:
    run_python(page, "explorer.latent = 2.5")
    wait_for_label(page, "SLR-ldl-1", (2.5,))
    assert page.get_by_role("slider").input_value() == "2.5"
    run_python(page, "explorer.latent = 7")
    wait_for_label(page, "SLR-ldl-1", (7.0,))
    assert page.get_by_role("slider").input_value() == "4"


@pytest.fixture(params=["alone", "link", "jslink"])
def linked(request, page, run_python: Callable) -> Iterator[str]:
    """Link a slider of ipywidgets with the latent, or none."""
    kind = request.param
    if kind != "alone":
        make = (
            "import ipywidgets; slider = ipywidgets.FloatSlider(min=-4, max=4, step=0.02); holder.children = [slider]"
        )
        run_python(page, f"{make}; link = ipywidgets.{kind}((slider, 'value'), (explorer, 'latent'))")
        page.locator(".widget-readout").wait_for()
    yield kind
    if kind != "alone":
        run_python(page, "link.unlink(); slider.close()")


def test_observers_hear_a_drag_and_nothing_jumps_back(page, run_python: Callable, linked: str) -> None:
    run_python(page, "heard = []; hear = lambda change: heard.append(change['new']); explorer.observe(hear, 'latent')")
    page.evaluate(
        """() => {
            const slider = document.querySelector(".crf input[type=range]");
            window.shown = [];
            const look = () => { shown.push(slider.valueAsNumber); window.looking = requestAnimationFrame(look); };
            look();
        }"""
    )
    slider = page.get_by_role("slider", name="latent z")
    drag(page, slider, 0.4)
    reached = float(slider.input_value())
    wait_for_python(page, run_python, (reached,))
    page.wait_for_timeout(300)  # a late answer that would move the thumb comes within it, if there is one
    shown = page.evaluate("() => { cancelAnimationFrame(looking); return shown; }")
    heard = [float(z) for z in run_python(page, "print(*heard); explorer.unobserve(hear, 'latent')").split()]
    assert shown == sorted(shown), "the thumb only ever moved with the hand"
    assert heard == sorted(heard)
    assert len(heard) > 1, "not only the end of the drag"
    assert shown[-1] == heard[-1] == reached


@pytest.mark.parametrize("linked", ["link", "jslink"], indirect=True)
def test_a_slider_of_ipywidgets_is_linked_both_ways(page, run_python: Callable, linked: str) -> None:
    other = page.locator(".widget-readout")
    page.get_by_role("slider", name="latent z").press("ArrowRight")
    page.get_by_role("slider", name="latent z").press("ArrowRight")
    other.filter(has_text="0.04").wait_for()
    other.fill("-2.5")
    other.press("Enter")
    wait_for_label(page, "SLR-ldl-1", (-2.5,))
    wait_for_python(page, run_python, (-2.5,))
    run_python(page, "explorer.latent = 1")
    other.filter(has_text="1.00").wait_for()

    def both() -> list[str]:
        return run_python(page, "print(explorer.latent, slider.value)").split()

    # By `jslink` it is the page that moves the slider, which tells Python later; what Python sets before is undone.
    eventually(page, both, lambda held: held == ["1.0", "1.0"])
    run_python(page, "slider.value = -1")
    wait_for_label(page, "SLR-ldl-1", (-1.0,))
    eventually(page, both, lambda held: held == ["-1.0", "-1.0"])


def test_readouts_are_those_of_python(page, run_python: Callable) -> None:
    show(page, run_python, "SLR-ldl-1", (1.0,))
    curve, measured = MODELS["SLR-ldl-1"].decode((1.0,)), load_opencrf()
    fitted = Gamma("inverse").fit(curve)[0]
    assert float(readout(page, "gamma-equivalent").removeprefix("γ = ")) == pytest.approx(fitted[0], rel=0.02)
    to_gamma = float(rmse(Gamma("inverse").decode(fitted), curve))
    assert float(readout(page, "RMSE to that gamma")) == pytest.approx(to_gamma, rel=0.02)
    distances = rmse(measured.in_direction("inverse")[:, ::11], curve[::11])
    assert readout(page, "nearest curve") == measured.names[int(np.argmin(distances))]
    assert float(readout(page, "RMSE to nearest curve")) == pytest.approx(distances.min(), rel=0.01)


def test_network_and_photograph_follow_the_latent(page, run_python: Callable) -> None:
    network = page.get_by_role("img", name="The network: 1024, 8, 5, 1, 5, 8, 1024 neurons")
    photo = page.get_by_role("img", name="A photograph; left: the light")
    before = [shown.evaluate("(canvas) => canvas.toDataURL()") for shown in (network, photo)]
    page.get_by_role("slider", name="latent z").press("End")
    settled(page)
    after = [shown.evaluate("(canvas) => canvas.toDataURL()") for shown in (network, photo)]
    assert after[0] != before[0]
    assert after[1] != before[1]
    show(page, run_python, "SLR-monotone-3", (0.5, -1.0, 2.0))
    page.get_by_role("img", name="The network: 1024, 8, 5, 3, 5, 8, 1024 neurons").wait_for()
    screenshot(page, "latent-network")


def test_animation_starts_and_stops(page, run_python: Callable) -> None:
    slider = page.get_by_role("slider", name="latent z")
    page.get_by_role("button", name="Animate").click()
    page.wait_for_function("() => document.querySelector('.crf input').valueAsNumber > 0.3")
    page.get_by_role("button", name="Pause").click()
    stopped = slider.input_value()
    settled(page)
    assert slider.input_value() == stopped


def test_setting_the_latent_ends_the_animation(page, run_python: Callable) -> None:
    for _ in range(5):  # the page's last moves are under way meanwhile, and must not undo what Python says
        page.get_by_role("button", name="Animate").click()
        page.wait_for_function("() => document.querySelector('.crf input').valueAsNumber > -2.8")
        run_python(page, "explorer.latent = 4; explorer.latent = -3")
        wait_for_label(page, "SLR-ldl-1", (-3.0,))
        assert page.get_by_role("button", name="Animate").is_visible()
        wait_for_python(page, run_python, (-3.0,))


def test_animation_goes_in_steps_for_who_wants_less_motion(page) -> None:
    page.emulate_media(reduced_motion="reduce")
    try:
        page.get_by_role("button", name="Animate").click()
        values = page.evaluate(
            """() => new Promise((done) => {
                const seen = new Set();
                const end = performance.now() + 1200;
                const look = (now) => {
                    seen.add(document.querySelector(".crf input").value);
                    now < end ? requestAnimationFrame(look) : done([...seen]);
                };
                requestAnimationFrame(look);
            })"""
        )
        page.get_by_role("button", name="Pause").click()
    finally:
        page.emulate_media(reduced_motion="no-preference")
    assert values == ["0", "0.5"]


@pytest.fixture
def offline_page(new_context: Callable) -> Iterator:
    """Return a page that fails the test if it asks the network for anything or reports an error."""
    context = new_context(viewport={"width": 1000, "height": 760})
    page = context.new_page()
    asked, errors = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.route(re.compile("^https?:"), lambda route: route.abort())
    page.asked = asked
    yield page
    context.close()
    assert errors == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_exported_page_works_from_a_file(offline_page, tmp_path: Path, scheme: str) -> None:
    explorer = LatentExplorer(MODELS, load_opencrf())
    explorer.latent = 0.5
    explorer.to_html(tmp_path / "page.html")
    offline_page.emulate_media(color_scheme=scheme)
    offline_page.goto((tmp_path / "page.html").as_uri())
    wait_for_label(offline_page, "SLR-ldl-1", (0.5,))
    offline_page.get_by_role("slider").press("ArrowRight")
    wait_for_label(offline_page, "SLR-ldl-1", (0.52,))
    offline_page.get_by_label("Decoder", exact=True).select_option("monotone")
    _, brightness = saved_curve(offline_page, tmp_path / "curve.csv")
    np.testing.assert_allclose(brightness, GRID, atol=1e-8)
    assert colours(offline_page) == {"#0072B2": scheme == "light", "#56B4E9": scheme == "dark"}
    assert [url for url in offline_page.asked if not url.startswith(("file:", "blob:"))] == []
    screenshot(offline_page, f"latent-page-{scheme}", "body")
    offline_page.set_viewport_size({"width": 400, "height": 760})
    settled(offline_page)
    assert overflowing(offline_page) == []
    screenshot(offline_page, f"latent-page-{scheme}-narrow", "body")


def test_a_notebook_made_into_html_stays_alive(offline_page, tmp_path: Path) -> None:
    from nbconvert import HTMLExporter

    explorer = LatentExplorer(MODELS)
    explorer.latent = 1.0
    data, metadata = explorer._repr_mimebundle_()
    output = nbformat.v4.new_output("execute_result", data=data, metadata=metadata, execution_count=1)
    cell = nbformat.v4.new_code_cell("explorer", execution_count=1, outputs=[output])
    html, _ = HTMLExporter().from_notebook_node(nbformat.v4.new_notebook(cells=[cell]))
    (tmp_path / "notebook.html").write_text(html, encoding="utf-8")
    offline_page.goto((tmp_path / "notebook.html").as_uri())
    frame = offline_page.frame_locator("iframe")
    frame.get_by_role("slider").press("ArrowRight")
    frame.get_by_role("application", name="Curve of SLR-ldl-1 at 1.02:").wait_for()
    overflow = "({ scrollHeight, clientHeight }) => scrollHeight - clientHeight"
    assert frame.locator("html").evaluate(overflow) == 0, "the frame is as high as the page in it"
    screenshot(offline_page, "latent-notebook-html", "body")
