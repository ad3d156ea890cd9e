"""What observations refuse, with what words; what they derive from colours; and part of them."""

import re

import numpy as np
import pytest

from crfbench.calibration import Noise, Observations, calibrate
from crfbench.calibration.observations import colour_error
from crfbench.curves import GRID
from crfbench.errors import InputError
from crfbench.metrics import rmse
from crfbench.models import load_model

BRIGHTNESS = np.array([[0.2, 0.4, 0.6], [0.3, 0.5, 0.7]])
REFERENCE = np.array([1.0, 2.0, 3.0])


def with_nan(values):
    return np.where(np.arange(np.size(values)).reshape(np.shape(values)) == 1, np.nan, values)


@pytest.mark.parametrize(
    ("brightness", "others", "message"),
    [
        (np.empty((2, 0)), {"reference": []}, r"shape \(2, 0\).*\(images, patches\)"),
        ([0.2, 0.4], {"reference": [1, 2]}, r"shape \(2,\).*\(images, patches\)"),
        ([["dark", "light"]], {"reference": [1, 2]}, "brightness=.* holds text"),
        (BRIGHTNESS[:, :1], {"reference": [1.0]}, "observations 0: 1; use 2 or more"),
        (np.full((2, 3), 0.4), {"reference": REFERENCE}, "observations 0 have brightness 0.4; use patches that differ"),
        (np.stack([BRIGHTNESS, 0 * BRIGHTNESS + 1]), {"reference": REFERENCE}, "observations 1: 0; use 2 or more"),
        (BRIGHTNESS, {"reference": REFERENCE, "clipped": True}, "observations 0: 0; use 2 or more"),
        (BRIGHTNESS, {"reference": REFERENCE, "weights": 0}, "observations 0: 0; use 2 or more"),
        (with_nan(BRIGHTNESS), {"reference": REFERENCE}, r"brightness of shape \(2, 3\) holds NaN"),
        (BRIGHTNESS, {"reference": with_nan(REFERENCE)}, r"reference of shape \(3,\) holds NaN"),
        (BRIGHTNESS, {"exposures": [0, np.inf]}, r"exposures of shape \(2,\) holds NaN or infinite"),
        (BRIGHTNESS, {"reference": [0, 1, 2]}, "reference runs from 0 to 2; use values above 0"),
        (BRIGHTNESS, {"reference": [-1, 1, 2]}, "reference runs from -1 to 2; use values above 0"),
        (BRIGHTNESS, {"reference": [1, 2, 1e40]}, r"to 1e\+40; use values above 0, 1e-30 to 1e\+30"),
        (BRIGHTNESS, {"reference": REFERENCE, "reference_error": 0}, "reference_error runs from 0 to 0"),
        (2 * BRIGHTNESS, {"reference": REFERENCE}, "brightness runs from 0.4 to 1.4; use values from 0 to 1"),
        (-BRIGHTNESS, {"reference": REFERENCE}, "brightness runs from -0.7 to -0.2; use values from 0 to 1"),
        (BRIGHTNESS, {"reference": [1, 2]}, r"reference has shape \(2,\).*use \(1, 3\)"),
        (BRIGHTNESS, {"exposures": [0, 1, 2]}, r"exposures has shape \(3,\).*use \(1, 2\)"),
        (BRIGHTNESS, {"exposures": [30, 4000]}, "exposures span 3970 stops; use stops, the base-2 logarithm"),
        (BRIGHTNESS, {"reference": REFERENCE, "weights": with_nan(BRIGHTNESS)}, "^weights of shape .* holds NaN"),
        (BRIGHTNESS, {}, "^neither reference nor exposures are given; use one of them, or both$"),
        (BRIGHTNESS, {"reference": REFERENCE, "weights": [1, 2]}, r"weights has shape \(2,\).*use \(1, 2, 3\)"),
        (BRIGHTNESS, {"reference": REFERENCE, "weights": [1, 2, -1]}, r"weights run from -1 to 2; use 0 to 1e\+06"),
        (BRIGHTNESS, {"reference": REFERENCE, "weights": [1, 2, 1e9]}, r"weights run from 1 to 1e\+09"),
        (BRIGHTNESS, {"reference": REFERENCE, "clipped": [True] * 2}, r"clipped has shape \(2,\)"),
        (BRIGHTNESS[:1], {"exposures": [0]}, "unclipped in 2 photographs; use more exposures"),
        (np.stack([BRIGHTNESS, [[1] * 3, [0] * 3]]), {"exposures": [0, 1]}, "no patch of observations 1 is unclipped"),
        (np.stack([BRIGHTNESS, 0 * BRIGHTNESS + 0.4]), {"reference": REFERENCE}, "observations 1 have brightness 0.4"),
        (BRIGHTNESS, {"reference": REFERENCE, "absolute": True}, "^absolute=True needs both reference and exposures"),
    ],
)
def test_bad_input_is_refused_with_what_came_in(brightness, others, message):
    with pytest.raises(InputError, match=message):
        Observations(brightness, **others)


@pytest.mark.parametrize("shape", [(3, 4), (2, 3, 4), (2, 3, 4, 5, 3), (3,)])
def test_colours_of_another_shape_are_refused(shape):
    with pytest.raises(InputError, match=rf"rgb has shape {re.escape(str(shape))}"):
        Observations.from_rgb(np.full(shape, 0.5), REFERENCE)


def test_colours_that_are_not_finite_are_refused():
    with pytest.raises(InputError, match=r"^rgb of shape \(1, 2, 3\) holds NaN"):
        Observations.from_rgb(np.full((1, 2, 3), np.nan), REFERENCE[:2])


def test_saturated_and_black_patches_are_clipped_by_default():
    brightness = np.array([[0, 1 / 255, 0.5, 253.9 / 255, 254 / 255, 1]])
    observations = Observations(brightness, np.arange(1, 7))
    assert observations.clipped.tolist() == [[[True, False, False, False, True, True]]]
    assert observations.counts.tolist() == [[[False, True, True, True, False, False]]]
    weights = [1, 1, 0, 1, 1, 1]
    assert Observations(brightness, np.arange(1, 7), weights=weights).counts.sum() == 2


def test_one_set_is_a_batch_of_one():
    one = Observations(BRIGHTNESS, REFERENCE, exposures=[0, 1])
    assert len(one) == 1
    assert one.brightness.shape == (1, 2, 3)
    assert one.reference.shape == (1, 3)
    assert one.exposures.shape == (1, 2)


def test_taking_patches_keeps_all_that_belongs_to_them():
    rng = np.random.default_rng(0)
    brightness = rng.random((2, 3, 5))
    parts = {
        "clipped": rng.random((2, 3, 5)) < 0.2,
        "weights": rng.random((2, 3, 5)),
        "reference_error": rng.random((2, 5)) + 0.01,
    }
    reference = rng.random((2, 5)) + 0.1
    chosen = [4, 0, 2]
    taken = Observations(brightness, reference, [0, 1, 2], **parts).take(chosen)
    again = Observations(
        brightness[..., chosen],
        reference[:, chosen],
        [0, 1, 2],
        **{name: values[..., chosen] for name, values in parts.items()},
    )
    for name in ("brightness", "reference", "exposures", "clipped", "weights", "reference_error"):
        assert np.array_equal(getattr(taken, name), getattr(again, name))
    assert Observations(brightness, None, [0, 1, 2]).take(chosen).reference is None
    assert Observations(brightness, reference, [0, 1, 2], absolute=True).take(chosen).absolute


def test_grey_patches_are_trusted_more_than_coloured_ones():
    """A colour's mean of bent channels is off by what is added to the error of its reference."""
    rgb = np.array([[[0.4, 0.4, 0.4], [0.6, 0.35, 0.25], [0.7, 0.7, 0.7]]])
    observations = Observations.from_rgb(rgb, REFERENCE)
    assert np.allclose(observations.brightness, [[[0.4, 0.4, 0.7]]])
    grey, coloured, white = observations.reference_error[0]
    assert grey == white == 0.05
    linear = (rgb**2.2).mean(axis=-1)[0]
    off = np.log(linear[1] / linear[0])
    assert np.isclose(np.sqrt(coloured**2 - grey**2), off, rtol=0.2)
    assert Observations.from_rgb(rgb, REFERENCE, reference_error=0.1).reference_error[0].tolist() == [0.1] * 3


def test_a_slight_colour_is_off_by_what_the_second_order_says():
    """The logarithm of the mean of bent channels over the bent mean; two photographs of a patch count by their mean."""
    channels = 0.5 * (1 + np.array([[[0, 0, 0], [-0.02, 0.0, 0.02]], [[0, 0, 0], [0.03, -0.03, 0.0]]]))
    off = np.log((channels**2.2).mean(axis=-1) / channels.mean(axis=-1) ** 2.2)
    spread = np.sqrt(off).mean(axis=0) ** 2
    assert np.allclose(colour_error(channels), spread, rtol=0.02, atol=1e-12)
    assert np.allclose(colour_error(np.stack([channels, channels])), [spread, spread], rtol=0.02, atol=1e-12)
    assert colour_error(np.zeros((1, 2, 3))).tolist() == [0, 0]


@pytest.mark.parametrize(
    "given",
    [
        {"reference": [1e-30, 1.0, 1e30]},
        {"exposures": [-40.0, 60.0]},
        {"reference": REFERENCE, "weights": [0, 1, 1e6]},
        {"reference": REFERENCE, "reference_error": 1e30},
    ],
)
def test_what_is_just_allowed_fits(given):
    assert np.isfinite(calibrate(load_model("Gamma-1"), Observations(BRIGHTNESS, **given)).curves).all()


def test_an_absolute_reference_tells_the_scale_too():
    model = load_model("EMoR-3")
    truth = model.decode([[0.4, -0.1, 0.02]])[0]
    irradiance = np.array([0.01, 0.03, 0.08, 0.15])  # the lower end only: without the scale, many curves would do
    brightness = np.interp(irradiance * 2.0 ** np.array([[0.0], [1.0]]), truth, GRID)
    known = {"reference": irradiance, "exposures": [0.0, 1.0], "reference_error": 0.01}
    noise = Noise(brightness=0.002, exposure=0.005)
    absolute = calibrate(model, Observations(brightness, **known, absolute=True), noise=noise).curves[0]
    relative = calibrate(model, Observations(brightness, **known), noise=noise).curves[0]
    low = brightness.max() >= GRID
    assert rmse(absolute[low], truth[low]) < 0.01
    assert rmse(absolute[low], truth[low]) < rmse(relative[low], truth[low])
    doubled = {**known, "reference": 2 * irradiance}
    np.testing.assert_allclose(
        calibrate(model, Observations(brightness, **doubled), noise=noise).curves[0], relative, atol=1e-9
    )
    twice = calibrate(model, Observations(brightness, **doubled, absolute=True), noise=noise).curves[0]
    assert np.mean(twice[low]) > 1.3 * np.mean(absolute[low])
    with pytest.raises(InputError, match="absolute=True needs both"):
        Observations(brightness, irradiance, absolute=True)


def test_masked_brightness_weighs_nothing():
    brightness = np.array([[0.2, 0.9, 0.5, 0.7], [0.3, 0.4, 0.6, 0.1]])
    mask = np.array([[False, True, False, False], [False, False, False, True]])
    seen = Observations(np.ma.array(brightness, mask=mask), [1.0, 2.0, 4.0, 9.0])
    plain = Observations(brightness, [1.0, 2.0, 4.0, 9.0], weights=~mask)
    assert np.array_equal(seen.counts, plain.counts)
    model = load_model("Gamma-1")
    assert np.allclose(calibrate(model, seen).curves, calibrate(model, plain).curves)


@pytest.mark.parametrize("name", ["reference", "weights"])
def test_masked_values_elsewhere_are_refused(name):
    values = np.ma.array([1.0, 2.0, 4.0], mask=[False, True, False])
    with pytest.raises(InputError, match=f"{name} holds 1 masked values; fill them"):
        Observations([[0.2, 0.5, 0.7]], **{"reference": [1.0, 2.0, 4.0], name: values})


def test_tensors_with_gradients_are_refused_and_generators_read():
    torch = pytest.importorskip("torch")
    with pytest.raises(InputError, match=r"reference is a tensor that requires gradients; use reference\.detach\(\)"):
        Observations([[0.2, 0.5, 0.7]], torch.ones(3, requires_grad=True))
    assert Observations([[0.2, 0.5, 0.7]], (2.0**i for i in range(3))).reference.tolist() == [[1.0, 2.0, 4.0]]


@pytest.mark.parametrize("kind", [list, iter])
def test_masks_within_a_list_are_not_lost(kind):
    rows = [np.ma.array([0.2, 0.5, 0.7], mask=[False, False, True]), np.ma.array([0.3, 0.6, 0.9])]
    with pytest.raises(InputError, match="brightness holds 1 masked values; fill them"):
        Observations(kind(rows), [1.0, 2.0, 4.0])
    assert Observations(kind(rows[1:]), [1.0, 2.0, 4.0]).brightness.tolist() == [[[0.3, 0.6, 0.9]]]


def test_weighed_observations_count_for_so_much():
    seen = Observations([[0.2, 0.5, 0.8], [0.3, 0.6, 0.9]], [1, 2, 3], [0, 1], weights=2.0, colour=0.1, absolute=True)
    less = seen.weighed(np.array([0.5, 1.0, 0.0]))
    assert less.weights.tolist() == [[[1.0, 2.0, 0.0]] * 2]
    assert less.absolute
    for name in ("brightness", "reference", "exposures", "clipped", "reference_error", "colour"):
        np.testing.assert_array_equal(getattr(less, name), getattr(seen, name))
