"""The losses against independent arithmetic: lstsq, a dense covariance, finite differences, integrals."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import binomtest, norm

from crfbench.calibration import Noise, Observations, calibrate, decode_table
from crfbench.calibration.paper_loss import AlignedLoss
from crfbench.calibration.posterior import Likelihood, Posterior, PosteriorSamples, drawn_samples, exact_samples
from crfbench.calibration.table import chunks
from crfbench.curves import GRID
from crfbench.errors import InputError
from crfbench.metrics import rmse
from crfbench.models import load_model
from tests.support.observing import known_curves, ready, scene, unclipped

ROW = np.array([0])
KNOWN = [("reference",), ("exposures",), ("reference", "exposures")]


def observed(rng, known=("reference",), n=1, e=3, p=6, clipped=0.0, darkest=0.05, absolute=False):
    given = {"reference": rng.uniform(0.1, 1, (n, p)), "exposures": np.sort(rng.uniform(0, 3, (n, e)), axis=1)}
    brightness = rng.uniform(darkest, 0.95, (n, e, p))
    return Observations(
        brightness,
        **{name: given[name] for name in known},
        clipped=rng.random((n, e, p)) < clipped,
        weights=rng.uniform(0.5, 2, (n, e, p)),
        reference_error=rng.uniform(0.02, 0.2, p),
        absolute=absolute,
    )


# --- the paper's loss


def loss_by_lstsq(curve, brightness, reference, weights):
    """The paper's loss, photograph by photograph."""
    squares = []
    for b, w in zip(brightness, weights, strict=True):
        g = np.interp(b, GRID, curve)
        columns = np.stack([g, np.ones_like(g)], axis=1) * np.sqrt(w)[:, None]
        fit = np.linalg.lstsq(columns, np.sqrt(w) * reference)[0]
        squares.append(((np.sqrt(w) * reference - columns @ fit) ** 2).sum() / w.sum())
    return np.linalg.norm(squares)


@pytest.mark.parametrize("name", ["SLR-ldl-1", "GGCM-3"])
def test_the_papers_loss_is_least_squares_in_each_photograph(name):
    model, table = ready(name)
    observations = observed(np.random.default_rng(0), n=3)
    loss = AlignedLoss(observations)
    on_table = loss.on_table(table)
    for i in range(3):
        rows = np.random.default_rng(i).integers(0, len(table.unconstrained), 5)
        curves = model.decode(table.params[rows])
        given = observations.brightness[i], observations.reference[i], observations.weights[i]
        expected = [loss_by_lstsq(curve, *given) for curve in curves]
        polished = np.linalg.norm(loss.evaluate(model, table.unconstrained[rows], np.full(5, i))[0], axis=1)
        assert np.allclose(polished, expected, rtol=1e-9)
        assert np.allclose(on_table[i, rows], expected, rtol=1e-4)


@pytest.mark.parametrize("contrast", [1.0, 1e-2])
def test_the_table_ranks_photographs_of_low_contrast_too(contrast):
    """Bright patches that differ little: the worst case of single precision."""
    model, table = ready("SLR-ldl-1")
    brightness = 0.98 - contrast * np.random.default_rng(1).uniform(0, 0.9, (2, 3, 9))
    loss = AlignedLoss(unclipped(brightness, np.linspace(1, 5, 9)))
    for i, row in enumerate(loss.on_table(table)):
        sets = np.full(len(table.unconstrained), i)
        exact = np.linalg.norm(loss.evaluate(model, table.unconstrained, sets)[0], axis=1)
        assert np.allclose(row, exact, rtol=1e-3)


def differences(value, at, step=1e-6):
    """Central differences of a function of rows, (m, k) to (m,)."""
    shifts = step * np.eye(at.shape[1])
    return np.stack([(value(at + shift) - value(at - shift)) / (2 * step) for shift in shifts], axis=1)


@pytest.mark.parametrize("name", ["SLR-ldl-1", "SLR-monotone-1", "SLR-ldl-3", "PPISP-4", "EMoR-3"])
class TestGradients:
    def drawn(self, name):
        model, _ = ready(name)
        return model, 0.5 * model.prior_.sample(5, seed=2) + 0.5 * model.prior_.mean

    def test_of_the_papers_loss(self, name):
        model, free = self.drawn(name)
        loss = AlignedLoss(observed(np.random.default_rng(3)))
        owner = np.zeros(5, dtype=int)
        mse, gradient, _ = loss.evaluate(model, free, owner)
        for photograph in range(mse.shape[1]):
            numeric = differences(lambda z, e=photograph: loss.evaluate(model, z, owner)[0][:, e], free)
            assert np.allclose(gradient[:, photograph], numeric, rtol=1e-4, atol=1e-6 * np.abs(numeric).max())
        objective = loss.objective(model)
        half = objective(free, owner)[2]
        numeric = differences(lambda z: objective(z, owner)[0], free)
        assert np.allclose(2 * half, numeric, rtol=1e-4, atol=1e-6 * np.abs(numeric).max())

    @pytest.mark.parametrize("known", KNOWN)
    def test_of_the_posterior(self, name, known):
        model, free = self.drawn(name)
        posterior = Posterior(observed(np.random.default_rng(4), known, clipped=0.2, darkest=0.25), Noise())
        objective, owner = posterior.objective(model), np.zeros(5, dtype=int)
        _, curvature, half = objective(free, owner)
        numeric = differences(lambda z: objective(z, owner)[0], free, step=1e-5)
        assert np.allclose(2 * half, numeric, rtol=1e-3, atol=1e-4 * np.abs(numeric).max())
        assert (np.linalg.eigvalsh(curvature) > 0).all()

    def test_the_objective_is_the_log_posterior(self, name):
        model, table = ready(name)
        posterior = Posterior(observed(np.random.default_rng(5), clipped=0.2), Noise())
        free = table.unconstrained[::37][:8]
        curves = model.decode(model.from_unconstrained(free))
        irradiance = np.array([np.interp(posterior.brightness, GRID, curve) for curve in curves])
        logs = posterior.log_likelihood(np.moveaxis(irradiance, 0, -1))[0]
        off = free - model.prior_.mean
        logs -= 0.5 * np.einsum("mi,ij,mj->m", off, np.linalg.inv(model.prior_.covariance), off)
        value = posterior.objective(model)(free, np.zeros(len(free), dtype=int))[0]
        assert np.allclose(value, -2 * logs, rtol=1e-9)


class TestCurvature:
    """Exact in the best places; and searches by it are short. The gradients that are differenced are tested above."""

    def slopes(self, gradient, free, step=1e-5):
        """Differentiate a gradient (..., k) by each of the unconstrained parameters, (..., k, k)."""
        shifts = step * np.eye(len(free))
        return np.stack([(gradient(free + s) - gradient(free - s)) / (2 * step) for s in shifts], axis=-1)

    @pytest.fixture
    def perfect(self):
        """A model, free parameters and observations that they explain without a residual."""
        model = load_model("GGCM-3")
        free = model.prior_.mean
        reference, exposures, brightness = scene(model.decode(free[None]))
        return model, free, (brightness, reference, exposures)

    def test_of_the_papers_loss_at_a_perfect_fit(self, perfect):
        model, free, (brightness, reference, _) = perfect
        weights = np.random.default_rng(1).uniform(0.5, 2, 10)
        loss = AlignedLoss(unclipped(brightness, reference, weights=weights))
        mse, _, half = loss.evaluate(model, free[None], ROW)
        assert mse.max() < 1e-20
        numeric = self.slopes(lambda z: loss.evaluate(model, z[None], ROW)[1][0], free)
        assert np.allclose(2 * half[0], numeric, rtol=1e-4, atol=1e-6 * np.abs(numeric).max())

    def test_of_the_square_of_the_papers_loss_near_a_perfect_fit(self, perfect):
        model, free, (brightness, reference, _) = perfect
        nearly = reference * np.exp(1e-4 * np.random.default_rng(3).normal(size=reference.shape))
        objective = AlignedLoss(unclipped(brightness, nearly)).objective(model)
        numeric = self.slopes(lambda z: objective(z[None], ROW)[2][0], free, step=1e-7)
        assert np.allclose(objective(free[None], ROW)[1][0], numeric, atol=0.01 * np.abs(numeric).max())

    @pytest.mark.parametrize("known", KNOWN)
    def test_of_the_posterior_at_a_perfect_fit(self, perfect, known):
        model, free, (brightness, reference, exposures) = perfect
        given = {"reference": reference, "exposures": exposures}
        observations = unclipped(brightness, **{each: given[each] for each in known})
        objective = Posterior(observations, Noise()).objective(model)
        curved = objective(free[None], ROW)[1][0]
        numeric = self.slopes(lambda z: objective(z[None], ROW)[2][0], free)
        assert np.allclose(curved, numeric, rtol=1e-3, atol=1e-4 * np.abs(numeric).max())

    def test_of_clipped_patches(self):
        """The logarithm of GGCM is linear in its parameters, so what censoring adds has this curvature anywhere."""
        model = load_model("GGCM-3")
        rng = np.random.default_rng(2)
        brightness, reference = rng.uniform(0.3, 0.95, (1, 3, 6)), rng.uniform(0.1, 1, 6)
        clipped = np.zeros((1, 3, 6), bool)
        clipped[0, 1, 2] = clipped[0, 2, 5] = True
        told = Posterior(Observations(brightness, reference, clipped=clipped), Noise()).objective(model)
        silent = Posterior(unclipped(brightness, reference, weights=~clipped), Noise()).objective(model)
        free = model.prior_.mean

        def added(z):
            return [
                with_it - without for with_it, without in zip(told(z[None], ROW), silent(z[None], ROW), strict=True)
            ]

        numeric = self.slopes(lambda z: added(z)[2][0], free)
        assert np.abs(numeric).max() > 1e-3
        assert np.allclose(added(free)[1][0], numeric, rtol=1e-4, atol=1e-6 * np.abs(numeric).max())


# --- the likelihood


def dense_covariance(observations, noise):
    """Covariance of the counted log irradiances with the unknowns as Gaussian effects; indices of the counted."""
    e, p = observations.brightness.shape[1:]
    photograph, patch = np.nonzero(observations.counts[0])
    b, w = observations.brightness[0, photograph, patch], observations.weights[0, photograph, patch]
    own = (2.2 * noise.brightness / b) ** 2 / w
    wide = 1e3**2
    error = observations.reference_error[0] ** 2 if observations.reference is not None else np.full(p, wide)
    if observations.exposures is None:
        exposure = np.linalg.inv((np.eye(e) - 1 / e) / wide + np.eye(e) / wide)
    elif observations.absolute:
        exposure = np.eye(e) * (noise.exposure * np.log(2)) ** 2
    else:
        exposure = np.linalg.inv((np.eye(e) - 1 / e) / (noise.exposure * np.log(2)) ** 2 + np.eye(e) / wide)
    same_patch = patch[:, None] == patch
    covariance = np.diag(own) + same_patch * error[patch] + exposure[photograph[:, None], photograph]
    return covariance, photograph, patch


def dof_by_rank(observations, i):
    """Counted observations less the rank of the unknowns that they determine."""
    photograph, patch = np.nonzero(observations.counts[i])
    columns = [np.ones((len(patch), 0 if observations.absolute else 1))]
    if observations.exposures is None:
        columns.append(photograph[:, None] == np.unique(photograph))
    if observations.reference is None:
        columns.append(patch[:, None] == np.unique(patch))
    weight = observations.weights[i, photograph, patch].sum()
    return max(weight - np.linalg.matrix_rank(np.hstack(columns)), 1)


@pytest.mark.parametrize(("known", "absolute"), [*((known, False) for known in KNOWN), (KNOWN[2], True)])
def test_unknowns_take_up_degrees_of_freedom(known, absolute):
    observations = observed(np.random.default_rng(9), known, n=4, clipped=0.3, absolute=absolute)
    freedom = Likelihood(observations, Noise()).freedom
    assert np.allclose(freedom, [dof_by_rank(observations, i) for i in range(4)])


@pytest.mark.parametrize("known", KNOWN)
def test_clipped_patches_speak_only_where_others_give_them_a_scale(known):
    """A whole photograph and a whole patch are clipped, and one patch in one photograph; one that is left out never."""
    clipped = np.zeros((1, 3, 5), bool)
    clipped[0, 1] = clipped[0, :, 2] = clipped[0, 0, 4] = True
    brightness = np.where(clipped, 1.0, np.linspace(0.2, 0.8, 5) * np.array([[0.9], [1.0], [1.1]]))
    weights = np.ones((3, 5))
    weights[2, 2] = 0
    brightness[0, 0, 4] = 0
    given = {"reference": np.arange(1, 6), "exposures": np.arange(3)}
    observations = Observations(brightness, **{each: given[each] for each in known}, clipped=clipped, weights=weights)
    expected = np.where(clipped & (weights > 0), 1, 0)
    expected[0, 0, 4] = -1
    if "exposures" not in known:
        expected[0, 1] = 0
    if "reference" not in known:
        expected[0, :, 2] = 0
    assert np.array_equal(np.sign(Likelihood(observations, Noise()).clip), expected)


def test_a_reference_better_than_any_counts_as_exact():
    given = np.array([[0.2, 0.4, 0.6, 0.8]]), np.array([1.0, 6.0, 11.0, 30.0])
    d = np.random.default_rng(1).normal(size=(1, 1, 4, 3))
    tiny, exact = (Likelihood(unclipped(*given, reference_error=e), Noise()).squares(d, ROW)[0] for e in (1e-30, 1e-6))
    assert np.allclose(tiny, exact, rtol=1e-6)
    assert np.allclose(
        exact, Likelihood(unclipped(*given, reference_error=1e-4), Noise()).squares(d, ROW)[0], rtol=1e-3
    )


@pytest.mark.parametrize(("known", "absolute"), [*((known, False) for known in KNOWN), (KNOWN[2], True)])
@pytest.mark.parametrize("seed", range(3))
def test_the_quadratic_form_is_that_of_the_dense_covariance(known, absolute, seed):
    rng = np.random.default_rng(seed)
    observations, noise = observed(rng, known, clipped=0.2, absolute=absolute), Noise(exposure=0.2)
    likelihood = Likelihood(observations, noise)
    d = rng.normal(size=(1, 3, 6, 4))
    covariance, photograph, patch = dense_covariance(observations, noise)
    inner = d[0, photograph, patch]
    expected = np.einsum("ik,ij,jk->k", inner, np.linalg.inv(covariance), inner)
    squares, exposures = likelihood.squares(d, ROW)
    assert np.allclose(squares[0], expected, rtol=1e-5)
    product, same = likelihood.products(d, ROW)
    assert np.allclose(product[0], inner.T @ np.linalg.inv(covariance) @ inner, rtol=1e-5, atol=1e-4)
    assert np.allclose(exposures, same)
    assert exposures.shape == (1, 3, 4)


def test_a_photograph_of_weight_2_equals_the_photograph_twice_when_its_exposure_is_free():
    observations = observed(np.random.default_rng(6))
    weights = np.ones((3, 6))
    weights[1] = 2
    once = Observations(observations.brightness, observations.reference, weights=weights)
    twice = Observations(observations.brightness[:, [0, 1, 1, 2]], observations.reference)
    d = np.random.default_rng(7).normal(size=(1, 3, 6, 5))
    first = Likelihood(once, Noise()).squares(d, ROW)[0]
    assert np.allclose(first, Likelihood(twice, Noise()).squares(d[:, [0, 1, 1, 2]], ROW)[0], rtol=1e-5)


def test_what_the_unknowns_absorb_costs_nothing():
    """Any scale of a photograph with a reference; also any irradiance of a patch without."""
    rng = np.random.default_rng(8)
    d = rng.normal(size=(1, 3, 6, 1))
    scale, irradiance = rng.normal(size=(1, 3, 1, 1)), rng.normal(size=(1, 1, 6, 1))
    with_reference = Likelihood(observed(rng), Noise())
    assert np.allclose(with_reference.squares(d, ROW)[0], with_reference.squares(d + scale, ROW)[0], rtol=1e-4)
    without = Likelihood(observed(rng, ("exposures",)), Noise())
    assert np.allclose(without.squares(d, ROW)[0], without.squares(d + irradiance, ROW)[0], rtol=1e-4)


def test_clipped_patches_are_censored():
    """Against SciPy: how probable it is that a patch is at least, or at most, as bright as it looks."""
    brightness = np.array([[[0.2, 0.5, 0.7, 1.0, 0.0]]])
    reference, error = np.array([1.0, 3.0, 5.0, 9.0, 0.1]), 0.1
    noise = Noise(brightness=0.03, independent=1.0)
    posterior = Posterior(Observations(brightness, reference, reference_error=error), noise)
    alone = Posterior(Observations(brightness[..., :3], reference[:3], reference_error=error), noise)
    g = np.array([0.1, 0.31, 0.52, 0.95, 0.02])
    added = posterior.log_likelihood(g[None, None, :, None]) - alone.log_likelihood(g[None, None, :3, None])
    variance = (2.2 * 0.03 / np.array([0.2, 0.5, 0.7])) ** 2 + error**2
    scale = np.average(np.log(g[:3] / reference[:3]), weights=1 / variance)  # g = scale x reference, in logarithms
    sigma = np.hypot(2.2 * 0.03 / np.array([1.0, 1 / 255]), error)
    beyond = norm.logsf(np.log(g[3] / reference[3]), scale, sigma[0])
    below = norm.logcdf(np.log(g[4] / reference[4]), scale, sigma[1])
    assert np.allclose(added, beyond + below, rtol=1e-4)


def test_noise_that_cannot_be_is_refused():
    for name in ("brightness", "exposure", "independent", "freedom"):
        for value in (0, -1, np.nan, np.inf, 1e-9):
            with pytest.raises(InputError, match=rf"noise {name}=.*use a number from 1e-06 to 1e\+06"):
                Noise(**{name: value})


# --- the posterior


def brute_force(model, observations, noise):
    """The posterior of one parameter on a very fine grid: unconstrained parameters, weights, curves, log evidence."""
    mean, sd = model.prior_.mean[0], model.prior_.covariance[0, 0] ** 0.5
    free = mean + sd * np.linspace(-6, 6, 6001)
    curves = model.decode(model.from_unconstrained(free[:, None]))
    posterior = Posterior(observations, noise)
    at = observations.brightness[0]
    irradiance = np.array([np.interp(at, GRID, curve) for curve in curves])
    logs = posterior.log_likelihood(np.moveaxis(irradiance, 0, -1)[None])[0]
    density = np.exp(logs - logs.max()) * norm.pdf(free, mean, sd)
    total = density.sum() * (free[1] - free[0])
    return free, density / density.sum(), curves, np.log(total) + logs.max()


@pytest.mark.parametrize("name", ["SLR-ldl-1", "SLR-monotone-1", "Gamma-1"])
@pytest.mark.parametrize("known", KNOWN)
@pytest.mark.parametrize("noise", [pytest.param(Noise(), marks=pytest.mark.slow), Noise(brightness=0.005)])
def test_the_posterior_of_one_parameter_is_the_integral(name, known, noise):
    model, table = ready(name)
    curves = known_curves(model, 1, seed=5)
    reference, exposures, brightness = scene(curves)
    brightness = np.clip(brightness + 0.01 * np.random.default_rng(1).normal(size=brightness.shape), 0.005, 0.99)
    given = {"reference": reference, "exposures": exposures}
    observations = unclipped(brightness, **{each: given[each] for each in known})
    found = calibrate(model, observations, "posterior", discrepancy=False, noise=noise, table=table)
    free, weights, dense, log_evidence = brute_force(model, observations, noise)
    assert np.isclose(found.samples.weights.sum(), 1)
    assert rmse(found.curves[0], weights @ dense) < 2e-4
    assert np.isclose(found.samples.log_evidence[0], log_evidence, atol=0.01)
    steps = np.abs(np.diff(table.curves[128:-128], axis=0)).max(axis=0)  # one row of the table
    best = free[np.argmax(weights)]
    assert abs(model.to_unconstrained(found.params)[0, 0] - best) < 2 * (free[1] - free[0])
    for level, band in found.bands.items():
        for share, end in zip((0.5 - level / 2, 0.5 + level / 2), band, strict=True):
            for sample in range(40, 1024, 77):
                order = np.argsort(dense[:, sample])
                rank = np.searchsorted(np.cumsum(weights[order]), share)
                assert abs(end[0, sample] - dense[order[rank], sample]) < 1.2 * steps[sample]


@pytest.mark.parametrize("shared", [True, False])
def test_means_and_quantiles_of_curves_are_numpys(shared):
    """Equal weights by Hazen's definition, in which a value stands for itself up to halfway; others by `np.interp`."""
    rng, levels = np.random.default_rng(3), (0.02, 0.25, 0.5, 0.9, 0.99)
    curves = GRID ** rng.uniform(0.3, 3, (1 if shared else 2, 20, 1)) + 0.2 * rng.normal(size=(1, 20, 1)) * GRID
    weights = np.stack([np.full(20, 0.05), rng.dirichlet(np.ones(20))])
    at = np.append(np.arange(0, 1024, 8), 1023)
    order = np.argsort(np.swapaxes(curves[:, :, at], 1, 2), axis=2)
    samples = PosteriorSamples(rng.normal(size=(*curves.shape[:2], 1)), curves, order, weights, np.zeros(2))
    even, uneven = curves[0], curves[-1]
    assert np.allclose(samples.mean(), [even.mean(axis=0), np.average(uneven, axis=0, weights=weights[1])], atol=1e-6)
    found = samples.quantiles(levels)
    assert np.allclose([q[0, at] for q in found], np.quantile(even, levels, axis=0, method="hazen")[:, at])
    for sample in at:
        rank = np.argsort(uneven[:, sample])
        middle = np.cumsum(weights[1, rank]) - weights[1, rank] / 2
        assert np.allclose([q[1, sample] for q in found], np.interp(levels, middle, uneven[rank, sample]))
    for quantile in found:
        assert np.allclose(quantile, [np.interp(GRID, GRID[at], row[at]) for row in quantile])


def test_a_table_is_looked_up_as_by_interpolation():
    table = ready("GGCM-3")[1]
    brightness = np.append(np.random.default_rng(1).random((2, 3, 5)), np.tile([0.0, 1.0], (2, 3, 1)), axis=2)
    expected = np.array([np.interp(brightness, GRID, curve) for curve in table.curves[:9].astype(float)])
    assert np.allclose(table.at(brightness)[..., :9], np.moveaxis(expected, 0, -1), atol=1e-5)


@pytest.mark.parametrize("cells", [0, 1, 2**17, 2**17 + 1, 2**19, 2**21])
def test_parts_hold_every_set_once_and_as_many_as_may_be(cells):
    sizes = [part.stop - part.start for part in chunks(11, cells)]
    assert [i for part in chunks(11, cells) for i in range(part.start, part.stop)] == list(range(11))
    most = next(n for n in range(11, 0, -1) if n == 1 or n * cells <= 2**19)
    assert set(sizes[:-1]) <= {most}
    assert 0 < sizes[-1] <= most


def test_bands_are_nested():
    model, table = ready("SLR-ldl-3")
    reference, _, brightness = scene(known_curves(model, 5))
    found = calibrate(model, Observations(brightness, reference), "posterior", discrepancy=False, table=table)
    (inner_low, inner_high), (outer_low, outer_high) = found.bands[0.5], found.bands[0.9]
    assert (outer_low <= inner_low).all()
    assert (inner_low <= inner_high).all()
    assert (inner_high <= outer_high).all()
    middle = slice(200, 800)
    assert ((outer_high - outer_low)[:, middle] > (inner_high - inner_low)[:, middle]).all()


def test_evidence_of_a_toy_is_its_integral():
    """Two photographs of two patches by a gamma curve: everything in one line, integrated by SciPy."""
    model = load_model("Gamma-1")
    brightness, reference = np.array([[0.3, 0.8]]), np.array([1.0, 6.0])
    noise = Noise(brightness=0.05, independent=1.0, freedom=3.0)
    found = calibrate(
        model, unclipped(brightness, reference, reference_error=0.1), "posterior", discrepancy=False, noise=noise
    )
    variance = ((2.2 * 0.05 / brightness[0]) ** 2 + 0.1**2).sum()  # of the difference of the two; one scale is free
    mean, sd = model.prior_.mean[0], model.prior_.covariance[0, 0] ** 0.5

    def density(z):
        difference = np.exp(z) * np.log(0.8 / 0.3) - np.log(6.0)
        return (1 + difference**2 / variance / 3) ** (-(1 + 3) / 2) * norm.pdf(z, mean, sd)

    expected = quad(density, mean - 8 * sd, mean + 8 * sd, limit=200)[0]
    assert np.isclose(found.samples.log_evidence[0], np.log(expected), atol=1e-3)


def test_the_scale_of_the_noise_by_hand():
    """Four patches of a gamma curve: their weighted scatter about one free scale, and three degrees of freedom."""
    brightness, reference = np.array([0.2, 0.4, 0.6, 0.8]), np.array([1.0, 6.0, 11.0, 30.0])
    noise = Noise(brightness=0.03, independent=0.4, freedom=5.0)
    observations = unclipped(brightness[None], reference, reference_error=0.1)
    found = calibrate(load_model("Gamma-1"), observations, noise=noise, discrepancy=False)
    precision = 1 / ((2.2 * 0.03 / brightness) ** 2 + 0.1**2)
    residual = found.params[0, 0] * np.log(brightness) - np.log(reference)
    scatter = (precision * (residual - np.average(residual, weights=precision)) ** 2).sum()
    assert np.isclose(found.noise_scale[0], np.sqrt((5 + 0.4 * scatter) / (5 + 0.4 * 3)), rtol=1e-3)


def test_draws_weigh_as_the_exact_table_does():
    """One parameter, which both can do; the draws are spread no less than the posterior, or few would weigh much."""
    model, table = ready("Gamma-1")
    reference, _, brightness = scene(known_curves(model, 4))
    posterior = Posterior(unclipped(brightness, reference), Noise())
    logs = posterior.log_likelihood_on(table)
    exact, best = exact_samples(table, logs), table.unconstrained[np.argmax(logs + table.log_prior, axis=1)]
    drawn, again, other = (drawn_samples(posterior, model, best, seed) for seed in (1, 1, 2))
    assert np.array_equal(drawn.unconstrained, again.unconstrained)
    assert not np.array_equal(drawn.unconstrained, other.unconstrained)
    assert np.allclose(drawn.log_evidence, exact.log_evidence, atol=0.1)
    free = exact.unconstrained[..., 0]
    mean = (exact.weights * free).sum(axis=1)
    sd = np.sqrt((exact.weights * (free - mean[:, None]) ** 2).sum(axis=1))
    assert np.allclose(np.einsum("nt,nt->n", drawn.weights, drawn.unconstrained[..., 0]), mean, atol=0.2 * sd.min())
    assert (drawn.unconstrained[..., 0].std(axis=1) > 0.9 * sd).all()
    assert (np.abs(drawn.mean() - exact.mean()).max(axis=1) < 0.01).all()
    for ours, theirs in zip(drawn.quantiles((0.1, 0.5, 0.9)), exact.quantiles((0.1, 0.5, 0.9)), strict=True):
        assert np.abs(ours - theirs).max() < 0.02


def test_draws_spread_as_the_curvature_tells_only_wider():
    """Three parameters that depend on each other: whitened by the curvature, the draws have variance 1.4^2."""
    model, _ = ready("GGCM-3")
    reference, _, brightness = scene(known_curves(model, 4))
    posterior = Posterior(unclipped(brightness, reference), Noise())
    best, rows = np.tile(model.prior_.mean, (4, 1)), np.arange(4)
    root = np.linalg.cholesky(posterior.objective(model)(best, rows)[1])
    off = drawn_samples(posterior, model, best, seed=3).unconstrained - best[:, None]
    assert np.allclose(np.cov((off @ root).reshape(-1, 3).T), 1.4**2 * np.eye(3), atol=0.3)


def test_posterior_means_are_irradiances_where_the_model_is_unbounded():
    model, table = ready("Polynomial-3")
    dark = unclipped(np.array([[0.05, 0.1, 0.15]]), np.array([1.0, 2.5, 4.0]))
    assert (np.abs(table.curves[:, 900:] - 0.5) > 0.6).any()
    found = calibrate(model, dark, "posterior", discrepancy=False, table=table)
    for curve in (found.curves, *found.bands[0.5], *found.bands[0.9]):
        assert curve.min() >= 0
        assert curve.max() <= 1


def test_drawn_posteriors_agree_with_a_dense_grid():
    """Two parameters: 256 weighted draws against 14,400 points."""
    model, table = ready("GGCM-2")
    reference, _, brightness = scene(known_curves(model, 3))
    brightness = np.clip(brightness + 0.02 * np.random.default_rng(2).normal(size=brightness.shape), 0.005, 0.99)
    observations = unclipped(brightness, reference)
    found = calibrate(model, observations, "posterior", discrepancy=False, table=table)
    root = np.linalg.cholesky(model.prior_.covariance)
    steps = np.linspace(-5, 5, 120)
    normal = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    dense = decode_table(model)
    dense = type(dense)(
        model.prior_.mean + normal @ root.T, normal, model.decode(model.prior_.mean + normal @ root.T), normal[:, 0]
    )
    logs = Posterior(observations, Noise()).log_likelihood_on(dense) - 0.5 * (normal**2).sum(axis=1)
    weights = np.exp(logs - logs.max(axis=1, keepdims=True))
    log_evidence = np.log(weights.sum(axis=1) * (steps[1] - steps[0]) ** 2 / (2 * np.pi)) + logs.max(axis=1)
    weights /= weights.sum(axis=1, keepdims=True)
    mean = weights @ dense.curves
    spread = np.sqrt(np.maximum(weights @ dense.curves**2 - mean**2, 0))
    assert (np.abs(found.curves - mean)[:, 1:-1] <= 0.3 * spread[:, 1:-1] + 1e-4).all()
    width = (found.bands[0.9][1] - found.bands[0.9][0])[:, 100:900] / (2 * 1.645 * spread[:, 100:900])
    assert 0.75 < width.min() < width.max() < 1.3
    assert np.allclose(found.samples.log_evidence, log_evidence, atol=0.15)


@pytest.mark.parametrize("name", ["SLR-monotone-1", "SLR-ldl-1", pytest.param("GGCM-2", marks=pytest.mark.slow)])
def test_bands_cover_as_often_as_they_say(name):
    """Truth from the prior, one photograph, errors as `Noise` states them: then the posterior is exact."""
    model, table = ready(name)
    noise, rng, n, p = Noise(independent=1.0), np.random.default_rng(12), 300, 10
    curves = model.decode(model.from_unconstrained(model.prior_.sample(n, seed=11)))
    curves = curves[curves[:, 100:].min(axis=1) > 1e-3]
    n = len(curves)
    brightness = rng.uniform(0.1, 0.98, (n, 1, p))
    irradiance = np.array([np.interp(b[0], GRID, curve) for b, curve in zip(brightness, curves, strict=True)])
    sigma = np.hypot(2.2 * noise.brightness / brightness[:, 0], 0.05)
    sigma *= np.sqrt(noise.freedom / rng.chisquare(noise.freedom, size=(n, 1)))  # the scale of all the noise
    reference = irradiance * np.exp(sigma * rng.normal(size=(n, p)))
    found = calibrate(model, unclipped(brightness, reference), "posterior", discrepancy=False, noise=noise, table=table)
    for level, (low, high) in found.bands.items():
        for sample in (251, 512, 773):
            inside = (low[:, sample] <= curves[:, sample]) & (curves[:, sample] <= high[:, sample])
            assert binomtest(int(inside.sum()), n, level).pvalue > 1e-3


@pytest.mark.parametrize("known", KNOWN)
def test_bands_cover_nearly_as_often_when_it_is_brightness_that_errs(known):
    """The width of the noise is that of a typical response, and all observations do not count in full."""
    model, table = ready("SLR-monotone-1")
    noise, rng, n = Noise(independent=0.25), np.random.default_rng(13), 200
    curves = model.decode(model.from_unconstrained(model.prior_.sample(n, seed=14)))
    reference, exposures, _ = scene(curves, patches=12)
    log_irradiance = np.log(reference * np.exp(0.05 * rng.normal(size=reference.shape)))[:, None]
    log_irradiance = log_irradiance + (np.log(2) * (exposures + 0.1 * rng.normal(size=exposures.shape)))[:, :, None]
    pairs = zip(np.exp(log_irradiance).reshape(n, -1), curves, strict=True)
    exact = np.array([np.interp(i, curve, GRID) for i, curve in pairs]).reshape(log_irradiance.shape)
    brightness = np.clip(exact + noise.brightness * rng.normal(size=exact.shape), 0, 1)
    given = {"reference": reference, "exposures": exposures}
    observations = Observations(brightness, **{each: given[each] for each in known})
    low, high = calibrate(model, observations, "posterior", discrepancy=False, noise=noise, table=table).bands[0.9]
    inside = (low <= curves) & (curves <= high)
    assert 0.85 < inside[:, 100:900].mean() < 0.97
