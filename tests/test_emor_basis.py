"""The published EMoR basis: both files, and what damaged ones give."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crfbench.curves import GRID
from crfbench.datasets.dorf import load_emor_basis, parse_emor
from crfbench.errors import FormatError, InputError, MissingDataError

COMPONENTS = np.array([np.sin(np.pi * k * GRID) * 1e-4 for k in range(1, 26)])


def number(value: float) -> str:
    """Print as the published files do: three digits of exponent."""
    mantissa, exponent = f"{value:.6e}".split("e")
    return f"{mantissa}e{int(exponent):+04d}"


def block(name: str, values) -> str:
    lines = ["   ".join(map(number, values[start : start + 4])) for start in range(0, len(values), 4)]
    return "\n".join([name, *lines, ""])


def text_of(grid="E = ", mean="f0 = ", component="h({})=", x=GRID) -> str:
    blocks = [block(component.format(k + 1), values) for k, values in enumerate(COMPONENTS)]
    return block(grid, x) + block(mean, GRID**0.5) + "".join(blocks)


FORWARD = text_of()


@pytest.mark.parametrize("end", ["\n", "\r\n", "\n\n"])
@pytest.mark.parametrize("text", [FORWARD, text_of("B = ", "g0 = ", "hinv({})=")])
def test_both_files_parse(text, end):
    grid, mean, components = parse_emor(text.replace("\n", end))
    np.testing.assert_allclose(grid, GRID, atol=1e-6)
    np.testing.assert_allclose(mean, GRID**0.5, atol=1e-6)
    np.testing.assert_allclose(components, COMPONENTS, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "0 blocks"),
        ("hello\n" + FORWARD, "27 blocks"),
        (FORWARD.replace("h(25)", "h(26)"), "27 blocks"),
        (FORWARD[: FORWARD.index("h(25)")], r"26 blocks \(E, f0, h\(1\) \.\.\.\)"),
        (FORWARD.replace("f0", "g0"), "27 blocks"),
        (FORWARD.rsplit("   ", 1)[0], r"block h\(25\) has 1023 values; it needs 1024"),
        (FORWARD + "1.0\n", r"block h\(25\) has 1025 values"),
        (FORWARD.replace("0.000000e+000", "zero", 1), "block E holds something that is not a number: .*'zero'"),
        (FORWARD.replace("1.000000e+000", "1.000000e+999", 1), "block E holds NaN or infinite"),
    ],
)
def test_bad_text(text, message):
    with pytest.raises(FormatError, match=message):
        parse_emor(text)


PIECES = st.sampled_from([FORWARD, block("E =", GRID), "f0 =\n", "h(1)=\n", "1e400 ", "nan ", "=", "\n", "\x00"])


@settings(max_examples=150)
@given(st.one_of(st.text(), st.lists(PIECES, max_size=6).map("".join)))
def test_any_text_parses_or_is_refused(text):
    try:
        grid, mean, components = parse_emor(text)
    except FormatError:
        return
    assert grid.shape == mean.shape == (1024,)
    assert components.shape == (25, 1024)
    assert np.isfinite(components).all()


@settings(max_examples=40)
@given(st.integers(0, len(FORWARD) - 1), st.integers(0, 40), st.text("0123456789.e+-() \nhf=x", max_size=5))
def test_any_damage_parses_or_is_refused(position, length, patch):
    with suppress(FormatError):
        parse_emor(FORWARD[:position] + patch + FORWARD[position + length :])


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("CRFBENCH_DATA", str(tmp_path))
    (tmp_path / "dorf").mkdir()
    return tmp_path / "dorf"


def test_load(folder):
    (folder / "emor.txt").write_text(FORWARD)
    mean, components = load_emor_basis("forward")
    assert mean.shape == (1024,)
    assert components.shape == (25, 1024)
    with pytest.raises(MissingDataError, match=r"dorf/invemor\.txt .*'crfbench fetch emor'"):
        load_emor_basis("inverse")


def test_exchanged_files_are_noticed(folder):
    (folder / "invemor.txt").write_text(FORWARD)
    with pytest.raises(FormatError, match="starts with 'E'; the inverse basis starts with 'B'"):
        load_emor_basis("inverse")


def test_uneven_grid_is_refused(folder):
    (folder / "emor.txt").write_text(text_of(x=GRID**2))
    with pytest.raises(FormatError, match="uneven grid"):
        load_emor_basis("forward")


def test_unknown_direction():
    with pytest.raises(InputError, match="'sideways' is not known"):
        load_emor_basis("sideways")


@pytest.mark.dorf
@pytest.mark.parametrize("direction", ["forward", "inverse"])
def test_real_basis_is_orthonormal(emor_files, direction):
    mean, components = load_emor_basis(direction)
    np.testing.assert_allclose(components @ components.T, np.eye(25), atol=1e-7)
    np.testing.assert_allclose(components[:, [0, -1]], 0, atol=1e-12)
    assert mean[0] == 0
    assert mean[-1] == 1
    assert (np.diff(mean) > 0).all()
