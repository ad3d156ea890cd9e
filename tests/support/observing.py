"""Observations made from known curves, without any of the code under test."""

from functools import cache

import numpy as np

from crfbench.calibration import Observations, decode_table
from crfbench.curves import GRID
from crfbench.metrics import nonmonotone
from crfbench.models import load_model

MODELS = ("SLR-ldl-1", "SLR-monotone-1", "SLR-ldl-3", "Gamma-1", "Polynomial-3", "GGCM-3", "EMoR-3", "PPISP-4")


@cache
def ready(name):
    """Return a bundled model and its table."""
    model = load_model(name)
    return model, decode_table(model)


def known_curves(model, n, seed=3):
    """Draw curves near the mean of the prior that a camera could have; those of a plain SLR always wave a little."""
    mean = model.prior_.mean
    curves = model.decode(model.from_unconstrained(mean + 0.7 * (model.prior_.sample(60, seed) - mean)))
    waves = model.name == "SLR" and not model.monotone
    fits = curves.max(axis=1) <= 1.05 * curves[:, -1] if waves else ~nonmonotone(curves)
    return curves[fits][:n]


def brightness_of(curve, irradiance):
    """Return where an inverse response first reaches irradiances of any shape."""
    first = np.maximum(np.argmax(curve >= irradiance[..., None], axis=-1), 1)
    low, high = curve[first - 1], curve[first]
    return GRID[first - 1] + (irradiance - low) / (high - low) * GRID[1]


def scene(curves, patches=10, photographs=3):
    """Return reference (n, p), exposures in stops (n, e) and the exact brightness (n, e, p) that the curves give."""
    low, high = np.maximum(1.1 * curves[:, :1], 0.03), 0.96 * curves.max(axis=1, keepdims=True)
    span = np.sqrt(high / low)
    reference, exposure = low * span ** np.linspace(0, 1, patches), span ** np.linspace(0, 1, photographs)
    irradiance = exposure[:, :, None] * reference[:, None]
    pairs = zip(curves, irradiance, strict=True)
    return reference, np.log2(exposure), np.array([brightness_of(curve, values) for curve, values in pairs])


def unclipped(brightness, reference=None, exposures=None, **others):
    """Observe with every patch counted."""
    return Observations(brightness, reference, exposures, clipped=np.zeros(brightness.shape, bool), **others)


def shape_rmse(calibration, curves, offset=False):
    """Compare at the observed brightnesses, up to the scale that no photograph tells, or the offset too; shape (n,)."""
    at = calibration.observations.brightness.reshape(len(curves), -1)
    found, true = (
        np.array([np.interp(x, GRID, curve) for x, curve in zip(at, each, strict=True)])
        for each in (calibration.curves, curves)
    )
    if offset:
        found, true = (each - each.mean(axis=1, keepdims=True) for each in (found, true))
    scale = (found * true).sum(axis=1) / (found**2).sum(axis=1)
    return np.sqrt(((scale[:, None] * found - true) ** 2).mean(axis=1))
