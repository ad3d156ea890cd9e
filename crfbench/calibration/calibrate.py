"""One calibrator for every model."""

import time

import numpy as np

from crfbench.calibration.alignment import AlignedLoss
from crfbench.calibration.bands import Belief, drawn_belief, exact_belief
from crfbench.calibration.likelihood import Noise
from crfbench.calibration.observations import Observations
from crfbench.calibration.optimise import descend, minimise
from crfbench.calibration.posterior import Posterior
from crfbench.calibration.result import LEVELS, Calibration
from crfbench.calibration.table import Table, decode_table
from crfbench.checks import check_choice, check_count, check_seed
from crfbench.curves import Array
from crfbench.errors import InputError
from crfbench.models import ResponseModel

METHODS = ("paper", "grid", "lm", "map", "posterior")

_FEW = 4  # patches; with fewer, the prior says much
_WIDE = 1.25  # times the stated noise; beyond, something else than noise is at work


def calibrate(
    model: ResponseModel,
    observations: Observations,
    method: str = "map",
    *,
    noise: Noise | None = None,
    offset: bool = True,
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
        "map": the most probable parameters under `noise` and the model's prior. "posterior": also the posterior
        mean, bands and evidence; exact for one parameter, weighted draws for more. "grid" (one parameter) and "lm":
        the least loss of the paper, from a table of the whole range or many starts, polished. "paper": the same
        loss as the paper minimises it, by Adam from random starts.
    noise : Noise, optional
        For "map" and "posterior".
    offset : bool
        Whether the paper's loss aligns each photograph by scale and offset, as in the paper, or by scale alone.
    starts : int
        Random starts of "paper".
    seed : int
        Of every random step.
    table : Table, optional
        From `decode_table(model)`, to decode only once for many calls.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        For a model of the other direction or without a prior, a table of another model, and for an unknown method or
        one that does not fit the model or the observations.
    """
    _check(model, observations, method)
    _check_table(model, table)
    check_count("starts", starts)
    check_seed(seed)
    noise = Noise() if noise is None else noise
    _check_kind("noise", noise, Noise, "Noise()")
    began = time.perf_counter()
    scale = belief = None
    if method == "paper":
        free = descend(AlignedLoss(observations, offset), model, len(observations), starts, seed)
    elif method in ("grid", "lm"):
        loss, table = AlignedLoss(observations, offset), table or decode_table(model, seed=seed)
        free = minimise(loss, model, table, loss.on_table(table))
    else:
        posterior, table = Posterior(observations, noise), table or decode_table(model, seed=seed)
        logs = posterior.log_likelihood_on(table)
        free = minimise(posterior, model, table, -(logs + table.log_prior))
        scale = posterior.noise_scale(model, free)
        if method == "posterior":
            one = model.n_params == 1
            belief = exact_belief(table, logs) if one else drawn_belief(posterior, model, free, seed)
    return _result(model, method, observations, noise, free, (scale, belief), began)


def _check(model: ResponseModel, observations: Observations, method: str) -> None:
    _check_kind("model", model, ResponseModel, "load_model(name)")
    _check_kind("observations", observations, Observations, "Observations(brightness, reference)")
    check_choice("method", method, METHODS)
    if model.direction != "inverse":
        raise InputError(f"{model!r} maps irradiance to brightness; calibrate with a model of direction 'inverse'")
    if method == "grid" and model.n_params > 1:
        raise InputError(f"{model!r} has {model.n_params} parameters and 'grid' takes one; use 'lm'")


def _check_kind(name: str, value: object, kind: type, made: str) -> None:
    if not isinstance(value, kind):
        raise InputError(f"{name} is a {type(value).__name__}; use what {made} gives")


def _check_table(model: ResponseModel, table: Table | None) -> None:
    """Refuse a table of another model, which would give wrong curves without a word."""
    if table is not None:
        _check_kind("table", table, Table, "decode_table(model)")
        fits = table.params.shape[1] == model.n_params
        if not (fits and np.allclose(table.curves[:1], model.decode_float32(table.params[:1]), atol=1e-4)):
            raise InputError(f"the table was not decoded from {model!r}; use decode_table(model)")


def _result(
    model: ResponseModel,
    method: str,
    observations: Observations,
    noise: Noise,
    free: Array,
    extras: tuple[Array | None, Belief | None],
    began: float,
) -> Calibration:
    params = model.from_free(free)
    scale, belief = extras
    curves, bands = model.decode(params), {}
    if belief is not None:
        curves = belief.mean()
        ends = tuple(0.5 + side * level / 2 for level in LEVELS for side in (-1, 1))
        quantiles = belief.quantiles(ends)
        bands = {level: (quantiles[2 * i], quantiles[2 * i + 1]) for i, level in enumerate(LEVELS)}
    measured = np.where(observations.counts, observations.brightness, np.nan)
    return Calibration(
        model,
        method,
        observations,
        noise,
        params,
        curves,
        np.stack([np.nanmin(measured, axis=(1, 2)), np.nanmax(measured, axis=(1, 2))], axis=1),
        _warnings(model, observations, free, (scale, belief)),
        time.perf_counter() - began,
        scale,
        belief,
        bands,
    )


def _warnings(
    model: ResponseModel, observations: Observations, free: Array, extras: tuple[Array | None, Belief | None]
) -> tuple[tuple[str, ...], ...]:
    scale, belief = extras
    wide = np.zeros(len(free)) if scale is None else scale
    used = observations.weights > 0
    clipped, total = (observations.clipped & used).sum(axis=(1, 2)), used.sum(axis=(1, 2))
    patches = observations.counts.any(axis=1).sum(axis=1)
    flat, edge = _flat(model, belief, len(free)), _at_edge(model, free)
    falling = _falling(observations)
    return tuple(
        tuple(
            text
            for holds, text in (
                (clipped[i] > 0.1 * total[i], f"{clipped[i]} of {total[i]} observations are clipped"),
                (patches[i] < _FEW, f"only {patches[i]} patches: the prior says much of this curve"),
                (falling[i], "brightness falls where the reference rises; check the order of the patches"),
                (
                    wide[i] > _WIDE,
                    f"the observations scatter {wide[i]:.1f} times as widely as their noise lets expect; check that "
                    "the scene stood still and that exposures and reference are right",
                ),
                (flat[i], "the observations say little: the curve is mostly what the model expects beforehand"),
                (edge[i], "the best parameters lie at the edge of what the prior expects"),
            )
            if holds
        )
        for i in range(len(free))
    )


def _flat(model: ResponseModel, belief: Belief | None, n: int) -> np.ndarray:
    """Say where the posterior of the first parameter is nearly as wide as its prior."""
    if belief is None or model.prior_ is None:
        return np.zeros(n, dtype=bool)
    first = np.broadcast_to(belief.free[..., 0], belief.weights.shape)
    mean = (belief.weights * first).sum(axis=1, keepdims=True)
    variance = (belief.weights * (first - mean) ** 2).sum(axis=1)
    return np.asarray(variance > 0.8**2 * model.prior_.covariance[0, 0])


def _at_edge(model: ResponseModel, free: Array) -> np.ndarray:
    """Say where a parameter lies more than 4 standard deviations from the mean of the prior."""
    if model.prior_ is None:
        return np.zeros(len(free), dtype=bool)
    sd = np.sqrt(np.diagonal(model.prior_.covariance))
    return np.asarray((np.abs(free - model.prior_.mean) > 4.0 * sd).any(axis=1))


def _falling(observations: Observations) -> np.ndarray:
    """Say where brightness and reference run against each other."""
    if observations.reference is None:
        return np.zeros(len(observations), dtype=bool)
    w = observations.counts * observations.weights
    total = np.maximum(w.sum(axis=2, keepdims=True), 1e-300)
    b, r = (
        x - (w * x).sum(axis=2, keepdims=True) / total
        for x in (observations.brightness, np.log(observations.reference)[:, None])
    )
    return np.asarray((w * b * r).sum(axis=(1, 2)) < -1e-12 * w.sum(axis=(1, 2)))
