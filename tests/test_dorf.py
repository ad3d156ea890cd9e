"""DoRF: both file formats, units that keep related curves together, and what damaged files give."""

import hashlib
import json
import zipfile
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from crfbench.curves import GRID
from crfbench.datasets import dorf, load_responses
from crfbench.datasets.registry import RemoteFile
from crfbench.datasets.responses import near_copies
from crfbench.errors import FormatError, InputError, MissingDataError
from crfbench.files import bundled

# 1 is the copy of 0 under another name, 2 is the blue of the film of 1.
NAMES = ("filmRed", "sameFilmRed", "sameFilmBlue", "Red", "camera")
CURVES = np.array([GRID**gamma for gamma in (0.5, 0.5, 0.9, 2.0, 3.0)])


def record(name="film", x=GRID, y=GRID, *, end="\n", gap="   ") -> str:
    lines = (
        name,
        "graph lin-lin",
        "I =",
        gap.join(map(repr, map(float, x))),
        "B =",
        gap.join(map(repr, map(float, y))),
    )
    return end.join(lines) + end


def text_of(curves=CURVES, names=NAMES, **form) -> str:
    return "".join(record(name, y=curve, **form) for name, curve in zip(names, curves, strict=True))


def write_zip(path, text, name=dorf.MEMBER, **form):
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo(name) if not form else name, text, **form)
    return path


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Give a data folder in which the five synthetic curves pass for DoRF."""
    monkeypatch.setenv("CRFBENCH_DATA", str(tmp_path))
    monkeypatch.setattr(dorf, "known_fingerprint", lambda: dorf.fingerprint(CURVES))
    (tmp_path / "dorf").mkdir()
    return tmp_path / "dorf"


@pytest.fixture
def mat(folder, monkeypatch):
    """Give a function that writes 201_CRF_data.mat and makes its checksum the known one."""

    def write(**content):
        path = folder / "201_CRF_data.mat"
        savemat(path, content)
        file = RemoteFile("dorf/201_CRF_data.mat", "", hashlib.sha256(path.read_bytes()).hexdigest())
        monkeypatch.setattr(dorf, "known", lambda: {"dorf": (file,)})

    return write


# --- the text format


@pytest.mark.parametrize("form", [{}, {"end": "\r\n"}, {"end": "\r"}, {"end": "\n \n\n"}, {"gap": " \t  "}])
def test_round_trip(form):
    names, x, y = dorf.parse_dorf_text(text_of(**form))
    assert names == NAMES
    np.testing.assert_array_equal(x, np.tile(GRID, (5, 1)))
    np.testing.assert_array_equal(y, CURVES)


@settings(max_examples=20)
@given(
    seed=st.integers(0, 2**32 - 1),
    names=st.lists(st.text("abcXYZ019-_ ", min_size=1).map(str.strip).filter(bool), min_size=1, max_size=4),
)
def test_round_trip_of_any_records(seed, names):
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.uniform(0.1, 1.0, (len(names), 1024)), axis=1)
    y = np.cumsum(rng.uniform(0.0, 1.0, (len(names), 1024)) ** 4, axis=1)
    text = "".join(record(name, x=a, y=b) for name, a, b in zip(names, x, y, strict=True))
    parsed, irradiance, brightness = dorf.parse_dorf_text(text)
    assert parsed == tuple(names)
    np.testing.assert_array_equal(irradiance, x)
    np.testing.assert_array_equal(brightness, y)


FALLING = np.where(np.arange(1024) == 500, 0.0, GRID)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no record"),
        (" \n\r\n", "no record"),
        (record() + "kodak\nlabel\n", r"record 2 \('kodak'\) is cut off after 2 lines"),
        (record().replace("I =", "E ="), r"record 1 \('film'\) has 'E =' where 'I =' belongs"),
        (record().replace("B =", "B"), "has 'B' where 'B =' belongs"),
        (record(x=GRID[:-1]), r"I of record 1 \('film'\) has 1023 values; it needs 1024"),
        (record() + record("b", y=[*GRID, 2.0]), r"B of record 2 \('b'\) has 1025 values"),
        (record().replace("1.0\n", "one\n"), "not a number: .*'one'"),
        (record(y=np.where(GRID == 1, np.nan, GRID)), "NaN or infinite"),
        (record().replace("1.0\n", "1e999\n"), "NaN or infinite"),
        (record(x=FALLING), r"I of record 1 \('film'\) does not rise"),
        (record(y=FALLING), r"B of record 1 \('film'\) falls"),
        (record(y=np.zeros(1024)), "is constant"),
        (record(x=np.zeros(1024)), "does not rise"),
    ],
)
def test_bad_text(text, message):
    with pytest.raises(FormatError, match=message):
        dorf.parse_dorf_text(text)


PIECES = st.sampled_from([record(), "I =\n", "B =\n", "film\n", "\r", "1e400 ", "0.5 ", "=", record()[:9000], "\x00"])


@settings(max_examples=150)
@given(st.one_of(st.text(), st.lists(PIECES, max_size=8).map("".join)))
def test_any_text_parses_or_is_refused(text):
    try:
        names, irradiance, brightness = dorf.parse_dorf_text(text)
    except FormatError:
        return
    assert irradiance.shape == brightness.shape == (len(names), 1024)
    assert (np.diff(irradiance) > 0).all()
    assert (np.diff(brightness) >= 0).all()


@settings(max_examples=60)
@given(
    position=st.integers(0, len(record()) - 1),
    length=st.integers(0, 40),
    patch=st.text("0123456789.eE+- \nIB=x", max_size=5),
)
def test_any_damage_to_a_record_parses_or_is_refused(position, length, patch):
    good = record()
    with suppress(FormatError):
        dorf.parse_dorf_text(good[:position] + patch + good[position + length :])


# --- loading


def test_text_gives_names_and_units_that_keep_copies_together(folder):
    write_zip(folder / "dorfCurves.zip", text_of())
    responses = load_responses("dorf")
    assert responses.dataset == "dorf"
    assert responses.names == NAMES
    assert responses.units == ("film", "film", "film", "Red", "camera")
    np.testing.assert_array_equal(responses.curves, CURVES)


def test_unzipped_text_loads_too(folder):
    (folder / "dorfCurves.txt").write_text(text_of())
    assert dorf.load_dorf().names == NAMES


def test_zip_is_preferred_to_mat(folder, mat):
    mat(I=np.tile(GRID, (5, 1)), B=CURVES)
    assert dorf.load_dorf().names[0] == "curve 1"
    write_zip(folder / "dorfCurves.zip", text_of())
    assert dorf.load_dorf().names == NAMES


def test_mat_has_units_of_near_copies_and_exact_ends(mat):
    mat(I=np.tile(GRID, (5, 1)), B=np.float32(CURVES))
    responses = dorf.load_dorf()
    assert responses.units == ("group 1", "group 1", "group 2", "group 3", "group 4")
    assert responses.curves.dtype == np.float64
    np.testing.assert_array_equal(responses.curves, np.float32(CURVES))


def test_uneven_grid_is_resampled(folder):
    x = GRID**1.5
    text = "".join(record(name, x=x, y=np.interp(x, GRID, curve)) for name, curve in zip(NAMES, CURVES, strict=True))
    write_zip(folder / "dorfCurves.zip", text)
    np.testing.assert_allclose(dorf.load_dorf().curves, CURVES, atol=2e-3)


def test_order_does_not_matter_but_values_do(folder):
    dorf.check_fingerprint(CURVES[::-1])
    with pytest.raises(FormatError, match="4 curves where DoRF has 5"):
        dorf.check_fingerprint(CURVES[:4])
    other = CURVES.copy()
    other[3] = GRID**1.999
    with pytest.raises(FormatError, match="other curves"):
        dorf.check_fingerprint(other)


def test_absent(tmp_path, monkeypatch):
    monkeypatch.setenv("CRFBENCH_DATA", str(tmp_path))
    with pytest.raises(MissingDataError, match=r"'crfbench fetch dorf'.*CRFBENCH_DATA"):
        load_responses("dorf")
    assert load_responses("auto").dataset == "opencrf"
    assert load_responses("opencrf").dataset == "opencrf"


def test_unknown_set():
    with pytest.raises(InputError, match="'kodak' is not known; use one of auto, dorf, opencrf"):
        load_responses("kodak")


@pytest.mark.parametrize("content", [b"", b"no matlab file at all" * 40, bytes(range(256)) * 8, b"MATLAB 5.0" * 99])
def test_damaged_mat(folder, content):
    (folder / "201_CRF_data.mat").write_bytes(content)
    with pytest.raises(FormatError, match=r"201_CRF_data\.mat is not DoRF: its SHA-256 .*; delete it"):
        dorf.load_dorf()


@pytest.mark.parametrize(("x", "y"), [(GRID, GRID**1.9), (GRID[::-1], GRID)])
def test_other_curves_in_the_mat(mat, x, y):
    mat(I=np.tile(x, (5, 1)), B=np.tile(y, (5, 1)))
    with pytest.raises(FormatError, match="is not DoRF"):
        dorf.load_dorf()


# --- the zip


@pytest.mark.parametrize("name", ["../dorfCurves.txt", "/dorfCurves.txt", "a/../../dorfCurves.txt", "..\\x", "C:x"])
def test_unsafe_names_are_refused(folder, name):
    path = write_zip(folder / "dorfCurves.zip", text_of(), name)
    with pytest.raises(FormatError, match="unsafe name"):
        dorf.load_dorf()
    assert list(folder.rglob("*")) == [path]


def test_member_in_a_folder_is_fine(folder):
    write_zip(folder / "dorfCurves.zip", text_of(), "response/dorfCurves.txt")
    assert len(dorf.load_dorf()) == 5


def test_zip_without_the_member(folder):
    write_zip(folder / "dorfCurves.zip", text_of(), "readme.txt")
    with pytest.raises(FormatError, match=r"0 files dorfCurves\.txt"):
        dorf.load_dorf()


def test_bomb_is_not_unpacked(folder, monkeypatch):
    monkeypatch.setattr(dorf, "MAX_TEXT_BYTES", 10**6)
    write_zip(folder / "dorfCurves.zip", b"\0" * (10**6 + 1), compress_type=zipfile.ZIP_DEFLATED)
    with pytest.raises(FormatError, match="more than the 1000000 bytes"):
        dorf.load_dorf()


def test_unusual_packing_is_refused(folder):
    write_zip(folder / "dorfCurves.zip", text_of(), compress_type=zipfile.ZIP_BZIP2)
    with pytest.raises(FormatError, match="encrypted or packed"):
        dorf.load_dorf()


@settings(max_examples=150)
@given(data=st.data())
def test_any_damage_to_the_zip_is_refused_or_harmless(tmp_path_factory, data):
    path = write_zip(tmp_path_factory.mktemp("zip") / "dorfCurves.zip", "some text", compress_type=zipfile.ZIP_DEFLATED)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    with pytest.raises(FormatError):
        dorf.read_official(path)


# --- the real set


def test_bundled_fingerprint_holds_no_curve():
    content = json.loads(bundled("data/registry/dorf_fingerprint.json").read_text())
    assert {name: len(moments) for name, moments in content.items()} == {"B": 201, "B*I": 201, "B^2": 201}
    assert all(moments == sorted(moments) for moments in content.values())


@pytest.mark.dorf
def test_real_curves(dorf_curves):
    assert len(dorf_curves) == 201
    assert dorf.fingerprint(dorf_curves.curves) == dorf.known_fingerprint()
    assert near_copies(dorf_curves.curves).max() + 1 == 87


@pytest.mark.dorf
def test_auto_takes_dorf_where_it_is(dorf_curves):
    assert load_responses("auto").dataset == "dorf"
