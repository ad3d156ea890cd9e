"""Vignetting comes back from an exposure series of an evenly lit surface, and undoes itself in other photographs."""

import cv2
import numpy as np
import pytest
import tifffile

from crfbench import camera
from crfbench.camera.passport import Passport, linearise
from crfbench.camera.vignetting import find_vignetting
from crfbench.curves import GRID, evaluate, invert
from crfbench.datasets import load_opencrf
from crfbench.errors import InputError
from tests.support.command import run_command

SIZE = HEIGHT, WIDTH = 160, 240
TRUE = [-0.4, 0.1, -0.2]
COLOUR = np.array([0.9, 0.75, 0.5])
STOPS = (-3.0, -2.0, -1.0, 0.0)
RESPONSE = load_opencrf().curves[33]


def falloff(coefficients: list[float] = TRUE) -> np.ndarray:
    """Compute V(r) by the formula, pixel by pixel."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    r = np.hypot(x - WIDTH / 2, y - HEIGHT / 2) / np.hypot(WIDTH / 2, HEIGHT / 2)
    return np.exp(sum(a * r ** (2 * k + 2) for k, a in enumerate(coefficients)))


def photographs(light: np.ndarray, response: np.ndarray = RESPONSE, seed: int = 0) -> list[np.ndarray]:
    """Take photographs of irradiance (h, w, 3), with noise as `render_series` has."""
    rng = np.random.default_rng(seed)
    taken = []
    for stop in STOPS:
        irradiance = 2.0**stop * light
        noisy = irradiance + rng.standard_normal(light.shape) * np.sqrt(irradiance / 20_000 + 1e-6)
        taken.append(np.rint(255 * evaluate(response, noisy.ravel())).astype(np.uint8).reshape(light.shape))
    return taken


def wall(coefficients: list[float] = TRUE) -> np.ndarray:
    return falloff(coefficients)[..., None] * COLOUR


@pytest.mark.parametrize("coefficients", [TRUE, [-1.2, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -0.5]])
@pytest.mark.parametrize("index", [3, 33, 120])
def test_the_vignetting_of_a_known_response_comes_back(coefficients, index):
    response = load_opencrf().curves[index]
    images = photographs(wall(coefficients), response)
    found, deviation = find_vignetting(images, invert(response)[None])
    back = Passport("inverse", GRID, vignetting=found).falloff(*SIZE)
    np.testing.assert_allclose(back, falloff(coefficients), rtol=0.01)
    assert abs(found.sum() - sum(coefficients)) < max(5 * deviation, 0.005)


def test_dust_and_clipped_photographs_do_no_harm():
    images = photographs(1.5 * wall())
    for image in images:
        image[20:40, 30:60] //= 2
    found, _ = find_vignetting(images, invert(RESPONSE)[None])
    np.testing.assert_allclose(Passport("inverse", GRID, vignetting=found).falloff(*SIZE), falloff(), rtol=0.02)


def test_a_grey_camera_of_16_bits():
    grey = [np.uint16(257) * image[..., 1] for image in photographs(wall())]
    found, _ = find_vignetting(grey, invert(RESPONSE)[None])
    np.testing.assert_allclose(Passport("inverse", GRID, vignetting=found).falloff(*SIZE), falloff(), rtol=0.01)


@pytest.mark.parametrize("stop", [-9, 4])
def test_photographs_that_are_black_or_white_say_so(stop):
    with pytest.raises(InputError, match="neither dark nor clipped"):
        find_vignetting(photographs(2.0**stop * wall()), invert(RESPONSE)[None])


def test_what_is_no_even_surface_is_refused():
    scene = camera.render_series(RESPONSE, 2, size=(WIDTH, HEIGHT))
    tilted = wall() * np.linspace(0.6, 1.0, WIDTH)[:, None]
    for images in (scene.images, photographs(tilted)):
        with pytest.raises(InputError, match="no evenly lit surface"):
            find_vignetting(images, invert(RESPONSE)[None])


@pytest.mark.parametrize("vignetting", [[], [[1.0]], [np.nan], [40.0], ["a"]])
def test_a_passport_refuses_what_no_lens_does(vignetting):
    with pytest.raises(InputError, match="vignetting"):
        Passport("inverse", GRID, vignetting=vignetting)


def test_linearising_divides_by_it():
    passport = Passport("inverse", invert(RESPONSE), vignetting=TRUE)
    image = np.full((*SIZE, 3), 200, np.uint8)
    light = linearise(image, passport)
    np.testing.assert_allclose(linearise(image, passport, vignette=True), light / falloff()[..., None], rtol=1e-5)
    np.testing.assert_allclose(linearise(image[..., 0], passport, vignette=True), light[..., 0] / falloff(), rtol=1e-5)
    for response in (GRID, Passport("inverse", GRID)):
        with pytest.raises(InputError, match="no vignetting"):
            linearise(image, response, vignette=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wall")
    for k, image in enumerate(photographs(wall())):
        assert cv2.imwrite(str(folder / f"{k}.png"), image[..., ::-1])
    return folder


def test_the_command_finds_it_writes_it_and_undoes_it(folder, tmp_path):
    told, out = ("--chart", "none", "--exposures", "1/8,1/4,1/2,1"), tmp_path / "out"
    done = run_command("calibrate", folder, *told, "--vignette", "--out", out)
    assert done.returncode == 0, done.stderr
    left = float(done.stderr.partition("vignetting: ")[2].partition("%")[0])
    assert left == pytest.approx(100 * np.exp(sum(TRUE)), abs=1)
    passport = camera.read_response(out / "passport.json")
    np.testing.assert_allclose(passport.falloff(*SIZE), falloff(), rtol=0.02)
    assert "Share of the light that is left" in (out / "report.html").read_text()
    picture = cv2.imread(str(out / "vignette.png"), cv2.IMREAD_UNCHANGED)
    assert picture.dtype == np.uint16
    np.testing.assert_allclose(picture / 65535, passport.falloff(*SIZE) / passport.falloff(*SIZE).max(), atol=1e-5)
    assert "light left in the corners" in (out / "report.html").read_text()
    linear = tmp_path / "even.tif"
    args = ("linearise", folder / "2.png", "--response", out / "passport.json", "--out", linear)
    assert run_command(*args, "--vignette").returncode == 0
    even = cv2.blur(tifffile.imread(linear), (15, 15))
    assert (even.std(axis=(0, 1)) < 0.01 * even.mean(axis=(0, 1))).all()


def test_exposures_that_are_estimated_tell_none(folder):
    with pytest.raises(InputError, match="up to a power"):
        camera.calibrate(folder, "none", "estimate", vignette=True)


@pytest.mark.parametrize(
    ("options", "words"),
    [((), "--chart 'auto' tells no vignetting"), (("--chart", "none"), "RAW files tell no vignetting")],
)
def test_where_it_cannot_be_told_the_command_says_so(tmp_path, options, words):
    done = run_command("calibrate", camera.EXAMPLE_FOLDER, "--vignette", "--out", tmp_path / "out", *options)
    assert done.returncode == 2
    assert words in done.stderr
    assert not (tmp_path / "out").exists()


def test_white_below_the_top_of_the_range_is_no_light():
    """Video levels: brightness 1 is level 235."""
    wall = photographs(4.0 * np.dstack([falloff()] * 3), GRID)
    taken = [np.rint(image * (235 / 255)).astype(np.uint8) for image in wall]
    curve = np.minimum(GRID * (255 / 235), 1.0)[None]
    corner = [np.exp(find_vignetting(taken, curve, white)[0].sum()) for white in (234 / 255, 254 / 255)]
    true = np.exp(sum(TRUE))
    assert abs(corner[0] / true - 1) < 0.02
    assert abs(corner[1] / true - 1) > 0.04
