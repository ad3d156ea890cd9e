"""The calibrator that knows of its models' misses: against dense arithmetic, simulation, and unseen cameras."""

from itertools import product

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

import crfbench
from crfbench.calibration import Noise, Observations, calibrate, decode_table, learn_discrepancy, learning
from crfbench.calibration import mixture as mixtures
from crfbench.calibration.calibrate import LEVELS
from crfbench.calibration.learning import fit_discrepancy
from crfbench.calibration.mixture import Family, Readings, solve, typical_slope
from crfbench.calibration.posterior import Posterior, drawn_samples, exact_samples
from crfbench.calibration.table import minimise, rows_near
from crfbench.curves import GRID, as_valid_curves, invert
from crfbench.datasets.middlebury import REFERENCE_IRRADIANCE, THREE_GREYS
from crfbench.errors import InputError
from crfbench.metrics import rmse
from crfbench.models import DEFAULT_MODEL, GGCM, EMoR, Gamma, Kernel, bundled_models, load_model
from crfbench.models.base import KNOTS, SCALES, Discrepancy, at_knots, between_knots, from_knots
from tests.support.observing import MODELS, ready, unclipped

FILMS = crfbench.load_responses("opencrf")
STOPS = np.arange(4.0)


def shoot(responses, seed):
    """Photograph a chart of 24 patches at four exposures: brightness (n, 4, 24) and what is clipped."""
    rng = np.random.default_rng(seed)
    share = REFERENCE_IRRADIANCE / REFERENCE_IRRADIANCE.max()
    share = share * np.exp(0.05 * rng.standard_normal((len(responses), 24)))
    top = np.exp(rng.uniform(np.log(0.6), np.log(1.5), (len(responses), 1, 1)))
    light = share[:, None] * 2.0 ** (STOPS - STOPS.max())[:, None] * top
    bright = np.array([np.interp(each, GRID, curve) for each, curve in zip(light, responses, strict=True)])
    bright = np.rint(255 * np.clip(bright + 0.005 * rng.standard_normal(bright.shape), 0, 1)) / 255
    clipped = (bright >= 254 / 255) | (bright <= 0) | (light >= 1)
    return np.where(light >= 1, 1.0, bright), clipped


def observe(how, bright, clipped):
    """See three greys or all patches with their reference, or all with their exposures; those that tell enough."""
    patches = np.array(THREE_GREYS) - 1 if how == "3 greys" else np.arange(24)
    bright, clipped = bright[:, :, patches], clipped[:, :, patches]
    span = np.ptp(np.where(clipped, np.nanmean(bright), bright), axis=(1, 2))
    told = (~clipped).sum(axis=1) >= (2 if how == "chart-free" else 1)
    told = (told.sum(axis=1) >= 3) & (span > 0.05)
    bright, clipped = bright[told], clipped[told]
    if how == "chart-free":
        return told, Observations(bright, None, STOPS, clipped)
    return told, Observations(bright, REFERENCE_IRRADIANCE[patches], None, clipped)


# --- against dense arithmetic

KNOWN = [("reference",), ("exposures",), ("reference", "exposures")]
TIED = [*((known, False) for known in KNOWN), *((known, True) for known in KNOWN if "reference" in known)]
WIDE = 10.0  # stands for "unknown" here, so that dense matrices keep their digits
ALL_COUNT = Noise(repeats=1.0)


@pytest.fixture
def narrower(monkeypatch):
    monkeypatch.setattr(mixtures, "UNKNOWN", WIDE)
    monkeypatch.setattr("crfbench.calibration.observations.UNKNOWN", WIDE)
    monkeypatch.setattr(mixtures, "_BELOW_WHITE", ())


def toy(known, seed=0, clipped=()):
    """Return a family of five components, and eight readings of one camera, those at `clipped` at white."""
    rng = np.random.default_rng(seed)
    logs = np.log(KNOTS) * rng.uniform(0.8, 2.5, (5, 1))
    factor = 0.3 * np.stack([np.log(KNOTS), np.sin(3 * KNOTS) * (1 - KNOTS)], axis=1)
    weights = np.arange(1.0, 7.0) / 21
    family = Family.of(logs, np.log(np.arange(1.0, 6.0) / 15), Discrepancy(factor, weights))
    brightness, reference = rng.uniform(0.1, 0.9, (2, 4)), np.array([0.05, 0.1, 0.3, 0.9])
    brightness = 0.6 * reference ** (1 / 2.2) * np.array([[0.8], [1.1]]) + 0.2 * brightness
    white = np.zeros((2, 4), bool)
    for e, p in clipped:
        brightness[e, p], white[e, p] = 1.0, True
    given = {"reference": reference, "exposures": np.array([0.0, 1.0])}
    seen = Observations(
        brightness,
        **{name: given[name] for name in known},
        clipped=white,
        reference_error=rng.uniform(0.02, 0.2, 4),
        absolute=len(known) == 2,
    )
    return family, seen


def noise_covariance(seen, ratio, tied):
    """Write out the covariance of all readings about their curve, in units of the squared level."""
    e, p = seen.brightness.shape[1:]
    b = seen.brightness[0].ravel()
    reading = (typical_slope(b) * ALL_COUNT.brightness / b) ** 2 + ALL_COUNT.fine**2
    error = ratio * seen.reference_error[0] if seen.reference is not None else np.full(p, WIDE)
    mean, exposure = np.full((e, e), 1.0 / e), np.eye(e) / WIDE**2
    if seen.exposures is None:
        exposure = exposure + (np.eye(e) - mean) / WIDE**2
    else:
        each = (ratio * ALL_COUNT.exposure * np.log(2)) ** 2
        trend = np.log(2) * (seen.exposures[0] - seen.exposures[0].mean())
        # Their common part is known if absolute; a share of them all, the power, by itself.
        exposure = exposure + (np.eye(e) - mean + seen.absolute * mean) / each
        exposure = exposure + np.outer(trend, trend) / (trend @ trend) ** 2 / mixtures._POWER**2
    own = np.diag(error**-2.0)
    if tied:  # the power of the references is known by itself too
        rise = np.where(seen.counts[0].any(axis=0), np.log(seen.reference[0]), np.nan)
        rise = np.nan_to_num(rise - np.nanmean(rise))
        own += np.outer(rise, rise) / (rise @ rise) ** 2 / mixtures._POWER**2
    patch, photograph = np.tile(np.eye(p), (e, 1)), np.repeat(np.eye(e), p, axis=0)
    references = patch @ np.linalg.inv(own) @ patch.T
    return np.diag(reading) + references + photograph @ np.linalg.inv(exposure) @ photograph.T


class Dense:
    """The joint normal distribution of state and readings for each term, by matrices of all readings."""

    def __init__(self, family, seen, tied=False):
        self.family, self.seen, self.tied, self.counts = family, seen, tied, seen.counts[0].ravel()
        b = seen.brightness[0].ravel()
        self.basis, self.mean = between_knots(family.basis, b), between_knots(family.mean[:, None], b)[:, 0]
        self.told = Readings(seen, ALL_COUNT, family, tied).columns[0, ..., -1].ravel() + self.mean

    def joint(self, ratio, level, scale, component):
        """Return mean and covariance of the state, of the readings, and the covariance between the two."""
        prior = scale**2 * self.family.factors[0] @ self.family.factors[0].T
        readings = self.basis @ prior @ self.basis.T + level**2 * noise_covariance(self.seen, ratio, self.tied)
        return component, prior, self.mean + self.basis @ component, readings, prior @ self.basis.T

    def log_density(self, *term):
        _, _, mean, covariance, _ = self.joint(*term)
        seen = np.ix_(self.counts, self.counts)
        return multivariate_normal(mean[self.counts], covariance[seen]).logpdf(self.told[self.counts])

    def given_readings(self, *term):
        """Return mean and covariance of state and clipped readings together, given the others."""
        state, prior, mean, covariance, between = self.joint(*term)
        first, second = np.append(state, mean), np.block([[prior, between], [between.T, covariance]])
        known = np.append(np.zeros(len(state), bool), self.counts)
        gain = second[np.ix_(~known, known)] @ np.linalg.inv(second[np.ix_(known, known)])
        off = self.told[self.counts] - first[known]
        return first[~known] + gain @ off, second[np.ix_(~known, ~known)] - gain @ second[np.ix_(known, ~known)]


def terms_of(family):
    """Return every term as its index, ratio, level, scale and component."""
    several = (mixtures._RATIOS, mixtures._LEVELS, SCALES, family.components[0])
    return [(tuple(i for i, _ in term), tuple(x for _, x in term)) for term in product(*map(enumerate, several))]


@pytest.mark.parametrize(("known", "tied"), TIED)
def test_the_posterior_is_that_of_the_dense_joint_distribution(known, tied, narrower):
    """Probability of every term, evidence, and the moments of the state, with references and exposures integrated."""
    family, seen = toy(known)
    dense = Dense(family, seen, tied)
    unknowns = {("reference",): 2, ("exposures",): 4, ("reference", "exposures"): 0}[known]
    slope, b = typical_slope(seen.brightness[0]), seen.brightness[0]
    read = (slope * ALL_COUNT.brightness / b) ** 2
    # Unknowns take up readings, and the density of a brightness is that of its logarithm times the slope.
    constant = 4 * np.log(2 * np.pi) + (8 - unknowns) / 8 * (np.log(slope) * read / (read + ALL_COUNT.fine**2)).sum()
    logs = np.empty((4, 5, 6, 5))
    for at, term in terms_of(family):
        ratio, level = term[:2]
        prior = norm.logpdf(np.log(level), np.log(0.35), 0.9) + norm.logpdf(np.log(level * ratio), 0, 0.4)
        prior += np.log(family.scale_weight[at[2]]) + family.log_weight[0, at[3]]
        logs[at] = dense.log_density(*term) + unknowns * np.log(level) + constant + prior
    levels = np.log(mixtures._LEVELS)
    both = norm.logpdf(levels, np.log(0.35), 0.9) + norm.logpdf(levels + np.log(mixtures._RATIOS)[:, None], 0, 0.4)
    logs -= logsumexp(both)
    parameters = np.arange(5.0)[None, :, None]
    found = solve(seen, ALL_COUNT, family, parameters, tied)
    assert found.log_evidence[0] == pytest.approx(logsumexp(logs), abs=1e-8)
    probability = np.exp(logs - logsumexp(logs))
    assert found.best[0, 0] == probability.sum(axis=(0, 1, 2)).argmax()
    chosen = np.stack([index[0] for index in found.which], axis=1)
    for at, term in terms_of(family):
        drawn = np.flatnonzero((chosen == at).all(axis=1))
        assert abs(len(drawn) / 256 - probability[at]) < 1 / 256
        if len(drawn):
            mean, covariance = dense.given_readings(*term)
            root = found.root[0, at[0]]
            assert np.allclose(term[3] + root @ found.z[0, drawn[0]], mean, atol=1e-8)
            assert np.allclose((root * found.deviation[0, drawn[0]] ** 2) @ root.T, covariance, atol=1e-8)


@pytest.mark.parametrize(("known", "tied"), TIED)
def test_a_clipped_patch_is_censored_as_in_the_dense_joint_distribution(known, tied, narrower):
    """Exact in probability and mean: what is told lies beyond what the term expects of that patch."""
    family, seen = toy(known, clipped=[(1, 3)])
    dense = Dense(family, seen, tied)
    found = solve(seen, ALL_COUNT, family, np.zeros((1, 5, 1)), tied)
    by_index, weights = dict(terms_of(family)), []
    for i, at in enumerate(zip(*(index[0] for index in found.which), strict=True)):
        mean, covariance = dense.given_readings(*by_index[tuple(map(int, at))])
        deviation = np.sqrt(covariance[-1, -1])
        margin = (dense.told[~dense.counts][0] - mean[-1]) / deviation
        weights.append(norm.cdf(margin))
        moved = mean[:-1] - covariance[:-1, -1] / deviation * norm.pdf(margin) / norm.cdf(margin)
        state = found.family.components[0, at[3]] + found.root[0, at[0]] @ found.z[0, i]
        assert np.allclose(state, moved, atol=1e-6)
    assert np.allclose(found.weight[0], np.array(weights) / np.sum(weights), atol=1e-8)
    assert np.ptp(weights) > 0.05


def test_two_clipped_patches_are_censored_nearly_as_sampling_tells(narrower):
    """The mean to 0.3 standard deviations, the probability to a fifth: means are moved, deviations are not narrowed."""
    family, seen = toy(("reference",), clipped=[(0, 3), (1, 3)])
    dense = Dense(family, seen)
    found = solve(seen, ALL_COUNT, family, np.zeros((1, 5, 1)))
    by_index = dict(terms_of(family))
    probabilities, off = [], []
    for i in range(0, 256, 16):
        at = tuple(int(index[0, i]) for index in found.which)
        mean, covariance = dense.given_readings(*by_index[at])
        draws = np.random.default_rng(i).multivariate_normal(mean, covariance, size=40_000, method="eigh")
        keep = (draws[:, -2:] <= dense.told[~dense.counts]).all(axis=1)
        probabilities.append(keep.mean())
        deviation = (draws[keep, :-2] @ family.basis.T).std(axis=0)
        ours = found.family.components[0, at[3]] + found.root[0, at[0]] @ found.z[0, i]
        missed = (ours - draws[keep, :-2].mean(axis=0)) @ family.basis.T
        off.append(np.abs(missed)[:-1] / deviation[:-1])
    share = found.weight[0, ::16] / found.weight[0, ::16].sum()
    assert np.allclose(share, np.array(probabilities) / np.sum(probabilities), rtol=0.2)
    assert np.max(off) < 0.3


def test_irradiance_below_that_of_white_is_told_of_every_term(narrower, monkeypatch):
    """As by a reading without noise: exact in probability and mean."""
    family, seen = toy(("exposures",))
    before = solve(seen, ALL_COUNT, family, np.zeros((1, 5, 1)))
    monkeypatch.setattr(mixtures, "_BELOW_WHITE", (58,))
    found = solve(seen, ALL_COUNT, family, np.zeros((1, 5, 1)))
    weights = []
    for i, (j, c) in enumerate(zip(found.which[0][0], found.which[3][0], strict=True)):
        root = family.basis[58] @ before.root[0, j]
        mean = family.mean[58] + family.basis[58] @ family.components[0, c] + root @ before.z[0, i]
        along = before.deviation[0, i] ** 2 * root
        deviation = np.sqrt(along @ root)
        weights.append(norm.cdf(-mean / deviation))
        moved = before.z[0, i] - along / deviation * norm.pdf(mean / deviation) / weights[-1]
        assert np.allclose(found.z[0, i], moved, atol=1e-3)
    assert np.allclose(found.weight[0], np.array(weights) / np.sum(weights), atol=1e-5)
    assert np.ptp(weights) > 0.01


@pytest.mark.parametrize("name", ["Kernel-8", "SLR-ldl-1", "Gamma-1", "SLR-ldl-3"])
def test_many_photographs_that_scatter_widely_make_no_flat_curve(name):
    """As of one chart in 15 scenes: each reading is off by 40 % of its light, and exposures are not known."""
    rng, (model, table) = np.random.default_rng(0), ready(name)
    reference = np.exp(np.linspace(np.log(0.03), np.log(0.9), 24))
    scatter = np.array([0.4, 0.01])[:, None, None] * rng.standard_normal((2, 15, 24))
    light = reference * np.exp(rng.normal(-0.3, 0.3, (15, 1)) + scatter)
    seen = Observations(np.minimum(light, 1) ** (1 / 2.2), reference)
    found = calibrate(model, seen, table=table)
    low, high = np.log(found.curves[0, [256, 768]])
    assert high - low > 0.8 * 2.2 * np.log(3)
    assert "scatter 4 times or more" in "".join(found.warnings[0])
    for i in range(2):  # neither set of a batch changes what the other says
        alone = calibrate(model, seen.of_sets(slice(i, i + 1)), table=table)
        np.testing.assert_allclose(found.curves[i], alone.curves[0], atol=1e-9)


def test_components_and_kernel_are_led_to_white():
    """As a normal distribution is by a reading of its last value, added to its precision."""
    rng = np.random.default_rng(0)
    factor, logs = rng.standard_normal((8, 8)), rng.standard_normal((3, 8))
    led, left = mixtures._with_white(logs, factor @ factor.T)
    precision, reading = np.linalg.inv(factor @ factor.T), np.zeros((8, 8))
    reading[-1, -1] = mixtures._WHITE**-2
    assert np.allclose(left, np.linalg.inv(precision + reading))
    assert np.allclose(led, logs @ precision @ left)


def test_a_family_that_misses_white_is_led_there():
    """One power of brightness has no white of its own, and a chart without RAW does not tell where it lies."""
    model, table = ready("Polynomial-1")
    told, seen = observe("24 patches", *shoot(FILMS.curves[::5], 5))
    found, truth = calibrate(model, seen, table=table), invert(FILMS.curves[::5][told])
    assert rmse(found.curves, truth).mean() < 0.03
    assert rmse(calibrate(model, seen, discrepancy=False, table=table).curves, truth).mean() > 0.1


def test_draws_lie_about_the_most_probable_curve():
    model, table = ready("SLR-ldl-1")
    _, seen = observe("24 patches", *shoot(FILMS.curves[::30], 2))
    drawn = calibrate(model, seen, "posterior", table=table).samples
    assert np.allclose(drawn.weights.sum(axis=1), 1)
    most = np.log(calibrate(model, seen, "map", table=table).curves[:, 300:900:100])
    assert np.allclose(np.log(drawn.curves[:, :, 300:900:100]).mean(axis=1), most, atol=0.06)


def test_a_clipped_patch_pulls_the_curve_to_where_it_is_clipped():
    model, table = ready("SLR-ldl-1")
    bright, reference = np.array([[0.3, 0.5, 0.7, 1.0]]), np.array([0.1, 0.25, 0.5, 2.0])
    plain = calibrate(model, Observations(bright[:, :3], reference[:3]), "posterior", table=table)
    changes = []
    for light in (0.52, 20.0):
        found = calibrate(model, Observations(bright, np.append(reference[:3], light)), "posterior", table=table)
        changes.append(found.curves[0, 716] - plain.curves[0, 716])
    # A patch little brighter than that of 0.7 which is white already says that 0.7 is near white; a bright one nothing.
    assert changes[0] > 0.05
    assert abs(changes[1]) < 0.03


# --- what is learned


def test_learning_recovers_a_known_kernel():
    rng = np.random.default_rng(3)
    factor = np.stack([np.log(KNOTS), np.sin(6 * KNOTS) * (1 - KNOTS)], axis=1) * (0.2, 0.6)
    scale = rng.choice([0.25, 1.0], 300, p=[0.7, 0.3])
    misses = scale[:, None] * rng.standard_normal((300, 2)) @ factor.T + 0.03 * rng.standard_normal((300, 64))
    found = fit_discrepancy(misses, [(np.zeros((1, 64)), np.zeros(1))] * 300, np.ones(300))
    variance = lambda f: (f**2).sum(axis=1)  # noqa: E731
    mean_square = (found.scale_weight * SCALES**2).sum()
    expected = 0.7 * 0.0625 + 0.3
    assert np.allclose(mean_square * variance(found.factor), expected * variance(factor), rtol=0.25, atol=0.004)


def test_a_curve_of_weight_3_counts_as_three_of_it():
    rng, weight = np.random.default_rng(5), np.tile([1.0, 2.0, 3.0], 8)
    misses = rng.choice([0.3, 1.0], (24, 1)) * rng.standard_normal((24, 1)) * np.log(KNOTS)
    row = (np.zeros((1, 64)), np.zeros(1))
    copies = np.repeat(misses, weight.astype(int), axis=0)
    weighed, copied = (
        fit_discrepancy(x, [row] * len(x), w) for x, w in ((misses, weight), (copies, np.ones(len(copies))))
    )
    kernel = copied.kernel()
    np.testing.assert_allclose(weighed.kernel(), kernel, atol=1e-4 * kernel.max())
    np.testing.assert_allclose(weighed.scale_weight, copied.scale_weight, rtol=1e-4)


def test_a_model_of_ones_own_gets_its_discrepancy_in_one_call():
    inverse = FILMS.in_direction("inverse")
    model = Gamma().learn_prior(inverse[::2])
    seen = Observations([[0.2, 0.4, 0.7]], [1.0, 3.0, 8.0])
    with pytest.raises(
        InputError, match=r"has no discrepancy; use learn_discrepancy\(model, curves\) or discrepancy=False"
    ):
        calibrate(model, seen)
    assert learn_discrepancy(model, inverse[1::2]) is model
    found = calibrate(model, seen, "posterior")
    as_valid_curves(np.clip(found.curves, 0, 1), tolerance=2e-2)
    assert (found.bands[0.9][0] <= found.bands[0.9][1]).all()


def test_expectation_maximisation_never_loses_likelihood(monkeypatch):
    """By SciPy's densities in the eigenbasis of each step's kernel; the kernel itself by its scales alone."""
    rng, seen = np.random.default_rng(4), []
    factor = np.stack([np.log(KNOTS), np.sin(6 * KNOTS) * (1 - KNOTS)], axis=1) * (0.2, 0.6)
    components = np.log(KNOTS) * np.array([[1.0], [1.7], [2.4]])
    scale = rng.choice([0.25, 1.0], (80, 1), p=[0.7, 0.3])
    x = components[rng.integers(0, 3, 80)] + scale * rng.standard_normal((80, 2)) @ factor.T
    x += 0.03 * rng.standard_normal(x.shape)
    original = learning._expected

    def watched(turned, logs, share, values):
        sd = np.sqrt(SCALES[:, None] ** 2 * values + 0.03**2)
        each = norm.logpdf(turned[:, None], 0, sd[:, None]).sum(axis=-1) + logs[:, None] + np.log(share)[:, None]
        seen.append(logsumexp(each, axis=(1, 2)).sum())
        return original(turned, logs, share, values)

    monkeypatch.setattr(learning, "_expected", watched)
    fit_discrepancy(x, [(components, np.log(np.full(3, 1 / 3)))] * 80, np.ones(80))
    assert (np.diff(seen) > -1e-6 * np.abs(seen[0])).all()
    assert seen[-1] > seen[0] + 10


@pytest.mark.parametrize("kind", [Gamma, pytest.param(GGCM, marks=pytest.mark.slow)])
def test_what_learn_discrepancy_learns_makes_bands_that_cover(kind):
    """Prior from a third of the films, discrepancy from another, bands on the last."""
    third = np.unique(np.array(FILMS.units), return_inverse=True)[1] % 3
    inverse = FILMS.in_direction("inverse")
    n_params = 1 if kind is Gamma else 2
    model = kind.from_curves(inverse[third == 0], n_params).learn_prior(inverse[third == 0])
    learn_discrepancy(model, inverse[third == 1])
    responses = FILMS.curves[third == 2]
    told, seen = observe("24 patches", *shoot(responses, 5))
    truth = invert(responses[told])[:, 4::8]
    low, high = (each[:, 4::8] for each in calibrate(model, seen, "posterior").bands[0.9])
    assert 0.82 < np.mean((low <= truth) & (truth <= high)) < 0.99


def test_more_misses_make_a_wider_kernel():
    """Of a family that is learned from these films the misses are small, of gamma curves they are large."""
    inverse = FILMS.in_direction("inverse")
    near, far = (
        learn_discrepancy(kind.from_curves(inverse[::2], k).learn_prior(inverse[::2]), inverse[1::2]).discrepancy_
        for kind, k in ((EMoR, 4), (Gamma, 1))
    )
    size = lambda d: (d.scale_weight * SCALES**2).sum() * np.trace(d.kernel())  # noqa: E731
    assert size(near) < 0.8 * size(far)


def test_a_model_of_responses_has_no_discrepancy_to_learn():
    with pytest.raises(InputError, match=r"'forward'.*use a model of direction 'inverse'"):
        learn_discrepancy(load_model("Gamma-1-forward"), FILMS.in_direction("inverse"))


def test_all_bundled_inverse_models_know_their_misses():
    for key in bundled_models():
        assert (key.load().discrepancy_ is not None) == (key.direction == "inverse"), key


@pytest.mark.parametrize(
    ("factor", "weights"),
    [(np.ones((63, 2)), np.ones(6)), (np.ones((64, 2)), np.ones(5)), (np.ones(64), np.ones(6, int)[:2])],
)
def test_shapes_that_are_no_discrepancy_are_refused(factor, weights):
    with pytest.raises(InputError, match=r"a discrepancy has shapes .*use \(64, r\) and \(6,\)"):
        Discrepancy(factor, weights)


# --- the family alone, and rows of a table


@pytest.mark.parametrize("method", ["map", "posterior"])
@pytest.mark.parametrize("name", MODELS)
def test_without_the_discrepancy_it_is_the_posterior_within_the_family(name, method):
    model, table = ready(name)
    _, seen = observe("24 patches", *shoot(FILMS.curves[::30], 2))
    posterior = Posterior(seen, Noise())
    logs = posterior.log_likelihood_on(table)
    best = minimise(posterior.objective(model), table, -(logs + table.log_prior))
    found = calibrate(model, seen, method, discrepancy=False, table=table, seed=3)
    assert np.array_equal(found.params, model.from_unconstrained(best))
    if method == "map":
        assert np.array_equal(found.curves, model.decode(found.params))
    else:
        one = model.n_params == 1
        samples = exact_samples(table, logs) if one else drawn_samples(posterior, model, best, 3)
        assert np.array_equal(found.curves, samples.mean())
        assert np.array_equal(found.bands[0.9], samples.quantiles((0.5 - 0.45, 0.5 + 0.45)))
    assert np.array_equal(found.noise_scale, posterior.noise_scale(model, best))


@pytest.mark.parametrize("name", ["GGCM-2", "EMoR-3"])
def test_rows_near_weigh_as_one_sample_of_the_prior(name):
    """By SciPy's densities: prior over the mixture that rows and draws come from."""
    model, table = ready(name)
    prior = model.prior_
    best = prior.mean + np.array([[0.0] * model.n_params, [2.0] + [0.0] * (model.n_params - 1)])
    z, curves, log_weight = rows_near(model, table, best, seed=1)
    rows, draws = len(table.params), z.shape[1] - len(table.params)
    assert np.array_equal(z[:, :rows], np.broadcast_to(table.unconstrained, (2, rows, model.n_params)))
    assert np.allclose(curves, model.decode(model.from_unconstrained(z[:, rows:])), atol=1e-5)
    for i in range(2):
        own = multivariate_normal(prior.mean, prior.covariance).pdf(z[i])
        near = multivariate_normal(best[i], 0.25**2 * prior.covariance).pdf(z[i])
        assert np.allclose(np.exp(log_weight[i]), own / (rows * own + draws * near), rtol=1e-8)
    again, other = (rows_near(model, table, best, seed)[0] for seed in (1, 2))
    assert np.array_equal(z, again)
    assert not np.array_equal(z, other)


def test_rows_near_give_the_means_of_the_prior():
    model, table = ready("GGCM-2")
    z, _, log_weight = rows_near(model, table, model.prior_.mean[None], seed=1)
    weight = np.exp(log_weight[0])
    assert weight.sum() == pytest.approx(1, abs=0.1)
    mean = (weight / weight.sum()) @ z[0]
    off = z[0] - mean
    sd = np.sqrt(np.diagonal(model.prior_.covariance))
    assert np.allclose(mean, model.prior_.mean, atol=0.15 * sd)
    assert np.allclose((weight[:, None] / weight.sum() * off).T @ off, model.prior_.covariance, rtol=0.25)


# --- data that the model itself makes


def simulated(name, n=300, patches=8, seed=6):
    """Draw curves of family and discrepancy, at the knots, and a photograph of each as the calibrator believes.

    Brightness is fixed and the references are what errs, which is how the likelihood has it.
    """
    model, table = ready(name)
    rng, prior = np.random.default_rng(seed), model.discrepancy_
    rows = rng.choice(len(table.params), n, p=np.exp(table.log_prior) / np.exp(table.log_prior).sum())
    scale = rng.choice(SCALES, n, p=prior.scale_weight / prior.scale_weight.sum())
    values, vectors = np.linalg.eigh(prior.kernel())
    process = rng.standard_normal((n, len(KNOTS))) @ (vectors * np.sqrt(np.maximum(values, 0))).T
    truth = table.at_knots[rows] + scale[:, None] * process
    ratios, levels = mixtures._RATIOS, mixtures._LEVELS
    weight = np.exp(mixtures._level_weights()).ravel()
    ratio, level = np.unravel_index(rng.choice(weight.size, n, p=weight / weight.sum()), (len(ratios), len(levels)))
    brightness = rng.uniform(0.06, 0.97, (n, patches))
    logs = np.array([np.interp(np.log(b), np.log(KNOTS), x) for b, x in zip(brightness, truth, strict=True)])
    read = np.hypot(typical_slope(brightness) * ALL_COUNT.brightness / brightness, ALL_COUNT.fine)
    sigma = levels[level][:, None] * np.hypot(read, ratios[ratio][:, None] * 0.05)
    reference = np.exp(logs + sigma * rng.standard_normal(logs.shape) + rng.normal(size=(n, 1)))
    return truth, unclipped(brightness[:, None], reference, reference_error=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["SLR-ldl-1", "Gamma-1"])
def test_quantiles_cover_as_they_say_what_the_model_itself_draws(name, monkeypatch):
    """The posterior's own, before what is known of all cameras and how far real curves lie from such draws."""
    monkeypatch.setattr(mixtures, "_BELOW_WHITE", ())
    monkeypatch.setattr(mixtures, "_WHITE_STEP", 0.0)
    model, table = ready(name)
    truth, seen = simulated(name)
    truth = from_knots(np.minimum(np.sort(truth, axis=1), 0.0))
    found = calibrate(model, seen, "posterior", noise=ALL_COUNT, table=table)
    for level in LEVELS:
        low, high = found.samples.quantiles((0.5 - level / 2, 0.5 + level / 2))
        inside = ((low <= truth) & (truth <= high))[:, 40:-40:16]
        assert abs(inside.mean() - level) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize(("made_by", "other"), [("SLR-ldl-1", "Gamma-1"), ("Gamma-1", "SLR-ldl-1")])
def test_evidence_of_the_model_that_made_the_data_is_the_greater_in_the_mean(made_by, other):
    """Whatever the other believes, if both are densities of the same data (Gibbs' inequality)."""
    _, seen = simulated(made_by)
    own, wrong = (
        calibrate(ready(name)[0], seen, "posterior", noise=ALL_COUNT, table=ready(name)[1]).samples.log_evidence
        for name in (made_by, other)
    )
    gain = own - wrong
    assert gain.mean() > 2 * gain.std() / np.sqrt(len(gain))


# --- what does not matter


@pytest.mark.parametrize("name", ["SLR-ldl-1", "GGCM-3", DEFAULT_MODEL])
class TestPosterior:
    def solve(self, name, *given, **options):
        model, table = ready(name)
        return calibrate(model, unclipped(*given), "posterior", table=table, **options)

    @pytest.fixture
    def seen(self):
        bright, clipped = shoot(FILMS.curves[[3, 60, 110]], 9)
        use = np.flatnonzero(~clipped.any(axis=(0, 1)))
        return bright[:, :, use], np.broadcast_to(REFERENCE_IRRADIANCE[use], (3, len(use))), np.tile(STOPS, (3, 1))

    def same(self, first, second, tolerance=1e-5):
        assert np.allclose(first.curves, second.curves, atol=tolerance)
        assert np.allclose(first.bands[0.9], second.bands[0.9], atol=tolerance)
        assert np.allclose(first.samples.log_evidence, second.samples.log_evidence, atol=tolerance)
        assert np.allclose(first.noise_scale, second.noise_scale, rtol=tolerance)

    def test_units_and_the_zero_of_exposures(self, name, seen):
        bright, reference, stops = seen
        self.same(self.solve(name, bright, reference, stops), self.solve(name, bright, 1e9 * reference, stops - 20))

    def test_the_order_of_photographs_and_patches(self, name, seen):
        """But for rounding, which may choose another of two terms whose probability is cumulated to just the same."""
        bright, reference, stops = seen
        rng = np.random.default_rng(0)
        e, p = rng.permutation(len(STOPS)), rng.permutation(reference.shape[1])
        self.same(
            self.solve(name, bright, reference, stops),
            self.solve(name, bright[:, e][:, :, p], reference[:, p], stops[:, e]),
            tolerance=0.01,
        )

    def test_the_other_sets_of_a_batch(self, name, seen):
        together = self.solve(name, *seen)
        for i in range(3):
            alone = self.solve(name, *(each[i : i + 1] for each in seen))
            assert np.allclose(together.curves[i], alone.curves[0], atol=1e-5)
            assert np.allclose(together.bands[0.5][0][i], alone.bands[0.5][0][0], atol=1e-5)
            assert np.allclose(together.samples.log_evidence[i], alone.samples.log_evidence[0], atol=1e-6)

    def test_the_seed_repeats_to_the_last_digit(self, name, seen):
        first, again, other = (self.solve(name, *seen, seed=seed) for seed in (1, 1, 2))
        assert np.array_equal(first.bands[0.9], again.bands[0.9])
        assert not np.array_equal(first.bands[0.9], other.bands[0.9])
        assert np.allclose(first.bands[0.9], other.bands[0.9], atol=0.05)


# --- on cameras that it has not seen


@pytest.mark.parametrize("how", ["3 greys", "24 patches", "chart-free"])
@pytest.mark.parametrize("name", ["SLR-ldl-1", "Gamma-1", DEFAULT_MODEL])
def test_bands_hold_what_they_promise_on_films(name, how):
    check_bands(name, how, slice(None, None, 3))


@pytest.mark.slow
@pytest.mark.parametrize("how", ["3 greys", "24 patches", "chart-free"])
@pytest.mark.parametrize("name", [str(key) for key in bundled_models() if key.direction == "inverse"])
def test_bands_of_every_model_hold_what_they_promise_on_films(name, how):
    check_bands(name, how, slice(None, None, 2))


def check_bands(name, how, some):
    model, table = ready(name)
    responses = FILMS.curves[some]
    told, seen = observe(how, *shoot(responses, 5))
    truth = invert(responses[told])[:, 4::8]
    found = calibrate(model, seen, "posterior", table=table)
    inside = {
        level: np.mean((low[:, 4::8] <= truth) & (truth <= high[:, 4::8])) for level, (low, high) in found.bands.items()
    }
    assert 0.85 < inside[0.9] < 0.99
    assert 0.42 < inside[0.5] < 0.76  # wider than asked where films are smoother than DoRF curves
    family_alone = calibrate(model, seen, "map", discrepancy=False, table=table)
    ours, theirs = (rmse(each.curves, invert(responses[told])).mean() for each in (found, family_alone))
    # PPISP-4 was made for curves such as these.
    assert ours < (1.3 if name == "PPISP-4" else 1.05) * theirs


def test_plentiful_data_lead_out_of_the_family():
    """A film that no gamma makes, with 24 patches."""
    response = FILMS.curves[list(FILMS.names).index("Fuji Velvia 50 R")]
    reference = np.linspace(0.03, 1, 24)
    seen = Observations(np.interp(reference * 2.0 ** np.arange(-3, 1)[:, None], GRID, response), reference)
    model, table = ready("Gamma-1")
    alone, allowed = (calibrate(model, seen, discrepancy=each, table=table).curves for each in (False, True))
    assert rmse(allowed, invert(response)) < 0.1 * rmse(alone, invert(response))


def test_curves_and_bands_rise_and_are_nested():
    model, table = ready(DEFAULT_MODEL)
    _, seen = observe("24 patches", *shoot(FILMS.curves[::30], 2))
    found = calibrate(model, seen, "posterior", table=table)
    inner, outer = found.bands[0.5], found.bands[0.9]
    for curves in (found.curves, *inner, *outer):
        assert (np.diff(curves, axis=1) > -1e-6).all()
        assert curves.min() >= 0
        assert curves.max() <= 1 + 1e-6
    assert (outer[0] <= inner[0] + 1e-6).all()
    assert (inner[0] <= inner[1] + 1e-6).all()
    assert (inner[1] <= outer[1] + 1e-6).all()


# --- channels of one camera


def three_channels(responses, seed=7):
    """See the 24 patches through three responses of one camera, at four exposures."""
    bright, clipped = shoot(np.repeat(responses, 1, axis=0), seed)
    return Observations(bright, REFERENCE_IRRADIANCE, None, clipped)


def test_alike_channels_share_their_data_and_films_keep_their_own():
    model, table = ready("SLR-ldl-3")  # learned from other curves
    units = np.array(FILMS.units)
    films = [FILMS.curves[units == unit] for unit in dict.fromkeys(FILMS.units)]
    films = [film for film in films if len(film) == 3][::2]
    together, apart = [], []
    for film in films:
        seen, truth = three_channels(film), invert(film)
        together.append(rmse(calibrate(model, seen, channels=True, table=table).curves, truth).mean())
        apart.append(rmse(calibrate(model, seen, table=table).curves, truth).mean())
    assert np.median(together) < 1.25 * np.median(apart)
    alike = np.repeat(FILMS.curves[40:41], 3, axis=0)
    both = [calibrate(model, three_channels(alike), channels=each, table=table).curves for each in (True, False)]
    spread = [np.ptp(curves, axis=0).max() for curves in both]
    assert spread[0] < spread[1]


def test_cameras_of_a_batch_do_not_meet():
    model, table = ready(DEFAULT_MODEL)
    seen = three_channels(FILMS.curves[:6])
    batch = calibrate(model, seen, channels=True, table=table).curves
    alone = [
        calibrate(model, seen.of_sets(sets), channels=True, table=table).curves for sets in (slice(3), slice(3, 6))
    ]
    assert np.allclose(batch, np.concatenate(alone), atol=1e-8)


@pytest.mark.parametrize(
    "asked", [{}, {"method": "paper"}, {"discrepancy": False}], ids=["two sets", "another method", "family alone"]
)
def test_channels_that_cannot_be_are_refused(asked):
    model, table = ready(DEFAULT_MODEL)
    seen = three_channels(FILMS.curves[: 3 if asked else 2])
    with pytest.raises(InputError, match=r"channels=True with \d sets.*use 3 sets a camera"):
        calibrate(model, seen, channels=True, table=table, **asked)


# --- the kernel mixture


def test_the_kernel_mixture_draws_its_curves():
    curves = FILMS.in_direction("inverse")
    model = Kernel.from_curves(curves, 8).learn_prior(curves, np.arange(1.0, len(curves) + 1))
    assert set(map(tuple, model.sample(50, 0).round(9))) <= set(map(tuple, model.prior_.centres.round(9)))
    table = decode_table(model)
    assert len(table.params) == len(curves)
    assert np.exp(table.log_prior).sum() == pytest.approx(1)
    assert np.allclose(np.exp(table.log_prior)[-1] / np.exp(table.log_prior)[0], len(curves))
    assert rmse(from_knots(at_knots(curves)), curves).max() < 0.01


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda c: Kernel.from_curves(c[:8], 8), "8 curves have fewer than 8 components; use more than n_params"),
        (lambda c: Kernel.from_curves(c, 0), "n_params=0 is out of range"),
        (lambda c: Kernel.from_curves(255 * c, 2), "curve 0 reaches 255"),
        (lambda c: Kernel.from_curves(c, 2, "sideways"), "sideways"),
        (lambda c: Kernel(np.zeros(64), np.eye(64)[:2], 3), r"n_params=3 and .*\(2, 64\).*use \(3, 64\)"),
        (lambda c: Kernel(np.zeros(64), np.eye(63)[:2], 2), r"shape \(2, 63\)"),
        (lambda c: Kernel(np.zeros(63), np.eye(64)[:2], 2), r"mean of shape \(63,\).*use \(64,\)"),
        (lambda c: Kernel.from_curves(c, 2).learn_prior(c[:1]), "two or more curves"),
        (
            lambda c: Kernel.from_curves(c, 2).learn_prior(c, [1.0, 2.0]),
            r"weights of shape \(2,\).*use \d+ values above 0",
        ),
        (lambda c: Kernel.from_curves(c, 2).learn_prior(c, np.zeros(len(c))), "weights.*above 0"),
        (lambda c: Kernel.from_curves(c, 2).learn_prior(c, -np.ones(len(c))), "weights.*above 0"),
    ],
)
def test_kernel_mixtures_that_cannot_be_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make(FILMS.in_direction("inverse"))


def test_the_edge_of_a_mixture_is_its_outermost_centre():
    """A curve of the mixture itself is never told to lie at the edge of what the prior expects."""
    model, table = ready(DEFAULT_MODEL)
    off = np.abs(model.prior_.centres - model.prior_.mean) / np.sqrt(np.diagonal(model.prior_.covariance))
    odd = off.max(axis=1).argsort()[-3:]
    curves = model.nearest_valid(table.params[odd])
    bright = np.linspace(0.05, 0.95, 30)
    reference = np.array([np.interp(bright, GRID, curve) for curve in curves])
    found = calibrate(model, unclipped(np.tile(bright, (3, 1, 1)), reference, reference_error=0.01), table=table)
    assert off[odd].max() > 4
    assert found.warnings == ((),) * 3
