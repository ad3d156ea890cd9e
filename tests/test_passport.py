"""Passports and the formats of other programs: what goes out comes back, and other programs read it alike."""

import io
import json
import subprocess
import sys
from contextlib import nullcontext, suppress
from dataclasses import fields
from types import SimpleNamespace

import cv2
import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from crfbench.camera import Passport, formats, read_response, write_response
from crfbench.camera.formats import FORMATS, decode
from crfbench.curves import GRID, invert
from crfbench.datasets import load_opencrf
from crfbench.datasets.dorf import parse_dorf_text
from crfbench.errors import FormatError, InputError, MissingDataError
from crfbench.metrics import nonmonotone
from crfbench.models import EMoR
from tests.support.curves import off_endpoints
from tests.support.responses import file_of

RGB = np.array([GRID**2.0, GRID**2.2, np.expm1(3 * GRID) / np.expm1(3)])
ONE = Passport("inverse", RGB[2], camera="Coolcam 3")
THREE = Passport("inverse", RGB, camera="Coolcam 3")
EXACT = {"passport", "csv", "npy", "dorf"}  # in their own direction
SINGLE = {"hugin", "pcalib"}
# What inverting twice moves, at most: the response of GRID**2.2 begins upright.
INVERSION = 5e-4
# Straight lines between 256 samples, and five components, come this near.
TOLERANCE = {
    **dict.fromkeys(("opencv", "pcalib"), 2e-5),
    "cube": 1e-9,
    "hugin": 3e-3,
}
WRITTEN = [name for name, each in FORMATS.items() if each.channels]


@pytest.fixture(scope="module")
def learned():
    return EMoR.from_curves(load_opencrf().curves, 25, "forward")


@pytest.fixture(autouse=True)
def basis(monkeypatch, learned):
    """Give Hugin's format a basis learned here, and no data folder with the published one."""
    model = learned
    monkeypatch.setattr(formats, "load_emor_basis", lambda direction: (model.mean_, model.components_))
    return model


# --- the passport

bands = st.floats(0.0, 0.3).map(lambda width: (RGB - width, RGB + width))
texts = st.text(max_size=20)
passports = st.builds(
    lambda c, gammas, band, rest: Passport(
        curves=GRID ** np.array(gammas[:c])[:, None],
        **({} if band is None else {"low": band[0][:c], "high": band[1][:c], "level": 0.9}),
        **rest,
    ),
    st.sampled_from([1, 3]),
    st.lists(st.floats(0.2, 5.0), min_size=3, max_size=3),
    st.none() | bands,
    st.fixed_dictionaries(
        {"direction": st.sampled_from(["inverse", "forward"])},
        optional={
            "camera": texts,
            "iso": st.integers(1, 10**9),
            "model": texts,
            "data_sha256": st.binary(min_size=32, max_size=32).map(bytes.hex),
            "valid_range": st.tuples(st.floats(0.0, 0.4), st.floats(0.5, 1.0)),
            "created": st.dates().map(lambda day: day.isoformat()),
            "version": texts,
            "white_level": st.sampled_from([255, 1023, 65535]),
            "warnings": st.lists(texts).map(tuple),
        },
    ),
)


def same(a: Passport, b: Passport) -> bool:
    return all(np.array_equal(getattr(a, entry.name), getattr(b, entry.name)) for entry in fields(Passport))


@given(passports)
@settings(max_examples=50)
def test_json_round_trip_is_exact(passport):
    assert same(decode("passport", FORMATS["passport"].write(passport)), passport)


def test_write_and_read(tmp_path):
    path = tmp_path / "camera.json"
    passport = Passport("forward", invert(RGB), params=[[1, 2], [3, 4], [5, 6]], iso=np.int64(200))
    write_response(passport, path)
    loaded = read_response(path)
    assert same(loaded, passport)
    assert (loaded.iso, loaded.params.tolist()) == (200, [[1, 2], [3, 4], [5, 6]])
    with pytest.raises(InputError, match=r"camera\.json exists already.*--force"):
        write_response(THREE, path)
    assert same(read_response(path), passport)
    write_response(THREE, path, overwrite=True)
    assert same(read_response(path), THREE)


def test_a_passport_keeps_its_own_curves():
    curves = RGB.copy()
    passport = Passport("inverse", curves)
    curves[:] = 0.0
    np.testing.assert_array_equal(passport.curves, RGB)
    with pytest.raises(ValueError, match="read-only"):
        passport.curves[0, 5] = 0.5


def test_a_channel_is_a_passport_of_its_own():
    passport = Passport("inverse", RGB, RGB - 0.1, RGB + 0.1, 0.9, iso=100, params=[[1.0], [2.0], [3.0]])
    blue = passport.channel("blue")
    assert (blue.channels, blue.iso, blue.params.tolist()) == (("intensity",), 100, [[3.0]])
    np.testing.assert_array_equal([blue.curves[0], blue.low[0], blue.high[0]], [RGB[2], RGB[2] - 0.1, RGB[2] + 0.1])
    with pytest.raises(InputError, match="channel='violet' is not in this passport; use one of red, green, blue"):
        passport.channel("violet")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"direction": "up"}, "direction='up'"),
        ({"curves": RGB[:2]}, "2 curves are not a passport's; use 1"),
        ({"curves": RGB[:, ::-1]}, "falls"),
        ({"curves": [[10**400] * 1024]}, "something that is not a number"),
        ({"low": RGB}, "lacks one of low, high and level"),
        ({"low": RGB, "high": RGB - 0.1, "level": 0.9}, "use low <= high"),
        ({"low": RGB[:1], "high": RGB[:1], "level": 0.9}, r"of shape \(3, 1024\)"),
        ({"low": RGB, "high": RGB, "level": 90}, "level=90 is not a probability"),
        ({"low": RGB, "high": RGB, "level": [0.9]}, r"level=\[0.9\] is not a probability"),
        ({"camera": 3}, "camera=3 is not text"),
        ({"iso": 0}, "iso=0"),
        ({"iso": True}, "iso=True"),
        ({"params": [[1.0]]}, r"params have the wrong shape, \(1, 1\), for 3 curves"),
        ({"params": [["a"]] * 3}, "params=.* holds text"),
        ({"params": [[np.nan]] * 3}, "params of shape .* holds NaN"),
        ({"data_sha256": "abc"}, "data_sha256='abc'"),
        ({"valid_range": (0.5, 0.5)}, "use two rising"),
        ({"valid_range": 0.5}, "use two rising"),
        ({"created": "yesterday"}, "created='yesterday' is not a valid date"),
        ({"created": "20260131"}, "is not a valid date; use one like '2026-01-31'"),
    ],
)
def test_what_cannot_be_a_passport(values, message):
    with pytest.raises(InputError, match=message):
        Passport(**{"direction": "inverse", "curves": RGB, **values})


def altered(**changes: object) -> bytes:
    content = json.loads(FORMATS["passport"].write(THREE))
    return json.dumps({key: value for key, value in {**content, **changes}.items() if value != "drop"}).encode()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not JSON"),
        (b"[" * 100_000, "not JSON"),
        (b"[]", "does not say that its format"),
        (altered(format="other"), "does not say that its format"),
        (altered(schema=2), "its schema is '2'; this crfbench reads 1"),
        (altered(iso="drop"), "missing or unknown: iso"),
        (altered(extra=1), "missing or unknown: extra"),
        (altered(curves=[1, 2]), "curves have shape"),
        (altered(level=0.9), "lacks one of low"),
        (altered(iso=1.5), "iso=1.5"),
        (altered(iso=[1.5] * 9999), r"iso=\[1\.5, 1\.5.{200,300}; use a whole number from 1$"),
        (altered(camera=["x"] * 9999), r"camera=\['x', 'x'.{200,300} is not text; use a str$"),
        (altered(direction=["inverse"]), "is not known"),
        (altered(valid_range=[0, float("nan")]), "it holds NaN"),
        (FORMATS["passport"].write(THREE)[:-1] + b', "iso": 3}', "'iso' occurs twice"),
    ],
)
def test_what_cannot_be_a_passport_file(data, message, tmp_path):
    path = tmp_path / "a.json"
    path.write_bytes(data)
    with pytest.raises(FormatError, match=rf"a\.json: this is not a response in the format 'passport': .*{message}"):
        read_response(path)


# --- every format


@pytest.mark.parametrize("direction", ["inverse", "forward"])
@pytest.mark.parametrize("passport", [ONE, THREE], ids=["one", "three"])
@pytest.mark.parametrize("name", WRITTEN)
def test_what_is_written_is_read_again(name, passport, direction, tmp_path):
    passport = Passport(direction, passport.in_direction(direction), camera=passport.camera)
    path = tmp_path / f"my{FORMATS[name].suffix}"
    if name in SINGLE and len(passport.curves) > 1:
        with pytest.raises(InputError, match=r"has 3 curves and .* holds one curve; use passport\.channel.* --channel"):
            write_response(passport, path)
        assert not list(tmp_path.iterdir())
        return
    write_response(passport, path)
    found = read_response(path)
    assert found.channels == passport.channels
    if name in EXACT and found.direction == direction:
        np.testing.assert_array_equal(found.curves, passport.curves)
    gap = np.abs(found.in_direction("inverse") - passport.in_direction("inverse")).max()
    assert gap < TOLERANCE.get(name, INVERSION)
    assert not (nonmonotone(found.curves) | off_endpoints(found.curves)).any()
    with pytest.raises(InputError, match="exists already"):
        write_response(passport, path)
    write_response(passport, path, overwrite=True)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("name", WRITTEN)
def test_every_real_response_survives(name):
    """Steep and flat stretches of measured curves do not break a format, though 256 samples may blunt them."""
    for curve in load_opencrf().curves[::5]:
        found = decode(name, FORMATS[name].write(Passport("forward", curve)))
        assert np.abs(found.in_direction("inverse") - invert(curve)).mean() < 5e-3


@pytest.mark.parametrize("name", FORMATS)
@given(data=st.binary(max_size=400) | st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace")))
@settings(max_examples=100)
def test_bytes_of_any_kind_give_a_format_error(name, data):
    with pytest.raises(FormatError):
        decode(name, data)


@pytest.mark.parametrize("name", FORMATS)
@given(st.data())
@settings(max_examples=40)
def test_a_damaged_file_gives_a_passport_or_a_format_error(name, data):
    content = file_of(name, ONE)
    near_head = st.integers(0, min(200, len(content))) | st.integers(0, len(content))
    start, length = data.draw(near_head), data.draw(st.integers(0, 20))
    damaged = content[:start] + data.draw(st.binary(max_size=8)) + content[start + length :]
    assume(damaged != content)
    with suppress(FormatError):
        assert isinstance(decode(name, damaged), Passport)


@pytest.mark.parametrize("name", sorted(set(FORMATS) - {"passport", "npy", "opencv", "debevec", "pfstools"}))
@pytest.mark.parametrize("odd", ["nan", "inf", "1e999", "-1", "zero", "1_0 2"])
def test_odd_numbers_are_refused(name, odd):
    words = file_of(name, ONE).decode().replace(",", " , ").split(" ")
    row = next(i for i in range(-1, -len(words), -1) if words[i].strip() not in ("", ","))
    words[row] = ("Re" if name == "hugin" else "") + odd
    allowed = (name, odd) == ("hugin", "-1")  # a coefficient may be negative
    with nullcontext() if allowed else pytest.raises(FormatError):
        decode(name, " ".join(words).replace(" , ", ",").encode())


def test_the_longest_ending_tells_the_format(tmp_path):
    write_response(ONE, tmp_path / "a.opencv.npy")
    assert np.load(tmp_path / "a.opencv.npy").shape == (256, 1, 3)
    write_response(ONE, tmp_path / "a.npy")
    assert np.load(tmp_path / "a.npy").shape == (1024,)
    write_response(ONE, tmp_path / "a.txt", to="pcalib")
    assert read_response(tmp_path / "a.txt", format="pcalib").direction == "inverse"
    with pytest.raises(InputError, match=r"b\.txt tells no format that is written; let it end in one of \.json, \.csv"):
        write_response(ONE, tmp_path / "b.txt")
    with pytest.raises(InputError, match="to='exr' is not known; use one of passport, csv"):
        write_response(ONE, tmp_path / "a.exr", to="exr")
    with pytest.raises(MissingDataError, match=r"no file .*b\.npy"):
        read_response(tmp_path / "b.npy")


# --- what other programs make of them


def content(name, passport) -> io.BytesIO:
    return io.BytesIO(FORMATS[name].write(passport))


def test_pandas_and_numpy_read_the_table():
    table = pd.read_csv(content("csv", THREE))
    assert list(table) == ["brightness", "irradiance_r", "irradiance_g", "irradiance_b"]
    np.testing.assert_allclose(table.to_numpy().T, [GRID, *RGB], rtol=1e-15)
    forward = np.loadtxt(content("csv", Passport("forward", RGB[0])), delimiter=",", skiprows=1)
    np.testing.assert_array_equal(forward.T, [GRID, RGB[0]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "its head is ''"),
        ("a,b\n0,0\n1,1", "its head is 'a,b'"),
        ("brightness,irradiance\n", "has rows of no values"),
        ("brightness,irradiance\n0,0\n1", r"rows of \[1, 2\] values"),
        ("brightness,irradiance\n0,0,0\n1,1,1", "rows have 3 values below a head of 2"),
        ("brightness,irradiance\n0,0\n255,1", "first column runs from 0 to 255"),
        ("brightness,irradiance\n0,0\n1,255", "curve 0 runs from 0 to 255"),
        ("brightness,irradiance\n0,0\n0,0\n1,1", "rise strictly"),
        ("brightness,irradiance\n0,0\n1,x", "not a number"),
    ],
)
def test_tables_that_are_refused(text, message):
    with pytest.raises(FormatError, match=message):
        decode("csv", text.encode())


def test_a_table_by_hand_is_read():
    text = '"Irradiance" , "Brightness"\r\n0,0\r\n0.5,0.75\r\n1,1\r\n\r\n'
    found = decode("csv", b"\xef\xbb\xbf" + text.encode())
    assert found.direction == "forward"
    np.testing.assert_allclose(found.curves[0], np.interp(GRID, [0, 0.5, 1], [0, 0.75, 1]))


def exposures(inverse, light, times):
    """Photograph the same light at several exposure times with the camera of those inverse responses; 8-bit BGR."""
    forward = invert(inverse)
    seen = [[np.interp(light[..., i] * time, GRID, forward[i]) for i in range(3)] for time in times]
    return [np.rint(255 * np.stack(image[::-1], axis=2)).astype(np.uint8) for image in seen]


def test_opencv_merges_exposures_to_the_light_that_was_there():
    light = np.random.default_rng(0).uniform(0.01, 0.2, size=(30, 40, 3))
    times = np.array([0.5, 1, 2, 4], dtype=np.float32)
    response = np.load(content("opencv", THREE))
    merged = cv2.createMergeDebevec().process(exposures(RGB, light, times), times, response)
    ratio = merged[..., ::-1] / light
    assert np.median(np.abs(ratio - 1)) < 0.01, "the scale is 1 too: irradiance 1 is what saturates in time 1"
    wrong = cv2.createMergeDebevec().process(exposures(RGB, light, times), times, response[:, :, ::-1].copy())
    assert np.median(np.abs(wrong[..., ::-1] / light - 1)) > 0.05, "the order of the channels matters"


def test_black_pixels_do_not_spoil_the_merging():
    response = np.load(content("opencv", THREE))
    assert (response > 0).all()
    black = np.zeros((4, 4, 3), np.uint8)
    merged = cv2.createMergeDebevec().process([black, black], np.array([1, 2], np.float32), response)
    assert np.isfinite(merged).all()
    assert merged.max() < 1e-3


def test_what_opencv_calibrates_is_read():
    light = np.linspace(0.01, 0.3, 900).repeat(3).reshape(30, 30, 3)
    times = np.array([0.25, 0.5, 1, 2, 4], dtype=np.float32)
    images = exposures(np.stack([RGB[1]] * 3), light, times)
    response = cv2.createCalibrateDebevec(samples=200, lambda_=50).process(images, times)
    rising = np.maximum.accumulate(response, axis=0)
    file = io.BytesIO()
    np.save(file, rising)
    found = decode("opencv", file.getvalue()).curves
    assert np.abs(found - RGB[1]).max() < 0.05


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.ones((3, 256), np.float32), r"shape \(3, 256\); use \(256, 1, 3\)"),
        (np.zeros((256, 1, 3), np.float32), "values above 0"),
        (np.linspace(2, 1, 768, dtype=np.float32).reshape(256, 1, 3), "falls"),
    ],
)
def test_responses_opencv_could_not_use(array, message):
    file = io.BytesIO()
    np.save(file, array)
    with pytest.raises(FormatError, match=message):
        decode("opencv", file.getvalue())


@pytest.mark.parametrize("array", [np.array(["a"] * 1024), np.ones(1024, complex), np.ones(5), np.ones((2, 1024))])
def test_arrays_that_are_not_curves(array):
    file = io.BytesIO()
    np.save(file, array)
    with pytest.raises(FormatError):
        decode("npy", file.getvalue())


@pytest.mark.parametrize("kind", ["<f4", ">f8", "<f2"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_numpy_files_of_any_real_kind_are_read(kind, order):
    file = io.BytesIO()
    np.save(file, np.asarray(RGB, dtype=kind, order=order))
    np.testing.assert_array_equal(decode("npy", file.getvalue()).curves, RGB.astype(kind))


def test_objects_in_a_numpy_file_are_never_made():
    file = io.BytesIO()
    np.save(file, np.array([SimpleNamespace(a=1)] * 1024, dtype=object), allow_pickle=True)
    with pytest.raises(FormatError, match="of real numbers"):
        decode("npy", file.getvalue())


def test_the_reader_of_dorf_reads_our_records():
    names, x, y = parse_dorf_text(content("dorf", THREE).read().decode("latin-1"))
    assert names == ("Coolcam 3Red", "Coolcam 3Green", "Coolcam 3Blue")
    np.testing.assert_array_equal(x, np.tile(GRID, (3, 1)))
    np.testing.assert_array_equal(y, invert(RGB))
    assert decode("dorf", FORMATS["dorf"].write(THREE)).camera == "Coolcam 3"


def test_colour_science_and_we_read_each_others_cubes(tmp_path):
    write_response(THREE, tmp_path / "ours.cube")
    image = np.random.default_rng(0).uniform(size=(8, 9, 3))
    table = np.stack([np.linspace(0, 1, 33) ** gamma for gamma in (2.0, 2.2, 2.4)], axis=1)
    np.savez(tmp_path / "in.npz", image=image, table=table)
    # In a process of its own: importing colour-science changes the filters of warnings for every later test.
    code = """import colour, numpy as np
given, lut = np.load("in.npz"), colour.read_LUT("ours.cube")
np.savez("out.npz", name=lut.name, table=lut.table, image=lut.apply(given["image"]))
colour.write_LUT(colour.LUT3x1D(given["table"], name="theirs"), "theirs.cube", decimals=9)"""
    subprocess.run([sys.executable, "-W", "ignore", "-c", code], cwd=tmp_path, check=True, capture_output=True)
    out = np.load(tmp_path / "out.npz")
    assert out["name"] == "Coolcam 3"
    np.testing.assert_allclose(out["table"], RGB.T, atol=1e-9)
    expected = np.stack([np.interp(image[..., i], GRID, RGB[i]) for i in range(3)], axis=2)
    np.testing.assert_allclose(out["image"], expected, atol=1e-8)
    found = read_response(tmp_path / "theirs.cube")
    assert found.camera == "theirs"
    np.testing.assert_allclose(found.curves, [np.interp(GRID, np.linspace(0, 1, 33), g) for g in table.T], atol=1e-8)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("LUT_1D_SIZE 1024", "LUT_3D_SIZE 2", "no single line LUT_1D_SIZE"),
        ("LUT_1D_SIZE 1024", "LUT_1D_SIZE 1023", r"shape \(1024, 3\); its head says \(1023, 3\)"),
        (
            "DOMAIN_MAX 1.0 1.0 1.0",
            "DOMAIN_MAX 2.0 1.0 0.9",
            "input runs from 0 to 0.9; use a table that covers 0 to 1",
        ),
        ("DOMAIN_MAX 1.0 1.0 1.0", "DOMAIN_MAX 1.0", "DOMAIN_MAX': 1}; use DOMAIN_MIN and DOMAIN_MAX of 3"),
        ("DOMAIN_MAX 1.0 1.0 1.0", "LUT_1D_INPUT_RANGE 0 1", "use DOMAIN_MIN and DOMAIN_MAX of 3, or LUT_1D_INPUT"),
        ("TITLE", "LUT_IN_VIDEO_RANGE\nTITLE", "it says LUT_IN_VIDEO_RANGE; write the table for full-range values"),
        ("TITLE", "LUT_1D_SIZE 1024\nTITLE", "no single line LUT_1D_SIZE"),
    ],
)
def test_cubes_that_are_refused(old, new, message):
    with pytest.raises(FormatError, match=message):
        decode("cube", FORMATS["cube"].write(ONE).replace(old.encode(), new.encode()))


def test_hugins_coefficients_are_those_of_the_basis(basis):
    coefficients = np.array([0.5, -0.2, 0.1, 0.05, -0.02])
    curve = basis.mean_ + coefficients @ basis.components_[:5]
    assert not nonmonotone(curve).any()
    text = FORMATS["hugin"].write(Passport("forward", curve)).decode()
    words = text.splitlines()[1].split()
    assert [word[:2] for word in words] == ["i", "Ra", "Rb", "Rc", "Rd", "Re"]
    np.testing.assert_allclose([float(word[2:]) for word in words[1:]], coefficients, atol=1e-8)


def test_a_project_of_hugin_is_read_by_its_first_image(basis):
    project = """# hugin project file
p f2 w3000 h1500 v360  E0 R0 n"TIFF_m c:LZW"
m g1 i0 f0 m2 p0.00784314
# image lines
i w4000 h3000 f0 v50 Ra0.5 Rb-0.2 Rc1e-1 Rd0.05 Re-0.02 Eev0 Er1 Eb1 r0 p0 y0 a0 b0 c0 d0 e0 Va1 Vm5 n"one.jpg"
i w4000 h3000 f0 v=0 Ra=0 Rb=0 Rc=0 Rd=0 Re=0 Eev1 Er1 Eb1 r0 p0 y9 a=0 b=0 c=0 d0 e0 Va=0 Vm5 n"two Ra9 .jpg"
v Ra0 Rb0 Rc0 Rd0 Re0
"""
    found = decode("hugin", project.encode())
    assert (found.model, found.params.tolist()) == ("EMoR", [[0.5, -0.2, 0.1, 0.05, -0.02]])
    expected = basis.mean_ + found.params[0] @ basis.components_[:5]
    np.testing.assert_allclose(found.curves[0], expected, atol=1e-12)
    with pytest.raises(FormatError, match="no image line with Ra"):
        decode("hugin", project.replace("Rc1e-1", "").encode())


def test_hugin_needs_the_published_basis(monkeypatch, tmp_path):
    monkeypatch.undo()
    monkeypatch.setenv("CRFBENCH_DATA", str(tmp_path))
    with pytest.raises(MissingDataError, match="crfbench fetch emor"):
        write_response(ONE, tmp_path / "a.pto")
    assert not list(tmp_path.iterdir())


def test_the_published_basis_serves_hugin(monkeypatch, emor_files):
    monkeypatch.undo()
    found = decode("hugin", FORMATS["hugin"].write(ONE))
    assert np.abs(found.in_direction("inverse") - ONE.curves).max() < 0.02


def as_dso_reads(data: bytes) -> np.ndarray:
    """Read in single precision, demand strictly rising values, and scale to 0 to 255."""
    values = np.array(data.decode().splitlines()[0].split(), dtype=np.float32)
    assert len(values) == 256
    assert (np.diff(values) > 0).all()
    return 255 * (values - values[0]) / (values[-1] - values[0])


def test_dso_reads_the_calibration():
    np.testing.assert_allclose(
        as_dso_reads(FORMATS["pcalib"].write(ONE)), 255 * np.interp(np.arange(256) / 255, GRID, RGB[2]), atol=1e-4
    )


@pytest.mark.parametrize("plateau", [slice(0, 300), slice(500, 900), slice(700, 1023)])
def test_dso_gets_rising_values_from_a_plateau(plateau):
    flat = GRID.copy()
    flat[plateau] = flat[plateau.start]
    found = as_dso_reads(FORMATS["pcalib"].write(Passport("inverse", flat)))
    np.testing.assert_allclose(found, 255 * np.interp(np.arange(256) / 255, GRID, flat), atol=0.03)


@pytest.mark.parametrize("words", [["1"] * 256, ["0"], [str(i) for i in range(255)], []])
def test_calibrations_dso_would_refuse(words):
    with pytest.raises(FormatError):
        decode("pcalib", " ".join(words).encode())
