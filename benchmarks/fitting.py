"""Fitting all curves at once against SciPy curve by curve: GGCM-3, same curves and same optimum."""

from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from benchmarks.timing import Growth, Row, median_seconds, row
from crfbench import load_responses
from crfbench.curves import GRID, Array
from crfbench.metrics import rmse
from crfbench.models import GGCM

SIZES = (10, 30, 100, 300, 1000)
MODEL = GGCM(3, "forward")


def scipy_loop(curves: Array, **options: Any) -> Array:
    """Fit each curve alone from f(x) = x, as a user would with SciPy's defaults."""

    def residuals(p: Array, curve: Array) -> Array:
        x = GRID[1:]
        return x ** (p[0] + p[1] * x + p[2] * x**2) - curve[1:]

    return np.array([least_squares(residuals, [1.0, 0.0, 0.0], args=(c,), **options).x for c in curves])


def scipy_loop_with_jacobian(curves: Array) -> Array:
    """Fit each curve alone with SciPy's fastest method and the analytic Jacobian."""
    return scipy_loop(curves, jac=lambda p, c: MODEL.jacobian(p)[1:], method="lm")


LOOPS = {"SciPy least_squares, defaults": scipy_loop, "SciPy lm, analytic Jacobian": scipy_loop_with_jacobian}


def rows(repeats: int = 3) -> list[Row]:
    """Time all at once and each loop; the notes tell the RMSE that both reach."""
    responses = load_responses("auto")
    curves = responses.curves
    name = f"fit GGCM-3, {len(curves)} curves of {responses.dataset}"
    ours, reached = median_seconds(partial(MODEL.fit, curves), repeats), _mean_rmse(MODEL.fit(curves), curves)
    found = []
    for other, loop in LOOPS.items():
        seconds = median_seconds(partial(loop, curves), repeats)
        note = f"mean RMSE {reached:.6f} against {_mean_rmse(loop(curves), curves):.6f}, median of {repeats}"
        found.append(row(name, ours, other, seconds, note))
    return found


def growths() -> list[Growth]:
    """Time fits of more and more curves, mixtures of the real ones, and the SciPy loop on as many."""
    curves, rng = load_responses("auto").curves, np.random.default_rng(0)
    runs = (MODEL.fit, scipy_loop_with_jacobian)
    mixed = [rng.dirichlet(np.ones(len(curves)), size=n) @ curves for n in SIZES]
    seconds = np.array([[median_seconds(partial(run, some), 3) for run in runs] for some in mixed])
    return [Growth("curves", ("crfbench, all at once", "SciPy lm, one by one"), SIZES, seconds)]


def _mean_rmse(params: Array, curves: Array) -> float:
    return float(rmse(MODEL.decode(params), curves).mean())
