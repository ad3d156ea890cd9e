import statistics

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import stats

from crfbench import metrics
from crfbench.curves import GRID
from crfbench.errors import InputError

VALUES = hnp.arrays(float, st.integers(1, 30), elements=st.floats(-5, 5))


def test_rmse_of_a_constant_offset_is_the_offset():
    assert metrics.rmse(GRID, GRID + 0.25) == pytest.approx(0.25)
    assert metrics.mse(GRID, GRID + 0.25) == pytest.approx(0.0625)


def test_rmse_broadcasts_pairs():
    batch = np.stack([GRID, GRID**2, GRID**3])
    pairs = metrics.rmse(batch[:, None], batch[None])
    assert pairs.shape == (3, 3)
    assert pairs[0, 1] == pytest.approx(np.linalg.norm(GRID - GRID**2) / np.sqrt(1024))


@pytest.mark.parametrize(("a", "b"), [(GRID, GRID[1:]), (GRID[:0], GRID[:0])])
def test_what_cannot_be_compared_is_refused(a, b):
    with pytest.raises(InputError, match=rf"a has shape \({len(a)},\) and b \({len(b)},\); use .*which broadcast"):
        metrics.rmse(a, b)


@pytest.mark.parametrize("judge", [metrics.nonmonotone, metrics.out_of_range])
def test_what_is_no_batch_of_curves_is_refused(judge):
    for shape in ((2, 2, 1024), (0, 1024)):
        with pytest.raises(InputError) as caught:
            judge(np.zeros(shape))
        assert str(caught.value) == f"curves have shape {shape}; use (n, m) or (m,)"


def test_statistics_of_rows_are_the_summaries_of_each():
    rows = np.random.default_rng(0).integers(0, 200, (4, 9)).astype(np.uint8)
    for name, found in metrics.statistics(rows).items():
        assert found == pytest.approx([metrics.summarise(row)[name] for row in rows])


@given(VALUES)
def test_summary_agrees_with_independent_formulas(values):
    summary = metrics.summarise(values)
    assert summary["mean"] == pytest.approx(statistics.fmean(values), abs=1e-12)
    assert summary["median"] == pytest.approx(statistics.median(values), abs=1e-12)
    assert summary["sd"] == pytest.approx(statistics.pstdev(values), abs=1e-9)
    assert summary["max"] == max(values)
    assert summary["p95"] == pytest.approx(stats.scoreatpercentile(values, 95), abs=1e-9)


@pytest.mark.parametrize("values", [[], [np.nan], [[1.0]], [np.inf]])
def test_summary_refuses(values):
    with pytest.raises(InputError, match=r"one or more numbers|holds NaN"):
        metrics.summarise(values)


def test_total_variance_by_hand():
    assert metrics.total_variance([GRID, GRID]) == 0
    # Two curves d apart have variance (d/2)^2 at each of the 1024 samples.
    assert metrics.total_variance([GRID, GRID + 0.2]) == pytest.approx(1024 * 0.01)


def test_validity_flags():
    curves = np.stack([GRID, GRID**2 - 0.1 * np.sin(np.pi * GRID), 1.2 * GRID, 0.5 * GRID])
    assert metrics.nonmonotone(curves).tolist() == [False, True, False, False]
    assert metrics.out_of_range(curves).tolist() == [False, True, True, False]


def test_curves_may_be_integers_or_single_precision():
    dark, bright = np.zeros(4, dtype=np.uint8), np.full(4, 255, dtype=np.uint8)
    assert metrics.mse(dark, bright) == metrics.mse(bright, dark) == 255**2
    assert metrics.nonmonotone(np.array([[1, 2, 3], [3, 2, 1]], dtype=np.uint8)).tolist() == [False, True]
    thirds = np.full(10_000, 1 / 3, dtype=np.float32)
    assert metrics.summarise(thirds)["mean"] == pytest.approx(float(thirds[0]), rel=1e-14)
    third = np.stack([np.zeros_like(thirds), thirds])
    assert metrics.total_variance(third) == pytest.approx(10_000 * (float(thirds[0]) / 2) ** 2, rel=1e-12)


@pytest.mark.parametrize(("by", "told"), [(0.9e-9, False), (1.1e-9, True)])
def test_what_rounding_may_do_is_allowed(by, told):
    curves = np.array([[0, 0.5, 0.5 - by, 1], [-by, 0.5, 0.5, 1], [0, 0.5, 0.5, 1 + by]])
    found = [flag(curves).tolist() for flag in (metrics.nonmonotone, metrics.out_of_range)]
    assert found == [[told, False, False], [False, told, told]]
