"""Colour matrix and curves from RAW and JPEG: known cameras come back, and real ones predict other photographs."""

import dataclasses
import json

import numpy as np
import pytest
import tifffile

from crfbench import camera
from crfbench.calibration.colour import calibrate_colour, to_raw
from crfbench.camera import Passport, linearise
from crfbench.camera.calibrate import _warnings
from crfbench.camera.formats import FORMATS, decode
from crfbench.curves import GRID, evaluate
from crfbench.datasets import load_opencrf, load_patches
from crfbench.datasets.middlebury import patch_arrays
from crfbench.errors import InputError
from crfbench.metrics import rmse
from tests.support.command import run_command
from tests.support.photographs import write_pair
from tests.support.scenes import render_chart

MIXES = np.array([[1.5, -0.35, -0.15], [-0.2, 1.4, -0.2], [0.0, -0.5, 1.5]])
GAINS = np.array([1.3, 0.85, 1.1])
M = MIXES * GAINS
OFF = ~np.eye(3, dtype=bool)
RESPONSES = load_opencrf().curves[[40, 70, 100]]
INVERSE = load_opencrf().in_direction("inverse")[[40, 70, 100]]


def photographs(rng, n=1, places=24, exposures=(0.15, 0.3, 0.6, 1.2)):
    """RAW of random colours, balanced ones among them, in several exposures: (n, e, p, 3)."""
    light = rng.uniform(0.03, 1.0, (n, 1, places, 1)) * rng.uniform(0.35, 1.0, (n, 1, places, 3)) / GAINS
    return np.clip(0.9 * light * np.reshape(exposures, (-1, 1, 1)), 0.0, 1.0)


def developed(raw, responses, rng=None, matrix=M):
    """Develop RAW (n, e, p, 3) as a camera with one response (n, 1024) and a hard edge of its gamut does, in 8 bits."""
    light = np.clip(raw @ matrix.T, 0.0, 1.0)
    b = np.stack([evaluate(row, part.ravel()).reshape(part.shape) for row, part in zip(responses, light, strict=True)])
    noise = 0.0 if rng is None else 0.003 * rng.standard_normal(b.shape)
    return np.rint(255 * np.clip(b + noise, 0.0, 1.0)) / 255


def balanced(matrix):
    """Return the shares of M for RAW that is balanced to grey."""
    return matrix * np.linalg.solve(matrix, np.ones(3))


def gains(matrix):
    return 1.0 / np.linalg.solve(matrix, np.ones(3))


@pytest.fixture(scope="module")
def pairs():
    rng = np.random.default_rng(0)
    raw = photographs(rng, n=3)
    return developed(raw, RESPONSES, rng), raw


@pytest.fixture(scope="module")
def found(pairs):
    return calibrate_colour(*pairs)


def test_dark_photographs_give_no_camera_turned_round():
    """Steps of the fit from far off must not end beyond 0, where all is black; bands hold what was not seen."""
    rng = np.random.default_rng(1)
    raw = photographs(rng, n=10, places=80, exposures=[0.1, 0.05])
    dark = calibrate_colour(developed(raw, load_opencrf().curves[4::15], rng), raw, scatter=0.005)
    assert (np.einsum("ncc->nc", dark.matrix) > 0.4).all()
    inverse = load_opencrf().in_direction("inverse")[4::15].repeat(3, axis=0)
    low, high = dark.calibration.bands[0.9]
    held = ((low <= inverse + 1e-9) & (inverse <= high + 1e-9)).mean(axis=1).reshape(-1, 3).mean(axis=1)
    assert held.mean() > 0.8
    assert np.median(held) > 0.9


def off(found, index=slice(None)):
    """Return how far M is from the truth: its shares, and its gains in log, (n,) each."""
    shares = np.array([abs(balanced(matrix) - MIXES).max() for matrix in found.matrix])
    return shares[index], abs(np.log([gains(matrix) / gains(M) for matrix in found.matrix])).max(axis=1)[index]


def test_known_cameras_come_back(found):
    shares, factors = off(found)
    assert found.told.all()
    assert np.median(shares) < 0.01
    assert shares.max() < 0.02
    assert np.median(factors) < 0.03
    assert factors.max() < 0.09
    apart = np.sqrt(((found.curves - INVERSE[:, None]) ** 2).mean(axis=(1, 2)))
    assert np.median(apart) < 0.012
    assert apart.max() < 0.025


def test_wild_readings_do_no_harm(pairs, found):
    jpeg, raw = pairs
    rng = np.random.default_rng(1)
    wild = rng.random(jpeg.shape[:3]) < 0.08
    dirty = calibrate_colour(np.where(wild[..., None], rng.random(jpeg.shape), jpeg), raw, method="map")
    assert dirty.told.all()
    assert off(dirty)[0].max() < 0.03
    assert rmse(dirty.calibration.curves, found.calibration.curves).max() < 0.03


def test_what_is_clipped_or_weighs_nothing_says_nothing(pairs, found):
    jpeg, raw = (part[:1].copy() for part in pairs)
    weights = np.ones(jpeg.shape[:3])
    weights[0, 1, :5] = 0.0
    expected = calibrate_colour(jpeg, raw, weights, method="map")
    jpeg[0, 1, :5], raw[0, 1, :5] = 0.5, 0.01
    # One place more, where a channel of RAW is full.
    jpeg = np.concatenate([jpeg, np.full((1, 4, 1, 3), 0.1)], axis=2)
    raw = np.concatenate([raw, np.broadcast_to([0.2, 1.0, 0.3], (1, 4, 1, 3))], axis=2)
    clipped = calibrate_colour(jpeg, raw, np.pad(weights, ((0, 0), (0, 0), (0, 1)), constant_values=1.0), method="map")
    np.testing.assert_allclose(clipped.matrix, expected.matrix, atol=1e-9)
    np.testing.assert_allclose(clipped.curves, expected.curves, atol=1e-9)


def test_neither_the_order_nor_the_company_matters(pairs):
    jpeg, raw = pairs
    both = calibrate_colour(jpeg[:2], raw[:2], method="map")
    order = np.random.default_rng(2).permutation(jpeg.shape[2])
    alone = calibrate_colour(jpeg[1][:, order], raw[1][:, order], method="map")
    np.testing.assert_allclose(alone.matrix[0], both.matrix[1], rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(alone.curves[0], both.curves[1], atol=1e-4)
    # So do the names of the channels: red and blue change places.
    turned = calibrate_colour(jpeg[1, ..., ::-1], raw[1, ..., ::-1], method="map")
    np.testing.assert_allclose(turned.matrix[0, ::-1, ::-1], both.matrix[1], rtol=0.02, atol=0.01)
    np.testing.assert_allclose(turned.deviation[0, ::-1], both.deviation[1], rtol=0.05)


def test_each_channel_is_developed_by_its_own_curve(found):
    calibration = dataclasses.replace(found.calibration, curves=np.tile(INVERSE, (3, 1)))
    alone = np.tile(np.eye(3), (3, 1, 1))
    cameras = dataclasses.replace(found, matrix=alone, soft=np.zeros(3), calibration=calibration)
    light = np.linspace(0.02, 0.98, 40)
    expected = np.array([np.interp(light, curve, GRID) for curve in INVERSE]).T
    for brightness in cameras.develop(np.tile(light[:, None], 3)):
        np.testing.assert_allclose(brightness, expected, atol=1e-6)


def test_greys_tell_no_mixture():
    rng = np.random.default_rng(3)
    grey = np.geomspace(0.03, 0.9, 12)[None, None, :, None] * np.reshape([0.3, 1.0], (-1, 1, 1)) * 0.85 / GAINS
    found = calibrate_colour(developed(grey, RESPONSES[1:2], rng), grey)
    assert not found.told.any()
    assert (found.matrix[:, OFF] == 0.0).all()
    assert found.deviation.max() > 0.1
    np.testing.assert_allclose(found.develop(grey[0, 1]), developed(grey, RESPONSES[1:2])[:, 1], atol=0.03)


def test_what_is_developed_comes_back_as_raw(found):
    colours = photographs(np.random.default_rng(4), places=200)[0, 2]
    seen = found.develop(colours)
    inside = ((seen > 0.05) & (seen < 0.99)).all(axis=2)
    assert inside.sum() > 100
    back = to_raw(np.swapaxes(evaluate(found.curves, np.swapaxes(seen, 1, 2)), 1, 2), found.matrix, found.soft)
    np.testing.assert_allclose(back[inside], np.broadcast_to(colours, back.shape)[inside], atol=0.01)
    assert (to_raw(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), found.matrix, found.soft) >= 0.0).all()


RGB = np.full((2, 4, 3), 0.5)


@pytest.mark.parametrize(
    ("jpeg", "raw", "weights", "message"),
    [
        (RGB[0], RGB[0], None, r"brightness has shape \(4, 3\).*use \(photographs, places, 3\)"),
        (RGB, RGB[:1], None, r"raw \(1, 4, 3\)"),
        (RGB[..., :2], RGB[..., :2], None, r"shape \(2, 4, 2\)"),
        (RGB * np.nan, RGB, None, "brightness of shape .* holds NaN"),
        (RGB, RGB * np.inf, None, "raw of shape .* infinite"),
        (RGB, RGB * 255, None, "raw reaches from 127.5 to 127.5; use values from 0 to 1"),
        (RGB, RGB, -1.0, "weights reaches from -1"),
        (RGB, RGB, np.ones(3), r"weights has shape \(3,\)"),
        (RGB, RGB, 0.0, "observations 0: 0; use 2 or more"),
        (RGB, RGB, None, "all patches of observations 0 have brightness 0.5"),
        (np.ma.masked_less(RGB, 1), RGB, None, "masked"),
    ],
)
def test_what_cannot_be_calibrated(jpeg, raw, weights, message):
    with pytest.raises(InputError, match=message):
        calibrate_colour(jpeg, raw, weights)


def test_colours_of_another_shape_are_refused(found):
    with pytest.raises(InputError, match=r"shape \(2, 5, 3\); use \(m, 3\) or \(3, m, 3\)"):
        found.develop(np.zeros((2, 5, 3)))


@pytest.mark.slow
def test_real_cameras_predict_the_jpeg_of_the_other_illumination():
    chart = patch_arrays(load_patches())
    jpeg, raw, clipped = (part.reshape(28, *part.shape[2:]) for part in (chart.jpeg, chart.raw, chart.clipped))
    found, other = calibrate_colour(jpeg, raw, ~clipped, method="map"), np.arange(28) ^ 1
    assert found.told.all()
    predicted = found.develop(raw[other].reshape(28, -1, 3)).reshape(jpeg.shape)
    miss = np.where(clipped[other][..., None], np.nan, predicted - jpeg[other])
    channels = np.sqrt(np.nanmean(miss**2, axis=(1, 2, 3)))
    intensity = np.sqrt(np.nanmean(miss.mean(axis=3) ** 2, axis=(1, 2)))
    # A diagonal matrix gives 0.043 and 0.034, one curve of intensity 0.038.
    assert channels.mean() < 0.022
    assert intensity.mean() < 0.0135
    assert np.median(channels) < 0.021
    assert np.median(intensity) < 0.012


# --- in a camera's passport


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Photograph a chart with a camera that mixes colours."""
    folder = tmp_path_factory.mktemp("mixing")
    for i, exposure in enumerate((0.12, 0.3, 0.75)):
        scene = render_chart(RESPONSES[1], seed=i, size=(480, 360), exposure=exposure)
        jpeg = developed(scene.raw[None], RESPONSES[1:2], matrix=MIXES)[0]
        mixed = dataclasses.replace(scene, jpeg=np.rint(255 * jpeg).astype(np.uint8))
        write_pair(folder, f"chart {i}", mixed, exposure_time=0.01 * exposure)
    return folder


@pytest.fixture(scope="module")
def result(folder):
    return camera.calibrate(folder)


def test_a_chart_with_raw_tells_the_matrix(result):
    assert result.passport.told is True
    assert result.passport.channels == ("red", "green", "blue")
    assert abs(balanced(result.passport.matrix) - MIXES).max() < 0.04
    assert not result.warnings
    page = camera.outputs.report_page(result)
    assert camera.matrix_text(result.passport.matrix) in page


def test_a_matrix_that_is_not_told_is_a_warning(result):
    untold = dataclasses.replace(result.colour, told=np.array([False]))
    said = _warnings(result.calibration, untold)
    assert said == ["the colours do not tell how the camera mixes its channels: the colour matrix is diagonal"]


def test_what_holds_for_all_channels_is_said_once(result):
    doubtful = dataclasses.replace(result.calibration, warnings=(("a", "b"), ("b",), ("b", "c")))
    assert _warnings(doubtful, None) == ["b", "red: a", "blue: c"]


def test_shared_gives_one_curve_and_no_matrix(folder):
    result = camera.calibrate(folder, channels="shared")
    assert (len(result.passport.curves), result.passport.matrix, result.colour) == (1, None, None)


def test_an_image_becomes_the_camera_s_raw(folder, result, tmp_path):
    path = folder / "chart 1.jpg"
    patches = camera.linearised_patches(result, "chart 1")
    assert rmse(patches["linear"], patches["raw"]) < 0.01
    list(camera.write_outputs(result, tmp_path))
    for to in ("light", "camera"):
        done = run_command(
            "linearise", path, "--response", tmp_path / "passport.json", "--out", tmp_path / f"{to}.tif", "--to", to
        )
        assert done.returncode == 0, done.stderr
    light, raw = (tifffile.imread(tmp_path / f"{to}.tif") for to in ("light", "camera"))
    assert abs(light - raw).max() > 0.05
    back = linearise(camera.read_image(path), camera.read_response(tmp_path / "passport.json"), to="camera")
    np.testing.assert_allclose(raw, back, atol=1e-5)
    done = run_command(
        "linearise", path, "--response", tmp_path / "response.cube", "--out", tmp_path / "no.tif", "--to", "camera"
    )
    assert done.returncode == 2
    assert "--to 'camera' needs a colour matrix" in done.stderr
    assert not (tmp_path / "no.tif").exists()


THREE = Passport("inverse", INVERSE, matrix=M, soft=0.03, told=True)


def test_a_passport_keeps_the_matrix_and_its_channels_do_not():
    content = FORMATS["passport"].write(THREE)
    again = decode("passport", content)
    assert np.array_equal(again.matrix, M)
    assert (again.soft, again.told) == (0.03, True)
    assert THREE.channel("red").matrix is None
    # A passport as it was written before there were matrices.
    old = {name: value for name, value in json.loads(content).items() if name not in ("matrix", "soft", "told")}
    assert decode("passport", json.dumps(old).encode()).matrix is None


def test_linear_light_and_raw_are_both_exact():
    raw = np.random.default_rng(5).uniform(0.2, 0.5, (20, 30, 3)) / GAINS
    mixed = raw @ M.T
    image = np.stack([np.interp(mixed[..., c], INVERSE[c], GRID) for c in range(3)], axis=2)
    hard = dataclasses.replace(THREE, soft=0.0)
    np.testing.assert_allclose(linearise(image, hard), mixed, atol=1e-4)
    np.testing.assert_allclose(linearise(image, hard, to="camera"), raw, atol=1e-4)
    assert linearise(image, hard, to="camera").dtype == np.float32


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"matrix": M}, "soft=None and told=None of 3 curves; use all"),
        ({"matrix": M, "soft": 0.03, "told": 1}, "told=1"),
        ({"matrix": M[:2], "soft": 0.03, "told": True}, r"use one of shape \(3, 3\)"),
        ({"matrix": np.ones((3, 3)), "soft": 0.03, "told": True}, "that can be inverted"),
        ({"matrix": M * np.nan, "soft": 0.03, "told": True}, "NaN"),
        ({"matrix": M, "soft": 2.0, "told": True}, "soft"),
        ({"matrix": M, "soft": 0.03, "told": True, "curves": INVERSE[:1]}, "of 1 curves"),
    ],
)
def test_what_is_no_matrix_of_a_passport(values, message):
    with pytest.raises(InputError, match=message):
        Passport(**{"direction": "inverse", "curves": INVERSE, **values})


def test_raw_needs_a_passport_that_has_a_matrix():
    image = np.full((2, 2, 3), 0.5)
    for response in (INVERSE, Passport("inverse", INVERSE)):
        with pytest.raises(InputError, match="to='camera' needs a colour matrix"):
            linearise(image, response, to="camera")
    with pytest.raises(InputError, match="to='raw' is not known; use one of light, camera"):
        linearise(image, THREE, to="raw")
