"""One contract for every model and method; optima against brute force; a photograph of nothing unusual breaks it."""

import re
import time
import warnings
from functools import partial

import matplotlib.pyplot as plt
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crfbench.calibration import METHODS, Noise, Observations, calibrate, decode_table
from crfbench.calibration.paper_loss import AlignedLoss, descend
from crfbench.calibration.table import minimise
from crfbench.curves import GRID, as_valid_curves
from crfbench.datasets import load_patches
from crfbench.datasets.middlebury import REFERENCE_IRRADIANCE, patch_arrays, patch_intensity
from crfbench.errors import CrfbenchError, InputError
from crfbench.metrics import rmse
from crfbench.models import GGCM, Gamma, load_model
from crfbench.numerics import normal_equations
from crfbench.paper.calibration import chart_observations
from crfbench.plots import plot_calibration
from tests.support.observing import MODELS, known_curves, ready, scene, shape_rmse, unclipped

SHARP = Noise(brightness=1e-3, exposure=1e-3)
LONG = ("SLR-monotone-1", "GGCM-3", "PPISP-4")  # of which the others run through the same code
CASES = [
    pytest.param(name, method, id=f"{name}-{method}", marks=[pytest.mark.slow] * (name in LONG))
    for name in MODELS
    for method in ("map", "discrepancy", "grid" if name.endswith("-1") else "lm")
]


@pytest.fixture(scope="module")
def middlebury():
    """Brightness of 28 calibrations: 14 cameras, 2 illuminations; shape (28, 4, 24)."""
    return patch_intensity(load_patches())["jpeg"].to_numpy().reshape(28, 4, 24)


def noisy(curves, seed=8):
    """Return reference and brightness with errors of 2 %, as real data have them."""
    reference, _, brightness = scene(curves)
    return reference, np.clip(brightness + 0.02 * np.random.default_rng(seed).normal(size=brightness.shape), 0, 1)


def asked(method):
    """Return the options of a method; "discrepancy" is "map" that allows for what the model misses."""
    return {"method": "map" if method == "discrepancy" else method, "discrepancy": method == "discrepancy"}


@pytest.mark.parametrize(("name", "method"), CASES)
class TestContract:
    def solve(self, name, method, observations, **options):
        model, table = ready(name)
        return calibrate(model, observations, **asked(method), table=table, **options)

    def test_known_curves_come_back(self, name, method):
        curves = known_curves(ready(name)[0], 8)
        reference, _, brightness = scene(curves)
        observations = unclipped(brightness, reference, reference_error=1e-3)
        found = self.solve(name, method, observations, noise=SHARP)
        # What the paper's loss aligns, it cannot tell: curves that differ by scale and offset are equally good.
        aligned = method in ("grid", "lm")
        distance = shape_rmse(found, curves, offset=aligned)
        assert aligned or np.abs(found.residuals).max() < 0.05
        if method == "discrepancy":  # which cannot know that the curve is exactly one of the family
            assert np.median(distance) < 5e-3
            assert distance.max() < 0.02
            return
        assert np.median(distance) < 1e-4
        assert distance.max() < 1e-3
        if name.endswith("-1"):  # what one number cannot hide: the whole curve, not only where it was seen
            assert rmse(found.curves, curves).max() < 1e-4

    def test_a_batch_equals_one_by_one(self, name, method):
        reference, brightness = noisy(known_curves(ready(name)[0], 4))
        together = self.solve(name, method, Observations(brightness, reference))
        pairs = zip(brightness, reference, strict=True)
        alone = np.array([self.solve(name, method, Observations(b, r)).curves[0] for b, r in pairs])
        assert shape_rmse(together, alone).max() < 1e-5

    def test_repeats_to_the_last_digit(self, name, method):
        model = ready(name)[0]
        reference, brightness = noisy(known_curves(model, 2))
        few = Observations(brightness, reference)
        runs = [calibrate(model, few, **asked(method), seed=4).curves for _ in range(2)]
        assert np.array_equal(*runs)

    def test_the_order_of_patches_and_photographs_does_not_matter(self, name, method):
        reference, brightness = noisy(known_curves(ready(name)[0], 4))
        rng = np.random.default_rng(0)
        photographs, patches = rng.permutation(3), rng.permutation(10)
        plain = self.solve(name, method, Observations(brightness, reference))
        shuffled = Observations(brightness[:, photographs][:, :, patches], reference[:, patches])
        assert shape_rmse(plain, self.solve(name, method, shuffled).curves).max() < 1e-5

    @pytest.mark.parametrize("unit", [1e-12, 1e12])
    def test_the_unit_of_the_reference_does_not_matter(self, name, method, unit):
        reference, brightness = noisy(known_curves(ready(name)[0], 4))
        plain = self.solve(name, method, Observations(brightness, reference))
        scaled = self.solve(name, method, Observations(brightness, unit * reference))
        assert shape_rmse(plain, scaled.curves).max() < 1e-5

    def test_weight_0_leaves_a_patch_out(self, name, method):
        reference, brightness = noisy(known_curves(ready(name)[0], 4))
        kept = [0, 2, 3, 5, 6, 7, 9]
        zeroed = Observations(brightness, reference, weights=np.isin(np.arange(10), kept))
        taken = Observations(brightness, reference).take(kept)
        first, second = (self.solve(name, method, each) for each in (zeroed, taken))
        assert shape_rmse(first, second.curves).max() < 1e-5
        assert first.brightness_range.tolist() == second.brightness_range.tolist()

    def test_weight_2_equals_the_patch_twice(self, name, method):
        """True of the paper's loss; of the posterior where no error of the reference ties the two together."""
        reference, brightness = noisy(known_curves(ready(name)[0], 4))
        twice = np.append(np.arange(10), [3, 3, 8])
        weights = np.bincount(twice)
        weighted = unclipped(brightness, reference, weights=weights, reference_error=1e-5)
        repeated = unclipped(brightness, reference, reference_error=1e-5).take(twice)
        first, second = (self.solve(name, method, each) for each in (weighted, repeated))
        assert shape_rmse(first, second.curves).max() < 1e-5

    def test_exposures_alone_bring_known_curves_back(self, name, method):
        if method in ("grid", "lm"):
            with pytest.raises(InputError, match="have none; use 'map'"):
                self.solve(name, method, Observations([[0.2, 0.5], [0.4, 0.7]], exposures=[0, 1]))
            return
        curves = known_curves(ready(name)[0], 6)
        _, exposures, brightness = scene(curves)
        chart_free = self.solve(name, method, unclipped(brightness, None, exposures), noise=SHARP)
        distance, times = shape_rmse(chart_free, curves), 10 if method == "discrepancy" else 1
        assert np.median(distance) < 1e-3 * times
        assert distance.max() < 3e-3 * times


def test_chart_free_does_not_ask_how_bright_the_patches_were():
    model, table = ready("SLR-monotone-1")
    curve = known_curves(model, 1)
    exposures = np.array([0.0, 1.0, 2.0])
    found = []
    for seed in range(4):
        irradiance = np.random.default_rng(seed).uniform(0.04, 0.22, size=12)
        brightness = np.interp(irradiance * 2.0 ** exposures[:, None], curve[0], np.linspace(0, 1, 1024))
        seen = unclipped(brightness, None, exposures)
        found.append(calibrate(model, seen, discrepancy=False, noise=SHARP, table=table).curves[0])
    assert rmse(found, curve).max() < 1e-4


def test_grid_is_the_global_optimum_and_the_papers_search_is_no_better(middlebury):
    model, table = ready("SLR-ldl-1")
    few = Observations(middlebury[::9], REFERENCE_IRRADIANCE)
    loss = AlignedLoss(few)
    dense = decode_table(model, rows=20_000)
    best = loss.on_table(dense).min(axis=1)

    def loss_of(method, **options):
        free = model.to_unconstrained(calibrate(model, few, method, table=table, **options).params)
        return np.sqrt((loss.evaluate(model, free, np.arange(len(few)))[0] ** 2).sum(axis=1))

    grid = loss_of("grid")
    assert (grid <= best * (1 + 1e-5)).all()  # the dense table is in single precision
    assert (grid >= best * (1 - 1e-3)).all()
    assert (loss_of("paper", starts=3) >= grid * (1 - 1e-9)).all()


@pytest.mark.parametrize(("rate", "steps"), [pytest.param(0.02, 25, marks=pytest.mark.slow), (0.05, 600)])
def test_the_papers_search_takes_the_steps_of_pytorchs_adam(middlebury, rate, steps):
    """Until the loss moves by less than 1e-6, which the longer of the two runs does."""
    torch = pytest.importorskip("torch")
    model, _ = ready("EMoR-3")
    loss = AlignedLoss(Observations(middlebury[:2], 0.1 * REFERENCE_IRRADIANCE))
    start, found = (descend(loss, model, 1, seed=1, steps=n, rate=rate) for n in (0, steps))

    def value(free, i):
        return np.linalg.norm(loss.evaluate(model, free, np.full(len(free), i))[0], axis=1)

    shift = 1e-6 * np.eye(3)
    for i in range(2):
        z, values = torch.tensor(start[i], requires_grad=True), [np.inf]
        adam = torch.optim.Adam([z], lr=rate)
        while len(values) <= steps:
            free = z.detach().numpy()
            values.append(value(free[None], i)[0])
            if abs(values[-1] - values[-2]) < 1e-6:
                break
            z.grad = torch.tensor((value(free + shift, i) - value(free - shift, i)) / 2e-6)
            adam.step()
        assert (len(values) <= steps) == (steps == 600)
        assert np.allclose(found[i], z.detach().numpy(), atol=1e-4)
        assert values[-1] < values[1]


@pytest.mark.parametrize("method", ["grid", pytest.param("paper", marks=pytest.mark.slow)])
def test_how_large_all_weights_are_does_not_matter_to_the_papers_loss(middlebury, method):
    model, table = ready("SLR-ldl-1")
    few = (Observations(middlebury[:3], REFERENCE_IRRADIANCE, weights=w * np.linspace(1, 2, 24)) for w in (1e-3, 1.0))
    first, second = (calibrate(model, each, method, table=table) for each in few)
    np.testing.assert_allclose(first.params, second.params, rtol=1e-9)


@pytest.mark.parametrize("method", ["lm", "map"])
def test_the_seed_decides_the_table(middlebury, method):
    model, few = ready("GGCM-3")[0], Observations(middlebury[:2], REFERENCE_IRRADIANCE)
    by_seed, by_table = (
        calibrate(model, few, method, seed=5, **options) for options in ({}, {"table": decode_table(model, seed=5)})
    )
    assert np.array_equal(by_seed.params, by_table.params)
    assert not np.array_equal(by_seed.params, calibrate(model, few, method, seed=6).params)


def test_of_many_starts_the_papers_search_keeps_the_best(middlebury):
    model, _ = ready("GGCM-3")
    few = Observations(middlebury[:3], REFERENCE_IRRADIANCE)
    loss = AlignedLoss(few)
    starts = np.random.default_rng(5).normal(size=(3, 4, 3))
    values = [np.linalg.norm(loss.evaluate(model, starts[i], np.full(4, i))[0], axis=1) for i in range(3)]
    kept = descend(loss, model, 4, seed=5, steps=0)
    assert np.array_equal(kept, starts[np.arange(3), np.argmin(values, axis=1)])


def test_the_least_is_found_within_the_table_and_beyond_either_end():
    table = ready("Gamma-1")[1]
    targets = np.array([-20.0, 0.3, 20.0])

    def bowl(z, sets):
        return normal_equations(z - targets[sets][:, None], np.ones((len(sets), 1, 1)))

    found = minimise(bowl, table, (table.unconstrained[:, 0] - targets[:, None]) ** 2)
    assert np.allclose(found[:, 0], targets)


def test_a_narrow_valley_between_two_rows_is_found_beside_a_wide_one():
    table = ready("Gamma-1")[1]
    z = table.unconstrained[:, 0]
    step = z[1] - z[0]
    deep, wide = z[300] + step / 2, z[100]
    steep = 0.105 * (2 / step) ** 2

    def bowls(free):
        """Return the cost, a little above the wide bowl at all rows, its half second derivative and half gradient."""
        near = np.abs(free - deep) < step
        bend, at = np.where(near, steep, 1e-3), np.where(near, deep, wide)
        return np.where(near, 0.9, 1.0) + bend * (free - at) ** 2, bend, bend * (free - at)

    def objective(free, sets):
        return bowls(free[:, 0])[0], bowls(free)[1][:, :, None], bowls(free)[2]

    assert minimise(objective, table, bowls(z)[0][None]) == pytest.approx(deep)


def test_parts_of_a_large_batch_change_nothing(middlebury, monkeypatch):
    model, table = ready("SLR-ldl-1")
    observations = Observations(middlebury[:3], REFERENCE_IRRADIANCE)
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
    model, table = ready("Gamma-1")
    seen = []
    at = type(table).at
    monkeypatch.setattr(type(table), "at", lambda self, b: seen.append(b.size * len(self.params)) or at(self, b))
    many = Observations(np.tile(middlebury, (8, 1, 1)), REFERENCE_IRRADIANCE)
    calibrate(model, many, method, discrepancy=False, table=table)
    assert max(seen) <= 2**19
    assert sum(seen) == 8 * 28 * 96 * 512


# --- what is refused, and what is said


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"method": "best"}, "'best'.*use one of paper, grid, lm, map, posterior"),
        ({"model": Gamma("forward")}, "maps irradiance to brightness.*'inverse'"),
        ({"model": load_model("GGCM-3"), "method": "grid"}, "3 parameters.*use 'lm'"),
        ({"model": GGCM(2, "inverse")}, r"GGCM.*has no prior.*learn_prior\(curves\)"),
        ({"table": decode_table(load_model("Gamma-1"))}, "table was not decoded from SLR"),
        ({"table": decode_table(load_model("GGCM-2"))}, "table was not decoded from SLR"),
    ],
)
def test_calibrations_that_cannot_be_are_refused(change, message):
    asked = {"model": load_model("SLR-ldl-1"), "method": "map", **change}
    with pytest.raises(InputError, match=message):
        calibrate(observations=Observations([[0.2, 0.6]], [1.0, 4.0]), **asked)


@pytest.mark.parametrize(("name", "k", "default"), [("Gamma-1", 1, 512), ("GGCM-3", 3, 1024)])
def test_tables_have_the_rows_asked_for_and_no_fewer_than_16(name, k, default):
    model = load_model(name)
    for rows in (15, 0, -1):
        with pytest.raises(InputError, match=f"rows={rows} is out of range; use a whole number from 16"):
            decode_table(model, rows=rows)
    for rows, expected in ((16, 16), (700, 700), (None, default)):
        table = decode_table(model, rows)
        assert table.unconstrained.shape == table.params.shape == (expected, k)
        assert np.allclose(table.curves, model.decode(table.params), atol=1e-6)
        assert np.exp(table.log_prior).sum() == pytest.approx(1)


def test_a_table_of_one_parameter_holds_the_prior():
    """Its mean and variance from the rows and their weights; five standard deviations and at least 5 either side."""
    for name in ("Gamma-1", "SLR-ldl-1"):
        model = load_model(name)
        table, prior = decode_table(model), model.prior_
        free, weight = table.unconstrained[:, 0], np.exp(table.log_prior)
        mean, variance = prior.mean[0], prior.covariance[0, 0]
        assert weight @ free == pytest.approx(mean, abs=1e-6)
        assert weight @ (free - mean) ** 2 == pytest.approx(variance, rel=1e-3)
        assert np.ptp(np.diff(free)) < 1e-9
        assert free[[0, -1]] - mean == pytest.approx(np.array([-1, 1]) * max(5, 5 * np.sqrt(variance)))


def test_a_table_of_more_parameters_is_drawn_from_the_prior():
    model = load_model("GGCM-3")
    table, prior = decode_table(model, rows=4001), model.prior_
    assert np.array_equal(table.unconstrained[0], prior.mean)
    sd = np.sqrt(np.diagonal(prior.covariance))
    assert np.allclose(table.unconstrained.mean(axis=0), prior.mean, atol=0.05 * sd.max())
    assert np.allclose(np.cov(table.unconstrained.T), prior.covariance, rtol=0.1, atol=0.05 * sd.max() ** 2)
    first, again, other = (decode_table(model, 50, seed).unconstrained for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def warned(brightness, **given):
    model, table = ready("SLR-monotone-1")
    return "; ".join(calibrate(model, Observations(brightness, **given), "posterior", table=table).warnings[0])


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
    found = calibrate(load_model("Gamma-1"), steep, discrepancy=False, noise=SHARP)
    assert "at the edge of what the prior expects" in "".join(found.warnings[0])
    mixed = [[0.3, 0.31, 0.29, 0.3, 0.8, 0.82]]  # light and dark that do not follow the reference
    assert "times or more as widely as their noise lets expect" in warned(mixed, reference=[0.1, 0.2, 0.4, 0.8, 0.9, 1])


@pytest.mark.parametrize("name", ["PPISP-4", "SLR-ldl-3", "EMoR-3"])
def test_a_narrow_band_says_much_whatever_its_parameters_do(name):
    grey = np.linspace(0.05, 0.95, 24)
    for reference in (grey**0.6, np.sin(np.pi * grey / 2) ** 2):
        seen = Observations(grey[None], reference, [0.0], absolute=True)
        found = calibrate(load_model(name), seen, "posterior")
        assert np.mean(found.bands[0.9][1] - found.bands[0.9][0]) < 0.1
        assert "say little" not in "".join(found.warnings[0])


def test_of_a_batch_only_the_set_that_says_little_is_told_so():
    brightness = np.array([[[0.499, 0.5, 0.5005, 0.501]], [[0.2, 0.4, 0.6, 0.8]]])
    reference = np.array([[1.0, 1.002, 1.003, 1.004], *(brightness[1] ** 2)])
    first, second = calibrate(load_model("Gamma-1"), Observations(brightness, reference), "posterior").warnings
    assert first == ("the observations say little: the curve is mostly what the model expects beforehand",)
    assert second == ()


def said(brightness, reference, model="Gamma-1", **given):
    """The warnings about one set, as calibrations by "map" have them."""
    return calibrate(load_model(model), Observations(brightness, reference, **given)).warnings[0]


RISING, STEPS = np.linspace(0.3, 0.84, 10), np.linspace(0.3, 0.84, 10) ** 2.2


@pytest.mark.parametrize("clipped", [1, 2])
def test_more_than_a_tenth_clipped_is_said(clipped):
    brightness = np.append(RISING[:-clipped], [1.0] * clipped)
    reference = np.append(STEPS[:-clipped], [2.0] * clipped)
    expected = ("2 of 10 observations are clipped",) if clipped == 2 else ()
    assert said([brightness], reference) == expected
    left_out = {"weights": np.append(np.ones(10), np.zeros(4))}
    assert said([np.append(brightness, [1.0] * 4)], np.append(reference, [2.0] * 4), **left_out) == expected


@pytest.mark.parametrize("patches", [3, 4])
def test_fewer_than_4_patches_are_said_however_many_the_photographs(patches):
    exposed = np.linspace(0.8, 1.1, 5)[:, None] * RISING[:patches]
    expected = ("only 3 patches: the prior says much of this curve",) if patches == 3 else ()
    assert said(exposed, STEPS[:patches]) == expected


def test_falling_brightness_is_said_by_photograph():
    falls = "brightness falls where the reference rises; check the order of the patches"
    brightness = np.array([[0.3, 0.2, 0.5, 0.5], [0.5, 0.5, 0.9, 0.8]])  # it rises from one photograph to the other
    weights = [[1, 1, 0, 0], [0, 0, 1, 1]]
    assert falls in said(brightness, [1, 2, 3, 4], weights=weights)
    assert falls not in said(1 - brightness, [1, 2, 3, 4], weights=weights)
    odd_one = np.append(RISING, 0.01), np.append(STEPS, 1e6)
    assert falls not in said([odd_one[0]], odd_one[1], weights=np.append(np.ones(10), 0))
    assert falls in said([odd_one[0]], odd_one[1], weights=np.append(np.ones(10), 100))


def test_scatter_is_said_with_its_size():
    brightness = np.array([[0.2, 0.3, 0.4, 0.5], [0.5, 0.4, 0.3, 0.6]])
    found = calibrate(load_model("Gamma-1"), Observations(brightness, [1.0, 1.1, 1.2, 1.3]), discrepancy=False)
    assert (
        f"the observations scatter {found.noise_scale[0]:.1f} times as widely as their noise lets expect; "
        "check that the scene stood still and that exposures and reference are right"
    ) in found.warnings[0]


@pytest.mark.parametrize(("name", "side"), [("Gamma-1", -1), ("Gamma-1", 1), ("GGCM-2", 1)])
def test_the_edge_is_4_standard_deviations_from_the_mean_of_the_prior(name, side):
    model = load_model(name)
    sd = np.sqrt(np.diagonal(model.prior_.covariance))
    best = Noise(brightness=1e-5, exposure=1e-5)
    for times, expected in ((3.9, ()), (4.1, ("the best parameters lie at the edge of what the prior expects",))):
        free = model.prior_.mean + side * times * sd * (np.arange(len(sd)) == 0)
        curve = model.decode(model.from_unconstrained(free))
        brightness = np.linspace(0.8, 0.98, 20)
        seen = Observations([brightness], np.interp(brightness, GRID, curve), reference_error=1e-5)
        assert calibrate(model, seen, discrepancy=False, noise=best).warnings[0] == expected


def test_what_is_told_of_a_run():
    began = time.perf_counter()
    found = calibrate(load_model("Gamma-1"), unclipped(RISING[None], STEPS), "grid")
    assert 0 < found.seconds <= time.perf_counter() - began
    assert (len(found), found.method, found.noise, found.noise_scale, found.samples) == (1, "grid", Noise(), None, None)
    assert found.bands == {}
    for bad, message in (
        ({"model": "Gamma"}, r"^model is a str; use what load_model\(name\) gives$"),
        (
            {"observations": RISING},
            r"^observations is a ndarray; use what Observations\(brightness, reference\) gives$",
        ),
    ):
        with pytest.raises(InputError, match=message):
            calibrate(**{"model": found.model, "observations": found.observations, **bad})


def test_of_real_cameras_only_clipping_is_said():
    model, table = ready("SLR-ldl-1")
    found = calibrate(model, chart_observations(patch_arrays(load_patches()))[0], "posterior", table=table)
    assert all("clipped" in warning for warnings in found.warnings for warning in warnings)


# --- what a calibration tells


@pytest.fixture(scope="module")
def pair():
    """Two sets of one photograph each, one patch of the second clipped; and their calibration."""
    brightness = np.array([[[0.2, 0.4, 0.6, 0.8]], [[0.3, 0.5, 0.6, 1.0]]])
    reference = np.array([[1.0, 4.0, 12.0, 20.0], [3.0, 8.0, 14.0, 50.0]])
    return calibrate(load_model("Gamma-1"), Observations(brightness, reference), "posterior")


def test_dots_lie_at_the_curve_less_their_residuals(pair):
    """With one photograph that is the reference itself, on the scale of the curve."""
    for index, counted in ((0, slice(4)), (1, slice(3)), (-1, slice(3))):
        brightness, irradiance = pair.dots(index)
        assert np.array_equal(brightness, pair.observations.brightness[index, 0, counted])
        share = irradiance / pair.observations.reference[index, counted]
        assert np.ptp(share) < 1e-9 * share[0]
        residual = np.log(np.interp(brightness, GRID, pair.curves[index]) / irradiance)
        assert np.allclose(residual, pair.residuals[index, 0, counted])
    for index in (2, -3):
        with pytest.raises(InputError, match=f"index={index} is out of range; use a whole number from -2 to 1"):
            plot_calibration(pair, index)


def test_what_they_are_is_told_in_a_line(pair):
    assert repr(pair.observations) == "Observations(2 x 1 photographs x 4 patches; reference known)"
    assert re.fullmatch(r"Calibration\(Gamma-1, \w+, 2 sets, \d with warnings\)", repr(pair))


def test_the_set_asked_for_is_drawn(pair):
    for index in (0, 1, -1):
        ax = plot_calibration(pair, index)
        assert any(np.array_equal(line.get_ydata(), pair.curves[index]) for line in ax.get_lines())
        drawn = len(ax.get_lines())
        assert plot_calibration(pair, index, ax) is ax
        assert len(ax.get_lines()) > drawn
    plt.close("all")


def test_range_and_warnings_are_those_of_each_set(pair):
    assert pair.brightness_range.tolist() == [[0.2, 0.8], [0.3, 0.6]]
    assert ["clipped" in "; ".join(texts) for texts in pair.warnings] == [False, True]


def test_responses_undo_the_inverse_responses(pair):
    for curve, response in zip(pair.curves, pair.responses, strict=True):
        assert np.abs(np.interp(curve, GRID, response) - GRID)[100:-1].max() < 2e-3


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


anything = given(random_observations(), st.sampled_from([*MODELS, "SLR-open-1"]), st.sampled_from(METHODS), noises)


@settings(max_examples=25)
@anything
def test_any_observations_give_finite_results_or_an_error_of_ours(given, which, method, noise):
    check_any(given, which, method, noise)


@pytest.mark.slow
@settings(max_examples=200)
@anything
def test_many_observations_give_finite_results_or_an_error_of_ours(given, which, method, noise):
    check_any(given, which, method, noise)


def check_any(given, which, method, noise):
    model, table = ready(which)
    brightness, others = given
    try:
        found = calibrate(model, Observations(brightness, **others), method, noise=noise, table=table, starts=1)
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
        assert np.isfinite(found.samples.log_evidence).all()
        assert np.allclose(found.samples.weights.sum(axis=1), 1)


@pytest.mark.parametrize("method", METHODS)
def test_a_reference_that_is_all_the_same_does_no_harm(method):
    model, table = ready("GGCM-3" if method == "lm" else "Gamma-1")
    found = calibrate(model, Observations([[0.2, 0.5, 0.6]], [2.0] * 3), method, table=table, starts=2)
    as_valid_curves(found.curves)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["SLR-ldl-1", "SLR-monotone-1"])
def test_photographs_that_tell_little_do_no_harm(name, method):
    """One photograph all clipped and one with a single patch, beside a good one."""
    if method == "lm":
        method = "map"
    model, table = ready(name)
    reference, _, brightness = scene(known_curves(model, 2))
    fit = partial(calibrate, model, method=method, noise=Noise(repeats=1.0), table=table, starts=2)
    good = fit(Observations(brightness[:, 2:], reference))
    others = np.stack([np.ones((2, 10)), np.zeros((2, 10)), brightness[:, 0], brightness[:, 2]], axis=1)
    weights = np.ones((4, 10))
    weights[2, 1:] = 0
    if method in ("grid", "paper"):  # for the paper's loss, clipped patches count like any other
        weights[:2] = 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = fit(Observations(others, reference, weights=weights))
    tolerance = 0.03 if method == "paper" else 0.01
    assert rmse(found.curves, good.curves).max() < tolerance
