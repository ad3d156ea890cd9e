"""One calibrator for every model, and what it gives."""

import time
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from crfbench.calibration.mixture import marginalised
from crfbench.calibration.observations import Observations
from crfbench.calibration.paper_loss import AlignedLoss, descend
from crfbench.calibration.posterior import Likelihood, Noise, Posterior, PosteriorSamples, drawn_samples, exact_samples
from crfbench.calibration.table import BAND_SAMPLES, Table, check_kind, decode_table, minimise
from crfbench.checks import check_choice, check_count, check_seed
from crfbench.curves import GRID, Array, invert, repair
from crfbench.errors import InputError
from crfbench.models import ResponseModel
from crfbench.models.registry import ModelKey, channel_difference

LEVELS = (0.5, 0.9)
# Shares of the half widths that hold as much of held-out DoRF curves as the levels say; the whole ones hold more, as
# most curves lie nearer than the few far ones let a model expect (Kuleshov, Fenner and Ermon 2018, arXiv:1807.00263).
_HALF_WIDTH = {0.5: 0.68, 0.9: 0.85}
_FREE = 50.0  # stops; exposures that err so much are as the photographs say


@dataclass(frozen=True)
class Calibration:
    """Inverse responses from observations, one for each of the `n` sets.

    Parameters
    ----------
    model : ResponseModel
    method : str
    observations : Observations
    noise : Noise
        What `residuals` are weighed with.
    params : ndarray, shape (n, k)
        The best by the method's own measure.
    curves : ndarray, shape (n, 1024)
        Inverse responses (brightness to irradiance): of `params`, or with method "posterior" the posterior mean.
    warnings : tuple of tuples of str
        One tuple for each set.
    seconds : float
        For all of them.
    noise_scale : ndarray, shape (n,), optional
        By which factor the data scale the stated noise ("map", "posterior").
    samples : PosteriorSamples, optional
        The posterior itself ("posterior").
    bands : dict
        From level (0.5, 0.9) to the low and high curves, each (n, 1024), between which that share of the posterior
        lies at every brightness ("posterior").
    """

    model: ResponseModel
    method: str
    observations: Observations
    noise: Noise
    params: Array
    curves: Array
    warnings: tuple[tuple[str, ...], ...]
    seconds: float
    noise_scale: Array | None = None
    samples: PosteriorSamples | None = None
    bands: dict[float, tuple[Array, Array]] = field(default_factory=dict)

    def __repr__(self) -> str:
        model, warned = ModelKey.of(self.model), sum(map(bool, self.warnings))
        return f"Calibration({model}, {self.method}, {len(self)} sets, {warned} with warnings)"

    def __len__(self) -> int:
        return len(self.params)

    @cached_property
    def brightness_range(self) -> Array:
        """Least and greatest brightness measured, (n, 2); beyond, model and prior speak alone."""
        measured = np.where(self.observations.counts, self.observations.brightness, np.nan)
        return np.stack([np.nanmin(measured, axis=(1, 2)), np.nanmax(measured, axis=(1, 2))], axis=1)

    @cached_property
    def residuals(self) -> Array:
        """Log irradiance of each patch less what reference and exposure tell, (n, e, p); 0.05 is 5 % too bright.

        At the exposures that fit best, and without a reference at the irradiances that do.
        """
        likelihood, d, exposures = self._residual(self.noise)
        d = (d - exposures[:, :, None])[..., 0]
        if self.observations.reference is None:
            counted = likelihood.precision
            d = d - ((counted * d).sum(axis=1) / np.maximum(counted.sum(axis=1), 1e-300))[:, None]
        return np.asarray(d)

    @cached_property
    def exposure_errors(self) -> Array:
        """By how many stops each photograph seems brighter than its exposure says, (n, e); the median of a set is 0."""
        off = self._residual(replace(self.noise, exposure=_FREE))[2][:, :, 0] / np.log(2)
        return np.asarray(off - np.median(off, axis=1, keepdims=True))

    def _residual(self, noise: Noise) -> tuple[Likelihood, Array, Array]:
        """Return the likelihood, the residuals (n, e, p, 1), and the exposures (n, e, 1) that fit them best."""
        likelihood = Likelihood(self.observations, noise)
        d = likelihood.residual(self.observations.decoded(self.curves)[..., None], slice(None))
        return likelihood, d, likelihood.squares(d, slice(None))[1]

    @property
    def responses(self) -> Array:
        """Responses (irradiance to brightness), shape (n, 1024): the nearest valid curves, inverted."""
        return invert(repair(self.curves))

    def dots(self, index: int = 0) -> tuple[Array, Array]:
        """Return brightness and aligned irradiance of the measured patches of one set, each of shape (m,)."""
        check_count("index", index, least=-len(self), most=len(self) - 1)
        counts = self.observations.counts[index]
        brightness = self.observations.brightness[index][counts]
        irradiance = np.interp(brightness, GRID, self.curves[index])
        # On the curve up to its residual: where the patch would lie if exposure and reference were exact.
        return brightness, irradiance * np.exp(-self.residuals[index][counts])


METHODS = ("paper", "grid", "lm", "map", "posterior")

_FEW = 4  # patches; with fewer, the prior says much
# Times the stated noise; beyond, something else than noise is at work. With the discrepancy steps up to 4 are told.
_WIDE, _WIDE_WITH_DISCREPANCY = 1.25, 3.0
_AS_EXPECTED = 2.4  # standard deviations of the prior's curves; of a normal distribution, 3.3 hold 90 %


def calibrate(
    model: ResponseModel,
    observations: Observations,
    method: str = "map",
    *,
    discrepancy: bool = True,
    channels: bool = False,
    noise: Noise | None = None,
    starts: int = 10,
    seed: int = 0,
    table: Table | None = None,
) -> Calibration:
    """Find the inverse responses that explain observations.

    Parameters
    ----------
    model : ResponseModel
        Of direction "inverse", with a prior.
    observations : Observations
        One set or a batch; all are solved in one call.
    method : {"map", "posterior", "grid", "lm", "paper"}
        "map": the most probable curve under `noise` and what is known beforehand. "posterior": also bands and
        samples; the curve is then their middle. "grid" (one parameter) and "lm": the least loss of the paper, from a
        table of the whole range or many starts, polished. "paper": the same loss as the paper minimises it, by Adam
        from random starts.
    discrepancy : bool
        Whether "map" and "posterior" allow for what the model misses of real curves, as its `discrepancy_` tells; else
        the curve is one of the model's own.
    channels : bool
        Whether the sets are red, green and blue of one camera after another. Their curves then share what the data do
        not tell apart; for "map" and "posterior" with discrepancy.
    noise : Noise, optional
        For "map" and "posterior".
    starts : int
        Random starts of "paper".
    seed : int
        Of every random step.
    table : Table, optional
        From `decode_table(model)`, to decode only once for many calls.
    """
    noise = Noise() if noise is None else noise
    _check(model, observations, method, noise, table)
    if channels and (len(observations) % 3 or not discrepancy or method not in ("map", "posterior")):
        raise InputError(
            f"channels=True with {len(observations)} sets, method={method!r} and discrepancy={discrepancy}; "
            "use 3 sets a camera, 'map' or 'posterior', and discrepancy=True"
        )
    check_count("starts", starts)
    check_seed(seed)
    began = time.perf_counter()
    scale = samples = curves = None
    if method == "paper":
        z = descend(AlignedLoss(observations), model, starts, seed)
    elif method in ("grid", "lm"):
        loss, table = AlignedLoss(observations), table or decode_table(model, seed=seed)
        z = minimise(loss.objective(model), table, loss.on_table(table))
    elif discrepancy:
        table = table or decode_table(model, seed=seed)
        difference = channel_difference() if channels else None
        z, curves, scale, samples = marginalised(
            model, observations, noise, table, seed, method == "posterior", difference
        )
    else:
        posterior, table = Posterior(observations, noise), table or decode_table(model, seed=seed)
        logs = posterior.log_likelihood_on(table)
        z = minimise(posterior.objective(model), table, -(logs + table.log_prior))
        scale = posterior.noise_scale(model, z)
        if method == "posterior":
            one = model.n_params == 1
            samples = exact_samples(table, logs) if one else drawn_samples(posterior, model, z, seed)
            curves = samples.mean()
    params = model.from_unconstrained(z)
    curves = model.decode(params) if curves is None else curves
    bands = {} if samples is None else _bands(samples, curves if discrepancy else None)
    flat = _flat(table, bands) if table and bands else np.zeros(len(z), dtype=bool)
    seconds, none = time.perf_counter() - began, ((),) * len(z)
    found = Calibration(model, method, observations, noise, params, curves, none, seconds, scale, samples, bands)
    return replace(found, warnings=_warnings(found, z, flat, discrepancy))


def _bands(samples: PosteriorSamples, middle: Array | None) -> dict[float, tuple[Array, Array]]:
    """Return the ends of the bands, nearer to the `middle` curves (n, 1024), if given; see `_HALF_WIDTH`."""
    quantiles = iter(samples.quantiles(tuple(0.5 + side * level / 2 for level in LEVELS for side in (-1, 1))))
    bands = {}
    for level in LEVELS:
        low, high, share = next(quantiles), next(quantiles), _HALF_WIDTH[level]
        if middle is not None:
            low, high = middle + share * (low - middle), middle + share * (high - middle)
        bands[level] = low, high
    return bands


def _check(model: ResponseModel, observations: Observations, method: str, noise: Noise, table: Table | None) -> None:
    check_kind("model", model, ResponseModel, "load_model(name)")
    check_kind("observations", observations, Observations, "Observations(brightness, reference)")
    check_kind("noise", noise, Noise, "Noise()")
    check_choice("method", method, METHODS)
    if model.direction != "inverse":
        raise InputError(f"{model!r} maps irradiance to brightness; calibrate with a model of direction 'inverse'")
    if method == "grid" and model.n_params > 1:
        raise InputError(f"{model!r} has {model.n_params} parameters and 'grid' takes one; use 'lm'")
    if table is not None:
        check_kind("table", table, Table, "decode_table(model)")
        # A table of another model would give wrong curves without a word, so its first row is decoded again.
        same = table.params.shape[1] == model.n_params
        if not (same and np.allclose(table.curves[:1], model.decode(table.params[:1], np.float32), atol=1e-4)):
            raise InputError(f"the table was not decoded from {model!r}; use decode_table(model)")


def _warnings(found: Calibration, z: Array, flat: np.ndarray, discrepancy: bool) -> tuple[tuple[str, ...], ...]:
    observations = found.observations
    wide = np.zeros(len(z)) if found.noise_scale is None else found.noise_scale
    limit, times = (_WIDE_WITH_DISCREPANCY, "{:.0f} times or more") if discrepancy else (_WIDE, "{:.1f} times")
    right = "exposures are right" if observations.reference is None else "exposures and reference are right"
    if observations.reference is None and (wide > limit).any():
        # Errors that go together along the curve widen the bands; they are told where they pass what noise explains.
        wide = np.where(_scatter(found) > 1.0, wide, 0.0)
    used = observations.weights > 0
    clipped, total = (observations.clipped & used).sum(axis=(1, 2)), used.sum(axis=(1, 2))
    patches = observations.counts.any(axis=1).sum(axis=1)
    falling, edge = _falling(observations), _at_edge(found.model, z)
    return tuple(
        tuple(
            text
            for holds, text in (
                (clipped[i] > 0.1 * total[i], f"{clipped[i]} of {total[i]} observations are clipped"),
                (patches[i] < _FEW, f"only {patches[i]} patches: the prior says much of this curve"),
                (falling[i], "brightness falls where the reference rises; check the order of the patches"),
                (
                    wide[i] > limit,
                    f"the observations scatter {times.format(wide[i])} as widely as their noise lets expect; check "
                    f"that the scene stood still and that {right}",
                ),
                (flat[i], "the observations say little: the curve is mostly what the model expects beforehand"),
                (edge[i], "the best parameters lie at the edge of what the prior expects"),
            )
            if holds
        )
        for i in range(len(z))
    )


def _scatter(found: Calibration) -> Array:
    """Return the residuals of each set in units of the stated noise, root mean square, (n,)."""
    observations = found.observations
    w = observations.counts * observations.weights
    off = found.residuals / found.noise.relative(observations.brightness)
    return np.sqrt((w * off**2).sum(axis=(1, 2)) / np.maximum(w.sum(axis=(1, 2)), 1e-300))


def _flat(table: Table, bands: dict[float, tuple[Array, Array]]) -> np.ndarray:
    """Say where the outer band is nearly as wide as the curves that the model expects before any data."""
    curves, weight = np.clip(table.by_sample[BAND_SAMPLES], 0.0, 1.0).astype(np.float64), np.exp(table.log_prior)
    variance = np.maximum(curves**2 @ weight - (curves @ weight) ** 2, 0.0)
    low, high = bands[LEVELS[-1]]
    width = (high - low)[:, BAND_SAMPLES].mean(axis=1)
    return np.asarray(width > _AS_EXPECTED * np.sqrt(variance).mean())


def _at_edge(model: ResponseModel, z: Array) -> np.ndarray:
    """Say where a parameter lies more than 4 standard deviations from the mean of the prior, and beyond its centres."""
    if model.prior_ is None:  # "paper" asks for none
        return np.zeros(len(z), dtype=bool)
    prior, most = model.prior_, 4.0 * np.sqrt(np.diagonal(model.prior_.covariance))
    if prior.centres is not None:
        most = np.maximum(most, np.abs(prior.centres - prior.mean).max(axis=0) * (1.0 + 1e-9))
    return np.asarray((np.abs(z - prior.mean) > most).any(axis=1))


def _falling(observations: Observations) -> np.ndarray:
    """Say where brightness and reference are negatively correlated within the photographs."""
    if observations.reference is None:
        return np.zeros(len(observations), dtype=bool)
    w = observations.counts * observations.weights
    total = np.maximum(w.sum(axis=2, keepdims=True), 1e-300)
    b, r = (
        x - (w * x).sum(axis=2, keepdims=True) / total
        for x in (observations.brightness, np.log(observations.reference)[:, None])
    )
    return np.asarray((w * b * r).sum(axis=(1, 2)) < -1e-12 * w.sum(axis=(1, 2)))
