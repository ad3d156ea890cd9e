import numpy as np
from scipy.optimize import least_squares

from crfbench.numerics import levenberg_marquardt, normal_equations


def rosenbrock(p):
    return np.stack([10 * (p[:, 1] - p[:, 0] ** 2), 1 - p[:, 0]], axis=1)


def rosenbrock_jacobian(p):
    zero = np.zeros(len(p))
    return np.stack([np.stack([-20 * p[:, 0], 10 + zero], 1), np.stack([zero - 1, zero], 1)], axis=1)


def test_many_rosenbrock_valleys_all_end_in_the_minimum():
    start = np.random.default_rng(0).uniform(-3, 3, size=(600, 2))
    params, cost = levenberg_marquardt(
        lambda p, rows: normal_equations(rosenbrock(p), rosenbrock_jacobian(p)), start, max_steps=500
    )
    assert np.allclose(params, 1.0, atol=1e-4)
    assert (cost < 1e-8).all()


def test_agrees_with_scipy_on_exponential_decay_and_keeps_problems_apart():
    rng = np.random.default_rng(1)
    t = np.linspace(0, 4, 30)
    truth = rng.uniform(0.5, 2, size=(20, 2))
    data = truth[:, :1] * np.exp(-truth[:, 1:] * t) + rng.normal(0, 0.05, (20, 30))

    def objective(p, rows):
        decay = np.exp(-p[:, 1:] * t)
        jacobian = np.stack([decay, -p[:, :1] * t * decay], axis=-1)
        return normal_equations(p[:, :1] * decay - data[rows], jacobian)

    params, cost = levenberg_marquardt(objective, np.ones((20, 2)), tolerance=1e-14)
    for i in range(20):
        best = least_squares(lambda p, i=i: p[0] * np.exp(-p[1] * t) - data[i], [1.0, 1.0], xtol=1e-12)
        assert np.allclose(params[i], best.x, atol=1e-5)
        assert np.isclose(cost[i], 2 * best.cost, rtol=1e-8)


def test_never_worse_than_the_start_even_where_the_function_has_no_value():
    def objective(p, rows):
        with np.errstate(invalid="ignore"):
            residuals = np.sqrt(p - 1.0)
        return normal_equations(residuals, (0.5 / np.sqrt(np.maximum(p - 1.0, 1e-12)))[:, :, None])

    start = np.array([[1.5], [9.0]])
    params, cost = levenberg_marquardt(objective, start)
    assert np.isfinite(params).all()
    assert (cost <= start[:, 0] - 1.0).all()
