import dataclasses

import numpy as np
import pytest

from crfbench.curves import GRID
from crfbench.datasets.responses import Responses
from crfbench.errors import InputError


def make(gammas=(0.5, 1.0, 2.0), units=("a", "a", "b"), **changes):
    n = len(gammas)
    columns = {
        "dataset": "toy",
        "curves": np.array([GRID**gamma for gamma in gammas]),
        "names": tuple(f"power {gamma}" for gamma in gammas),
        "units": units,
        "families": ("power",) * n,
        "sources": ("mathematics",) * n,
        "licences": ("CC0-1.0",) * n,
    }
    return Responses(**columns | changes)


def test_length_and_short_text():
    responses = make()
    assert len(responses) == 3
    assert repr(responses) == "3 responses from toy, 2 units"


def test_curves_are_a_read_only_copy():
    mine = np.array([GRID, GRID**2, GRID**3])
    responses = make(curves=mine)
    mine[0] = 0.5
    np.testing.assert_array_equal(responses.curves[0], GRID)
    with pytest.raises(ValueError, match="read-only"):
        responses.curves[0] = 0.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        responses.dataset = "other"


@pytest.mark.parametrize("column", ["names", "units", "families", "sources", "licences"])
def test_a_column_of_another_length_is_refused(column):
    with pytest.raises(InputError, match=f"{column} has 2 entries for 3 curves"):
        make(**{column: ("x", "y")})


@pytest.mark.parametrize("curve", [1.0 - GRID, 0.5 * GRID, np.where(GRID < 0.5, np.nan, GRID)])
def test_a_curve_that_is_no_response_is_refused(curve):
    with pytest.raises(InputError, match="curve 1"):
        make(curves=np.array([GRID, curve, GRID]))


def test_in_direction():
    responses = make()
    np.testing.assert_array_equal(responses.in_direction("forward"), responses.curves)
    inverse = responses.in_direction("inverse")
    assert inverse.shape == (3, 1024)
    np.testing.assert_allclose(inverse[0], GRID**2, atol=2e-3)
    np.testing.assert_allclose(inverse[1], GRID, atol=1e-9)


def test_unknown_direction_names_the_two():
    with pytest.raises(InputError, match="use one of forward, inverse"):
        make().in_direction("backward")


@pytest.mark.parametrize("which", [[2, 0], np.array([2, 0]), [-1, -3]])
def test_select_by_position_keeps_the_order_asked_for(which):
    chosen = make().select(which)
    assert chosen.names == ("power 2.0", "power 0.5")
    assert chosen.units == ("b", "a")
    np.testing.assert_array_equal(chosen.curves, [GRID**2, GRID**0.5])


def test_select_by_mask():
    assert make().select([True, False, True]).names == ("power 0.5", "power 2.0")
    assert make().select(1).names == ("power 1.0",)


@pytest.mark.parametrize("which", [[3], [True, False], [0.5], "power 1.0", []])
def test_select_refuses_what_is_not_there(which):
    with pytest.raises(InputError):
        make().select(which)
