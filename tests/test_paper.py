import pytest

from crfbench import paper
from crfbench.models.registry import ModelKey, bundled_models
from crfbench.paper import verdicts
from crfbench.paper.verdicts import verdict


@pytest.mark.parametrize(
    ("ours", "printed", "expected"),
    [
        (0.036011, "3.60E-2", "reproduced"),
        (0.03614, "3.60E-2", "reproduced"),
        (0.03616, "3.60E-2", "differs"),
        (0.0458, "7.34E-3", "differs"),
        (0.0614, "0.062", "reproduced"),
        (0.1, None, "not comparable"),
    ],
)
def test_verdict_goes_by_the_last_printed_digit(ours, printed, expected):
    assert verdict(ours, printed) == expected


def test_verdict_goes_by_our_spread_and_by_what_is_near():
    assert verdict(0.070, "0.062") == "differs"
    assert verdict(0.070, "0.062", (0.061, 0.08)) == "reproduced"
    assert verdict(0.070, "0.062", (0.063, 0.08)) == "differs"
    assert [verdict(ours, "0.057", near=0.005) for ours in (0.062, 0.063)] == ["reproduced", "differs"]


def test_tables_are_complete():
    assert len(verdicts.FITTING) == 14
    assert len(verdicts.CALIBRATION) == 13
    assert all(len(row) == len(verdicts.CALIBRATION_COLUMNS) for row in verdicts.CALIBRATION.values())
    assert min(verdicts.STABILITY, key=verdicts.STABILITY.__getitem__) == "SLR-ldl-1"


def test_what_is_printed_is_of_models_that_can_be_loaded():
    for name in (*verdicts.STABILITY, *verdicts.CALIBRATION, *verdicts.FITTING):
        key = ModelKey.parse(name)
        assert str(key) == name
        assert key.constraint == "published" or key in bundled_models()


def test_everything_at_the_door_is_found():
    assert all(getattr(paper, name) is not None for name in paper.__all__)
    with pytest.raises(AttributeError, match=r"it has .*claims_table"):
        paper.nothing  # noqa: B018
