import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.interpolate import interp1d
from scipy.optimize import LinearConstraint, minimize

from crfbench import curves as c
from crfbench.errors import InputError

STEPS = hnp.arrays(float, c.N_SAMPLES - 1, elements=st.floats(0, 1)).filter(lambda steps: steps.sum() > 1)


def response(steps):
    total = np.concatenate([[0.0], np.cumsum(steps)])
    return total / total[-1]


@pytest.mark.parametrize("gamma", [0.2, 0.45, 1.0, 2.2, 5.0])
def test_invert_gamma_gives_the_root(gamma):
    # The steep end of x^0.2 needs x = 0.2^5 between two samples, where linear interpolation is off.
    assert np.abs(c.invert(c.GRID**gamma) - c.GRID ** (1 / gamma)).mean() < 1e-3


@given(STEPS)
def test_inverse_is_valid_and_undoes_the_curve_between_its_samples(steps):
    curve = response(steps)
    inverse = c.as_valid_curves(c.invert(curve))[0]
    # g(f(x)) = x wherever f rises faster than g can resolve a step of the grid.
    back = c.evaluate(inverse, curve)
    rising = np.r_[False, np.diff(curve) > 1e-5] & np.r_[np.diff(curve) > 1e-5, False]
    grid_step = np.diff(inverse).max()
    assert np.all(np.abs(back - c.GRID)[rising] <= grid_step + 1e-4)


def test_invert_a_plateau_keeps_the_ends():
    curve = np.minimum(c.GRID / 0.5, 1.0)
    inverse = c.invert(curve)
    assert inverse[0] == 0
    assert inverse[-1] == 1
    assert np.abs(inverse[:-1] - 0.5 * c.GRID[:-1]).max() < 1e-3


def test_invert_keeps_shape_and_treats_rows_alone():
    batch = np.stack([c.GRID**0.5, c.GRID**2])
    assert c.invert(batch).shape == batch.shape
    assert np.allclose(c.invert(batch)[1], c.invert(batch[1]), atol=1e-9)


@given(hnp.arrays(float, (3, 7), elements=st.floats(0, 1)))
def test_evaluate_is_linear_interpolation(x):
    batch = np.stack([c.GRID, c.GRID**2, np.sqrt(c.GRID)])
    expected = [interp1d(c.GRID, curve)(row) for curve, row in zip(batch, x, strict=True)]
    assert np.allclose(c.evaluate(batch, x), expected, atol=1e-12)
    assert np.allclose(c.evaluate(batch, x[0]), interp1d(c.GRID, batch)(x[0]), atol=1e-12)


def test_resample_normalises_any_units():
    x = np.geomspace(3, 300, 5000)
    assert np.allclose(c.resample(x, 7 + 2 * x), c.GRID, atol=1e-12)


@pytest.mark.parametrize(
    ("x", "y", "words"),
    [
        ([0, 1], [0, 1, 2], r"\(2,\) and y \(3,\)"),
        ([0, 1], [0, np.nan], "NaN"),
        ([0, 0], [0, 1], "increase"),
        ([0, 1], [1, 0], "rise"),
        ([0, 1], [1, 1], "rise"),
    ],
)
def test_resample_refuses(x, y, words):
    with pytest.raises(InputError, match=words):
        c.resample(x, y)


def test_repair_is_the_least_squares_projection():
    """Against a general quadratic programme on a curve that is constant between 16 knots."""
    rng = np.random.default_rng(3)
    knots = np.clip(np.linspace(0, 1, 16) + rng.normal(0, 0.3, 16), -0.4, 1.4)
    curve = np.repeat(knots, 64)
    rise = LinearConstraint(np.diff(np.eye(16), axis=0), lb=0)
    weight = np.r_[63, np.full(14, 64), 63]  # the end samples are pinned to 0 and 1, all others are free
    best = minimize(
        lambda y: (weight * (y - knots) ** 2).sum(), np.linspace(0, 1, 16), jac=lambda y: 2 * weight * (y - knots),
        bounds=[(0, 1)] * 16, constraints=rise, method="SLSQP", options={"ftol": 1e-14},
    )  # fmt: skip
    repaired = c.repair(curve)
    assert np.allclose(repaired[32::64], best.x, atol=1e-6)


@given(hnp.arrays(float, (2, c.N_SAMPLES), elements=st.floats(-2, 3)))
def test_repair_always_gives_valid_curves_and_changes_none_twice(batch):
    once = c.repair(batch)
    assert np.array_equal(c.as_valid_curves(once, tolerance=0.0), once)
    assert np.array_equal(c.repair(once), once)


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (np.zeros(10), r"\(10,\).*\(n, 1024\)"),
        (np.zeros((0, 1024)), r"\(0, 1024\)"),
        (np.zeros((1, 1, 1024)), r"\(1, 1, 1024\)"),
        (["a"], "holds text; use real numbers"),
        (np.where(c.GRID > 0.5, np.nan, 0.1), "curve 0 holds NaN"),
    ],
)
def test_as_curves_refuses(bad, words):
    with pytest.raises(InputError, match=words):
        c.as_curves(bad)


def test_as_valid_curves_names_the_curve_that_falls_or_misses_its_ends():
    wiggle = c.GRID + 2.0 * np.sin(20 * c.GRID) * c.GRID * (1 - c.GRID)
    with pytest.raises(InputError, match="curve 1 falls"):
        c.as_valid_curves([c.GRID, wiggle])
    with pytest.raises(InputError, match=r"curve 1 runs from 0 to 0\.5"):
        c.as_valid_curves([c.GRID, c.GRID / 2])


def test_direction_must_be_known():
    assert c.check_direction("inverse") == "inverse"
    with pytest.raises(InputError, match=r"'backward'.*use one of forward, inverse"):
        c.check_direction("backward")
    assert c.axis_labels("inverse") == c.axis_labels("forward")[::-1]
