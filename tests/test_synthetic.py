"""The rendered chart: what it is said to show, it shows; and what is written to files comes back."""

import json
import subprocess
import sys

import cv2
import numpy as np
import pytest

from crfbench.camera.measuring import measure_chart
from crfbench.camera.reading import read_exif, read_image, read_raw
from crfbench.curves import GRID, evaluate
from crfbench.datasets import load_opencrf
from crfbench.datasets.chart import chart_colours
from tests.support.photographs import write_pair
from tests.support.scenes import render_chart

GAMMA = GRID ** (1 / 2.2)


COLOUR_SCIENCE = """
import json, colour
chart = colour.CCS_COLOURCHECKERS["ColorChecker 1976"]
xyz = colour.xyY_to_XYZ(list(chart.data.values()))
print(json.dumps(colour.XYZ_to_RGB(xyz, "sRGB", chart.illuminant, "Bradford").tolist()))
"""


def test_chart_colours_equal_those_of_another_library():
    # In a process of its own, as importing colour-science changes which warnings are shown.
    run = subprocess.run([sys.executable, "-c", COLOUR_SCIENCE], capture_output=True, text=True, check=True)
    np.testing.assert_allclose(chart_colours(), json.loads(run.stdout), atol=1e-4)


def test_the_seed_decides_everything():
    first, again, other = (render_chart(GAMMA, seed, size=(96, 64)) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.raw, again.raw)
    np.testing.assert_array_equal(first.jpeg, again.jpeg)
    assert not np.allclose(first.corners, other.corners)


def test_raw_is_the_irradiance_and_jpeg_the_response_to_it():
    scene = render_chart(GAMMA, 1, exposure=0.9, illuminant=(1.0, 0.8, 0.6))
    assert scene.irradiance.shape == (24, 3)
    raw = measure_chart(scene.raw, scene.corners)
    np.testing.assert_allclose(raw.means, scene.irradiance, atol=1e-3)
    np.testing.assert_array_equal(
        scene.jpeg, np.rint(255 * evaluate(GAMMA, scene.raw.ravel()).reshape(scene.raw.shape))
    )


def test_irradiance_scales_with_exposure_light_and_vignetting():
    plain = render_chart(GAMMA, 2, size=(96, 64), vignetting=0.0).irradiance
    np.testing.assert_allclose(plain, np.maximum(chart_colours(), 0.01))
    lit = render_chart(GAMMA, 2, size=(96, 64), vignetting=0.0, exposure=0.5, illuminant=(2.0, 1.0, 0.5)).irradiance
    np.testing.assert_allclose(lit, plain * (1.0, 0.5, 0.25))
    vignetted = render_chart(GAMMA, 2, size=(96, 64), vignetting=0.5).irradiance / plain
    assert vignetted.max() <= 1.0
    assert vignetted.min() > 0.5


def test_noise_is_photon_noise_and_read_noise():
    shots = np.array([render_chart(GAMMA, 5, size=(96, 64), full_well=w, read_noise=r).raw for w, r in
                      ((1e12, 0.0), (1000.0, 0.01))])  # fmt: skip
    level, noise = shots[0], shots[1] - shots[0]
    inside = (level > 0.1) & (level < 0.8)
    assert np.std(noise[inside] / np.sqrt(level[inside] / 1000 + 0.01**2)) == pytest.approx(1.0, abs=0.03)


def test_what_is_too_bright_clips():
    scene = render_chart(GAMMA, 1, exposure=3.0)
    values = measure_chart(scene.raw, scene.corners)
    over = scene.irradiance.max(axis=1) > 1.1
    assert over.any()
    assert (values.clipped[over] == 1.0).all()
    assert scene.raw.max() == 1.0


def test_corners_are_those_of_the_patches():
    scene = render_chart(GAMMA, 7, size=(600, 400), vignetting=0.0, turn=90.0)
    height, width = scene.raw.shape[:2]
    centre = scene.corners.mean(axis=0)
    for corner, patch in zip(scene.corners, (0, 5, 23, 18), strict=True):
        x, y = (corner + 0.04 * (centre - corner)) * (width, height)
        np.testing.assert_allclose(scene.raw[int(y), int(x)], scene.irradiance[patch], atol=0.05)


def test_pair_comes_back_through_libraw_and_opencv(tmp_path):
    """No brightening, no balance, no black level left: the numbers of the RAW file are those of the scene."""
    scene = render_chart(load_opencrf().curves[3], 4, exposure=0.85, illuminant=(0.6, 1.0, 0.8))
    assert scene.raw.max() < 0.99  # where LibRaw would otherwise take the brightest pixel for white
    jpeg, dng = write_pair(tmp_path, "Фото 1", scene, exposure_time=1 / 60, f_number=8.0, iso=400)
    raw = read_raw(dng)
    assert raw.shape == scene.raw.shape
    sent, back = (measure_chart(pixels, scene.corners).means for pixels in (scene.raw, raw))
    np.testing.assert_allclose(back, sent, atol=2e-3)
    np.testing.assert_allclose(back.sum(axis=0) / sent.sum(axis=0), 1.0, atol=1e-3)
    means = measure_chart(read_image(jpeg), scene.corners).means
    np.testing.assert_allclose(means, measure_chart(scene.jpeg / 255, scene.corners).means, atol=1 / 255)
    for path in (jpeg, dng):
        exif = read_exif(path)
        assert exif.exposure_time == pytest.approx(1 / 60, rel=1e-4)
        assert (exif.f_number, exif.iso) == (8.0, 400.0)


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_raw_and_jpeg_are_turned_alike(tmp_path, orientation):
    scene = render_chart(GAMMA, 1, size=(96, 64))
    jpeg, dng = write_pair(tmp_path, "a", scene, orientation=orientation)
    quarter_turns = {1: 0, 3: 2, 6: 3, 8: 1}[orientation]
    np.testing.assert_allclose(read_image(jpeg), np.rot90(scene.jpeg / 255, quarter_turns), atol=0.1)
    raw, expected = read_raw(dng), np.rot90(scene.raw, quarter_turns)
    assert raw.shape == expected.shape
    np.testing.assert_allclose(*(cv2.blur(pixels, (9, 9)) for pixels in (raw, expected.astype(np.float32))), atol=0.1)
