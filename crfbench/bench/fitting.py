"""Fitting all curves at once against SciPy curve by curve: GGCM(3), side by side, same curves and same optimum.

Run it with: python -m crfbench.bench.fitting. The ratio is the claim; the seconds are of this machine and this minute.
"""

import argparse
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from crfbench import load_responses
from crfbench.bench.growth import Growth, print_growth
from crfbench.bench.timing import Row, median_seconds, row
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


SIZES = (10, 30, 100, 300, 1000)
LOOPS = {"SciPy least_squares, defaults": scipy_loop, "SciPy lm, analytic Jacobian": scipy_loop_with_jacobian}


def rows(repeats: int = 3) -> list[Row]:
    """Time all at once and each loop; the notes tell the RMSE that both reach."""
    responses = load_responses("auto")
    model, curves = GGCM(3), responses.curves
    name = f"fit GGCM(3), {len(curves)} curves of {responses.dataset}"
    ours, reached = median_seconds(partial(model.fit, curves), repeats), _mean_rmse(model.fit(curves), curves)
    found = []
    for other, loop in LOOPS.items():
        seconds = median_seconds(partial(loop, curves), repeats)
        note = f"mean RMSE {reached:.6f} against {_mean_rmse(loop(curves), curves):.6f}, median of {repeats}"
        found.append(row(name, ours, other, seconds, note))
    return found


def growths() -> list[Growth]:
    """Time fits of more and more curves, mixtures of the real ones, and the SciPy loop on as many."""
    curves, rng = load_responses("auto").curves, np.random.default_rng(0)
    runs = (GGCM(3).fit, scipy_loop_with_jacobian)
    mixed = [rng.dirichlet(np.ones(len(curves)), size=n) @ curves for n in SIZES]
    seconds = np.array([[median_seconds(partial(run, some), 3) for run in runs] for some in mixed])
    return [Growth("curves", ("crfbench, all at once", "SciPy lm, one by one"), SIZES, seconds)]


def main() -> None:
    """Print the times, the ratios and the RMSE each way reaches."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    for name, ours, other, other_s, ratio, note in rows(parser.parse_args().repeats):
        print(f"{name} {ours:8.3f} s   {other} {other_s:8.3f} s   {ratio:6.1f} x   {note}")
    for growth in growths():
        print_growth(growth)


def _mean_rmse(params: Array, curves: Array) -> float:
    return float(rmse(GGCM(3).decode(params), curves).mean())


if __name__ == "__main__":
    main()
