"""Responses as other programs write them, told by their content under any name, and turned from one into another."""

import io
import re
import subprocess
import sys

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crfbench.camera import Passport, read_response, write_response
from crfbench.camera.formats import FORMATS, decode
from crfbench.curves import GRID
from crfbench.errors import FormatError, InputError
from tests.support.command import run_command
from tests.support.responses import file_of, matrix_of_pfstools, rows

LEVELS = np.arange(256) / 255
RGB = np.array([GRID**2.0, GRID**2.2, np.expm1(3 * GRID) / np.expm1(3)])
SAMPLES = np.array([np.interp(LEVELS, GRID, curve) for curve in RGB]).T
ONE = Passport("inverse", RGB[1])
THREE = Passport("inverse", RGB)
BY_CONTENT = [name for name in FORMATS if name != "hugin"]


def npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def near(found: Passport, curves: np.ndarray, tolerance: float = 2e-5) -> None:
    """Beyond black, whose irradiance a file of samples above 0 cannot tell, the curves are those."""
    assert found.direction == "inverse"
    np.testing.assert_allclose(found.curves[:, 5:], np.broadcast_to(curves, found.curves.shape)[:, 5:], atol=tolerance)


# --- told by the content


@pytest.mark.parametrize("name", BY_CONTENT)
@pytest.mark.parametrize("file_name", ["response", "camera.dat", "a.cube", "pcalib.txt", "a.opencv.npy"])
def test_the_content_tells_the_format_whatever_the_name(name, file_name, tmp_path):
    passport = ONE if FORMATS[name].channels == (1,) else THREE
    path = tmp_path / file_name
    path.write_bytes(file_of(name, passport))
    expected, found = decode(name, path.read_bytes()), read_response(path)
    np.testing.assert_array_equal(found.curves, expected.curves)
    assert (found.direction, found.camera) == (expected.direction, expected.camera)


@pytest.mark.parametrize("content", [b"", b"hello\nworld\n", b"\x93NUMPY but not quite", b"GIF89a\x00\xff", b"1 2"])
def test_unknown_content_lists_the_formats(content, tmp_path):
    (tmp_path / "a.dat").write_bytes(content)
    with pytest.raises(FormatError, match=r"a\.dat is no response in a format that is known; use one of passport, csv"):
        read_response(tmp_path / "a.dat")


def test_a_damaged_file_is_judged_by_its_name_and_a_format_that_is_said_decides(tmp_path):
    (tmp_path / "pcalib.txt").write_text("0 1 2 3")
    with pytest.raises(FormatError, match="'pcalib': its first line has 4 values; use 256 or more that rise strictly"):
        read_response(tmp_path / "pcalib.txt")
    (tmp_path / "a.npy").write_bytes(npy(SAMPLES))
    near(read_response(tmp_path / "a.npy"), RGB)
    near(read_response(tmp_path / "a.npy", "opencv"), RGB[::-1])
    with pytest.raises(FormatError, match="not a response in the format 'cube'"):
        read_response(tmp_path / "a.npy", "cube")


# --- each format as its program writes it


@pytest.mark.parametrize("n", [256, 1024, 65536])
def test_calibrations_of_more_than_8_bits(n):
    x = np.linspace(0, 1, n)
    found = decode("pcalib", " ".join(map(repr, (65535 * x**2 + 7).tolist())).encode())
    np.testing.assert_allclose(found.curves[0], GRID**2, atol=5e-6)


@given(falls=st.floats(1e-7, 2e-3), seed=st.integers(0, 99))
@settings(max_examples=30)
def test_small_falls_are_repaired_and_said(falls, seed):
    response = SAMPLES + np.random.default_rng(seed).uniform(0, falls, SAMPLES.shape)
    response[100] = response[99] - falls  # one that falls for sure
    found = decode("opencv", npy(15.0 * response[:, None, ::-1].astype(np.float32)))
    assert (np.diff(found.curves) >= 0).all()
    near(found, RGB, tolerance=0.02)
    said = ["made valid as it was read: no sample moved by more than" in text for text in found.warnings]
    assert said == [True] or (not said and falls < 1e-5)


@pytest.mark.parametrize("name", ["opencv", "cube", "pfstools"])
def test_a_curve_of_another_shape_is_not_repaired(name):
    bump = SAMPLES[:, :1] + 0.05 * np.sin(np.pi * LEVELS * 6)[:, None] ** 2
    files = {
        "opencv": npy(np.repeat(bump, 3, axis=1)[:, None].astype(np.float32)),
        "cube": f"LUT_1D_SIZE 256\n{rows(np.repeat(bump, 3, axis=1))}".encode(),
        "pfstools": b"# Camera response curve\n# name: IY\n"
        + rows(np.column_stack([0 * LEVELS, np.arange(256), bump])).encode(),
    }
    with pytest.raises(FormatError, match=r"a curve falls or begins off 0, by 0\.0\d* of its end"):
        decode(name, files[name])


def test_what_opencv_stores_as_text(tmp_path):
    response = np.ascontiguousarray(7 * SAMPLES[:, None, ::-1].astype(np.float32)) + np.float32(1e-4)
    for end in ("yml", "xml", "json"):
        for shape in ((256, 1, 3), (256, 3)):
            storage = cv2.FileStorage(str(tmp_path / f"theirs.{end}"), cv2.FILE_STORAGE_WRITE)
            storage.write("response", response.reshape(shape))
            storage.release()
            near(read_response(tmp_path / f"theirs.{end}"), RGB, 1e-4)
    for delimiter in (",", ", ", " ", "\t"):
        np.savetxt(tmp_path / "theirs.csv", response.reshape(256, 3), delimiter=delimiter)
        near(read_response(tmp_path / "theirs.csv"), RGB, 1e-4)


def test_a_grey_response_of_opencv_is_one_curve():
    found = decode("opencv", npy(SAMPLES[:, 1].reshape(256, 1, 1).astype(np.float32)))
    assert found.channels == ("intensity",)
    near(found, RGB[1])


@pytest.mark.parametrize("c", [1, 3])
@pytest.mark.parametrize("shift", [-3.0, 0.0, 2.0])
def test_debevecs_g_is_a_logarithm_and_exposures_are_not(c, shift):
    exposures = SAMPLES[:, :c] + 1e-5
    g = np.log(exposures) + shift
    for content in (npy(g), npy(g.reshape(256, c)), rows(np.repeat(g, 3 // c, axis=1)).encode()):
        near(decode("debevec", content), RGB[:c], 1e-4)
    noisy = exposures - 2e-3 * np.exp(-20 * LEVELS)[:, None]  # a little below 0 where a fit extrapolates
    near(decode("debevec", npy(noisy)), RGB[:c], 3e-3)


def test_g_in_opencvs_shape_is_a_logarithm_too(tmp_path):
    g = np.log(SAMPLES[:, None, ::-1] + 1e-5).astype(np.float32)
    (tmp_path / "g.npy").write_bytes(npy(g))
    near(read_response(tmp_path / "g.npy"), RGB, 1e-4)


def test_pfstools_leaves_gaps_where_it_saw_nothing():
    y = np.interp(LEVELS, GRID, RGB[0])
    gaps = y.copy()
    gaps[[40, 90, 91]] = 0
    gaps[:3] = -0.001
    with np.errstate(all="ignore"):
        logarithms = np.log10(gaps)
    text = "# Camera response curve\n# name: IY\n" + rows(np.column_stack([logarithms, np.arange(256), gaps]))
    assert "nan" in text
    assert "-inf" in text
    near(decode("pfstools", text.encode()), RGB[:1], 1e-3)
    gaps[-1] = 0
    text = "# Camera response curve\n# name: IY\n" + rows(np.column_stack([0 * y, np.arange(256), gaps]))
    with pytest.raises(FormatError, match=r"its last values are \[0\.0\]"):
        decode("pfstools", text.encode())


@pytest.mark.parametrize("levels", [256, 4096])
def test_responses_of_pfstools(levels):
    x = np.linspace(0, 1, levels)
    columns = [3.0 * np.interp(x, GRID, curve) for curve in RGB]
    colour = "".join(matrix_of_pfstools(name, y) for name, y in zip(("IR", "IG", "IB"), columns, strict=True))
    near(decode("pfstools", colour.encode()), RGB)
    grey = decode("pfstools", matrix_of_pfstools("IY", columns[0]).encode())
    assert grey.channels == ("intensity",)
    near(grey, RGB[0])
    with pytest.raises(FormatError, match="channels IR, IG; use IR, IG and IB, or IY"):
        decode("pfstools", colour[: colour.index("# name: IB")].encode())
    with pytest.raises(FormatError, match=r"begin with shape \(\d+, 3\)"):
        decode("pfstools", matrix_of_pfstools("IY", columns[0]).replace(" 1 ", " 2 ").replace(" 1.0 ", " 2 ").encode())


def test_polynomials_of_hdrgen():
    found = decode("radiance", b"2 1 0 0\n3 2.0 0 0 0\n2 0.5 0.45 0.05\n")
    expected = np.array([GRID**2, GRID**3, 0.5 * GRID**2 + 0.45 * GRID + 0.05])
    np.testing.assert_allclose(found.curves[:, 1:], expected[:, 1:], atol=1e-12)
    assert found.curves[:, 0].tolist() == [0.0, 0.0, 0.0]
    assert decode("radiance", b"1 1 0\n").channels == ("intensity",)
    for wrong in (b"3 1 0 0\n", b"1 1 0\n1 1 0\n", b"2 -1 0 0\n", b"2 3 -3 1\n"):
        with pytest.raises(FormatError):
            decode("radiance", wrong)


@pytest.mark.parametrize("name", [name for name, each in FORMATS.items() if not each.channels])
def test_formats_that_are_only_read(name, tmp_path):
    path = tmp_path / f"a{FORMATS[name].suffix.replace('.g.npy', '.g')}"
    with pytest.raises(InputError, match="tells no format that is written; let it end in one of"):
        write_response(ONE, path)
    with pytest.raises(InputError, match=f"to='{name}' is not known; use one of passport"):
        write_response(ONE, path, to=name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("direction", "power"), [("inverse", 2.2), ("forward", 1 / 2.2)])
def test_a_table_above_the_diagonal_is_a_response(direction, power):
    table = np.repeat(LEVELS[:, None] ** power, 3, axis=1)
    found = decode("respfcns", f"16400 0 0 0\n{rows(table)}".encode())
    assert found.direction == direction
    np.testing.assert_allclose(found.curves[0], np.interp(GRID, LEVELS, LEVELS**power), atol=1e-9)


# --- lookup tables

CUBE = "LUT_1D_SIZE 33\n" + rows(np.linspace(0, 1, 33)[:, None] ** np.array([2.0, 2.2, 2.4]))


@pytest.mark.parametrize(
    "text",
    [
        CUBE.replace("\n", "\r\n"),
        CUBE.replace("\n", "\r"),
        CUBE.replace("LUT_1D_SIZE 33", "\tlut_1d_size\t33  # samples"),
        '# LUT_1D_SIZE 7\n\n  TITLE "x # y"\nLUT_1D_INPUT_RANGE 0 1\n' + CUBE + "# end\n",
        "\ufeff" + CUBE,
    ],
)
def test_cubes_as_people_write_them(text):
    found = decode("cube", text.encode())
    expected = [np.interp(GRID, np.linspace(0, 1, 33), np.linspace(0, 1, 33) ** g) for g in (2.0, 2.2, 2.4)]
    np.testing.assert_allclose(found.curves, expected, atol=1e-12)


def test_a_name_that_no_text_can_hold_makes_a_title():
    passport = decode("passport", FORMATS["passport"].write(Passport("inverse", GRID, camera="a\ud800")))
    assert decode("cube", FORMATS["cube"].write(passport)).camera == "a?"


def test_a_title_in_latin_1():
    assert decode("cube", ('TITLE "Kamera für Tag"\n' + CUBE).encode("latin-1")).camera == "Kamera für Tag"


def lut_file(kind: str, table: np.ndarray, low: float, high: float) -> bytes:
    text = rows(np.repeat(table[:, None], 3, axis=1))
    before = f"2\n{low} {high}\n0 1\n" * 3
    return {
        "range": f"LUT_1D_SIZE {len(table)}\nLUT_1D_INPUT_RANGE {low} {high}\n{text}",
        "domain": f"DOMAIN_MIN{f' {low}' * 3}\nDOMAIN_MAX{f' {high}' * 3}\nLUT_1D_SIZE {len(table)}\n{text}",
        "spi1d": f"Version 1\nFrom {low} {high}\nLength {len(table)}\nComponents 3\n{{\n{text}}}\n# made by hand\n",
        "csp": f"CSPLUTV100\n1D\n\nBEGIN METADATA\nx 1\nEND METADATA\n\n{before}\n{len(table)}\n{text}",
    }[kind].encode()


@pytest.mark.parametrize(
    "kind", ["range", *(pytest.param(k, marks=pytest.mark.slow) for k in ("domain", "spi1d", "csp"))]
)
@given(low=st.floats(-0.5, 0.0), high=st.floats(1.0, 8.0), scale=st.floats(0.01, 100.0))
@settings(max_examples=20)
def test_of_a_wider_input_the_part_from_0_to_1_counts(kind, low, high, scale):
    x = np.linspace(low, high, 4097)
    found = decode(
        {"range": "cube", "domain": "cube"}.get(kind, kind), lut_file(kind, scale * np.abs(x) * x, low, high)
    )
    assert (found.direction, found.channels) == ("inverse", ("intensity",))
    np.testing.assert_allclose(found.curves[0], GRID**2, atol=3e-5)


@pytest.mark.parametrize("kind", ["range", "domain", "spi1d", "csp"])
@pytest.mark.parametrize(("low", "high"), [(0.1, 1.0), (0.0, 0.9), (1.0, 0.0), (-1e308, 1e308)])
def test_a_narrower_input_is_refused(kind, low, high):
    with pytest.raises(FormatError):
        decode({"range": "cube", "domain": "cube"}.get(kind, kind), lut_file(kind, np.linspace(0, 1, 33), low, high))


@pytest.mark.parametrize("kind", ["range", "domain", "spi1d", "csp"])
@pytest.mark.parametrize("white", [255, 1023, 4095])
def test_levels_of_the_input_are_brightness(kind, white):
    reader = {"range": "cube", "domain": "cube"}.get(kind, kind)
    found = decode(reader, lut_file(kind, np.linspace(0, 1, 1024) ** 2.2, 0, white))
    np.testing.assert_allclose(found.curves[0], GRID**2.2, atol=1e-7)
    with pytest.raises(FormatError, match=r"0 to 1 holds \S+ of its 1024 samples; use a table that has 16 or more"):
        decode(reader, lut_file(kind, np.linspace(0, 1, 1024) ** 2.2, 0, 1000))


def test_a_table_in_utf_16_or_windows_1252():
    text = 'TITLE "Küche – Tag"\n' + CUBE
    for coding in ("utf-16", "cp1252"):
        assert decode("cube", text.encode(coding)).camera == "Küche – Tag"


def test_pre_luts_shape_the_input():
    table = rows(np.repeat(np.linspace(0, 1, 101)[:, None] ** 2, 3, axis=1))
    text = f"CSPLUTV100\n1D\n\n3\n0 0.5 1\n0 0.1 1\n0\n\n2\n0 1\n0 1\n101\n{table}"
    red, green, blue = decode("csp", text.encode()).curves
    np.testing.assert_allclose(red, np.interp(GRID, [0, 0.5, 1], [0, 0.1, 1]) ** 2, atol=3e-5)
    np.testing.assert_allclose(green, GRID**2, atol=3e-5)
    np.testing.assert_array_equal(green, blue)
    for old, new in (("1D", "3D"), ("\n101\n", "\n100\n"), ("3\n0 0.5", "4\n0 0.5"), ("0 0.5 1", "0 0 1")):
        with pytest.raises(FormatError):
            decode("csp", text.replace(old, new).encode())


@pytest.mark.parametrize("end", [pytest.param("spi1d", marks=pytest.mark.slow), "csp"])
def test_tables_that_colour_science_writes(end, tmp_path):
    table = np.stack([np.linspace(0, 1, 33) ** gamma for gamma in (2.0, 2.2, 2.4)], axis=1)
    np.save(tmp_path / "table.npy", table)
    # In a process of its own: importing colour-science changes the filters of warnings for every later test.
    code = f"""import colour, numpy as np
colour.write_LUT(colour.LUT3x1D(np.load("table.npy"), name="theirs"), "theirs.{end}", decimals=9)"""
    subprocess.run([sys.executable, "-W", "ignore", "-c", code], cwd=tmp_path, check=True, capture_output=True)
    expected = [np.interp(GRID, np.linspace(0, 1, 33), column) for column in table.T]
    np.testing.assert_allclose(read_response(tmp_path / f"theirs.{end}").curves, expected, atol=1e-8)


# --- the command


def test_convert_turns_one_into_another(tmp_path):
    write_response(THREE, tmp_path / "passport.json")
    done = run_command("convert", tmp_path / "passport.json", tmp_path / "a.cube")
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, str(tmp_path / "a.cube"), "")
    assert run_command("convert", tmp_path / "a.cube", tmp_path / "b.dat", "--to", "opencv").returncode == 0
    near(read_response(tmp_path / "b.dat"), RGB)
    again = run_command("convert", tmp_path / "passport.json", tmp_path / "a.cube")
    assert (again.returncode, again.stdout) == (2, "")
    assert "exists already" in again.stderr
    assert run_command("convert", tmp_path / "b.dat", tmp_path / "a.cube", "--force").returncode == 0


@pytest.mark.parametrize(("channel", "curve"), [("red", RGB[0]), ("blue", RGB[2])])
def test_convert_takes_one_channel_where_one_fits(channel, curve, tmp_path):
    write_response(THREE, tmp_path / "passport.json")
    refused = run_command("convert", tmp_path / "passport.json", tmp_path / "pcalib.txt")
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr.startswith(
        "crfbench: this passport has 3 curves and the format 'pcalib' holds one curve; use"
    )
    assert refused.stderr.count("\n") == 1
    assert not (tmp_path / "pcalib.txt").exists()
    done = run_command("convert", tmp_path / "passport.json", tmp_path / "pcalib.txt", "--channel", channel)
    assert done.returncode == 0
    near(read_response(tmp_path / "pcalib.txt"), curve)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["absent.json", "a.cube"], "there is no file absent.json"),
        (["good.json", "a.xyz"], "the name a.xyz tells no format that is written; let it end in one of"),
        (["good.json", "a.cube", "--to", "exr"], "--to 'exr' is not known; use one of passport"),
        (["good.json", "a.cube", "--format", "exr"], "format 'exr' is not known; use one of passport"),
        (["good.json", "a.cube", "--channel", "violet"], "use one of red, green, blue"),
        (["bad.json", "a.cube"], "bad.json: this is not a response in the format 'passport'"),
        (["bad.dat", "a.cube"], "bad.dat is no response in a format that is known"),
        (["good.json", "a.rsp"], "the name a.rsp tells no format that is written"),
    ],
)
def test_what_convert_refuses_in_one_sentence(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_response(THREE, "good.json")
    (tmp_path / "bad.json").write_text("{}")
    (tmp_path / "bad.dat").write_text("{}")
    before = sorted(tmp_path.iterdir())
    done = run_command("convert", *arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before


def test_a_full_disk_takes_no_converted_response(tmp_path):
    resource = pytest.importorskip("resource", reason="limits of a process are set another way")
    write_response(THREE, tmp_path / "passport.json")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, limits[1]))
    try:
        done = run_command("convert", tmp_path / "passport.json", tmp_path / "a.cube")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"crfbench: {tmp_path / 'a.cube'} cannot be used: File too large\n"
    assert [path.name for path in tmp_path.iterdir()] == ["passport.json"]


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(FORMATS) - {"hugin"}))
def test_a_number_or_line_that_is_wrong_is_read_or_refused_in_one_sentence(name, tmp_path):
    """Whatever stands there, nothing but a valid response comes out, and of a refused one nothing is written."""
    rng, content = np.random.default_rng(0), file_of(name, Passport("inverse", GRID**2))
    words, refused = [word.span() for word in re.finditer(rb"[-+.\w]+", content)], 0
    for i in range(60):
        start, end = words[rng.integers(len(words) if i % 2 else min(30, len(words)))]
        wrong = [b"1e308", b"9" * 5000, b"1e999", b"nan", b"-0", b"1_0", b'"\\ud800"', b"[[1]]", b"0.5", b"\n"][i % 10]
        path, out = tmp_path / f"{i}{FORMATS[name].suffix}", tmp_path / "out.csv"
        path.write_bytes(content[:start] + wrong + content[end:])
        done = run_command("convert", path, out)
        if done.returncode == 0:
            assert (np.diff(read_response(out).curves) >= -1e-6).all()
            out.unlink()
            continue
        refused += 1
        assert (done.returncode, done.stderr.count("\n"), out.exists()) == (2, 1, False)
        assert len(done.stderr) < 600
    assert refused


def test_a_repair_is_said_and_kept(tmp_path):
    response = SAMPLES.copy()
    response[100] = response[99] - 1e-3
    (tmp_path / "a.npy").write_bytes(npy(response[:, None, ::-1].astype(np.float32)))
    done = run_command("convert", tmp_path / "a.npy", tmp_path / "a.json")
    assert done.returncode == 0
    assert "a.npy: made valid as it was read: no sample moved by more than" in done.stderr
    assert read_response(tmp_path / "a.json").warnings[0].startswith("made valid as it was read")


def test_linearise_takes_a_format(tmp_path):
    (tmp_path / "curve.npy").write_bytes(npy(SAMPLES))
    image = np.full((4, 4, 3), 128, np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), image)
    found = []
    for extra in ([], ["--format", "opencv"]):
        options = ("--response", tmp_path / "curve.npy", "--out", tmp_path / "a.tif", "--force", *extra)
        assert run_command("linearise", tmp_path / "a.png", *options).returncode == 0
        found.append(cv2.imread(str(tmp_path / "a.tif"), cv2.IMREAD_UNCHANGED)[0, 0, ::-1])
    np.testing.assert_allclose(found, [SAMPLES[128], SAMPLES[128, ::-1]], atol=1e-4)


def test_help_lists_the_own_camera_before_the_paper():
    lines = run_command("--help").stdout.splitlines()
    names = [line.split()[1] for line in lines if line.startswith("│ ") and line[2].isalpha()]
    assert names[:4] == ["calibrate", "linearise", "convert", "lab"]
    assert names.index("tables") < names.index("report") < names.index("train")
