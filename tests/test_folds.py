import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crfbench.curves import GRID
from crfbench.datasets.responses import grouped_folds, load_opencrf, near_copies
from crfbench.errors import InputError
from crfbench.metrics import rmse


@st.composite
def labels_and_folds(draw):
    labels = draw(st.lists(st.integers(0, 12), min_size=2, max_size=80).filter(lambda row: len(set(row)) > 1))
    return labels, draw(st.integers(2, len(set(labels))))


@given(labels_and_folds())
def test_folds_are_a_balanced_partition_that_splits_no_group(case):
    labels, n_folds = case
    folds = grouped_folds(labels, n_folds)
    assert folds.shape == (len(labels),)
    assert set(folds.tolist()) == set(range(n_folds))
    assert len(set(zip(labels, folds.tolist(), strict=True))) == len(set(labels))
    sizes = np.bincount(folds, minlength=n_folds)
    assert sizes.max() - sizes.min() <= np.bincount(labels).max()


@given(labels_and_folds())
def test_folds_depend_on_grouping_and_order_alone(case):
    labels, n_folds = case
    renamed = [f"unit {label}" for label in labels]
    np.testing.assert_array_equal(grouped_folds(labels, n_folds), grouped_folds(labels, n_folds))
    first_seen = [labels.index(label) for label in labels]
    np.testing.assert_array_equal(grouped_folds(first_seen, n_folds), grouped_folds(renamed, n_folds))


def test_largest_group_goes_first_then_first_appearance_to_the_emptiest_fold():
    labels = [7, 3, 3, 5, 5, 5, 9]  # sizes: 5 has 3, 3 has 2, then 7 before 9
    assert grouped_folds(labels, 2).tolist() == [1, 1, 1, 0, 0, 0, 0]


@pytest.mark.parametrize("n_folds", [-1, 0, 1, 4])
def test_folds_that_do_not_fit_are_refused(n_folds):
    with pytest.raises(InputError, match=r"is out of range for 3 groups|use a whole number from 2"):
        grouped_folds([0, 1, 2, 2], n_folds)


@pytest.mark.parametrize("labels", [[], [[0, 1], [2, 3]], 3])
def test_labels_that_do_not_fit_are_refused(labels):
    with pytest.raises(InputError):
        grouped_folds(labels, 2)


def test_near_copies_chain():
    near, middle, far, alone = GRID**1.0, GRID**1.025, GRID**1.05, GRID**3.0
    assert rmse(near, middle) < 0.01 < rmse(near, far)
    assert near_copies([alone, near, far, middle]).tolist() == [0, 1, 1, 1]
    assert near_copies([near, alone, far]).tolist() == [0, 1, 2]


def test_tolerance_is_an_rmse():
    curves = np.array([GRID, GRID**1.05])
    distance = float(rmse(*curves))
    assert near_copies(curves, distance * 1.001).tolist() == [0, 0]
    assert near_copies(curves, distance * 0.999).tolist() == [0, 1]


def test_one_curve_is_one_group():
    assert near_copies(GRID).tolist() == [0]


def test_near_copies_agree_with_a_search_curve_by_curve():
    curves = load_opencrf("all").curves
    labels = np.full(len(curves), -1)
    for start in range(len(curves)):
        if labels[start] >= 0:
            continue
        label, reached = labels.max() + 1, [start]
        while reached:
            row = reached.pop()
            labels[row] = label
            reached += np.flatnonzero((rmse(curves, curves[row]) < 0.01) & (labels < 0)).tolist()
    np.testing.assert_array_equal(near_copies(curves), labels)


@pytest.mark.dorf
@pytest.mark.skipif("CRFBENCH_DATA" not in os.environ, reason="CRFBENCH_DATA does not point at the real DoRF curves")
def test_dorf_has_87_groups():
    from scipy.io import loadmat

    curves = loadmat(Path(os.environ["CRFBENCH_DATA"]) / "dorf" / "201_CRF_data.mat")["B"]
    labels = near_copies(curves)
    assert labels.max() + 1 == 87
    assert sorted(np.bincount(grouped_folds(labels)).tolist()) == [40, 40, 40, 40, 41]
