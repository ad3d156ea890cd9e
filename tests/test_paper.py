import pytest

from crfbench import paper


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
    assert paper.verdict(ours, printed) == expected


def test_tables_are_complete():
    assert len(paper.FITTING) == 14
    assert len(paper.CALIBRATION) == 13
    assert all(len(row) == len(paper.CALIBRATION_COLUMNS) for row in paper.CALIBRATION.values())
    assert min(paper.STABILITY, key=paper.STABILITY.__getitem__) == "SLR"
