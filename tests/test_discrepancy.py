"""The calibrator that knows of its models' misses: against dense arithmetic, simulation, and unseen cameras."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import crfbench
from crfbench.calibration import Noise, Observations, calibrate, decode_table, learn_discrepancy
from crfbench.calibration import mixture as mixtures
from crfbench.calibration.learning import fit_discrepancy
from crfbench.calibration.mixture import Family, Readings
from crfbench.curves import GRID, as_valid_curves, invert
from crfbench.datasets.middlebury import REFERENCE_IRRADIANCE, THREE_GREYS
from crfbench.errors import InputError
from crfbench.metrics import rmse
from crfbench.models import DEFAULT_MODEL, Gamma, Kernel, bundled_models
from crfbench.models.discrepancy import KNOTS, SCALES, Discrepancy, at_knots, between_knots, from_knots
from tests.support.observing import ready

FILMS = crfbench.load_responses("opencrf")
STOPS = np.arange(4.0)
# One power of brightness is far from most curves; its band holds less than it says.
_LEAST = {"Polynomial-1": 0.7}
# Of the others some know these films already, and SLR-monotone-1 and PPISP-4 fit some of them better by themselves.
_BETTER = ("SLR-ldl-1", "SLR-ldl-3", "Gamma-1")


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


def toy(known, seed=0):
    """Return a family of five components in three knots' worth of basis, and a few readings of one camera."""
    rng = np.random.default_rng(seed)
    logs = np.log(KNOTS) * rng.uniform(0.8, 2.5, (5, 1))
    factor = 0.3 * np.stack([np.log(KNOTS), np.sin(3 * KNOTS) * (1 - KNOTS)], axis=1)
    weights = np.full(6, 1 / 6)
    family = Family.of(logs, np.log(np.full(5, 0.2)), Discrepancy(factor, weights))
    given = {"reference": rng.uniform(0.1, 1, 4), "exposures": np.array([0.0, 1.0])}
    seen = Observations(
        rng.uniform(0.1, 0.9, (2, 4)),
        **{name: given[name] for name in known},
        clipped=np.zeros((2, 4), bool),
        reference_error=rng.uniform(0.02, 0.2, 4),
        absolute=len(known) == 2,
    )
    return family, seen


@pytest.mark.parametrize("known", [("reference",), ("exposures",), ("reference", "exposures")])
def test_every_term_is_that_of_the_dense_joint_distribution(known):
    """The covariance of the readings written out: components, discrepancy, noise, references and exposures."""
    family, seen = toy(known)
    readings, noise = Readings(seen, Noise(), family), Noise()
    b = seen.brightness[0].ravel()
    basis, mean = between_knots(family.basis, b), between_knots(family.mean[:, None], b)[:, 0]
    told = readings.columns[0, ..., -1].ravel() + mean
    patch, photograph = np.tile(np.eye(4), (2, 1)), np.repeat(np.eye(2), 4, axis=0)
    scores = []
    for ratio, level, (a, scale) in product(mixtures._RATIOS, mixtures._LEVELS, enumerate(SCALES)):
        reading = level**2 * np.diag(1.0 / readings.precision[0].ravel())
        u = level**2 * patch * readings.errors(ratio)[0] @ patch.T
        s = level**2 * photograph @ np.linalg.inv(readings.exposure_prior(ratio)[0]) @ photograph.T
        root = basis @ family.factors[0]
        covariance = scale**2 * root @ root.T + reading + u + s
        for component in family.components[0]:
            normal = multivariate_normal(mean + basis @ component, covariance, allow_singular=False)
            scores.append((ratio, level, a, normal.logpdf(told)))
    dense = np.array([score[-1] for score in scores]).reshape(4, 5, 6, 5)
    found = [readings.eliminate(ratio) for ratio in mixtures._RATIOS]
    solved = [mixtures._diagonalised(each, family.factors[0], family) for each in found]
    ours = np.stack([mixtures._log_probability(f, s, readings)[0] for f, s in zip(found, solved, strict=True)])
    # What stands for unknown is 1000 wide: its constants, and the noise's weight in the degrees of freedom, aside,
    # components and scales must be told apart as by the dense arithmetic.
    dense -= dense[:, :, :1, :1]
    ours -= ours[:, :, :1, :1]
    assert np.allclose(ours, dense, rtol=1e-4, atol=1e-3)
    assert noise.fine == 0.03


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
    scale = rng.choice([0.25, 1.0], 600, p=[0.7, 0.3])
    misses = scale[:, None] * rng.standard_normal((600, 2)) @ factor.T + 0.03 * rng.standard_normal((600, 64))
    found = fit_discrepancy(misses, [(np.zeros((1, 64)), np.zeros(1))] * 600, np.ones(600))
    variance = lambda f: (f**2).sum(axis=1)  # noqa: E731
    mean_square = (found.scale_weight * SCALES**2).sum()
    expected = 0.7 * 0.0625 + 0.3
    assert np.allclose(mean_square * variance(found.factor), expected * variance(factor), rtol=0.25, atol=0.004)


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


# --- on cameras that it has not seen


@pytest.mark.parametrize("how", ["3 greys", "24 patches", "chart-free"])
@pytest.mark.parametrize("name", ["SLR-ldl-1", "Gamma-1", "SLR-ldl-3", DEFAULT_MODEL])
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
    assert _LEAST.get(name, 0.82) < inside[0.9] < 0.995
    assert 0.38 < inside[0.5] < 0.85
    family_alone = calibrate(model, seen, "map", discrepancy=False, table=table)
    if name in _BETTER:
        ours, theirs = (rmse(each.curves, invert(responses[told])).mean() for each in (found, family_alone))
        assert ours < 1.1 * theirs


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


def test_evidence_prefers_the_family_that_made_the_data():
    names = ("SLR-ldl-3", "Polynomial-1")
    for made_by, other in (names, names[::-1]):
        model, _ = ready(made_by)
        curves = model.nearest_valid(model.sample(24, seed=1))
        bright, clipped = shoot(invert(curves), 4)
        _, seen = observe("24 patches", bright, clipped)
        own, wrong = (calibrate(ready(n)[0], seen, "posterior", table=ready(n)[1]).samples for n in (made_by, other))
        assert own.log_evidence.mean() > wrong.log_evidence.mean() - 0.5


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
