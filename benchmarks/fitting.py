"""Fitting all curves at once against SciPy curve by curve: GGCM(3), side by side, same curves and same optimum.

Run it with: make bench. The ratio is the claim; the seconds are of this machine and this minute.
"""

import argparse
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from timing import median_seconds

from crfbench import load_responses
from crfbench.curves import GRID, Array
from crfbench.metrics import rmse
from crfbench.models import GGCM


def scipy_loop(curves: Array, **options: Any) -> Array:
    """Fit each curve alone from f(x) = x, as a user would with SciPy's defaults."""

    def residuals(p: Array, curve: Array) -> Array:
        x = GRID[1:]
        return x ** (p[0] + p[1] * x + p[2] * x**2) - curve[1:]

    return np.array([least_squares(residuals, [1.0, 0.0, 0.0], args=(c,), **options).x for c in curves])


def scipy_loop_with_jacobian(curves: Array) -> Array:
    """Fit each curve alone with SciPy's fastest method and the analytic Jacobian."""
    model = GGCM(3)
    return scipy_loop(curves, jac=lambda p, c: model.jacobian(p)[1:], method="lm")


_LOOPS = {"SciPy least_squares, defaults": scipy_loop, "SciPy lm, analytic Jacobian": scipy_loop_with_jacobian}


def main() -> None:
    """Print the times, the ratios and the RMSE each way reaches."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    repeats = parser.parse_args().repeats
    responses = load_responses("auto")
    model, curves = GGCM(3), responses.curves
    ours = median_seconds(partial(model.fit, curves), repeats)
    print(f"{len(curves)} curves of {responses.dataset}, GGCM with 3 parameters, median of {repeats} runs")
    print(f"{'crfbench, all at once':<34}{ours:8.3f} s   mean RMSE {_mean_rmse(model.fit(curves), curves):.6f}")
    for name, loop in _LOOPS.items():
        other = median_seconds(partial(loop, curves), repeats)
        print(f"{name:<34}{other:8.3f} s   mean RMSE {_mean_rmse(loop(curves), curves):.6f}   {other / ours:6.1f} x")


def _mean_rmse(params: Array, curves: Array) -> float:
    return float(rmse(GGCM(3).decode(params), curves).mean())


if __name__ == "__main__":
    main()
