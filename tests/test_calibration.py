"""One contract for every model and method; optima against brute force; a photograph of nothing unusual breaks it."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from observing import MODELS, known_curves, ready, scene, shape_rmse, unclipped

from crfbench.calibration import METHODS, Noise, Observations, calibrate, decode_table
from crfbench.calibration.alignment import AlignedLoss
from crfbench.curves import as_valid_curves
from crfbench.datasets import load_patches
from crfbench.datasets.middlebury import REFERENCE_IRRADIANCE, patch_arrays, patch_intensity
from crfbench.errors import CrfbenchError, InputError
from crfbench.metrics import rmse
from crfbench.models import GGCM, Gamma, load_model
from crfbench.tables.calibration import chart_observations

SHARP = Noise(brightness=1e-3, exposure=1e-3)
CASES = [
    pytest.param(name, k, method, id=f"{name}-{k}-{method}")
    for name, k in MODELS
    for method in ("map", "grid" if k == 1 else "lm")
]


@pytest.fixture(scope="module")
def middlebury():
    """Brightness of 28 calibrations: 14 cameras, 2 illuminations; shape (28, 4, 24)."""
    return patch_intensity(load_patches())["jpeg"].to_numpy().reshape(28, 4, 24)


def noisy(curves, seed=8):
    """Return reference and brightness with errors of 2 %, as real data have them."""
    reference, _, brightness = scene(curves)
    return reference, np.clip(brightness + 0.02 * np.random.default_rng(seed).normal(size=brightness.shape), 0, 1)


@pytest.mark.parametrize(("name", "k", "method"), CASES)
class TestContract:
    def solve(self, name, k, method, observations, **options):
        model, table = ready(name, k)
        return calibrate(model, observations, method, table=table, **options)

    def test_known_curves_come_back(self, name, k, method):
        curves = known_curves(ready(name, k)[0], 8)
        reference, _, brightness = scene(curves)
        observations = unclipped(brightness, reference, reference_error=1e-3)
        found = self.solve(name, k, method, observations, noise=SHARP, offset=False)
        distance = shape_rmse(found, curves)
        assert np.median(distance) < 1e-4
        assert distance.max() < 1e-3
        assert np.abs(found.residuals).max() < 0.05
        if k == 1:  # what one number cannot hide: the whole curve, not only where it was seen
            assert rmse(found.curves, curves).max() < 1e-4

    def test_a_batch_equals_one_by_one(self, name, k, method):
        reference, brightness = noisy(known_curves(ready(name, k)[0], 4))
        together = self.solve(name, k, method, Observations(brightness, reference))
        pairs = zip(brightness, reference, strict=True)
        alone = np.array([self.solve(name, k, method, Observations(b, r)).curves[0] for b, r in pairs])
        assert shape_rmse(together, alone).max() < 1e-5

    def test_repeats_to_the_last_digit(self, name, k, method):
        model = ready(name, k)[0]
        reference, brightness = noisy(known_curves(model, 2))
        runs = [calibrate(model, Observations(brightness, reference), method, seed=4).params for _ in range(2)]
        assert np.array_equal(*runs)

    def test_the_order_of_patches_and_photographs_does_not_matter(self, name, k, method):
        reference, brightness = noisy(known_curves(ready(name, k)[0], 4))
        rng = np.random.default_rng(0)
        photographs, patches = rng.permutation(3), rng.permutation(10)
        plain = self.solve(name, k, method, Observations(brightness, reference))
        shuffled = Observations(brightness[:, photographs][:, :, patches], reference[:, patches])
        assert shape_rmse(plain, self.solve(name, k, method, shuffled).curves).max() < 1e-5

    @pytest.mark.parametrize("unit", [1e-12, 1e12])
    def test_the_unit_of_the_reference_does_not_matter(self, name, k, method, unit):
        reference, brightness = noisy(known_curves(ready(name, k)[0], 4))
        plain = self.solve(name, k, method, Observations(brightness, reference))
        scaled = self.solve(name, k, method, Observations(brightness, unit * reference))
        assert shape_rmse(plain, scaled.curves).max() < 1e-5

    def test_weight_0_leaves_a_patch_out(self, name, k, method):
        reference, brightness = noisy(known_curves(ready(name, k)[0], 4))
        kept = [0, 2, 3, 5, 6, 7, 9]
        zeroed = Observations(brightness, reference, weights=np.isin(np.arange(10), kept))
        taken = Observations(brightness, reference).take(kept)
        first, second = (self.solve(name, k, method, each) for each in (zeroed, taken))
        assert shape_rmse(first, second.curves).max() < 1e-5
        assert first.brightness_range.tolist() == second.brightness_range.tolist()

    def test_weight_2_equals_the_patch_twice(self, name, k, method):
        """True of the paper's loss; of the posterior where no error of the reference ties the two together."""
        reference, brightness = noisy(known_curves(ready(name, k)[0], 4))
        twice = np.append(np.arange(10), [3, 3, 8])
        weights = np.bincount(twice)
        weighted = unclipped(brightness, reference, weights=weights, reference_error=1e-5)
        repeated = unclipped(brightness, reference, reference_error=1e-5).take(twice)
        first, second = (self.solve(name, k, method, each) for each in (weighted, repeated))
        assert shape_rmse(first, second.curves).max() < 1e-5

    def test_exposures_alone_bring_known_curves_back(self, name, k, method):
        if method != "map":
            with pytest.raises(InputError, match="have none; use 'map'"):
                self.solve(name, k, method, Observations([[0.2, 0.5], [0.4, 0.7]], exposures=[0, 1]))
            return
        curves = known_curves(ready(name, k)[0], 6)
        _, exposures, brightness = scene(curves)
        chart_free = self.solve(name, k, method, unclipped(brightness, None, exposures), noise=SHARP)
        distance = shape_rmse(chart_free, curves)
        assert np.median(distance) < 1e-3
        assert distance.max() < 3e-3


def test_chart_free_does_not_ask_how_bright_the_patches_were():
    model, table = ready("SLR-monotone", 1)
    curve = known_curves(model, 1)
    exposures = np.array([0.0, 1.0, 2.0])
    found = []
    for seed in range(4):
        irradiance = np.random.default_rng(seed).uniform(0.04, 0.22, size=12)
        brightness = np.interp(irradiance * 2.0 ** exposures[:, None], curve[0], np.linspace(0, 1, 1024))
        found.append(calibrate(model, unclipped(brightness, None, exposures), noise=SHARP, table=table).curves[0])
    assert rmse(found, curve).max() < 1e-4


def test_grid_is_the_global_optimum_and_the_papers_search_is_no_better(middlebury):
    model, table = ready("SLR-ldl", 1)
    few = Observations(middlebury[::9], REFERENCE_IRRADIANCE)
    loss = AlignedLoss(few)
    dense = decode_table(model, rows=20_000)
    best = loss.on_table(dense).min(axis=1)

    def loss_of(method, **options):
        free = model.to_free(calibrate(model, few, method, table=table, **options).params)
        return np.sqrt((loss.evaluate(model, free, np.arange(len(few)))[0] ** 2).sum(axis=1))

    grid = loss_of("grid")
    assert (grid <= best * (1 + 1e-5)).all()  # the dense table is in single precision
    assert (grid >= best * (1 - 1e-3)).all()
    assert (loss_of("paper", starts=3) >= grid * (1 - 1e-9)).all()


def test_parts_of_a_large_batch_change_nothing(middlebury, monkeypatch):
    model, table = ready("SLR-ldl", 1)
    observations = Observations(middlebury[:6], REFERENCE_IRRADIANCE)
    runs = {}
    for cells in (1, 2**40):
        monkeypatch.setattr("crfbench.calibration.table._CELLS", cells)
        runs[cells] = [calibrate(model, observations, method, table=table) for method in ("grid", "map", "posterior")]
        runs[cells].append(calibrate(model, observations, "paper", starts=1, seed=1))
    for small, whole in zip(*runs.values(), strict=True):
        assert np.allclose(small.params, whole.params, rtol=1e-9, atol=1e-12)
        assert rmse(small.curves, whole.curves).max() < 1e-9
        for level, band in small.bands.items():
            assert np.allclose(band, whole.bands[level], atol=1e-9)


@pytest.mark.parametrize("method", ["map", "grid", "posterior"])
def test_the_largest_batch_of_numbers_is_split(method, middlebury, monkeypatch):
    """No look-up may hold all sets of observations at once."""
    model, table = ready("Gamma", 1)
    seen = []
    at = type(table).at
    monkeypatch.setattr(type(table), "at", lambda self, b: seen.append(b.size * len(self.free)) or at(self, b))
    calibrate(model, Observations(np.tile(middlebury, (8, 1, 1)), REFERENCE_IRRADIANCE), method, table=table)
    assert max(seen) <= 2**19
    assert sum(seen) == 8 * 28 * 96 * 512


# --- what is refused, and what is said


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"method": "best"}, "'best'.*use one of paper, grid, lm, map, posterior"),
        ({"model": Gamma("forward")}, "maps irradiance to brightness.*'inverse'"),
        ({"model": load_model("GGCM", 3), "method": "grid"}, "3 parameters.*use 'lm'"),
        ({"model": GGCM(2, "inverse")}, r"GGCM.*has no prior.*learn_prior\(curves\)"),
        ({"table": decode_table(load_model("Gamma"))}, "table was not decoded from SLR"),
        ({"table": decode_table(load_model("GGCM", 2))}, "table was not decoded from SLR"),
    ],
)
def test_calibrations_that_cannot_be_are_refused(change, message):
    asked = {"model": load_model("SLR-ldl"), "method": "map", **change}
    with pytest.raises(InputError, match=message):
        calibrate(observations=Observations([[0.2, 0.6]], [1.0, 4.0]), **asked)


def test_tables_of_too_few_rows_are_refused():
    with pytest.raises(InputError, match="rows=3 does not fit; use a whole number from 16"):
        decode_table(load_model("GGCM", 3), rows=3)


def warned(brightness, **given):
    model, table = ready("SLR-monotone", 1)
    found = calibrate(model, Observations(brightness, **given), "posterior", table=table)
    assert "; ".join(found.warnings[0]) == found.to_frame()["warnings"][0]
    return found.to_frame()["warnings"][0]


def test_doubtful_observations_are_warned_of():
    reference = np.geomspace(0.03, 1, 10)
    rising = np.linspace(0.1, 0.9, 10)[None]
    assert warned(rising, reference=reference) == ""
    assert "brightness falls where the reference rises" in warned(rising[:, ::-1], reference=reference)
    assert "only 2 patches" in warned(rising[:, [2, 7]], reference=reference[[2, 7]])
    assert "3 of 10 observations are clipped" in warned(np.minimum(1.4 * rising, 1), reference=reference)
    assert "the observations say little" in warned([[0.499, 0.501]], reference=[1.0, 1.004])
    bright = np.linspace(0.8, 0.98, 10)
    steep = Observations([bright], bright**25, reference_error=1e-4)
    found = calibrate(load_model("Gamma"), steep, noise=SHARP)
    assert "at the edge of what the prior expects" in "".join(found.warnings[0])
    mixed = np.array([[0.2, 0.3, 0.4, 0.5], [0.5, 0.4, 0.3, 0.6]])  # two photographs that contradict each other
    assert "times as widely as their noise lets expect" in warned(mixed, reference=[1.0, 1.1, 1.2, 1.3])


def test_of_real_cameras_only_clipping_is_said():
    model, table = ready("SLR-ldl", 1)
    found = calibrate(model, chart_observations(patch_arrays(load_patches()))[0], "posterior", table=table)
    assert all("clipped" in warning for warnings in found.warnings for warning in warnings)


# --- whatever comes in


@st.composite
def random_observations(draw):
    """Anything that has the right shape, ends and equal values included."""
    n, e, p = draw(st.integers(1, 3)), draw(st.integers(1, 4)), draw(st.integers(1, 7))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    brightness = draw(
        st.sampled_from(
            [
                rng.random((n, e, p)),
                np.round(3 * rng.random((n, e, p))) / 3,
                np.broadcast_to(rng.random((n, e, 1)), (n, e, p)),
                1e-9 * rng.random((n, e, p)),
                1 - 1e-9 * rng.random((n, e, p)),
            ]
        )
    )
    given = {
        "reference": 10.0 ** rng.uniform(-2, 2, p) * 10.0 ** draw(st.sampled_from([-20, 0, 20])),
        "exposures": rng.normal(size=e) * draw(st.sampled_from([0, 1, 20])),
        "clipped": rng.random((n, e, p)) < draw(st.sampled_from([0.0, 0.1, 0.6])),
        "weights": (rng.random((n, e, p)) < 0.8)
        * rng.uniform(0.1, 1, (n, e, p))
        * draw(st.sampled_from([1e-6, 1, 1e6])),
        "reference_error": 10.0 ** rng.uniform(-5, 1),
    }
    chosen = draw(st.sets(st.sampled_from(sorted(given)))) | {"reference"} - draw(st.sets(st.just("reference")))
    return brightness, {name: given[name] for name in chosen}


noises = st.builds(Noise, st.sampled_from([1e-5, 0.02, 1.0]), st.sampled_from([1e-4, 0.1, 10.0]))


@settings(max_examples=150, deadline=None)
@given(
    random_observations(), st.sampled_from([*MODELS, ("SLR-open", 1)]), st.sampled_from(METHODS), noises, st.booleans()
)
def test_any_observations_give_finite_results_or_an_error_of_ours(given, which, method, noise, offset):
    model, table = ready(*which)
    brightness, others = given
    try:
        found = calibrate(
            model, Observations(brightness, **others), method, noise=noise, table=table, offset=offset, starts=1
        )
    except CrfbenchError:
        return
    for values in (found.params, found.curves, found.residuals, found.brightness_range, found.responses):
        assert np.isfinite(values).all()
    if model.name == "SLR" and model.monotone:
        as_valid_curves(found.curves)
    if method in ("map", "posterior"):
        assert (found.noise_scale > 0).all()
    if method == "posterior":
        inner, outer = found.bands[0.5], found.bands[0.9]
        for low, high in ((outer[0], inner[0]), (inner[0], inner[1]), (inner[1], outer[1])):
            assert (low <= high + 1e-9).all()
        assert np.isfinite(found.belief.log_evidence).all()
        assert np.allclose(found.belief.weights.sum(axis=1), 1)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["SLR-ldl", "SLR-monotone"])
def test_photographs_that_tell_little_do_no_harm(name, method):
    """One photograph all clipped and one with a single patch, beside a good one."""
    if method == "lm":
        method = "map"
    model, table = ready(name, 1)
    reference, _, brightness = scene(known_curves(model, 2))
    good = calibrate(model, Observations(brightness[:, 2:], reference), method, table=table, starts=2)
    others = np.stack([np.ones((2, 10)), np.zeros((2, 10)), brightness[:, 0], brightness[:, 2]], axis=1)
    weights = np.ones((4, 10))
    weights[2, 1:] = 0
    if method in ("grid", "paper"):  # for the paper's loss, clipped patches count like any other
        weights[:2] = 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = calibrate(model, Observations(others, reference, weights=weights), method, table=table, starts=2)
    tolerance = 0.03 if method == "paper" else 0.01
    assert rmse(found.curves, good.curves).max() < tolerance
