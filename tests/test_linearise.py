"""Images to irradiance: the lookup agrees with interpolation, and undoes the response that made the image."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from crfbench import Observations, calibrate, load_model
from crfbench.camera import Passport, linearise
from crfbench.curves import GRID, invert, repair
from crfbench.errors import InputError

RGB = np.array([GRID**2.0, GRID**2.2, np.expm1(3 * GRID) / np.expm1(3)])
SHAPES = st.one_of(array_shapes(min_dims=2, max_dims=2), st.tuples(st.integers(1, 5), st.integers(1, 5), st.just(3)))
IMAGES = st.sampled_from([np.uint8, np.uint16]).flatmap(lambda dtype: arrays(dtype, SHAPES))


def interpolated(image, curves):
    """Do the same with np.interp, channel by channel."""
    x = image / np.iinfo(image.dtype).max
    if image.ndim == 2:
        return np.interp(x, GRID, curves[0])
    return np.stack([np.interp(x[..., i], GRID, curves[i % len(curves)]) for i in range(3)], axis=2)


@given(IMAGES)
def test_lookup_is_interpolation(image):
    for curves in (RGB[2:], RGB) if image.ndim == 3 else (RGB[2:],):
        found = linearise(image, curves)
        assert found.dtype == np.float32
        assert found.shape == image.shape
        np.testing.assert_allclose(found, interpolated(image, curves), atol=1e-6)
        as_floats = linearise(image / np.iinfo(image.dtype).max, curves)
        np.testing.assert_allclose(found, as_floats, atol=1e-6)


def test_an_image_of_a_camera_gives_the_light_back():
    light = np.random.default_rng(0).uniform(0.01, 1.0, size=(40, 50, 3))  # invert() is coarser below
    image = np.stack([np.interp(light[..., i], GRID, invert(RGB[i])) for i in range(3)], axis=2)
    seen = np.rint(image * 65535).astype(np.uint16)
    for passport in (Passport("inverse", RGB), Passport("forward", invert(RGB))):
        np.testing.assert_allclose(linearise(seen, passport), light, atol=1e-4)


def test_a_calibration_linearises_as_its_curves_made_monotone():
    image = np.arange(256, dtype=np.uint8).reshape(16, 16)
    seen = Observations([[0.2, 0.4, 0.6, 0.8]], np.array([0.2, 0.4, 0.6, 0.8]) ** 2.2)
    found = calibrate(load_model("Gamma-1"), seen)
    np.testing.assert_array_equal(linearise(image, found), linearise(image, repair(found.curves)))


def test_views_and_extremes():
    image = np.arange(256, dtype=np.uint8).reshape(16, 16)
    np.testing.assert_array_equal(linearise(image[::-1, ::2], RGB[0]), linearise(image, RGB[0])[::-1, ::2])
    assert linearise(image, RGB[0])[[0, -1], [0, -1]].tolist() == [0.0, 1.0]
    assert linearise(np.array([[-1.0, 1.9]]), RGB[0]).tolist() == [[0.0, 1.0]]


@pytest.mark.parametrize(
    ("image", "response", "message"),
    [
        (np.zeros((2, 2), np.int32), RGB[0], "pixels are int32; use uint8, uint16"),
        (np.ma.array(np.full((2, 2), 9, np.uint8), mask=np.eye(2)), RGB[0], "image holds 2 masked"),
        (np.zeros((2, 2), bool), RGB[0], "bool"),
        (np.full((2, 2), np.nan), RGB[0], "holds NaN"),
        (np.full((2, 2), 255.0), RGB[0], "image reaches 255; use floats from 0 to 1"),
        (np.zeros((2, 2, 4), np.uint8), RGB[0], r"shape \(2, 2, 4\); use \(h, w\)"),
        (np.zeros((0, 2), np.uint8), RGB[0], r"shape \(0, 2\)"),
        (np.zeros((2, 2), np.uint8), RGB, "three curves do not match a grey image"),
        (np.zeros((2, 2), np.uint8), RGB[:2], "2 curves do not match"),
        (np.zeros((2, 2), np.uint8), RGB[0, ::-1], "falls"),
    ],
)
def test_what_cannot_be_linearised(image, response, message):
    with pytest.raises(InputError, match=message):
        linearise(image, response)


def test_a_tensor_that_requires_gradients_is_told_the_way_out():
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    with pytest.raises(InputError, match=r"use image\.detach\(\)"):
        linearise(torch.ones((2, 2), requires_grad=True), GRID)
