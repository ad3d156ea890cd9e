"""One contract that every model passes, in both directions; then what is special to each."""

import zipfile
from functools import cache
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import differential_evolution, least_squares
from scipy.spatial.distance import cdist

from crfbench.curves import GRID, as_valid_curves, invert
from crfbench.datasets import load_emor_basis, load_opencrf, load_responses
from crfbench.errors import FormatError, InputError, MissingDataError
from crfbench.files import bundled
from crfbench.metrics import mse, nonmonotone, rmse
from crfbench.models import (
    GGCM,
    MODELS,
    PPISP,
    EMoR,
    Gamma,
    ModelKey,
    Polynomial,
    bundled_models,
    load_model,
    registry,
)
from crfbench.models.base import nearest_in_table
from scripts.build_priors import learn_prior
from tests.support.curves import off_endpoints

# Every formula, and the networks that stand for the others.
CASES = [key for key in bundled_models() if key.constraint in {"", "ldl", "monotone"}]
RESPONSES = load_responses("opencrf")
TRAIN = {direction: RESPONSES.in_direction(direction) for direction in ("forward", "inverse")}
SAMPLE = slice(None, None, 12)


@pytest.fixture(scope="class")
def k(key):
    return key.n_params


@pytest.fixture(scope="class")
def direction(key):
    return key.direction


@pytest.fixture(scope="class")
def model(key):
    train, formulas = TRAIN[key.direction], {kind.name: kind for kind in MODELS}
    known = key.family in formulas
    model = formulas[key.family].from_curves(train, key.n_params, key.direction) if known else load_model(key)
    return model.learn_prior(train[SAMPLE])


@pytest.fixture(scope="class")
def drawn(model):
    """Parameters from the model's own prior, shape (40, k)."""
    return model.sample(40, seed=5)


@pytest.mark.parametrize("key", CASES, scope="class", ids=str)
class TestContract:
    def test_shapes(self, model, drawn, k):
        assert model.n_params == k
        assert model.decode(drawn).shape == (40, 1024)
        assert model.decode(drawn[0]).shape == (1024,)
        assert model.decode(drawn.reshape(4, 10, k)).shape == (4, 10, 1024)
        assert model.jacobian(drawn).shape == (40, 1024, k)
        assert model.jacobian(drawn[0]).shape == (1024, k)
        assert np.allclose(model.decode(drawn)[3], model.decode(drawn[3]), atol=1e-12)
        assert len(model.param_names) == k

    def test_single_precision_is_the_same_but_for_rounding(self, model, drawn):
        fast = model.decode(drawn, dtype=np.float32)
        assert fast.dtype == np.float32
        np.testing.assert_allclose(fast, model.decode(drawn), atol=1e-5)

    def test_together_is_the_same_as_one_after_the_other(self, model, drawn):
        curves, jacobian = model.decode_with_jacobian(drawn)
        np.testing.assert_allclose(curves, model.decode(drawn), atol=1e-12)
        np.testing.assert_allclose(jacobian, model.jacobian(drawn), atol=1e-9)

    def test_every_curve_starts_at_zero(self, model, drawn, key):
        tolerance = 0.25 if key.constraint == "ldl" else 1e-9  # a sigmoid comes near 0 where the data did, no more
        assert np.abs(model.decode(drawn)[:, 0]).max() < tolerance

    def test_jacobian_agrees_with_finite_differences(self, model, drawn, k):
        step = 1e-6 * np.maximum(np.abs(drawn), 1e-2)
        for i in range(k):
            shift = np.where(np.arange(k) == i, step, 0.0)
            numeric = (model.decode(drawn + shift) - model.decode(drawn - shift)) / (2 * step[:, i, None])
            scale = 1.0 + np.abs(numeric).max()
            assert np.abs(model.jacobian(drawn)[..., i] - numeric).max() < 1e-5 * scale

    def test_fit_recovers_its_own_curves(self, model, drawn, k):
        curves = model.decode(drawn)
        distance = rmse(model.decode(model.fit(curves)), curves)
        assert np.quantile(distance, 0.9) < 1e-4
        # The bends of ReLU may stop a search short of the end, and with three latents in another fold, but near.
        assert distance.max() < (1e-3 * k if model.name == "SLR" else 1e-4)

    def test_curves_on_another_scale_are_refused(self, model):
        with pytest.raises(InputError, match="curve 1 reaches 255; use samples on a scale of 0 to 1"):
            model.fit([GRID, -255 * GRID])

    def test_fit_is_a_minimum(self, model, direction, k):
        curves = TRAIN[direction][SAMPLE]
        params = model.fit(curves)
        best = mse(model.decode(params), curves)
        rng = np.random.default_rng(2)
        for size in (1e-4, 1e-2):
            moved = model.from_unconstrained(model.to_unconstrained(params) + size * rng.normal(size=params.shape))
            assert (mse(model.decode(moved), curves) >= best * (1 - 1e-3) - 1e-12).all()

    def test_fit_treats_curves_alone(self, model, direction):
        curves = TRAIN[direction][[0, 70, 140]]
        together = model.decode(model.fit(curves))
        alone = np.concatenate([model.decode(model.fit(curve)) for curve in curves])
        assert rmse(together, alone).max() < 1e-6

    def test_unconstrained_parameters_round_trip(self, model, drawn):
        free = model.to_unconstrained(drawn)
        assert np.allclose(model.from_unconstrained(free), drawn, rtol=1e-9)
        nudge = 1e-6 * np.ones_like(free)
        slope = (model.from_unconstrained(free + nudge) - model.from_unconstrained(free - nudge)) / 2e-6
        assert np.allclose(model.unconstrained_slope(drawn), slope, rtol=1e-5, atol=1e-9)

    def test_prior_is_the_distribution_of_the_fits(self, model, direction, k):
        free = model.to_unconstrained(model.fit(TRAIN[direction][SAMPLE]))
        if model.prior_.centres is not None:  # curves as the centres hold them: near the fits, not the same
            assert np.allclose(model.decode(model.prior_.centres), model.decode(free), atol=0.1)
            free = model.prior_.centres
        samples = model.prior_.sample(20000, seed=1)
        assert np.allclose(samples.mean(axis=0), free.mean(axis=0), atol=0.05 * free.std(axis=0, ddof=1).max())
        assert np.allclose(samples.std(axis=0), free.std(axis=0, ddof=1), rtol=0.05)
        assert np.array_equal(model.sample(20000, seed=1), model.from_unconstrained(samples))

    def test_nearest_valid_is_valid_and_no_farther_than_any_valid_curve(self, model, drawn, direction):
        decoded = model.decode(drawn)
        nearest = as_valid_curves(model.nearest_valid(drawn))
        # The decoded curve's own ends are pinned, everything else is projected: no training curve is nearer.
        others = TRAIN[direction][::10]
        distance = mse(nearest[:, 1:-1], decoded[:, 1:-1])
        assert (distance[:, None] <= mse(decoded[:, None, 1:-1], others[None, :, 1:-1]) + 1e-12).all()

    def test_bad_parameters_are_refused(self, model, k):
        with pytest.raises(InputError, match=rf"\({k + 1},\).*\(\.\.\., {k}\)"):
            model.decode(np.ones(k + 1))
        with pytest.raises(InputError, match="NaN"):
            model.decode(np.full(k, np.nan))
        with pytest.raises(InputError, match="1024"):
            model.fit(np.ones((3, 100)))


@pytest.mark.parametrize("kind", MODELS)
def test_models_that_cannot_be_are_refused(kind):
    for n_params in (0, -1, 1.5):
        with pytest.raises(InputError, match="n_params="):
            kind.from_curves(TRAIN["forward"], n_params, "forward")
    with pytest.raises(InputError, match="sideways"):
        kind.from_curves(TRAIN["forward"], MODELS[kind][0], "sideways")


@st.composite
def response_batches(draw):
    """A few OpenCRF curves, mixed and bent by a gamma: monotone, from (0, 0) to (1, 1)."""
    rows = draw(st.lists(st.integers(0, len(RESPONSES) - 1), min_size=2, max_size=4, unique=True))
    weight = draw(st.floats(0, 1))
    gamma = draw(st.floats(0.4, 2.5))
    curves = RESPONSES.curves[rows]
    return (weight * curves + (1 - weight) * curves[::-1]) ** gamma


@cache
def models_by_size(kind, direction):
    return [kind.from_curves(TRAIN[direction], k, direction) for k in MODELS[kind]]


def errors_by_size(kind, direction, curves):
    return np.array([mse(m.decode(m.fit(curves)), curves) for m in models_by_size(kind, direction)])


@settings(max_examples=15)
@given(response_batches(), st.sampled_from([Polynomial, GGCM, EMoR]), st.sampled_from(["forward", "inverse"]))
def test_one_more_parameter_never_fits_worse(curves, kind, direction):
    errors = errors_by_size(kind, direction, curves if direction == "forward" else invert(curves))
    assert (errors[1:] <= errors[:-1] * (1 + 1e-7) + 1e-12).all()  # to the tolerance of the solver


@pytest.fixture(params=["opencrf", "opencrf-hdr", "dorf"])
def any_responses(request):
    name = request.param
    return (
        request.getfixturevalue("dorf_curves") if name == "dorf" else load_opencrf("hdr" if "hdr" in name else "core")
    )


@pytest.mark.parametrize("direction", ["forward", "inverse"])
@pytest.mark.parametrize("kind", [Polynomial, GGCM, EMoR])
def test_one_more_parameter_never_fits_worse_on_whole_sets(kind, direction, any_responses):
    errors = errors_by_size(kind, direction, any_responses.in_direction(direction))
    assert (errors[1:] <= errors[:-1] * (1 + 1e-7) + 1e-12).all()  # to the tolerance of the solver


@pytest.mark.parametrize("direction", ["forward", "inverse"])
def test_gamma_is_nested_in_ggcm_and_ppisp(direction):
    curves = TRAIN[direction]
    gamma = Gamma(direction)
    floor = mse(gamma.decode(gamma.fit(curves)), curves)
    for model in (GGCM(1, direction), GGCM(2, direction), PPISP(direction)):
        assert (mse(model.decode(model.fit(curves)), curves) <= floor * (1 + 1e-7) + 1e-12).all()


@pytest.mark.parametrize("direction", ["forward", "inverse"])
def test_gamma_fit_is_the_global_optimum(direction):
    """Against SciPy's global search, curve by curve."""
    curves = TRAIN[direction][SAMPLE]
    found = mse(Gamma(direction).decode(Gamma(direction).fit(curves)), curves)
    for curve, error in zip(curves, found, strict=True):
        best = differential_evolution(lambda p, c=curve: ((GRID ** p[0] - c) ** 2).mean(), [(0.01, 20)], seed=1)
        assert error <= best.fun + 1e-10


@pytest.mark.parametrize(("make", "bounds"), [(GGCM, [(-3, 6)] * 3), (PPISP, [(-3, 3)] * 4)])
@pytest.mark.parametrize("direction", [pytest.param("forward", marks=pytest.mark.slow), "inverse"])
def test_nonlinear_fits_match_many_scipy_starts(make, bounds, direction):
    curves = TRAIN[direction][::50]
    model = make(direction=direction)
    found = rmse(model.decode(model.fit(curves)), curves)
    low, high = np.array(bounds).T
    starts = np.random.default_rng(4).uniform(low, high, size=(20, len(bounds)))

    def slope(z):
        params = model.from_unconstrained(z)
        return model.jacobian(params) * model.unconstrained_slope(params)

    for curve, error in zip(curves, found, strict=True):

        def residual(z, curve=curve):
            return model.decode(model.from_unconstrained(z)) - curve

        runs = [least_squares(residual, start, jac=slope, max_nfev=60) for start in starts]
        best = np.sqrt(2 * min(run.cost for run in runs) / 1024)
        assert error <= best * 1.02 + 1e-6


def test_polynomial_fit_equals_polyfit_without_constant():
    curve = TRAIN["forward"][3]
    basis = GRID[:, None] ** np.arange(1, 4)
    expected = np.linalg.solve(basis.T @ basis, basis.T @ curve)
    assert np.allclose(Polynomial(3).fit(curve)[0], expected, rtol=1e-6)


def test_emor_of_all_components_is_exact_and_components_are_orthonormal():
    curves = TRAIN["forward"][::5]
    model = EMoR.from_curves(curves, len(curves) - 1, "forward")
    assert rmse(model.decode(model.fit(curves)), curves).max() < 1e-10
    assert np.allclose(model.components_ @ model.components_.T, np.eye(len(model.components_)), atol=1e-10)
    assert (model.components_.max(axis=1) == np.abs(model.components_).max(axis=1)).all()  # PCA leaves the sign open
    variances = (model.fit(curves) ** 2).sum(axis=0)
    assert (np.diff(variances) <= 1e-12).all()


def test_emor_refuses_more_parameters_than_components():
    with pytest.raises(InputError, match="basis of 2"):
        EMoR(GRID, [GRID, GRID**2], n_params=3)
    with pytest.raises(InputError, match="basis of 2; use 1 to 2"):
        EMoR.from_curves(TRAIN["forward"][:3], 3, "forward")
    two = EMoR.from_curves(TRAIN["forward"][:2], 1, "forward")
    np.testing.assert_allclose(two.decode(two.fit(TRAIN["forward"][:2])), TRAIN["forward"][:2], atol=1e-12)


@pytest.mark.parametrize("n_best", [1, 5])
def test_the_nearest_of_a_table_are_the_nearest(n_best):
    curves, exponents = (
        TRAIN["forward"][::30],
        np.random.default_rng(1).permutation(np.geomspace(0.1, 10, 400))[:, None],
    )
    found = nearest_in_table(curves, exponents, Gamma().decode(exponents), n_best)
    distance = cdist(curves[:, ::8], GRID[::8] ** exponents)
    expected = exponents[np.argsort(distance, axis=1)[:, :n_best]]
    assert np.array_equal(np.sort(found, axis=1), np.sort(expected, axis=1))


@pytest.mark.parametrize("params", [[1, 1, 0.45, 0.5], [2, 0.5, 1.2, 0.3], [0.6, 3, 0.8, 0.7]])
def test_ppisp_formula_and_its_inverse(params):
    t, s, g, c = params
    a = s * c / (t + (s - t) * c)
    low, high = a * (GRID / c) ** t, 1 - (1 - a) * ((1 - np.minimum(GRID, 1)) / (1 - c)) ** s
    expected = np.where(c >= GRID, low, high) ** g
    forward, inverse = PPISP("forward").decode(params), PPISP("inverse").decode(params)
    assert np.allclose(forward, expected, atol=1e-12)
    # f(g(y)) = y, with the formula evaluated at the inverse's own values.
    x = inverse
    round_trip = np.where(x <= c, a * (x / c) ** t, 1 - (1 - a) * ((1 - np.minimum(x, 1)) / (1 - c)) ** s) ** g
    assert np.allclose(round_trip, GRID, atol=1e-9)


@settings(max_examples=50)
@given(st.lists(st.floats(-5, 5), min_size=4, max_size=4), st.sampled_from(["forward", "inverse"]))
def test_ppisp_is_always_a_response(free, direction):
    model = PPISP(direction)
    curve = model.decode(model.from_unconstrained(np.array(free)))
    assert not nonmonotone(curve).any()
    assert not off_endpoints(curve).any()


@pytest.mark.parametrize("direction", ["forward", "inverse"])
@pytest.mark.parametrize("make", [Gamma, PPISP])
def test_searches_that_run_away_stay_within_floating_point(make, direction):
    """At every corner of the free parameters, and without a warning."""
    model = make(direction)
    corners = np.array(list(product([-1e3, 1e3], repeat=model.n_params)))
    params = model.from_unconstrained(corners)
    assert not nonmonotone(model.decode(params)).any()
    assert not off_endpoints(model.decode(params)).any()
    assert np.isfinite(model.jacobian(params)).all()


def test_ppisp_refuses_what_is_no_response():
    for params in ([0, 1, 1, 0.5], [1, 1, 1, 1.0], [1, 1, -1, 0.5]):
        with pytest.raises(InputError, match="above 0"):
            PPISP().decode(params)
    with pytest.raises(InputError, match="gamma=-1 is out of range"):
        Gamma().decode([-1.0])


@pytest.mark.dorf
def test_published_emor_gives_the_papers_figures(dorf_curves, emor_files):
    curves = dorf_curves.in_direction("forward")
    models = [load_model(ModelKey("EMoR", "published", k, "forward")) for k in (1, 2, 3, 4)]
    np.testing.assert_array_equal(models[3].mean_, load_emor_basis("forward")[0])
    means = [rmse(m.decode(m.fit(curves)), curves).mean() for m in models]
    assert np.allclose(means, [3.60e-2, 1.24e-2, 5.71e-3, 3.21e-3], rtol=2e-3)


def test_a_model_without_a_prior_draws_nothing():
    with pytest.raises(InputError, match=r"Gamma\(n_params=1, direction='inverse'\) has no prior .*learn_prior"):
        Gamma().sample(3, seed=0)


# --- one name a model


@pytest.mark.parametrize("key", bundled_models(), ids=str)
def test_every_bundled_model_has_one_name_and_a_prior_of_plausible_curves(key):
    assert ModelKey.parse(str(key)) == ModelKey.parse(str(key).upper()) == key
    model = load_model(str(key))
    assert ModelKey.of(model) == key
    assert (model.name, model.n_params, model.direction) == (key.family, key.n_params, key.direction)
    assert model.prior_.mean.shape == (key.n_params,)
    assert (np.linalg.eigvalsh(model.prior_.covariance) > 0).all()
    middle = model.decode(model.from_unconstrained(model.prior_.mean))
    assert abs(middle[512] - (0.7 if key.direction == "forward" else 0.3)) < 0.2
    assert middle[512] > middle[100]
    assert middle[900] > middle[512]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("Spline-3", "name='Spline-3' is not a valid name of a model; use one such as 'SLR-ldl-1'"),
        ("SLR-ldl", "not a valid name"),
        ("Gamma-1-sideways", "not a valid name"),
        (None, "name=None is not a valid name"),
        ("Gamma-2", "no model 'Gamma-2' is bundled; use one of Gamma-1, Gamma-1-forward$"),
        ("EMoR-5", "no model 'EMoR-5' is bundled; use one of EMoR-1, EMoR-2, EMoR-3, EMoR-4, EMoR-1-forward"),
        (
            "SLR-unheard-1",
            "no model 'SLR-unheard-1' is bundled; use one of SLR-aae-1-forward, SLR-aae-1, .*SLR-ldl-1, ",
        ),
        ("slr-LDL-2", "no model 'SLR-ldl-2' is bundled"),
    ],
)
def test_names_that_are_not_known_are_refused_with_a_list(name, message):
    with pytest.raises(InputError, match=message):
        load_model(name)


def test_the_published_emor_must_be_fetched(monkeypatch, tmp_path):
    monkeypatch.setenv("CRFBENCH_DATA", str(tmp_path))
    with pytest.raises(MissingDataError, match="crfbench fetch emor"):
        load_model("EMoR-published-3")


@pytest.mark.parametrize("damage", ["truncated", "emptied", "bytes", "another archive"])
def test_a_damaged_file_of_priors_is_told(damage, tmp_path, monkeypatch):
    content = bundled(registry.PRIORS).read_bytes()
    path = tmp_path / "priors.npz"
    if damage == "another archive":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("Gamma-1.mean.npy", b"none")
    else:
        half = len(content) // 2
        path.write_bytes({"truncated": content[:half], "emptied": b"", "bytes": b"\0" * half}[damage])
    monkeypatch.setattr(registry, "bundled", lambda name: path if name == registry.PRIORS else bundled(name))
    with pytest.raises(FormatError, match=r"priors\.npz is missing or damaged.*install crfbench again"):
        load_model("Gamma-1")


@pytest.mark.dorf
@pytest.mark.parametrize("key", [key for key in CASES if not key.constraint], ids=str)
def test_bundled_priors_are_those_of_the_dorf_curves(key, dorf_curves):
    curves, model = dorf_curves.in_direction(key.direction), load_model(key)
    again = type(model).from_curves(curves, key.n_params, key.direction)
    prior = learn_prior(again, curves)
    scale = np.sqrt(np.diagonal(prior.covariance)).max()
    # Some curves hardly tell PPISP's centre: where the search for it ends depends on how the processor rounds.
    share = 0.02 if key.family == "PPISP" else 1e-3
    assert np.allclose(model.prior_.mean, prior.mean, atol=share * scale)
    assert np.allclose(model.prior_.covariance, prior.covariance, rtol=1e-2, atol=share * scale**2)
    if key.family in ("EMoR", "Kernel"):
        assert np.allclose(model.components_, again.components_, atol=1e-6)
        assert np.allclose(model.mean_, again.mean_, atol=1e-6)


@pytest.mark.parametrize("direction", ["inverse", "forward"])
def test_one_more_coefficient_of_ggcm_never_fits_worse(direction):
    curves = load_opencrf().in_direction(direction)
    fits = [GGCM(k, direction) for k in (1, 2, 3, 4)]
    costs = [((fit.decode(fit.fit(curves)) - curves) ** 2).mean(axis=1) for fit in fits]
    assert all((more <= fewer * (1 + 1e-9)).all() for fewer, more in pairwise(costs))
