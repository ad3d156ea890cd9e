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
    assert metrics.off_endpoints(curves).tolist() == [False, False, True, True]
