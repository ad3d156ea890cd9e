"""The world's files: every kind that people have is read exactly, and what is assumed of it is said."""

import json
import os
import shutil
import struct
import subprocess
import sys
import unicodedata
from dataclasses import replace

import cv2
import numpy as np
import OpenEXR
import pandas as pd
import pillow_heif
import pytest
import rawpy
import tifffile
from PIL import Image, ImageOps
from PIL.TiffImagePlugin import IFDRational

from crfbench import camera
from crfbench.camera.photographs import (
    _given_times,
    find_white_level,
    list_photographs,
    pair_photographs,
    plan_photographs,
    read_planned,
)
from crfbench.camera.reading import Exif, read_balance, read_exif, read_levels, read_raw
from crfbench.camera.worker import WORKER
from crfbench.curves import GRID, invert
from crfbench.datasets import load_opencrf
from crfbench.errors import FormatError, InputError
from crfbench.metrics import rmse
from tests.support import photographs
from tests.support.command import run_command
from tests.support.scenes import render_chart

TIME, F_NUMBER, ISO, SHUTTER, APERTURE, SOS, REI, FOLDER, MODEL = (
    *(0x829A, 0x829D, 0x8827, 0x9201, 0x9202, 0x8831, 0x8832, 0x8769, 0x0110),
)
rng = np.random.default_rng(0)
SMOOTH = cv2.resize(rng.integers(0, 256, (4, 5, 3), dtype=np.uint8), (64, 48), interpolation=cv2.INTER_CUBIC)


def noise(*shape, dtype=np.uint16):
    return np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype=dtype)


def save_jpeg(path, tags=None, model=None, image=SMOOTH, **options):
    exif = Image.Exif()
    exif.get_ifd(FOLDER).update(tags or {})
    if model:
        exif[MODEL] = model
    Image.fromarray(image).save(path, exif=exif, quality=95, **options)


# --- kinds of files


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("layout", [{}, {"rowsperstrip": 7}, {"tile": (16, 16)}, {"compression": "zlib"}])
def test_planes_of_a_tiff_file_are_read_exactly(tmp_path, dtype, order, layout):
    planes = noise(3, 40, 32, dtype=dtype)
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, planes, photometric="rgb", planarconfig="separate", byteorder=order, metadata=None, **layout)
    for _ in range(3):
        np.testing.assert_array_equal(read_levels(path), np.moveaxis(planes, 0, -1))


@pytest.mark.parametrize("orientation", range(1, 9))
def test_planes_are_turned_too(tmp_path, orientation):
    planes = noise(3, 4, 6)
    tags = [(274, "H", 1, orientation, True)]
    tifffile.imwrite(
        tmp_path / "a.tif", planes, photometric="rgb", planarconfig="separate", metadata=None, extratags=tags
    )
    tifffile.imwrite(tmp_path / "b.tif", np.moveaxis(planes, 0, -1), photometric="rgb", metadata=None, extratags=tags)
    np.testing.assert_array_equal(read_levels(tmp_path / "a.tif"), read_levels(tmp_path / "b.tif"))


@pytest.mark.parametrize("compression", ["zlib", "lzma"])
def test_damaged_planes_are_refused(tmp_path, compression):
    path = tmp_path / "a.tif"
    planes = np.random.default_rng(0).integers(0, 65535, (3, 40, 32), dtype=np.uint16)
    tifffile.imwrite(path, planes, photometric="rgb", planarconfig="separate", compression=compression)
    content = path.read_bytes()
    path.write_bytes(content[:-3000] + bytes(20) + content[-2980:])
    with pytest.raises(FormatError, match=r"a\.tif cannot be decoded; use a complete JPEG"):
        read_levels(path)


def test_planes_that_need_another_decoder_are_refused(tmp_path):
    planes = noise(3, 8, 8)
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(planes, photometric="rgb", planarconfig="separate", metadata=None)
    content = (tmp_path / "a.tif").read_bytes()
    compression = struct.pack("<HHIH", 259, 3, 1, 1)
    assert content.count(compression) == 1
    (tmp_path / "a.tif").write_bytes(content.replace(compression, struct.pack("<HHIH", 259, 3, 1, 5)))  # LZW
    with pytest.raises(FormatError, match=r"^a\.tif cannot be decoded .*LZW.*; use"):
        read_levels(tmp_path / "a.tif")


def test_a_codec_that_is_not_installed_costs_one_file(tmp_path, monkeypatch):
    tifffile.imwrite(tmp_path / "a.tif", noise(3, 8, 8), photometric="rgb", planarconfig="separate", metadata=None)

    def lack(page):
        raise ModuleNotFoundError("No module named 'compression'")

    monkeypatch.setattr(tifffile.TiffPage, "asarray", lack)
    with pytest.raises(
        FormatError, match=r"^a\.tif cannot be decoded \(its compression needs the 'imagecodecs' package"
    ):
        read_levels(tmp_path / "a.tif")


def packed_tiff(levels, bits):
    """Write grey levels as machine vision does: without a gap between numbers of so many bits."""
    rows = (levels[..., None] >> np.arange(bits - 1, -1, -1)) & 1
    data = np.packbits(rows.astype(np.uint8).reshape(len(levels), -1), axis=1).tobytes()
    values = {256: levels.shape[1], 257: len(levels), 258: bits, 259: 1, 262: 1, 273: 8 + 2 + 8 * 12 + 4}
    values |= {277: 1, 279: len(data)}
    tags = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in values.items())
    return b"II*\0\x08\0\0\0" + struct.pack("<H", len(values)) + tags + bytes(4) + data


def test_packed_levels_have_their_own_white(tmp_path):
    levels = np.arange(4096).reshape(64, 64)
    (tmp_path / "a.tif").write_bytes(packed_tiff(levels, 12))
    np.testing.assert_array_equal(read_levels(tmp_path / "a.tif"), np.rint(levels * (65535 / 4095)))
    assert find_white_level([tmp_path / "a.tif"]) == (None, [])
    np.testing.assert_array_equal(read_levels(tmp_path / "a.tif", 2047)[:2, 0], np.rint([0, 64 * 65535 / 2047]))
    for bits in (10, 14):
        (tmp_path / "a.tif").write_bytes(packed_tiff(levels % 2**bits, bits))
        with pytest.raises(FormatError, match=r"a\.tif is not a readable .*of whole numbers of 8 or 16 bits"):
            read_levels(tmp_path / "a.tif")


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (b"GIF89a\1\0", "GIF"), (b"BM\x36\0", "BMP"), (b"\0\0\0\x0cjP  \r\n\x87\n", "JPEG 2000"),
        (b"\xff\x4f\xff\x51\0", "JPEG 2000"), (b"\xff\x0a\xfa", "JPEG XL"), (b"\0\0\0\x0cJXL \r\n", "JPEG XL"),
        (b"\n<!DOCTYPE html><html>", "HTML or XML"),
        (b"version https://git-lfs.github.com/spec/v1\n", "git-lfs pointer"),
    ],
)  # fmt: skip
def test_a_complete_file_of_another_kind_is_called_by_it(tmp_path, content, kind):
    for name, fitting in (("a.jpg", "JPEG, PNG, TIFF, HEIC, AVIF or WebP"), ("a.dng", "RAW")):
        (tmp_path / name).write_bytes(content + bytes(100))
        with pytest.raises(FormatError, match=rf"^{name} is an? {kind} file by its first bytes; use a {fitting} file$"):
            read_exif(tmp_path / name)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("below", [False, True])
def test_the_page_of_a_thumbnail_is_not_the_image(tmp_path, dtype, below):
    pixels, path = noise(48, 64, 3, dtype=dtype), tmp_path / "a.tif"
    exif = [(MODEL, "s", 0, "Coolcam", True)]
    with tifffile.TiffWriter(path) as file:
        file.write(
            pixels[::8, ::8].copy(),
            photometric="rgb",
            subfiletype=1,
            metadata=None,
            subifds=1 if below else None,
            extratags=exif,
        )
        file.write(pixels, photometric="rgb", metadata=None)
    np.testing.assert_array_equal(read_levels(path), pixels)
    assert read_exif(path).model == "Coolcam"


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_grey_and_opaque_images_are_read_exactly(tmp_path, suffix, dtype):
    path, pixels = tmp_path / f"a.{suffix}", noise(40, 32, 3, dtype=dtype)
    cv2.imwrite(str(path), pixels[..., 0])
    np.testing.assert_array_equal(read_levels(path), pixels[..., 0])
    for alpha in (np.iinfo(dtype).max, np.iinfo(dtype).max // 2):
        with_alpha = np.dstack([pixels, np.full((40, 32), alpha, dtype)])
        if suffix == "tif":
            tifffile.imwrite(path, with_alpha, photometric="rgb", extrasamples=["unassalpha"], metadata=None)
        else:
            cv2.imwrite(str(path), with_alpha[..., [2, 1, 0, 3]])
        np.testing.assert_array_equal(read_levels(path), pixels)
    cv2.imwrite(str(path), np.dstack([pixels, pixels[..., 0]]))
    with pytest.raises(FormatError, match="is transparent in places; use an image without alpha"):
        read_levels(path)


def test_grey_with_alpha_and_white_at_zero(tmp_path):
    grey = noise(20, 30, dtype=np.uint8)
    Image.merge("LA", [Image.fromarray(grey), Image.new("L", (30, 20), 255)]).save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_levels(tmp_path / "a.png"), grey)
    for dtype in (np.uint8, np.uint16):
        pixels = noise(20, 30, dtype=dtype)
        tifffile.imwrite(tmp_path / "a.tif", pixels, photometric="miniswhite", metadata=None)
        np.testing.assert_array_equal(read_levels(tmp_path / "a.tif"), np.iinfo(dtype).max - pixels)


@pytest.mark.parametrize("mode", ["RGB", "L"])
@pytest.mark.parametrize("suffix", ["jpg", "heic", "avif", "webp"])
def test_lossy_images_come_back_nearly(tmp_path, suffix, mode):
    image, path = Image.fromarray(SMOOTH).convert(mode), tmp_path / f"a.{suffix}"
    if suffix == "heic":
        pillow_heif.from_pillow(image).save(path, quality=95)
    else:
        image.save(path, quality=95)
    found = WORKER.run(read_levels, path)
    if suffix == "webp" and mode == "L":  # which knows no grey
        found = found[..., 0]
    assert found.shape == np.asarray(image).shape
    assert np.abs(found.astype(float) - np.asarray(image)).mean() < 4


def test_heic_is_upright_tells_its_exposure_and_keeps_10_bits(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    exif.get_ifd(FOLDER).update({TIME: 0.25, ISO: 50})
    image = Image.fromarray(SMOOTH)
    pillow_heif.from_pillow(image).save(tmp_path / "a.heic", quality=95, exif=exif.tobytes())
    found = read_levels(tmp_path / "a.heic")
    exif_free = pillow_heif.open_heif(tmp_path / "a.heic")
    assert found.shape[1::-1] == exif_free.size
    assert read_exif(tmp_path / "a.heic") == Exif(0.25, None, 50.0)
    deep = (np.arange(64 * 64, dtype=np.uint16).reshape(64, 64) // 4 * 64)[..., None].repeat(3, axis=2)
    pillow_heif.from_bytes("RGB;16", (64, 64), deep.tobytes()).save(tmp_path / "b.heic", quality=-1, chroma=444)
    levels = read_levels(tmp_path / "b.heic")
    assert levels.dtype == np.uint16
    assert len(np.unique(levels)) > 900
    np.testing.assert_allclose(levels.astype(float), deep, atol=3 * 64)


def test_the_first_picture_of_a_mpo_file_is_read(tmp_path):
    first, second = Image.fromarray(SMOOTH), Image.fromarray(255 - SMOOTH)
    first.save(tmp_path / "a.jpg", "MPO", save_all=True, append_images=[second], quality=95)
    with Image.open(tmp_path / "a.jpg") as file:
        assert file.format == "MPO"
    assert np.abs(read_levels(tmp_path / "a.jpg").astype(float) - SMOOTH).mean() < 3


def test_bytes_after_a_jpeg_are_no_part_of_it(tmp_path):
    """As a gain map is appended."""
    save_jpeg(tmp_path / "a.jpg")
    before = read_levels(tmp_path / "a.jpg")
    (tmp_path / "a.jpg").write_bytes((tmp_path / "a.jpg").read_bytes() * 2)
    np.testing.assert_array_equal(read_levels(tmp_path / "a.jpg"), before)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("channels", [(), (3,)])
def test_linear_and_monochrome_dng(tmp_path, channels, orientation):
    sensor = np.random.default_rng(1).integers(400, 16383, (40, 60, *channels), dtype=np.uint16)
    photographs.write_linear(tmp_path / "a.dng", sensor, "Mono", orientation)
    exif = Image.Exif()
    exif[0x0112] = orientation
    index = Image.fromarray(np.arange(40 * 60, dtype=np.int32).reshape(40, 60))
    index.getexif().update(exif)
    turned = np.asarray(ImageOps.exif_transpose(index))
    expected = (np.clip(sensor.astype(float), 512, None) - 512) / (16383 - 512)
    np.testing.assert_allclose(read_raw(tmp_path / "a.dng"), expected.reshape(-1, *channels)[turned], atol=1.5 / 16383)
    assert read_exif(tmp_path / "a.dng") == Exif(pytest.approx(0.01), pytest.approx(5.6), 100.0, "Mono")


@pytest.mark.parametrize(("tells", "balance"), [(True, [2.0, 1.0, 1.5]), (False, [1.0, 1.0, 1.0])])
def test_the_balance_is_the_cameras_or_none(tmp_path, monkeypatch, tells, balance):
    tags = photographs._dng_tags

    def with_or_without(*arguments):
        return {tag: entry for tag, entry in tags(*arguments).items() if tells or tag != 50728}

    monkeypatch.setattr(photographs, "_dng_tags", with_or_without)
    preview = np.zeros((300, 400, 3), np.uint8)
    photographs.write_raw(tmp_path / "a.dng", np.full((48, 64, 3), 0.5), preview, balance=(2.0, 1.0, 1.5))
    np.testing.assert_allclose(read_balance(tmp_path / "a.dng"), balance, rtol=1e-4)


@pytest.mark.parametrize("orientation", [5, 7])
def test_a_mirrored_pair_agrees(tmp_path, orientation):
    scene = render_chart(GRID, 1, size=(96, 64))
    jpeg, dng = photographs.write_pair(tmp_path, "a", scene, orientation=orientation)
    assert len(pair_photographs(tmp_path)[0]) == 1
    linear, developed = read_raw(dng), camera.read_image(jpeg)
    assert linear.shape == developed.shape == (96, 64, 3)
    assert np.corrcoef(linear.ravel(), developed.ravel())[0, 1] > 0.95
    assert np.corrcoef(linear[::-1].ravel(), developed.ravel())[0, 1] < 0.9


def test_a_cut_raw_file_gives_our_sentence_alone(tmp_path):
    _, dng = photographs.write_pair(tmp_path, "a", render_chart(GRID, 1, size=(96, 64)))
    dng.write_bytes(dng.read_bytes()[:6000])
    with pytest.raises(rawpy.LibRawError), rawpy.imread(str(dng)) as raw:
        raw.postprocess()
    code = "import sys; from crfbench.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "calibrate", str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    # First the table, then our sentence.
    assert [line[:6] for line in done.stderr.splitlines()] == ["a.jpg ", "crfben"]


# --- white level


def test_the_white_level_is_guessed_where_it_is_plain(tmp_path):
    values = np.arange(64 * 64).reshape(64, 64)
    images = {
        "full": (np.minimum(values, 4095), 4095),
        "nearly": (np.minimum(values, 3900), 3900),
        "dark": (values // 8, None),
        "tall": (values * 16, None),
    }
    for name, (image, expected) in images.items():
        path = tmp_path / f"{name}.png"
        cv2.imwrite(str(path), image.astype(np.uint16))
        level, notes = find_white_level([path])
        assert level == expected
        assert bool(notes) == (name != "tall")
    assert "end at 511" in find_white_level([tmp_path / "dark.png"])[1][0]
    assert find_white_level([tmp_path / "dark.png", tmp_path / "full.png"])[0] == 4095
    level, notes = find_white_level([tmp_path / "dark.png"] * 2)
    assert (level, "white is taken as 1023" in notes[0]) == (1023, True), "no series leaves most of its range unused"
    assert find_white_level([tmp_path / "dark.png", tmp_path / "tall.png"]) == (None, [])
    Image.new("L", (8, 8)).save(tmp_path / "eight.png")
    assert find_white_level([tmp_path / "eight.png", tmp_path / "nowhere.png"]) == (None, [])
    cv2.imwrite(str(tmp_path / "byte.png"), (values // 16).astype(np.uint16))
    level, notes = find_white_level([tmp_path / "byte.png"])
    assert (level, "end at 255, which is taken as white" in notes[0]) == (255, True), "of 8 bits in 16"
    assert read_levels(tmp_path / "byte.png", 255).max() == 65535
    stretched = read_levels(tmp_path / "full.png", 4095)
    np.testing.assert_array_equal(stretched, np.rint(images["full"][0] * (65535 / 4095)))
    assert read_levels(tmp_path / "full.png", 1000).max() == 65535
    assert read_levels(tmp_path / "eight.png", 1000).dtype == np.uint8


# --- EXIF


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({ISO: 65535, REI: 102400}, Exif(iso=102400)),
        ({ISO: 65535, SOS: 80000, REI: 102400, 0x8830: 2}, Exif(iso=102400)),
        ({ISO: 65535}, Exif(iso=65535)),
        ({ISO: 200, REI: 400}, Exif(iso=200)),
        ({REI: 400}, Exif(iso=400)),
        ({SHUTTER: 5.0, APERTURE: 4.0}, Exif(1 / 32, 4.0)),
        ({SHUTTER: -2.0, APERTURE: 0.0}, Exif(4.0, 1.0)),
        ({TIME: IFDRational(0, 1), SHUTTER: 1.0, F_NUMBER: IFDRational(0, 1), APERTURE: 6.0}, Exif(0.5, 8.0)),
        ({TIME: 0.1, SHUTTER: 5.0, F_NUMBER: 2.8, APERTURE: 4.0}, Exif(0.1, 2.8)),
        ({SHUTTER: 1e30}, Exif()),
        ({TIME: 1e300, F_NUMBER: 1e-300, ISO: 1e300}, Exif()),
    ],
)
def test_what_exif_tells_in_which_order(tmp_path, tags, expected):
    save_jpeg(tmp_path / "a.jpg", tags)
    found = read_exif(tmp_path / "a.jpg")
    for name in ("exposure_time", "f_number", "iso"):
        told = getattr(expected, name)
        assert getattr(found, name) == (told and pytest.approx(told, rel=1e-4))


@pytest.mark.parametrize("told", ["A\nB \x1b[31m C\0", "A B [31m C" + 1000 * " "])
def test_the_name_of_a_camera_is_one_line(tmp_path, told):
    save_jpeg(tmp_path / "a.jpg", model=told)
    assert read_exif(tmp_path / "a.jpg").model == "A B [31m C"
    save_jpeg(tmp_path / "a.jpg", model=30_000 * "x")
    assert read_exif(tmp_path / "a.jpg").model == 100 * "x"


def test_what_is_missing_everywhere_is_constant_and_said(tmp_path):
    for i, time in enumerate((0.1, 0.4, 0.2)):
        save_jpeg(tmp_path / f"{i}.jpg", {TIME: time, F_NUMBER: 8.0} if i else {TIME: time})
    plan = plan_photographs(tmp_path)
    np.testing.assert_allclose(plan.stops, [0, 2, 1], atol=1e-6)
    assert plan.notes == [
        "3 of 3 files do not tell the ISO speed, which is taken as constant",
        "1 of 3 files do not tell the f-number, which is taken as constant",
    ]
    save_jpeg(tmp_path / "2.jpg", {TIME: 0.2, F_NUMBER: 4.0})
    assert np.isnan(plan_photographs(tmp_path).stops).tolist() == [True, False, False]
    np.testing.assert_allclose(plan_photographs(tmp_path).stops[1:], [0, 1], atol=1e-6)


def test_two_cameras_are_told_apart(tmp_path):
    for i, model in enumerate(("Beta", "Alpha", None, "Alpha")):
        save_jpeg(tmp_path / f"{i}.jpg", {TIME: 0.1 * 2**i}, model)
    plan = plan_photographs(tmp_path)
    assert [pair.name for pair in plan.pairs] == ["1", "2", "3"]
    assert list(plan.problems.values()) == ["0.jpg is by Beta, and 2 are by Alpha; calibrate one camera"]
    np.testing.assert_allclose(plan.stops, [0, 1, 2], atol=1e-5)


# --- names, order and exposures


def touch(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    return [folder / name for name in names]


def names_of(source):
    return [pair.name for pair in pair_photographs(source)[0]]


def test_a_folder_is_in_natural_order_and_files_as_given(tmp_path):
    touch(tmp_path, "img10.png", "img9.png", "IMG1.png", "img2b.png", "notes.txt", ".hidden.png")
    assert names_of(tmp_path) == ["IMG1", "img2b", "img9", "img10"]
    given = [tmp_path / f"{name}.png" for name in ("img9", "IMG1", "img10")]
    for source in (given, iter(given), (str(path) for path in given), [*given, given[0]]):
        assert names_of(source) == ["img9", "IMG1", "img10"]
    assert names_of(str(given[0])) == names_of(given[0]) == ["img9"]
    assert sorted(names_of(tmp_path.glob("*9.png"))) == ["img9"]
    assert len(plan_photographs(tmp_path.glob("[Ii]*.png")).problems) == 4, "each is damaged, and named"


def test_raw_files_of_every_maker_are_photographs(tmp_path):
    makers = """3FR FFF Hasselblad, ARI ARRI, ARW SR2 SRF Sony, BAY Casio, CR2 CR3 CRW Canon, DC2 DCR K25 KDC Kodak,
        DNG anyone, ERF Epson, GPR GoPro, IIQ Phase_One, MDC MRW Minolta, MEF Mamiya, MOS Leaf, NEF NRW Nikon,
        ORF Olympus, PEF Pentax, RAF Fujifilm, RAW RW2 Panasonic, RWL Leica, SRW Samsung, X3F Sigma"""
    suffixes = [word for maker in makers.split(",") for word in maker.split()[:-1]]
    for suffix in suffixes:
        (tmp_path / f"photo {suffix}.{suffix}").touch()
    pairs, problems = pair_photographs(tmp_path)
    assert (len(pairs), problems) == (len(suffixes), {})
    assert all(pair.raw == pair.jpeg for pair in pairs)


def test_names_tell_photographs_apart(tmp_path):
    files = touch(tmp_path, *(f"{time}ms/frame.png" for time in (1, 2, 4)), "a.jpg", "a.png", "b.png")
    assert names_of(files) == ["1ms/frame.png", "2ms/frame.png", "4ms/frame.png", "a.jpg", "a.png", "b"]
    assert names_of([tmp_path / "2ms", tmp_path / "1ms"]) == ["2ms/frame.png", "1ms/frame.png"]


def test_pairs_of_phones_and_of_several_folders(tmp_path):
    pixel = touch(tmp_path, "PXL_1.RAW-01.COVER.jpg", "PXL_1.RAW-02.ORIGINAL.dng", "PXL_2.RAW-01.MP.COVER.jpg")
    touch(tmp_path, "PXL_2.RAW-02.ORIGINAL.dng", "img_1.DNG", "IMG_1.JPG")
    pairs, problems = pair_photographs(tmp_path)
    assert problems == {}
    assert [pair.jpeg.name for pair in pairs] == ["IMG_1.JPG", pixel[0].name, pixel[2].name]
    assert all(pair.raw for pair in pairs)
    files = touch(
        tmp_path, "x/a.jpg", "x/a.dng", "y/a.jpg", "y/a.dng", "jpg/c.jpg", "raw/c.dng", "b.jpg", "b.png", "b.dng"
    )
    pairs, problems = pair_photographs(files)
    assert problems == {}
    assert [(pair.name, pair.raw.parent.name) for pair in pairs] == [
        ("x/a.jpg", "x"), ("y/a.jpg", "y"), ("c", "raw"), ("b", tmp_path.name)
    ]  # fmt: skip
    assert pairs[3].jpeg.name == "b.jpg"


def test_an_edited_copy_is_not_another_photograph(tmp_path):
    touch(tmp_path, "IMG_1.JPG", "IMG_1-edited.jpg", "IMG_2-edited.jpg")
    pairs, problems = pair_photographs(tmp_path)
    assert [pair.name for pair in pairs] == ["IMG_1", "IMG_2-edited"]
    assert next(iter(problems.values())) == "IMG_1-edited.jpg is an edited copy of IMG_1.JPG by its name"


@pytest.mark.parametrize(
    "copy",
    [
        "IMG_E1002", "IMG_1002 (edited)", "IMG_1002-Enhanced-NR", "IMG_1002~2", "IMG_1002-bearbeitet", "IMG_1002_edit2",
        "IMG_1002 copy", "IMG_1002 (copy)", "IMG_1002 - Copy",
    ],
)  # fmt: skip
def test_edited_copies_have_many_names(tmp_path, copy):
    touch(tmp_path, "IMG_1001.JPG", "IMG_1002.JPG", f"{copy}.JPG")
    pairs, problems = pair_photographs(tmp_path)
    assert [pair.name for pair in pairs] == ["IMG_1001", "IMG_1002"]
    assert list(problems.values()) == [f"{copy}.JPG is an edited copy of IMG_1002.JPG by its name"]
    (tmp_path / "IMG_1002.JPG").unlink()
    assert len(names_of(tmp_path)) == 2, "without its original it is the photograph"


def test_series_whose_names_end_as_those_of_copies_are_whole(tmp_path):
    touch(
        tmp_path, *(f"wall{end}.jpg" for end in ("", "-2", "-3", "_1", "_2", " (1)", " (2)")), "img_e.jpg", "IMG_1.jpg"
    )
    assert len(names_of(tmp_path)) == 9


def test_an_edited_copy_beside_raw_files_is_none_too(tmp_path):
    touch(tmp_path, "IMG_1.CR3", "IMG_1.JPG", "IMG_1-Enhanced-NR.dng", "IMG_E1.JPG")
    pairs, problems = pair_photographs(tmp_path)
    assert [(pair.jpeg.name, pair.raw.name) for pair in pairs] == [("IMG_1.JPG", "IMG_1.CR3")]
    assert all("is an edited copy of IMG_1." in problem for problem in problems.values())


def test_a_file_that_is_given_twice_is_told(three):
    plan = plan_photographs([three / "c.jpg", three / "d.jpg", three / "c.jpg"], [1, 2])
    assert [pair.name for pair in plan.pairs] == ["c", "d"]
    assert plan.notes == ["c.jpg is given more than once and counts once"]


def test_what_times_do_not_match_names_the_files_beside(three):
    touch(three, "e.bmp", "f.jxl", "times.csv")
    (three / "times.csv").write_text("1\n2\n3\n4\n5\n")
    for times in ([1, 2, 3, 4, 5], "1,2,3,4,5"):
        with pytest.raises(InputError, match=r"do not match 3 photographs \(a b\.jpg, .*; left out are e\.bmp, f\.jxl"):
            plan_photographs(three, times)
    with pytest.raises(InputError, match=r"use one time above 0 for each; left out are e\.bmp, f\.jxl$"):
        plan_photographs(three, str(three / "times.csv"))


def test_a_copy_is_not_another_photograph(tmp_path):
    for name, time in (("IMG_1", 0.1), ("IMG_2", 0.2)):
        save_jpeg(tmp_path / f"{name}.jpg", {TIME: time})
    shutil.copy(tmp_path / "IMG_1.jpg", tmp_path / "IMG_1 bis.jpg")
    plan = plan_photographs(tmp_path)
    assert [pair.name for pair in plan.pairs] == ["IMG_1 bis", "IMG_2"]
    assert list(plan.problems.values()) == ["IMG_1.jpg is a copy of IMG_1 bis.jpg"]
    assert len(plan_photographs(tmp_path, [1, 2, 4]).pairs) == 3, "told to be three exposures"


def times_of(folder, exposures):
    return plan_photographs(folder, exposures, paired=False).times.tolist()


@pytest.fixture
def three(tmp_path):
    for name in ("a b", "c", "d"):
        save_jpeg(tmp_path / f"{name}.jpg")
    return tmp_path


@pytest.mark.parametrize(
    "exposures",
    [
        "1/60, 1/30,0.5s", "1/60s,1/30 s,500ms", "1_60,1_30,0.5", ["1/60", "1/30", 0.5], [1 / 60, 1 / 30, 0.5],
        "1/60 sec,1/30sec,0.5 seconds", "1/60;1/30;0,5", ["1/0.06ms", "1/30", "500000 µs"],
        np.array(["1/60", "1/30", "0.5"]), np.array(["1/60", "1/30", 0.5], object), pd.Series(["1/60", "1/30", "0.5"]),
        pd.Series([1 / 60, 1 / 30, 0.5]),
    ],
)  # fmt: skip
def test_times_are_fractions_too(three, exposures):
    np.testing.assert_allclose(times_of(three, exposures), [1 / 60, 1 / 30, 0.5])
    table = plan_photographs(three, exposures).table().splitlines()
    assert table[0] == "a b.jpg       1/60   +0.00 stops"
    assert table[2] == "d.jpg          0.5   +4.91 stops"


@pytest.mark.parametrize("between", [",", ", 1/"])
def test_many_times_are_no_name_of_a_file(tmp_path, between):
    for i in range(200):
        touch(tmp_path, f"{i}.jpg")
    plan = plan_photographs(tmp_path, "1" + 199 * f"{between}1")
    assert len(plan.problems) == 200, "each is empty"
    with pytest.raises(InputError, match="do not match 200 photographs"):
        plan_photographs(tmp_path, "1" + 5000 * f"{between}1")


NAMED = "is read as lines of name and time"


@pytest.mark.parametrize(
    ("name", "text", "note"),
    [
        ("t.txt", "# of a lens\n\nd.jpg 2\nA B.jpg  1/2 # said\nc.jpg,1\n", "t.txt is read as lines of name and time"),
        ("t.csv", "\ufeffa b;0.5\r\nc;1\r\nd;2\r\n", "t.csv is read as lines of name and time"),
        ("t.csv", "file,time\na b.jpg,0.5\nc.jpg,1\nd.jpg,2\n", "t.csv is read as lines of name and time"),
        ("list.txt", "a b.jpg 2\nc.jpg 1\nd.jpg 0.5", "list.txt is read as lines of name and 1/time, as in OpenCV's"),
        ("t.txt", "d 1305031102.2 2\nc 1305031102.1 1\na b 1305031102.0 1/2", "lines of name and time"),
        ("t.txt", "0.5\n1\n2\n", ""),
        ("t.txt", "exposure\n0.5\n1\n2\n", ""),
        ("t.csv", "Time [ms]\n500\n1000\n2000\n", ""),
        ("t.csv", "0,5;1;2\n", ""),
        ("t.csv", "file,exposure,index\na b.jpg,0.5,1\nc.jpg,1,2\nd.jpg,2,3\n", NAMED),
        ("t.csv", "exposure_ms,file,time\n500,a b.jpg,12:01\n1000,c.jpg,12:02\n2000,d.jpg,12:03\n", NAMED),
        ("t.csv", "file,ExposureCompensation,ExposureTime\na b.jpg,0,1/2\nc.jpg,1,1\nd.jpg,2,2\n", NAMED),
        ("t.csv", "file,timestamp,shutter (us),note\na b.jpg,7,5e5,\nc.jpg,8,1e6,x\nd.jpg,9,2e6,\n", NAMED),
        ("t.csv", "file,exposure\na b.jpg,0.5,\nc.jpg,1,,\nd.jpg,2\n", NAMED),
        ("t.txt", "file seconds iso\na b.jpg 0.5 100\nc.jpg 1 100\nd.jpg 2 100", NAMED),
        ("t.csv", "a b.jpg;100;0,5\nc.jpg;100;1,0\nd.jpg;100;2\n", NAMED),
        ("t.txt", "a b.jpg\t0,5\nc.jpg\t1\nd.jpg\t2,0\n", NAMED),
        ("t.txt", "a b.jpg 500 ms\nc.jpg 1 s\nd.jpg 2000000 µs\n", NAMED),
        ("t.csv", "SourceFile,ExposureTime,ISO\n./a b.jpg,1/2,100\n./x/c.jpg,1,100\n./d.jpg,2,100\n", NAMED),
        ("t.txt", "C:\\x y\\a b.jpg\t0.5\nC:\\x y\\c.jpg\t1\nC:\\d.jpg 2\n", NAMED),
        ("t.csv", '"file","exposure"\n"a b.jpg","0.5"\n"c.jpg","1 s"\n"d.jpg","2"\n', NAMED),
        ("t.txt", "0.5,1,2", ""),
        ("t.csv", ",file,time\n0,a b.jpg,0.5\n1,c.jpg,1\n2,d.jpg,2\n", NAMED),
        ("t.tsv", "\tfile\ttime\n0\ta b.jpg\t0.5\n1\tc.jpg\t1\n2\td.jpg\t2\n", NAMED),
        ("t.csv", ",exposure\n0,0.5\n1,1\n2,2\n", ""),
    ],
)
def test_times_in_a_file(three, tmp_path_factory, name, text, note):
    path = tmp_path_factory.mktemp("lists") / name
    path.write_text(text, encoding="utf-8")
    if "130503" in text:
        save_jpeg(three / "a.jpg")
        (three / "a b.jpg").unlink()
    plan = plan_photographs(three, str(path))
    np.testing.assert_allclose(plan.times, [0.5, 1, 2])
    assert note in "".join(plan.notes)


@pytest.mark.parametrize("coding", ["utf-8", "cp1252", "utf-16"])
def test_lists_as_programs_and_systems_write_them(tmp_path, coding):
    names = ("Küche – 1.png", "wall #2.png", "wall#3.png")
    touch(tmp_path, *names)
    text = "# of a wall\r\n" + "".join(f"{name}\t{i}\t# said\r\n" for i, name in enumerate(names, 1))
    (tmp_path / "t.txt").write_bytes(text.encode(coding))
    times = _given_times(tmp_path / "t.txt", pair_photographs(tmp_path)[0])[0]
    assert times.tolist() == [1, 2, 3]


def test_lists_name_folders_where_names_alone_do_not_do(tmp_path):
    files = touch(tmp_path, "x/a.jpg", "y/a.jpg")
    (tmp_path / "t.txt").write_text("shots/x/a.jpg 2\ny\\a.jpg 4\n")
    assert _given_times(tmp_path / "t.txt", pair_photographs(files)[0])[0].tolist() == [2, 4]
    (tmp_path / "t.txt").write_text("x/a.jpg 2\nz/a.jpg 4\n")
    assert np.isnan(_given_times(tmp_path / "t.txt", pair_photographs(files)[0])[0]).tolist() == [False, True]


def test_what_a_jpeg_does_not_tell_its_raw_file_does(tmp_path):
    scene = render_chart(GRID, 1, size=(96, 64))
    photographs.write_pair(tmp_path, "a", scene, exposure_time=0.25, model="Camera")
    save_jpeg(tmp_path / "a.jpg")
    (exif,) = plan_photographs(tmp_path).exifs
    assert (exif.exposure_time, exif.model) == (0.25, "Camera")
    save_jpeg(tmp_path / "a.jpg", {TIME: 0.5})
    (exif,) = plan_photographs(tmp_path).exifs
    assert (exif.exposure_time, exif.model) == (0.5, "Camera")


def test_folders_within_a_folder_are_named(tmp_path):
    (tmp_path / "camera").mkdir()
    with pytest.raises(InputError, match=r"camera is a folder; give it by itself, .*--each"):
        camera.calibrate(tmp_path, "none")


def test_a_tiff_file_of_several_photographs_is_refused(tmp_path):
    tifffile.imwrite(tmp_path / "stack.tif", np.zeros((3, 8, 8, 3), np.uint8), photometric="rgb")
    for read in (read_levels, read_exif):
        with pytest.raises(FormatError, match=r"stack\.tif holds 3 pictures of one size; use a file for each"):
            read(tmp_path / "stack.tif")


def test_what_was_left_out_is_named_where_the_rest_does_not_do(tmp_path):
    for i in range(2):
        save_jpeg(tmp_path / f"{i}.jpg", {TIME: 2.0**i})
    (tmp_path / "broken.jpg").write_bytes(b"none")
    with pytest.raises(InputError, match=r"brightness changes by .*\(left out: broken\.jpg is not a readable"):
        camera.calibrate(tmp_path, "none")


def test_a_list_that_lacks_a_photograph(three):
    (three / "t.txt").write_text("c.jpg 1\nd.jpg 2")
    _, plan = read_planned(plan_photographs(three, three / "t.txt"), read_levels)
    assert plan.stops.tolist() == [0, 1]
    assert next(iter(plan.problems.values())).startswith("a b.jpg does not tell its exposure; give times")
    for text, message in (
        ("x 1\ny 2", r"t\.txt names none of"),
        ("c.jpg 1/1O\nd.jpg 2", "t.txt, line 'c.jpg 1/1O': '1/1O' is not an exposure time"),
        ("c.jpg 1\nd.jpg two", "t.txt, line 'd.jpg two': 'two' is not an exposure time"),
    ):
        (three / "t.txt").write_text(text)
        with pytest.raises(InputError, match=message):
            plan_photographs(three, three / "t.txt")


@pytest.mark.parametrize(
    ("name", "seconds"),
    [
        ("a_1_60s.jpg", 1 / 60), ("b-1-60sec.jpg", 1 / 60), ("12.jpg", None), ("1_0s.jpg", None),
        ("x 0.5sec.jpg", 0.5),
        ("IMG_0001_2s.jpg", 2), ("cap_250us_3.jpg", 0.00025), ("IMG_1_60.jpg", None), ("iso100s.jpg", None),
        ("1s_2s.jpg", None), ("x.jpg", None), ("0ms.jpg", None), ("img_000123_exp8000us.jpg", 0.008),
        ("exp8ms.jpg", 0.008), ("t250us.jpg", 0.00025), ("a_125µs.jpg", 0.000125), ("a_125μs.jpg", 0.000125),
        ("0.5seconds.jpg", 0.5), ("a 2msec.jpg", 0.002), ("1_800 sec.jpg", 1 / 800), ("1_60 s.jpg", 1 / 60),
        ("a_0,5s.jpg", 0.5), ("IMG_1_60ms.jpg", 0.06), ("reset8ms.jpg", None), ("8milliseconds.jpg", 0.008),
    ],
)  # fmt: skip
def test_times_in_names(tmp_path, name, seconds):
    save_jpeg(tmp_path / name)
    for exposures in ("names", None):
        plan = plan_photographs([tmp_path / name], exposures)
        assert plan.times.tolist() == pytest.approx([seconds or np.nan], nan_ok=True)
    save_jpeg(tmp_path / "1_15.jpg")
    assert np.isnan(plan_photographs([tmp_path / "1_15.jpg"]).times), "it may be a number in a row"
    assert plan_photographs([tmp_path / "1_15.jpg"], "names").times == pytest.approx(1 / 15)
    save_jpeg(tmp_path / name, {TIME: 7.0})
    assert plan_photographs([tmp_path / name]).times.tolist() == [7.0], "EXIF counts first"


@pytest.mark.parametrize(
    ("names", "times"),
    [
        (["scene_EV-2", "scene_EV0", "scene_EV+1.5"], [0.25, 1, 2**1.5]),
        (["b_-1.0EV", "b_+1.0EV", "c_0EV"], [0.5, 2, 1]),
        (["ev_-1", "ev_2", "ev+1"], [0.5, 4, 2]),
        (["EV-2", "EV0", "x"], None),
        (["EV-2", "EV0", "EV1_4s"], None),
        (["lev1", "lev2", "lev3"], None),
    ],
)
def test_exposure_values_in_names(tmp_path, names, times):
    for name in names:
        save_jpeg(tmp_path / f"{name}.jpg")
    files = [tmp_path / f"{name}.jpg" for name in names]
    for exposures in ("names", None):
        found = plan_photographs(files, exposures).times
        assert np.isnan(found).any() if times is None else found.tolist() == times


@pytest.mark.parametrize(
    "time", ["-2s", "1e-3 days", "1/0s", "0", "-1", "1/0", "nan", "inf", "1e999999999", "5e-324", "a", ""]
)
def test_times_that_are_none(three, time):
    with pytest.raises(InputError, match="is not an exposure time; use times above 0"):
        plan_photographs(three, f"1,2,{time}")
    with pytest.raises(InputError, match=r"is not an exposure time|do not match 3"):
        plan_photographs(three, ["1/60", 1, time])
    with pytest.raises(InputError, match=r"there is|is not an exposure time"):
        plan_photographs(three, three / "nowhere.txt")
    (three / "list.txt").write_text(f"a b 1\nc {time}\nd 1")
    with pytest.raises(InputError, match="is not an exposure time; use times above 0"):
        plan_photographs(three, three / "list.txt")


def test_times_in_names_of_folders(tmp_path):
    for name in ("4ms", "8ms"):
        (tmp_path / name).mkdir()
        save_jpeg(tmp_path / name / "frame.jpg")
    assert plan_photographs([tmp_path / "8ms", tmp_path / "4ms"]).times.tolist() == [0.008, 0.004]
    assert np.isnan(plan_photographs(tmp_path / "8ms").times).all(), "one for all photographs is none"


def test_what_differs_from_most_is_named_and_left_out(three):
    Image.fromarray(SMOOTH[..., 0]).save(three / "c.jpg")
    Image.fromarray(SMOOTH).save(three / "e.jpg")
    Image.fromarray(SMOOTH[:20]).save(three / "f.jpg")
    images, plan = read_planned(plan_photographs(three, "1,2,4,8,16"), read_levels)
    assert len(images) == 3
    assert plan.stops.tolist() == [0, 2, 3]
    assert list(plan.problems.values()) == [
        f"{name}, and most are 64 x 48 pixels of 8 bits, colour; use one kind"
        for name in ("c.jpg is 64 x 48 pixels of 8 bits, grey", "f.jpg is 64 x 20 pixels of 8 bits, colour")
    ]


def test_a_folder_of_other_kinds_says_what_was_passed_over(tmp_path):
    touch(tmp_path, "a.psd", "b.gif")
    for chart in ("none", "auto"):
        with pytest.raises(InputError, match=r"a\.psd is neither RAW nor JPEG.*b\.gif is neither"):
            camera.calibrate(tmp_path, chart)
    save_jpeg(tmp_path / "only.jpg", {TIME: 1})
    with pytest.raises(InputError, match=r"1 photograph of a series left, only\.jpg \(a\.psd is neither"):
        camera.calibrate(tmp_path, "none")


# --- from files to a response


TRUTH = load_opencrf().curves[70]
SERIES = camera.render_series(TRUTH, 1, size=(96, 64))


def save_series(folder, save, suffix):
    folder.mkdir(exist_ok=True)
    for i, image in enumerate(SERIES.images):
        save(folder / f"{i}.{suffix}", image)
    return ",".join(str(2.0**stop) for stop in SERIES.stops)


def save_grey(path, image):
    Image.fromarray(image[..., 1]).save(path)


def save_grey_16(path, image):
    cv2.imwrite(str(path), image[..., 1].astype(np.uint16) * 257)


def save_12_bits(path, image):
    cv2.imwrite(str(path), np.rint(image[..., ::-1] / 255 * 4095).astype(np.uint16))


def save_heic(path, image):
    pillow_heif.from_pillow(Image.fromarray(image)).save(path, quality=98)


OTHER_FILES = [(save_grey, "png"), (save_grey_16, "tif"), (save_heic, "heic")]


@pytest.mark.parametrize(
    ("save", "suffix"),
    [
        (save_grey, "jpg"),
        (save_12_bits, "png"),
        *(pytest.param(*other, marks=pytest.mark.slow) for other in OTHER_FILES),
    ],
)
def test_a_known_response_comes_back_from_other_files(tmp_path, save, suffix):
    times = save_series(tmp_path / "series", save, suffix)
    done = run_command(
        "calibrate", tmp_path / "series", "--chart", "none", "--exposures", times, "--out", tmp_path / "out"
    )
    assert done.returncode == 0, done.stderr
    assert ("end at 4095, which is taken as white" in done.stderr) == (save is save_12_bits)
    assert f"0.{suffix}" in done.stderr.splitlines()[0]
    curve = camera.read_response(tmp_path / "out" / "passport.json").curves[0]
    inverse = invert(TRUTH)
    assert rmse(curve * (curve @ inverse) / (curve @ curve), inverse) < 0.03
    for suffix_out in ("exr", "tif", "hdr"):
        out = tmp_path / f"linear.{suffix_out}"
        image = tmp_path / "series" / f"1.{suffix}"
        done = run_command("linearise", image, "--response", tmp_path / "out" / "passport.json", "--out", out)
        assert done.returncode == 0, done.stderr
    expected = np.interp(SERIES.images[1] / 255, GRID, curve)
    if save in (save_grey, save_grey_16):
        expected = expected[..., 1]
        assert list(OpenEXR.File(str(tmp_path / "out" / "merged.exr")).channels()) == ["Y"]
        np.testing.assert_allclose(
            OpenEXR.File(str(tmp_path / "linear.exr")).channels()["Y"].pixels, expected, atol=0.15
        )
    assert np.abs(tifffile.imread(tmp_path / "linear.tif") - expected).mean() < 0.01


def test_given_white_levels_count_before_guesses(tmp_path):
    times = save_series(tmp_path, save_12_bits, "png")
    plan = plan_photographs(tmp_path, times, white_level=8190)
    assert plan.white_level == 8190
    assert read_planned(plan, read_levels)[0][0].max() <= 32768
    with pytest.raises(InputError, match="white_level=70000 is out of range"):
        camera.calibrate(tmp_path, "none", white_level=70000)


def test_notes_stand_in_the_report(tmp_path):
    for i, image in enumerate(SERIES.images):
        save_jpeg(tmp_path / f"{i}.jpg", {TIME: 2.0 ** SERIES.stops[i], ISO: 0.3}, image=image)
    said = []
    result = camera.calibrate(tmp_path, "none", say=said.append)
    assert result.passport.iso is None, "no whole number"
    assert (
        result.notes
        == said[1:]
        == [
            "5 of 5 files do not tell the f-number, which is taken as constant",
            "exposures tell curves up to a scale: where white lies, the model says",
        ]
    )
    from crfbench.camera.outputs import report_page

    assert all(note in report_page(result) for note in result.notes)
    named = replace(result, photographs={"a\udcff": tmp_path / "0.jpg"})  # as Linux reads a name that is no UTF-8
    *_, page, _merged = camera.write_outputs(named, tmp_path / "out")
    assert "<td>a?</td>" in page.read_text(encoding="utf-8")


def test_a_grey_file_has_no_chart(tmp_path):
    Image.fromarray(SMOOTH[..., 0]).save(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"a\.png is grey, .*--chart none"):
        camera.calibrate(tmp_path)


# --- machines


def test_the_package_keeps_to_what_every_machine_has():
    from crfbench.files import bundled

    package = bundled("cli.py").parent
    code = {path.name: path.read_text(encoding="utf-8") for path in package.rglob("*.py")}
    for word in ("os.execv", "cv2.imread(", "import resource", "getloadavg", "os.fork(", "import fcntl"):
        assert [name for name, text in code.items() if word in text] == [], word


def test_file_systems_that_write_accents_apart(tmp_path):
    touch(tmp_path, unicodedata.normalize("NFD", "é.jpg"), unicodedata.normalize("NFC", "É.dng"))
    assert names_of(tmp_path) == ["é"]


def test_lists_of_photographs_keep_links(tmp_path):
    if os.name == "nt":
        pytest.skip("links need rights")
    save_jpeg(tmp_path / "a.jpg")
    (tmp_path / "b.jpg").symlink_to("a.jpg")
    assert [path.name for path in list_photographs(tmp_path)] == ["a.jpg", "b.jpg"]


def test_a_passport_keeps_its_white_level_and_older_ones_have_none(tmp_path):
    path = tmp_path / "passport.json"
    camera.write_response(camera.Passport("inverse", GRID, white_level=4095), path)
    assert camera.read_response(path).white_level == 4095
    content = json.loads(path.read_text())
    del content["white_level"]
    path.write_text(json.dumps(content))
    assert camera.read_response(path).white_level is None
    del content["warnings"]
    path.write_text(json.dumps({**content, "note": "repaired"}))
    assert camera.read_response(path).warnings == ("repaired",), "as a warning was called before"
    with pytest.raises(InputError, match="white_level=0 is out of range"):
        camera.Passport("inverse", GRID, white_level=0)


@pytest.mark.parametrize("time", ["2_50", "-1/-60", "1_60_2"])
def test_what_is_no_time_is_refused(three, time):
    with pytest.raises(InputError, match="is not an exposure time"):
        times_of(three, [time, "1/30", "1/15"])


@pytest.mark.parametrize(
    ("text", "times"),
    [
        ("file,expo_comp,time_ms\na b.jpg,1,5\nc.jpg,2,10\nd.jpg,3,20", [0.005, 0.01, 0.02]),
        ("file,exposure_program,shutter\na b.jpg,1,1/60\nc.jpg,1,1/30\nd.jpg,1,0.5", [1 / 60, 1 / 30, 0.5]),
        ("file,exposure,iso\na b.jpg,0.5\nc.jpg,1,100\nd.jpg,2,100,", [0.5, 1, 2]),
    ],
)
def test_a_header_tells_which_column_holds_times(three, tmp_path_factory, text, times):
    path = tmp_path_factory.mktemp("list") / "t.csv"
    path.write_text(text)
    np.testing.assert_allclose(times_of(three, path), times)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("file,exposure\na b.jpg,0,5\nc.jpg,1\nd.jpg,2", "has 3 cells below 2 names; use as many"),
        ("c.jpg auto\nd.jpg 0.5", "line 'c.jpg auto': 'auto' is not an exposure time"),
    ],
)
def test_rows_that_do_not_fit_are_refused(three, tmp_path_factory, text, message):
    path = tmp_path_factory.mktemp("list") / "t.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        times_of(three, path)


def test_downloads_of_one_name_are_several_photographs(tmp_path):
    touch(tmp_path, "image.png", "image (1).png", "wall.jpg", "wall~1.jpg")
    pairs, problems = pair_photographs(tmp_path)
    assert len(pairs) == 4
    assert problems == {}
