"""Exposure series: known responses are recovered, merges are exact where they can be, files read back elsewhere."""

import re
import struct
import tracemalloc

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from crfbench.camera import (
    Passport,
    calibrate_series,
    merge_series,
    render_series,
    write_hdr,
)
from crfbench.camera import calibrate as camera_calibrate
from crfbench.camera.photographs import as_times, plan_photographs, read_planned
from crfbench.camera.reading import read_levels
from crfbench.camera.series import (
    black_floor,
    equalised,
    find_shifts,
    find_white,
    reduce_image,
    sample_series,
    shifted,
)
from crfbench.curves import GRID, invert
from crfbench.datasets import load_opencrf
from crfbench.errors import InputError
from crfbench.metrics import rmse
from crfbench.models import load_model
from crfbench.models.registry import DEFAULT_MODEL

SIZE = (240, 160)
GAMMA = GRID ** (1 / 2.2)


def scaled_rmse(curve, truth):
    """Compare up to the scale, which exposures do not tell, where the camera is neither black nor saturated."""
    curve, truth = curve[4:1016], truth[4:1016]
    return float(rmse((curve * truth).sum() / (curve**2).sum() * curve, truth))


@pytest.mark.parametrize("row", [3, 60, 120, 148])
def test_recovers_known_responses(row):
    response = load_opencrf().curves[row]
    series = render_series(response, row, size=SIZE)
    found = calibrate_series(series.images, series.stops, load_model("PPISP-4"))
    assert scaled_rmse(found.curves[0], invert(response)) < 0.015


def test_bands_hold_known_responses():
    """White too, where exposures do not tell the scale."""
    held = []
    for row in (3, 20, 60, 100, 120, 148):
        response = load_opencrf().curves[row]
        series = render_series(response, row, size=SIZE)
        low, high = calibrate_series(series.images, series.stops, load_model(DEFAULT_MODEL)).bands[0.9]
        held.append(np.mean((low[0] <= invert(response)) & (invert(response) <= high[0])))
    assert np.mean(held) > 0.8


@pytest.mark.parametrize("name", ["Agfa Vista 100 R", "Fuji Pro 400H R", "Protune", "Gamma 2.6"])
def test_many_clean_blocks_outweigh_the_prior_and_the_same_errors_over_and_over_do_not(name):
    responses = load_opencrf()
    truth = invert(responses.curves[list(responses.names).index(name)])
    series = render_series(invert(truth), 1, size=(480, 320))
    bent = [np.clip(image + np.rint(4 * np.sin(image / 9.0)), 0, 255).astype(np.uint8) for image in series.images]
    (clean, width), (wrong, wide) = (
        (scaled_rmse(found.curves[0], truth), np.mean(found.bands[0.9][1] - found.bands[0.9][0]))
        for found in (calibrate_series(images, series.stops) for images in (series.images, bent))
    )
    assert clean < 0.0025
    assert width < 0.5 * wide
    assert wrong < wide


def film(irradiance):
    """An S-shaped response of a log film, which no family holds."""
    logs = np.log1p(60 * np.clip(irradiance, 0, 1)) / np.log1p(60)
    ends = 1 / (1 + np.exp(-9 * (np.array([0, 1]) - 0.45)))
    return (1 / (1 + np.exp(-9 * (logs - 0.45))) - ends[0]) / (ends[1] - ends[0])


def film_series(white, depth):
    """A scene of patches whose brightest, in the longest of seven exposures, is `white` times what fills the film."""
    rng = np.random.default_rng(1)
    scene = np.kron(np.exp(rng.normal(0, 1, (12, 18, 3))), np.ones((20, 20, 1))) * np.linspace(0.6, 1.4, 360)[:, None]
    stops = np.arange(-4.0, 3.0)
    shots = film(white * scene / np.quantile(scene, 0.98) * 2 ** (stops - 2)[:, None, None, None])
    top = np.iinfo(depth).max
    return [np.rint(top * shot).astype(depth) for shot in shots], stops


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_of_a_clean_series_nothing_is_said(depth):
    found = calibrate_series(*film_series(4.0, depth))
    assert not any(found.warnings)
    assert scaled_rmse(found.curves[0], invert(film(GRID))) < 0.01


def test_a_series_far_from_white_is_told_so():
    found = calibrate_series(*film_series(0.1, np.uint8))
    assert "nothing that two exposures show is brighter than 0." in found.warnings[0][-1]
    assert "for the scale, the model speaks alone" in found.warnings[0][-1]


@pytest.mark.parametrize("latent", [-0.8, 0.6])
@pytest.mark.parametrize("method", ["posterior", "map"])
def test_a_model_recovers_its_own_curves(latent, method):
    model = load_model("SLR-monotone-1")
    truth = model.decode([[latent]])[0]
    series = render_series(invert(truth), 1, size=SIZE)
    found = calibrate_series(series.images, series.stops, model, method)
    assert scaled_rmse(found.curves[0], truth) < 0.01


def shifts_of(images, stops):
    return find_shifts([equalised(image) for image in images], np.array(stops), images[0].shape)


def test_photographs_from_the_hand_are_laid_over_each_other():
    response = load_opencrf().curves[40]
    series = render_series(response, 4, size=(480, 320))
    off = np.array([[9, -4], [-7, 11], [0, 0], [3, 12], [-12, -6]])
    shaken = [np.roll(image, (y, x), (0, 1)) for image, (x, y) in zip(series.images, off, strict=True)]
    shifts = shifts_of(shaken, series.stops)
    assert np.array_equal(shifts, off[2] - off)
    images = [shifted(image, *shift) for image, shift in zip(shaken, shifts, strict=True)]
    inside = np.s_[24:-24, 24:-24]
    for image, still in zip(images, series.images, strict=True):
        assert np.array_equal(image[inside], still[inside])
    before, after = (
        scaled_rmse(calibrate_series(each, series.stops).curves[1], invert(response)) for each in (shaken, images)
    )
    assert after < 0.01 < before


def test_still_photographs_and_those_of_other_scenes_are_not_shifted():
    one, other = (render_series(GAMMA, seed, size=SIZE) for seed in (1, 2))
    assert not shifts_of(one.images, one.stops).any()
    assert not shifts_of([one.images[0], other.images[1]], [0, 1]).any()


@pytest.mark.parametrize("size", [(130, 90), (150, 134), (240, 160)])  # 135 x 90, odd, is quickest to transform
def test_small_errors_of_many_steps_do_not_add_up_to_a_shift(size):
    rng = np.random.default_rng(0)
    image = render_series(GAMMA, 0, size=size).images[2]
    noisy = [np.clip(image + rng.normal(0, 6, image.shape), 0, 255).astype(np.uint8) for _ in range(12)]
    assert not shifts_of(noisy, np.arange(12)).any()
    moved = [np.roll(each, k // 4, 1) for k, each in enumerate(noisy)]
    assert shifts_of(moved, np.arange(12))[:, 0].tolist() == [1] * 4 + [0] * 4 + [-1] * 4


def test_times_in_place_of_stops_are_told():
    series = render_series(GAMMA, 1, size=(240, 160))
    with pytest.raises(InputError, match=r"doubles .* where exposures say 0\.0.* stops, .*give exposures in stops"):
        calibrate_series(series.images, 2.0**series.stops / 60)
    assert "stops" not in "".join(calibrate_series(series.images, series.stops).warnings[0])
    exchanged = "".join(calibrate_series(series.images, series.stops[[0, 1, 3, 2, 4]]).warnings[0])
    assert re.search(r"photograph 3 is 1\.\d stops below photograph 4; its exposure says 1\.0 stops above", exchanged)


def test_what_moves_is_left_out_and_told():
    response = load_opencrf().curves[0]
    series = render_series(response, 0, size=(480, 320))
    moving = [
        cv2.circle(image.copy(), (60 + 70 * i, 160), 50, (40 * i + 30, 200 - 30 * i, 120), -1)
        for i, image in enumerate(series.images)
    ]
    found = calibrate_series(moving, series.stops)
    assert all(scaled_rmse(curve, invert(response)) < 0.01 for curve in found.curves)
    assert all("do not follow the exposures" in "; ".join(told) for told in found.warnings)
    still = calibrate_series(series.images, series.stops)
    assert not any("do not follow" in text for told in still.warnings for text in told)


@pytest.mark.parametrize("visited", [1, 3])
def test_the_photograph_that_something_passed_through_is_named(visited):
    series = render_series(load_opencrf().curves[0], 0, size=(480, 320))
    images = [image.copy() for image in series.images]
    cv2.circle(images[visited], (200, 160), 80, (120, 90, 60), -1)
    named = [reduce_image(image, f"{i}.jpg") for i, image in enumerate(images)]
    for shown, name in ((named, f"{visited}.jpg"), (images, f"photograph {visited + 1}")):
        warned = calibrate_series(shown, series.stops).warnings
        assert all(f"most in {name}; they are left out" in "".join(texts) for texts in warned)


@pytest.mark.parametrize(("more", "told"), [(12, False), (60, True)])
def test_stray_light_in_dark_places_is_no_movement(more, told):
    """Twelve levels of 255 are much irradiance where it is dark, and yet a small change of brightness."""
    series = render_series(load_opencrf().curves[0], 0, size=(240, 160))
    images = [image.copy() for image in series.images]
    left = images[1][:, :120]
    left += np.uint8(more) * ((left > 25) & (left < 60))
    warned = calibrate_series(images, series.stops).warnings
    assert any("do not follow the exposures" in text for each in warned for text in each) == told


def test_where_nearly_all_moves_a_series_is_still_calibrated():
    scenes = [render_series(GAMMA, seed, size=SIZE) for seed in range(5)]
    images = [scene.images[i] for i, scene in enumerate(scenes)]
    found = calibrate_series(images, scenes[0].stops)
    assert np.isfinite(found.curves).all()
    assert (found.observations.counts.sum(axis=(1, 2)) > 20).all()


def test_each_channel_has_its_own_curve():
    series = render_series(GAMMA, 2, size=SIZE)
    gammas = (1.4, 1.0, 0.7)  # beyond 2.2, channel by channel
    images = [
        np.rint(255 * (image / 255.0) ** np.array([1 / gamma for gamma in gammas])).astype(np.uint8)
        for image in series.images
    ]
    found = calibrate_series(images, series.stops, load_model("PPISP-4"))
    assert found.curves.shape == (3, 1024)
    for curve, gamma in zip(found.curves, gammas, strict=True):
        assert scaled_rmse(curve, GRID ** (2.2 * gamma)) < 0.02


def test_a_pixel_of_misalignment_does_little_harm():
    series = render_series(GAMMA, 3, size=SIZE)
    moved = [np.roll(image, (i % 2, i // 2 % 2), axis=(0, 1)) for i, image in enumerate(series.images)]
    found = calibrate_series(moved, series.stops, load_model("PPISP-4"))
    assert scaled_rmse(found.curves[0], GRID**2.2) < 0.02


def test_samples_cover_the_range_and_are_measured_twice():
    series = render_series(GAMMA, 4, size=SIZE)
    seen = sample_series(series.images, series.stops, seed=1)
    measured = seen.brightness[seen.counts]
    assert seen.brightness.shape[2] <= 256
    assert (seen.counts.sum(axis=1) >= 2).all()
    assert np.histogram(measured, bins=10, range=(0, 1))[0].min() >= 10
    same, other = (sample_series(series.images, series.stops, seed=seed) for seed in (1, 2))
    np.testing.assert_array_equal(seen.brightness, same.brightness)
    assert not np.array_equal(seen.brightness, other.brightness)


def test_samples_are_true_block_means():
    """Every block is uniform, so that what is sampled must be one of the levels that were painted."""
    rng = np.random.default_rng(0)
    light = np.repeat(np.repeat(rng.integers(1, 60, (20, 20)), 5, axis=0), 5, axis=1)
    images = [(light * factor).astype(np.uint16) * 256 for factor in (1, 2, 4)]
    seen = sample_series(images, [0, 1, 2])
    first, second, third = seen.brightness[0] * 65535 / 256
    assert len(np.unique(first.round(3))) > 50
    np.testing.assert_allclose([second, third], [2 * first, 4 * first], rtol=1e-6)
    np.testing.assert_allclose(first, first.round(), atol=1e-6)


def test_merge_of_linear_photographs_is_exact():
    base = np.random.default_rng(0).integers(1, 2**12, (40, 30, 3))
    stops = np.array([-1.0, 0.0, 2.0, 4.0])
    images = [np.minimum(base * 2.0 ** (stop + 1), 65535).astype(np.uint16) for stop in stops]
    merged = merge_series(images, stops, GRID)
    assert merged.radiance.dtype == np.float32
    np.testing.assert_allclose(merged.radiance, base * 2 / 65535, rtol=2e-6)
    assert merged.weight.shape == (40, 30)
    assert (merged.weight > 0).all()


def test_merge_weighs_by_inverse_variance():
    """For a linear camera irradiance has the noise of brightness and of the sensor, over the square of the exposure."""
    merged = merge_series([np.uint8([[51]]), np.uint8([[120]])], [0, 1], GRID)
    precision = np.array([1, 4]) / (0.01**2 + 0.002**2)
    expected = precision @ (np.array([51, 60]) / 255) / precision.sum()
    np.testing.assert_allclose(merged.radiance, expected, rtol=1e-5)
    np.testing.assert_allclose(merged.weight, precision.sum() * expected**2, rtol=1e-4)


@pytest.mark.parametrize("gamma", [1.8, 2.2])
def test_noise_of_the_sensor_makes_the_dark_no_brighter(gamma):
    """What noise makes brighter must count no more than what it makes darker."""
    light, rng = np.repeat(np.geomspace(0.01, 0.5, 16), 4096).reshape(256, 256), np.random.default_rng(0)
    stops = np.arange(-6.0, 1.0)
    noisy = [np.clip(light * 2.0**stop + rng.normal(0, 0.002, light.shape), 0, 1) for stop in stops]
    images = [np.rint(255 * each ** (1 / gamma)).astype(np.uint8) for each in noisy]
    merged = merge_series(images, stops, GRID**gamma).radiance.reshape(16, -1)
    middle = np.median(merged, axis=1) / light.reshape(16, -1)[:, 0]
    np.testing.assert_allclose(middle, 1.0, atol=0.05)


def test_what_spills_over_from_saturated_neighbours_counts_where_nothing_else_does():
    """A pixel of level 60 whose longer exposure shows 251 in place of 255."""
    dark, spilt, black = (np.uint8([[level]]) for level in (60, 251, 0))
    np.testing.assert_allclose(merge_series([dark, spilt], [0, 6], GRID).radiance, 60 / 255, rtol=1e-3)
    np.testing.assert_allclose(merge_series([black, spilt], [0, 6], GRID).radiance, 251 / 255 / 64, rtol=1e-3)
    np.testing.assert_allclose(merge_series([spilt, np.uint8([[255]])], [0, 6], GRID).radiance, 251 / 255, rtol=1e-3)


def test_band_adds_its_own_variance():
    """Half a band of 90 % is 1.645 standard deviations."""
    half = 0.2 * GRID * (1 - GRID)
    passport = Passport("inverse", GRID, low=GRID - half, high=GRID + half, level=0.9)
    merged = merge_series([np.uint8([[51]]), np.uint8([[102]])], [0, 1], passport)
    b = np.array([0.2, 0.4])
    variance = (0.2 * b * (1 - b) / 1.645) ** 2 + 0.01**2 + 0.002**2
    np.testing.assert_allclose(merged.weight, 0.2**2 * (np.array([1, 4]) / variance).sum(), rtol=1e-3)


def test_calibration_and_passports_merge_alike():
    series = render_series(GAMMA, 5, size=(60, 40))
    found = calibrate_series(series.images, series.stops, per_channel=False)
    curves, (low, high) = found.curves[0], (band[0] for band in found.bands[0.9])
    forward = invert(curves)
    for alike in (
        [found, Passport("inverse", curves, low=low, high=high, level=0.9)],
        [invert(forward), Passport("forward", forward), Passport("inverse", invert(forward))],
    ):
        first, *others = (merge_series(series.images, series.stops, response) for response in alike)
        for other in others:
            np.testing.assert_allclose(other.radiance, first.radiance, rtol=1e-5)
            np.testing.assert_allclose(other.weight, first.weight, rtol=1e-5)


def test_clipped_everywhere_weighs_nothing_and_takes_the_nearest_end():
    low, high = np.full((2, 2, 3), 100, np.uint8), np.full((2, 2, 3), 200, np.uint8)
    low[0, 0], high[0, 0] = 255, 255
    low[0, 1], high[0, 1] = 0, 0
    low[1, 0, 1], high[1, 0, 1] = 0, 255  # one channel jumps from black to white
    merged = merge_series([low, high], [-1, 0], GRID)
    assert (merged.weight > 0).tolist() == [[False, False], [False, True]]
    assert merged.radiance[0, 0].tolist() == [2.0, 2.0, 2.0]
    assert merged.radiance[0, 1].tolist() == [0.0, 0.0, 0.0]
    assert merged.radiance[1, 0, 1] == 1.0


def test_merged_radiance_is_near_the_truth():
    series = render_series(GAMMA, 6, size=SIZE)
    found = calibrate_series(series.images, series.stops, load_model("PPISP-4"))
    merged = merge_series(series.images, series.stops, found)
    known = merged.weight > 0
    ratio = merged.radiance[known] / series.radiance[known]
    assert known.mean() > 0.6
    assert np.median(np.abs(ratio / np.median(ratio) - 1)) < 0.04


def test_stray_light_in_dark_frames_does_not_reach_the_merged_image():
    """Frames that are too short show levels 1 to 4 whatever the light was; the longer ones know better."""
    rng = np.random.default_rng(0)
    light = 10 ** rng.uniform(-3.5, -0.5, (100, 100))
    stops = np.arange(-10.0, 1.0)
    seen = [np.rint(255 * (light * 2**stop) ** (1 / 2.2) + rng.normal(0, 1, light.shape)) for stop in stops]
    stray = [np.maximum(image, rng.integers(1, 5, light.shape)).clip(0, 255).astype(np.uint8) for image in seen]
    error = np.abs(merge_series(stray, stops, GRID**2.2).radiance / light - 1)
    assert np.median(error) < 0.05
    assert np.quantile(error, 0.95) < 0.6
    darkest = merge_series([image // 64 for image in stray], stops, GRID**2.2)  # what no frame shows well is not lost
    assert (darkest.radiance[stray[-1] >= 64] > 0).all()


def test_a_scene_that_is_mostly_dark_is_calibrated_channel_by_channel():
    rng = np.random.default_rng(1)
    light = 10 ** rng.uniform(-1.5, -0.3, (160, 240, 3)).repeat(5, axis=0)[:160].repeat(5, axis=1)[:, :240]
    light[:, 40:] = 1e-5  # two levels in the longest exposure
    stops = np.arange(-6.0, 1.0)
    seen = [255 * (light * 2**stop) ** (1 / 2.2) + rng.normal(0, 0.6, light.shape) for stop in stops]
    found = calibrate_series([image.clip(1, 255).astype(np.uint8) for image in seen], stops, load_model("PPISP-4"))
    assert len(found.curves) == 3
    for curve in found.curves:
        assert scaled_rmse(np.append(curve[:600], np.zeros(424)), np.append(GRID[:600] ** 2.2, np.zeros(424))) < 0.01


SERIES = st.tuples(
    st.tuples(st.integers(1, 30), st.integers(1, 30)),
    st.lists(st.integers(-12, 12), min_size=2, max_size=5, unique=True),
    st.sampled_from([np.uint8, np.uint16]),
    st.sampled_from([(), (3,)]),
    st.integers(0, 2**31),
)


def random_images(size, stops, dtype, channels, seed):
    rng = np.random.default_rng(seed)
    return [rng.integers(np.iinfo(dtype).max, size=(*size, *channels), dtype=dtype, endpoint=True) for _ in stops]


@given(SERIES, st.integers(-5, 5))
@settings(max_examples=60)
def test_merge_keeps_order_unit_and_pixels_apart(case, shift):
    size, stops, *_ = case
    images = random_images(*case)
    whole = merge_series(images, stops, GRID**2)
    assert whole.radiance.shape == images[0].shape
    assert whole.weight.shape == size
    assert np.isfinite(whole.radiance).all()
    shifted = merge_series(images, np.add(stops, shift), GRID**2)
    np.testing.assert_allclose(shifted.radiance, whole.radiance / 2.0**shift, rtol=1e-6)
    turned = merge_series(images[::-1], stops[::-1], GRID**2)
    np.testing.assert_allclose(turned.radiance, whole.radiance, rtol=1e-5)
    row = size[0] // 2
    alone = merge_series([image[row : row + 1] for image in images], stops, GRID**2)
    np.testing.assert_array_equal(alone.radiance[0], whole.radiance[row])
    np.testing.assert_array_equal(alone.weight[0], whole.weight[row])


@given(SERIES)
@settings(max_examples=60)
def test_sampling_gives_observations_or_one_clear_error(case):
    try:
        seen = sample_series(random_images(*case), case[1])
    except InputError as error:
        assert "use" in str(error)  # noqa: PT017
    else:
        assert (seen.counts.sum(axis=1) >= 2).all()
        assert seen.brightness.shape[1] == len(case[1])


def test_merging_needs_little_memory_beside_its_result():
    images = [np.full((1500, 2000, 3), level, np.uint8) for level in (50, 90, 130, 200)]
    merge_series([image[:10] for image in images], range(4), GRID)
    tracemalloc.start()
    merged = merge_series(images, range(4), GRID)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < merged.radiance.nbytes + merged.weight.nbytes + 40e6


def test_photographs_that_are_read_one_by_one_are_not_held():
    images = (np.full((1000, 2000, 3), level, np.uint8) for level in range(20, 220, 10))  # 120 MB
    tracemalloc.start()
    merged = merge_series(images, range(20), GRID)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2 * merged.radiance.nbytes + merged.weight.nbytes + 50e6


def test_what_a_photograph_is_reduced_to_calibrates_alike_and_is_small():
    series = render_series(GAMMA, 2, size=SIZE)
    whole, reduced = calibrate_series(series.images, series.stops), [reduce_image(each) for each in series.images]
    np.testing.assert_array_equal(calibrate_series(reduced, series.stops).curves, whole.curves)
    large = reduce_image(np.random.default_rng(0).integers(0, 255, (3000, 4000, 3), np.uint8))
    assert large.blocks.nbytes + large.pixels.nbytes < 8e6
    assert large.blocks.shape[2] > 60_000


def test_16_bits_are_reduced_as_the_same_8():
    image = np.random.default_rng(0).integers(0, 256, (60, 80, 3), np.uint8)
    fine, coarse = reduce_image(image * np.uint16(257)), reduce_image(image)
    assert (fine.pixels == coarse.pixels).all()
    np.testing.assert_allclose(fine.blocks, coarse.blocks, atol=1 / 255)


def test_many_photographs_are_sampled_more_thinly():
    series = render_series(GAMMA, 1, size=(75, 50), stops=np.linspace(-3, 3, 400))
    seen = sample_series(series.images, series.stops)
    assert seen.brightness.shape[1] == 400
    assert 32 <= seen.brightness.shape[2] <= 2**15 // 400


FLAT = np.full((20, 20, 3), 90, np.uint8)
STEEP = [np.full((20, 20, 3), level, np.uint8) for level in (60, 120)]


@pytest.mark.parametrize(
    ("images", "stops", "message"),
    [
        (STEEP[:1], [0], "has 1 images; use two or more"),
        ([], [], "has 0 images"),
        ([STEEP[0], STEEP[1][:10]], [0, 1], r"image 1 uint8 \(10, 20, 3\); use images of one size"),
        ([STEEP[0], STEEP[1].astype(np.uint16)], [0, 1], "image 1 uint16"),
        ([FLAT / 255] * 2, [0, 1], "image 0 is float64"),
        ([STEEP[0], np.ma.masked_greater(STEEP[1], 0)], [0, 1], r"images holds \d+ masked values"),
        ([FLAT[..., :2]] * 2, [0, 1], r"shape \(20, 20, 2\)"),
        ([FLAT * 0, FLAT * 0 + 255], [0, 1], "none of 48 blocks is unclipped in two exposures"),
        ([FLAT, FLAT], [0, 1], "brightness changes by 0 where exposure rises"),
        (STEEP, [1, 0], "brightness changes by -0.235"),
        (STEEP, None, "exposures=None holds"),
        (STEEP, [1, 1], "span 0 stops; use unequal ones"),
        (STEEP, [0, 1, 2], "do not match 2 images"),
        (STEEP, [0, np.nan], "do not match 2 images"),
        (STEEP, [0, 1000], "span 1000 stops"),
        (STEEP, "exif", "exposures='exif' holds text"),
    ],
)
def test_what_cannot_be_sampled(images, stops, message):
    with pytest.raises(InputError, match=message):
        sample_series(images, stops)


def test_masked_photographs_are_not_merged():
    for masked in ([np.ma.masked_less(FLAT, 300)] * 2, iter([np.ma.masked_less(FLAT, 300)] * 2)):
        with pytest.raises(InputError, match=r"images holds \d+ masked values"):
            merge_series(masked, [0, 1], GRID)


@pytest.mark.parametrize(
    ("response", "message"),
    [(np.tile(GRID, (2, 1)), "2 curves do not match images of 3 channels"), (GRID[::-1], "falls")],
)
def test_what_cannot_be_merged(response, message):
    with pytest.raises(InputError, match=message):
        merge_series(STEEP, [0, 1], response)


@pytest.mark.parametrize(
    ("images", "message"),
    [
        ([FLAT, FLAT[..., 0]], "image 1 uint8"),
        ([FLAT, np.uint16(FLAT)], "image 1 uint16"),
        ([FLAT, FLAT[1:]], "use images of one size"),
        ([FLAT], "more or fewer images than 2 exposures"),
        ([FLAT] * 3, "more or fewer images than 2 exposures"),
        ([FLAT / 255] * 2, "image 0 is float64"),
    ],
)
def test_images_taken_one_by_one_are_checked(images, message):
    with pytest.raises(InputError, match=message):
        merge_series(iter(images), [0, 1], GRID)


def test_series_may_be_generators():
    found = calibrate_series(iter(WALL.images), WALL.stops)
    np.testing.assert_array_equal(found.curves, calibrate_series(WALL.images, WALL.stops).curves)


def read_exr(content):
    """Read an RGB float EXR of scan lines without compression, after the file layout of the OpenEXR documentation."""
    assert content[:4] == b"\x76\x2f\x31\x01"
    at, attributes = 8, {}
    while content[at]:
        name, kind = content[at:].split(b"\0", 2)[:2]
        at += len(name) + len(kind) + 6
        (size,) = struct.unpack_from("<i", content, at - 4)
        attributes[name] = content[at : at + size]
        at += size
    left, top, right, bottom = struct.unpack("<4i", attributes[b"dataWindow"])
    assert attributes[b"compression"] == b"\0"
    assert attributes[b"channels"].startswith(b"B\0")  # then G, R: sorted by name
    width, height = right - left + 1, bottom - top + 1
    offsets = struct.unpack_from(f"<{height}Q", content, at + 1)
    lines = [np.frombuffer(content, "<f4", 3 * width, offset + 8).reshape(3, width).T for offset in offsets]
    return np.stack(lines)[..., ::-1]


RADIANCE = np.float32(10.0) ** np.random.default_rng(0).uniform(-4, 4, (37, 21, 3)).astype(np.float32)


@pytest.mark.parametrize("image", [RADIANCE, np.tile(np.float32([0.25, 0.5, 1e6]), (20, 50, 1))])
def test_files_read_back_exactly_elsewhere(tmp_path, image):
    for name in ("a.exr", "a.tif", "b.TIFF"):
        write_hdr(tmp_path / name, image)
    np.testing.assert_array_equal(read_exr((tmp_path / "a.exr").read_bytes()), image)
    for name in ("a.tif", "b.TIFF"):
        np.testing.assert_array_equal(cv2.imread(tmp_path / name, cv2.IMREAD_UNCHANGED)[..., ::-1], image)


def test_radiance_files_keep_eight_bits(tmp_path):
    write_hdr(tmp_path / "a.hdr", RADIANCE)
    back = cv2.imread(tmp_path / "a.hdr", cv2.IMREAD_UNCHANGED)[..., ::-1]
    assert (np.abs(back - RADIANCE).max(axis=2) <= RADIANCE.max(axis=2) / 128).all()


@pytest.mark.parametrize(
    ("name", "image", "message"),
    [
        ("a.png", RADIANCE, "tells no format; let it end in one of .exr"),
        ("a.exr", RADIANCE[0, :, 0], r"shape \(21,\)"),
        ("a.exr", RADIANCE[:0], r"shape \(0, 21, 3\)"),
        ("a.exr", -RADIANCE, "negative"),
        ("a.exr", RADIANCE * np.nan, "not finite"),
        ("a.exr", [["x"]], "numbers of shape"),
    ],
)
def test_what_cannot_be_written(tmp_path, name, image, message):
    with pytest.raises(InputError, match=message):
        write_hdr(tmp_path / name, image)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a.exr", "a.tif", "a.hdr"])
def test_nothing_is_replaced_unasked(tmp_path, name):
    (tmp_path / name).write_bytes(b"mine")
    with pytest.raises(InputError, match="exists already"):
        write_hdr(tmp_path / name, RADIANCE)
    assert (tmp_path / name).read_bytes() == b"mine"
    write_hdr(tmp_path / name, RADIANCE, overwrite=True)
    assert len((tmp_path / name).read_bytes()) > 1000
    assert [path.name for path in tmp_path.iterdir()] == [name]


def save_photograph(path, seconds):
    exif = Image.Exif()
    if seconds:
        exif.get_ifd(0x8769).update({0x829A: seconds, 0x829D: 8.0, 0x8827: 200})
    Image.fromarray(FLAT).save(path, exif=exif)


def test_a_series_by_exif_reports_what_it_leaves_out(tmp_path):
    for name, seconds in (("1.jpg", 0.01), ("2.jpg", 0.04), ("3.jpg", None), ("5.JPEG", 0.16)):
        save_photograph(tmp_path / name, seconds)
    (tmp_path / "4.jpg").write_bytes(b"no photograph")
    names = ("1.jpg", "2.jpg", "3.jpg", "4.jpg", "5.JPEG", "6.jpg")
    images, plan = read_planned(plan_photographs([tmp_path / name for name in names]), read_levels)
    np.testing.assert_allclose(plan.stops, [0, 2, 4], atol=1e-6)
    assert len(images) == 3
    np.testing.assert_allclose(images[2].astype(float), FLAT, atol=1)
    reasons = {path.name: reason for path, reason in plan.problems.items()}
    assert sorted(reasons) == ["3.jpg", "4.jpg", "6.jpg"]
    assert reasons["3.jpg"].startswith("3.jpg does not tell its exposure; give times (--exposures 1/60,")


def test_a_series_keeps_every_level_of_16_bits(tmp_path):
    image = np.arange(65536, dtype=np.uint16).reshape(128, 512)
    image = np.stack([image, image.T.reshape(128, 512), image[::-1]], axis=2)
    for name in ("1.png", "2.tif"):
        cv2.imwrite(str(tmp_path / name), image[..., ::-1])
    (tmp_path / "0.png").touch()
    paths = [tmp_path / "0.png", tmp_path / "1.png", tmp_path / "2.tif"]
    images, plan = read_planned(plan_photographs(paths, [9.0, 0.5, 0.125]), read_levels)
    assert plan.stops.tolist() == [0.0, -2.0]
    for read in images:
        np.testing.assert_array_equal(read, image)


@pytest.mark.parametrize("exposures", [[1.0], [1.0, 0.0], [1.0, np.inf], ["a", "b"]])
def test_times_that_do_not_match(exposures):
    with pytest.raises(InputError, match=r"do not match 2 photographs|is not an exposure time"):
        as_times(exposures, ["1.jpg", "2.jpg"])


def test_photographs_that_contradict_their_exposures_are_told_apart():
    series = render_series(load_opencrf().curves[5], 2, size=(96, 64))
    wrong = np.array(series.stops, dtype=float)
    wrong[2:] += 1.5  # between the second and the third
    right, found = (calibrate_series(series.images, stops) for stops in (series.stops, wrong))
    assert np.abs(np.diff(right.exposure_errors, axis=1)).max() < 0.3
    steps = np.diff(found.exposure_errors, axis=1)[0]
    assert steps.argmin() == 1
    assert steps[1] < -0.5


@pytest.mark.parametrize("row", [10, 60, 100, 150])
def test_exposures_that_nobody_told_are_estimated_up_to_a_power(row):
    response = load_opencrf().curves[row]
    series = render_series(response, row, size=SIZE, stops=[0.5, -3.0, 2.0, -1.0, 1.0])
    found = calibrate_series(series.images, None)
    stops, truth = found.observations.exposures[0], invert(response)
    power, start = np.polyfit(series.stops, stops, 1)
    np.testing.assert_allclose(power * series.stops + start, stops, atol=0.15)
    assert scaled_rmse(found.curves[0] ** (1 / power), truth) < 0.02
    (low, high), (low_known, high_known) = (
        each.bands[0.9] for each in (found, calibrate_series(series.images, series.stops))
    )
    assert ((truth >= low[0]) & (truth <= high[0]))[50:974].mean() > 0.8
    assert (high - low).mean() > 2 * (high_known - low_known).mean()
    assert re.match("the exposures are estimated .*any power of the curve fits as well", found.warnings[0][-1])


@pytest.mark.parametrize("n", [31, 70])
def test_many_close_exposures_are_estimated_too(n):
    series = render_series(GAMMA, 3, size=(120, 80), stops=np.linspace(-1.5, 1.5, n).tolist())
    found = calibrate_series(series.images, None)
    (low, high), truth = found.bands[0.9], invert(GAMMA)
    assert np.mean((low <= truth) & (truth <= high)) > 0.85
    told = found.observations.exposures[0]
    assert np.corrcoef(told, series.stops)[0, 1] > 0.999, "even steps"
    assert 1.5 < np.ptp(told) < 6


def test_a_floor_that_does_not_follow_the_exposure_is_found_and_told():
    series = render_series(load_opencrf().curves[5], 3, size=(192, 128), stops=np.arange(-4.0, 3.0), decades=4.5)
    assert not black_floor(series.images, series.stops, calibrate_series(series.images, series.stops).curves).any()
    lifted = [np.maximum(image, 24) for image in series.images]
    found = calibrate_series(lifted, series.stops)
    assert "below brightness 0.1" in found.warnings[0][-1]
    assert "nothing follows the exposure" in found.warnings[0][-1]
    assert (found.curves[0][GRID < 20 / 255] == 0).all()
    assert (found.bands[0.9][1][0][GRID < 20 / 255] >= 0).all()


@pytest.mark.parametrize("rows", [0, 6, 40])
def test_a_level_that_stands_still_above_those_that_follow_is_no_floor(rows):
    """As where something of that brightness does not take part; what lies between it and the floor is light."""
    series = render_series(load_opencrf().curves[5], 3, size=(192, 128), stops=np.arange(-4.0, 3.0), decades=4.5)
    curves = calibrate_series(series.images, series.stops).curves
    images = [np.maximum(image, 24) for image in series.images]
    for image in images:
        image[:rows] = 50
    assert (np.abs(255 * black_floor(images, series.stops, curves) - 25) <= 1).all()


# --- white below the top of the range


WALL = render_series(GAMMA, 3, size=SIZE, stops=range(-3, 4))


def ending_at(top, bottom=0, dtype=np.uint8):
    """Return the series with brightness 0 and 1 at other levels."""
    return [np.rint(bottom + (top - bottom) / 255 * image).astype(dtype) for image in WALL.images]


def white_of(images, stops=WALL.stops):
    return find_white([reduce_image(image) for image in images], stops)


@pytest.mark.parametrize(("top", "bottom"), [(235, 0), (235, 16), (187, 0)])
def test_white_is_where_a_series_ends(top, bottom):
    images = ending_at(top, bottom)
    assert white_of(images) == pytest.approx((top - 1) / 255)
    found = calibrate_series(images, WALL.stops)
    assert all(f"end at brightness {(top - 1) / 255:.3f}" in " ".join(texts) for texts in found.warnings)
    merged = merge_series(images, WALL.stops, found, white_of(images)).radiance
    ratio = merged / WALL.radiance
    parts = [(WALL.radiance > low) & (WALL.radiance < 2 * low) for low in (0.02, 0.1, 0.5)]
    middle = [np.median(ratio[part]) for part in parts]
    assert np.ptp(middle) < 0.02 * np.mean(middle), "highlights keep their radiance"


def test_white_of_sixteen_bits_is_found_too():
    assert white_of([np.uint16(images) * 180 for images in WALL.images]) == pytest.approx(178 / 255, abs=0.003)


def test_white_stays_where_nothing_tells_another():
    assert white_of(WALL.images) == 254 / 255
    assert white_of([WALL.images[0]] * 3, [0, 1, 2]) == 254 / 255, "one photograph three times"
    dim = [image // 2 for image in WALL.images[:3]]
    assert white_of(dim, WALL.stops[:3]) == 254 / 255


def test_lossy_white_is_as_uneven_as_it_is():
    images = []
    for image in WALL.images:
        _, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 60])
        images.append(cv2.imdecode(content, cv2.IMREAD_COLOR))
    longest, shorter = images[-1], images[-2]
    white = 255 * white_of(images)
    assert 240 <= white < 254
    assert np.mean(longest[shorter >= 254] >= white) > 0.92


def test_white_reaches_the_merged_image_of_a_folder(tmp_path):
    for i, image in enumerate(ending_at(235)):
        Image.fromarray(image).save(tmp_path / f"{i}.png")
    merged = camera_calibrate(tmp_path, "none", (2.0**WALL.stops).tolist()).merged
    parts = [(WALL.radiance > low) & (WALL.radiance < 2 * low) for low in (0.02, 0.1, 0.5)]
    middle = [np.median((merged.radiance / WALL.radiance)[part]) for part in parts]
    assert np.ptp(middle) < 0.02 * np.mean(middle)


def test_saturated_areas_are_even_where_lossy_files_are_not():
    images = [np.uint8([[100, 250, 252, 253]]), np.uint8([[200, 251, 250, 252]])]
    radiance = merge_series(images, [0, 1], GRID, 249 / 255).radiance[0]
    np.testing.assert_allclose(radiance[1:], 250 / 255, rtol=1e-5)


@pytest.mark.parametrize("white", [np.nan, 0.0, 2.0])
def test_a_white_that_none_can_be_is_refused(white):
    with pytest.raises(InputError, match=r"white=\S+ is out of range"):
        merge_series(STEEP, [0, 1], GRID, white)


def test_reduced_images_and_arrays_may_be_mixed_but_are_of_one_kind():
    mixed = [reduce_image(image) if i % 2 else image for i, image in enumerate(WALL.images)]
    np.testing.assert_array_equal(
        calibrate_series(mixed, WALL.stops).curves, calibrate_series(WALL.images, WALL.stops).curves
    )
    with pytest.raises(InputError, match="use images of one size and depth"):
        calibrate_series([mixed[0], reduce_image(WALL.images[1][1:])], [0, 1])
