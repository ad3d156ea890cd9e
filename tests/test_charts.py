"""From photographs of a chart to patches: read, found, measured, paired, labelled and put into a table."""

import json
import unicodedata
import zlib
from contextlib import nullcontext
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, ImageOps
from PIL.TiffImagePlugin import IFDRational, ImageFileDirectory_v2

from crfbench.calibration import Observations, calibrate
from crfbench.camera import measuring, reading
from crfbench.camera.measuring import (
    chart_confidence,
    chart_table,
    find_chart,
    measure_chart,
    measure_photograph,
    orient,
    weighed_by_scatter,
)
from crfbench.camera.photographs import Pair, exposure_steps, pair_photographs
from crfbench.camera.reading import Exif, read_exif, read_image, read_levels, read_raw
from crfbench.curves import GRID, evaluate
from crfbench.datasets import load_opencrf, load_patches, registry
from crfbench.datasets.chart import load_labels, save_labels
from crfbench.datasets.middlebury import patch_intensity
from crfbench.errors import FormatError, InputError
from crfbench.models import load_model
from tests.support.photographs import write_pair
from tests.support.scenes import render_chart

GAMMA = GRID ** (1 / 2.2)
WHOLE = [(0, 0), (1, 0), (1, 1), (0, 1)]


def image_of(scene):
    return (scene.jpeg / 255).astype(np.float32)


@pytest.fixture(scope="module")
def scene():
    return render_chart(GAMMA, 1)


# --- reading


def photograph(shape=(24, 16), dtype=np.uint8):
    top = np.iinfo(dtype).max
    return np.random.default_rng(0).integers(0, top, (*shape, 3), dtype=dtype)


@pytest.mark.parametrize(
    ("suffix", "dtype"), [("png", np.uint8), ("png", np.uint16), ("tif", np.uint8), ("tif", np.uint16)]
)
def test_lossless_images_come_back_exactly(tmp_path, suffix, dtype):
    path, pixels = tmp_path / f"a.{suffix}", photograph(dtype=dtype)
    cv2.imwrite(str(path), pixels[..., ::-1])
    np.testing.assert_array_equal(read_levels(path), pixels)
    np.testing.assert_array_equal(read_image(path), pixels.astype(np.float32) / np.float32(np.iinfo(dtype).max))


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF", "WEBP", "AVIF"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation(tmp_path, kind, orientation):
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / f"a.{kind.lower()}"
    Image.fromarray(np.repeat(np.repeat(photograph((3, 2)), 16, axis=0), 16, axis=1)).save(path, kind, exif=exif)
    with Image.open(path) as image:
        expected = np.asarray(ImageOps.exif_transpose(image))
    np.testing.assert_allclose(read_image(path) * 255, expected, atol=3)


def test_sixteen_bit_tiff_is_turned(tmp_path):
    path, pixels = tmp_path / "a.tif", photograph(dtype=np.uint16)
    folder = ImageFileDirectory_v2(prefix=b"II")
    tags = {256: 16, 257: 24, 258: (16, 16, 16), 259: 1, 262: 2, 273: 0, 274: 6, 277: 3, 278: 24, 279: pixels.nbytes}
    for tag, value in tags.items():
        folder.tagtype[tag], folder[tag] = (4 if tag in (273, 279) else 3), value
    with path.open("wb") as file:
        folder.save(file)
        file.write(pixels.astype("<u2").tobytes())
    np.testing.assert_array_equal(read_levels(path), np.rot90(pixels, -1))


@pytest.mark.parametrize(("mode", "name"), [("P", "P"), ("1", "1")])
def test_other_kinds_of_png_are_refused(tmp_path, mode, name):
    path = tmp_path / "a.png"
    Image.new(mode, (8, 8)).save(path)
    with pytest.raises(FormatError, match=rf"a\.png is a {name} image; use RGB"):
        read_image(path)


def test_other_kinds_of_photographs_are_refused(tmp_path):
    Image.new("CMYK", (8, 8)).save(tmp_path / "cmyk.jpg")
    Image.new("RGB", (8, 8)).save(tmp_path / "key.png", transparency=(0, 0, 0))
    Image.new("RGB", (8, 8)).save(tmp_path / "a.gif")
    glass = Image.new("RGB", (256, 256))
    glass.putalpha(Image.linear_gradient("L"))
    glass.save(tmp_path / "glass.png")
    cv2.imwrite(str(tmp_path / "float.tif"), np.zeros((8, 8, 3), np.float32))
    for name in ("cmyk.jpg", "key.png", "a.gif", "glass.png", "float.tif", "missing.jpg"):
        with pytest.raises(FormatError, match=f"^{name} .*; use"):
            read_image(tmp_path / name)


def test_a_bomb_is_refused_by_its_header(tmp_path, monkeypatch):
    path = tmp_path / "bomb.png"
    cv2.imwrite(str(path), photograph())
    content = path.read_bytes()
    monkeypatch.setattr(cv2, "imdecode", lambda *arguments: pytest.fail("decoded"))
    for side, message in (
        (60_000, "is not a readable"),
        (13_000, "announces 13000 x 13000 pixels; use 1 to 160000000"),
    ):
        header = b"IHDR" + side.to_bytes(4, "big") * 2 + content[24:29]
        path.write_bytes(content[:12] + header + zlib.crc32(header).to_bytes(4, "big") + content[33:])
        for read in (read_image, read_exif):
            with pytest.raises(FormatError, match=rf"^bomb\.png {message}"):
                read(path)


def test_a_raw_bomb_is_refused_by_its_header(tmp_path, scene):
    _, dng = write_pair(tmp_path, "a", scene)
    content = dng.read_bytes()
    width = b"\x00\x01\x04\x00\x01\x00\x00\x00"
    assert content.count(width) == 1
    at = content.index(width) + 8
    dng.write_bytes(content[:at] + (60_000_000).to_bytes(4, "little") + content[at + 4 :])
    with pytest.raises(FormatError, match=r"^a\.dng "):
        read_raw(dng)
    dng.write_bytes(content)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reading, "MAX_PIXELS", 640 * 480 - 1)
        with pytest.raises(FormatError, match=r"a\.dng announces 640 x 480 pixels; use 1 to 307199"):
            read_raw(dng)


def test_a_file_too_large_is_not_read(tmp_path, monkeypatch):
    path = tmp_path / "a.jpg"
    path.write_bytes(bytes(1001))
    monkeypatch.setattr(reading, "MAX_BYTES", 1000)
    with pytest.raises(FormatError, match=r"a\.jpg has 1001 bytes; use a photograph of 1000 bytes or less"):
        read_image(path)


@pytest.mark.parametrize("read", [read_raw, read_exif])
def test_no_raw_file(tmp_path, read):
    path = tmp_path / "a.nef"
    path.write_bytes(b"II*\0" + bytes(100))
    with pytest.raises(FormatError, match=r"a\.nef is not a readable RAW file; use"):
        read(path)


# --- exposure


def test_exposure_steps_count_stops():
    reference = Exif(1 / 100, 8.0, 100.0)
    others = [Exif(1 / 50, 8.0, 100.0), Exif(1 / 100, 4.0, 100.0), Exif(1 / 100, 8.0, 50.0), Exif(None, 8.0, 100.0)]
    np.testing.assert_allclose(exposure_steps([reference, *others]), [0, 1, 2, -1, np.nan], atol=1e-12)
    np.testing.assert_allclose(exposure_steps([Exif(), *others[:2]]), [np.nan, 0, 1], atol=1e-12)
    assert exposure_steps([]).shape == (0,)
    assert np.isnan(exposure_steps([Exif()])).all()


def test_an_image_without_exif_says_nothing(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), photograph())
    assert read_exif(tmp_path / "a.png") == Exif()


@pytest.mark.parametrize("value", [IFDRational(0, 1), IFDRational(1, 0), IFDRational(0, 0)])
def test_exposures_that_cannot_be_are_unknown(tmp_path, value):
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0x829A: value, 0x8827: 0})
    Image.new("RGB", (8, 8)).save(tmp_path / "a.jpg", exif=exif)
    assert read_exif(tmp_path / "a.jpg") == Exif()


# --- finding and measuring


@pytest.mark.parametrize("seed", [0, 3, 6, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2, 4, 5, 7))])
def test_chart_is_found_whichever_way_it_lies(seed):
    """The patches measured between the corners found are the response at the true irradiance."""
    curves = load_opencrf().curves
    curve = curves[20 * seed]
    light = tuple(np.random.default_rng(seed).uniform(0.7, 1.4, 3).tolist())
    scene = render_chart(curve, seed, turn=45.0 * seed, exposure=0.7, illuminant=light)
    corners, confidence = find_chart(image_of(scene))
    assert confidence > 0.95
    np.testing.assert_allclose(corners, scene.corners, atol=0.02)
    true = evaluate(curve, scene.irradiance.ravel()).reshape(24, 3)
    error = np.abs(measure_chart(image_of(scene), corners).means - true)
    assert error.mean() < 0.5 / 255
    assert error.max() < 4 / 255


def test_turning_the_image_turns_the_corners_and_the_same_image_has_the_same(scene):
    found = [find_chart(np.rot90(image_of(scene), turns))[0] for turns in range(5)]
    upright, *turned = (measure_chart(np.rot90(image_of(scene), i), each).means for i, each in enumerate(found))
    for means in turned:
        np.testing.assert_allclose(means, upright, atol=1 / 255)
    np.testing.assert_array_equal(found[0], found[4])


@pytest.mark.parametrize(
    "size", [pytest.param((480, 640, 3), marks=pytest.mark.slow), (40, 400, 3), (2, 2, 3), (1, 500, 3)]
)
def test_no_chart_in_noise(size):
    noise = np.random.default_rng(0).uniform(0, 1, size)
    for image in (noise, np.zeros(size), np.ones(size)):
        with pytest.raises(InputError, match=r"no chart of 24 patches was found .*; label its four corners by hand"):
            find_chart(image)


def test_no_chart_in_a_board_of_other_colours():
    board = np.kron(np.random.default_rng(1).uniform(0.2, 1, (4, 6, 3)), np.ones((60, 60, 1)))
    grid = (np.arange(240)[:, None] % 60 < 8) | (np.arange(360) % 60 < 8)
    board[grid] = 0.02
    with pytest.raises(InputError, match="no chart"):
        find_chart(np.pad(board, ((60, 60), (60, 60), (0, 0)), constant_values=0.5))


@pytest.mark.parametrize("image", [np.zeros((8, 8)), np.zeros((8, 8, 4)), np.zeros((8, 8, 3), np.uint8),
                                   np.full((8, 8, 3), np.nan), np.zeros((0, 8, 3))])  # fmt: skip
def test_what_is_no_image(image):
    for use in (find_chart, lambda pixels: measure_chart(pixels, WHOLE), lambda pixels: orient(pixels, WHOLE)):
        with pytest.raises(InputError, match=r"the image (has shape|holds NaN)"):
            use(image)


def test_any_first_corner_gives_chart_order(scene):
    for turn in range(4):
        corners, _ = orient(image_of(scene), np.roll(scene.corners, turn, axis=0))
        np.testing.assert_array_equal(corners, scene.corners)


def test_a_mirrored_chart_is_refused(scene):
    with pytest.raises(InputError, match="not mirrored"):
        orient(image_of(scene)[:, ::-1], np.array([[1.0, 0.0]]) + scene.corners[[1, 0, 3, 2]] * [-1, 1])
    with pytest.raises(InputError, match="no chart"):
        find_chart(image_of(scene)[:, ::-1])
    for flipped in (image_of(scene)[::-1], np.rot90(image_of(scene))[::-1]):
        with pytest.raises(InputError, match="the nearest is mirrored"):
            find_chart(flipped)


def test_a_small_chart_is_found_at_full_size(monkeypatch):
    small = render_chart(GAMMA, 1, size=(330, 240))
    picture = np.full((2250, 3000, 3), 0.35, np.float32)
    picture[900:1140, 1800:2130] = image_of(small)
    place = (small.corners * (330, 240) + (1800, 900)) / (3000, 2250)
    corners, confidence = find_chart(picture)
    assert confidence > 0.95
    np.testing.assert_allclose(corners, place, atol=0.008)
    monkeypatch.setattr(measuring, "_LONGEST_SIDES", (1000,))
    with pytest.raises(InputError, match="no chart"):
        find_chart(picture)


def glare(image):
    """Add a reflection that fades from the left edge to the right."""
    veil = np.linspace(0.8, 0.0, image.shape[1])[:, None]
    return image + (1 - image) * veil


def overexposed(image):
    """Mix the channels, and lift the greys' brighter half to white."""
    return np.clip(1.6 * (0.35 * image + 0.65 * image @ np.outer((0.3, 0.6, 0.1), np.ones(3))), 0, 1)


def unbalanced(image):
    """Let next to no blue through, and as much of green into it."""
    return image @ np.array([(0.5, 0.15, 0.02), (0.2, 0.6, 0.06), (0, 0.02, 0.05)])


@pytest.mark.parametrize("change", [glare, overexposed, unbalanced])
def test_charts_whose_colours_are_out_of_order_are_found(change):
    scene = render_chart(GAMMA, 3, exposure=0.6)
    corners, confidence = find_chart(np.rint(255 * change(image_of(scene))) / 255)
    assert confidence < 0.8
    np.testing.assert_allclose(corners, scene.corners, atol=0.01)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 6))])
@pytest.mark.parametrize("colour", [(0.3, 0.5, 0.1), (0.9, 0.7, 0.6), (0.1, 0.1, 0.1)], ids=["leaf", "hand", "shadow"])
def test_a_chart_of_which_something_hides_a_part_is_refused(scene, seed, colour):
    place = np.random.default_rng(seed).integers(0, (4, 3))
    unit = np.array([(0, 0), (3, 0), (3, 2), (0, 2)]) + place
    grid = cv2.getPerspectiveTransform(
        np.float32([(0, 0), (6, 0), (6, 4), (0, 4)]), np.float32(scene.corners * (640, 480))
    )
    hidden = cv2.perspectiveTransform(np.float32([unit]), grid)
    image = cv2.fillPoly(image_of(scene).copy(), [np.int32(hidden[0])], colour)
    for use in (lambda: find_chart(image), lambda: orient(image, scene.corners)):
        with pytest.raises(InputError, match=r"hides a part|grey row does not fall"):
            use()


def test_a_chart_that_is_cut_off_is_refused(scene):
    left = scene.corners[:, 0].min() * 640
    with pytest.raises(InputError, match="no chart"):
        find_chart(image_of(scene)[:, int(left) + 90 :])


def test_a_grid_beside_the_patches_is_refused(scene):
    across = scene.corners[1] - scene.corners[0]
    with pytest.raises(InputError, match=r"patches of the nearest are not even|other colours"):
        orient(image_of(scene), scene.corners + across / 12)


REAL = {
    **dict.fromkeys(("charts/c03.jpg", "charts/c07.jpg", "charts/c21.jpg"), ""),
    **dict.fromkeys(("cases/overexposed_chart.png", "cases/unbalanced_chart.jpg", "cases/small_chart.jpg"), ""),
    **dict.fromkeys(("charts/c23.png", "charts/c24.jpg", "charts/c26.jpg"), "a part of the nearest lies outside"),
    **dict.fromkeys(("charts/c17.jpg", "charts/c20.png"), "hides a part"),
}


# Of each kind one is enough to see that nothing broke; all are looked at in CI.
FEW = ("charts/c03.jpg", "cases/small_chart.jpg", "charts/c23.png", "charts/c17.jpg")


@pytest.mark.parametrize(
    "name", [*FEW, *(pytest.param(name, marks=pytest.mark.slow) for name in REAL if name not in FEW)]
)
def test_real_photographs_of_whole_charts_and_of_parts(name):
    if not (path := registry.find(name)):
        pytest.skip("the real photographs are absent: set CRFBENCH_DATA to the folder that holds charts and cases")
    with pytest.raises(InputError, match=REAL[name]) if REAL[name] else nullcontext():
        assert find_chart(read_image(path))[1] > 0.5


def test_a_grey_row_that_rises_is_refused():
    scene = render_chart(GAMMA, 1, vignetting=0.0)
    image = image_of(scene)
    means = measure_chart(image, scene.corners).means
    # A reflection that raises the fourth grey above the third.
    to_patch = cv2.getPerspectiveTransform(np.float32(WHOLE), np.float32(scene.corners * (640, 480)))
    x, y = cv2.perspectiveTransform(np.float32([[[3.5 / 6, 3.5 / 4]]]), to_patch)[0, 0].astype(int)
    image[y - 25 : y + 25, x - 25 : x + 25] = means[20] + 0.05
    with pytest.raises(InputError, match="grey row does not fall from white to black"):
        orient(image, scene.corners)


def test_robust_means_clipping_and_spread():
    chart = np.kron(np.linspace(0.1, 0.9, 24).reshape(4, 6, 1), np.ones((100, 100, 3)))
    chart[40:60, 40:60] = 1.0  # a reflection on the first patch: 4 % of it, 16 % of the box or less
    noisy = chart + np.random.default_rng(0).normal(0, 0.02, chart.shape)
    clean, values = measure_chart(chart, WHOLE), measure_chart(np.clip(noisy, 0, 1), WHOLE)
    assert 0.1 < clean.clipped[0] < 0.2
    assert (clean.clipped[1:] == 0).all()
    np.testing.assert_allclose(clean.means[1:, 1], np.linspace(0.1, 0.9, 24)[1:], atol=1e-6)
    np.testing.assert_allclose(values.means[1:], clean.means[1:], atol=0.003)
    np.testing.assert_allclose(values.spread[1:], 0.02 / np.sqrt(3), rtol=0.1)
    assert abs(clean.means[0, 0] - 0.1) < abs(chart[25:75, 25:75, 0].mean() - 0.1)


@pytest.mark.parametrize(("level", "clipped"), [(0, 1.0), (1, 0.0), (253, 0.0), (254, 1.0), (255, 1.0)])
def test_clipping_is_that_of_the_middlebury_table(level, clipped):
    image = np.full((60, 90, 3), 0.5, np.float32)
    image[..., 1] = np.float32(level) / np.float32(255)
    assert (measure_chart(image, WHOLE).clipped == clipped).all()


def test_a_chart_too_small_is_refused():
    with pytest.raises(InputError, match=r"inner box of a patch has .* pixels a side; use a larger image"):
        measure_chart(np.full((24, 36, 3), 0.5), WHOLE)


def test_confidence_needs_neither_response_nor_light(scene):
    colours = measure_chart(image_of(scene), scene.corners).means
    assert chart_confidence(colours**3 * (0.2, 1.0, 0.5)) == pytest.approx(chart_confidence(colours), abs=1e-9)
    assert chart_confidence(1 - colours) == pytest.approx(-chart_confidence(colours), abs=0.01)
    assert chart_confidence(np.full((24, 3), 0.5)) == 0.0


def test_confidence_in_real_cameras():
    """All 14 cameras of the Middlebury set, right way round and mirrored or upside down."""
    charts = load_patches()[["jpeg_r", "jpeg_g", "jpeg_b"]].to_numpy().reshape(-1, 4, 6, 3)
    upright = [chart_confidence(chart.reshape(24, 3)) for chart in charts]
    wrong = [chart_confidence(chart.reshape(24, 3)) for c in charts for chart in (c[::-1], c[:, ::-1], c[::-1, ::-1])]
    assert min(upright) > 0.89
    assert max(wrong) < 0.0


@pytest.mark.middlebury
@pytest.mark.slow
def test_middlebury_images_measured_by_corners(middlebury_folder):
    """Their charts fill the image without gaps: the grid must lie over the boxes of the bundled table."""
    frame = load_patches()
    for (camera, illumination, exposure), rows in frame.groupby(["camera", "illumination", "exposure"]):
        path = middlebury_folder / camera / f"wb1i{illumination}e{exposure}-jpg.png"
        pixels = read_image(path)
        np.testing.assert_array_equal(orient(pixels, WHOLE)[0], WHOLE)
        means = measure_chart(pixels, WHOLE).means
        np.testing.assert_allclose(means, rows[["jpeg_r", "jpeg_g", "jpeg_b"]], atol=0.03)


# --- pairing


@pytest.fixture(scope="module")
def small_pair(tmp_path_factory):
    return write_pair(tmp_path_factory.mktemp("pair"), "a", render_chart(GAMMA, 1, size=(96, 64)))


def copy(source, target):
    target.write_bytes(source.read_bytes())
    return target


def test_pairs_are_found_whatever_their_names(tmp_path, small_pair):
    jpeg, dng = small_pair
    for name in ("zwei Wörter", "фото 1", "写真", "IMG_1.edit"):
        copy(jpeg, tmp_path / f"{name}.JPG")
        copy(dng, tmp_path / f"{name}.Dng")
    copy(jpeg, tmp_path / unicodedata.normalize("NFC", "é.jpeg"))
    copy(dng, tmp_path / unicodedata.normalize("NFD", "é.dng"))
    (tmp_path / "notes.txt").write_text("passed over")
    copy(jpeg, tmp_path / ".hidden.jpg")
    pairs, problems = pair_photographs(tmp_path)
    assert problems == {}
    assert [pair.name for pair in pairs] == sorted(["zwei Wörter", "фото 1", "写真", "IMG_1.edit", "é"])
    assert all(pair.raw and pair.jpeg.suffix.lower() in (".jpg", ".jpeg") for pair in pairs)
    assert pair_photographs(path for pair in pairs for path in (pair.raw, pair.jpeg))[0] == pairs


def test_every_problem_is_named(tmp_path, small_pair):
    jpeg, dng = small_pair
    copy(jpeg, tmp_path / "good.jpg"), copy(dng, tmp_path / "good.dng")
    copy(jpeg, tmp_path / "alone.jpg"), copy(dng, tmp_path / "single.dng")
    copy(jpeg, tmp_path / "two.jpg"), copy(dng, tmp_path / "two.dng"), copy(dng, tmp_path / "two.nef")
    (tmp_path / "bad.jpg").write_bytes(jpeg.read_bytes()[:50]), copy(dng, tmp_path / "bad.dng")
    larger, _ = write_pair(tmp_path / "other", "a", scene := render_chart(GAMMA, 1, size=(320, 240)))
    copy(larger, tmp_path / "size.jpg"), copy(dng, tmp_path / "size.dng")
    pairs, problems = pair_photographs(tmp_path)
    _, _, unmeasured = chart_table(pairs, {"size": scene.corners})
    assert [pair.name for pair in pairs] == ["bad", "good", "single", "size"]
    reasons = {path.name: reason for path, reason in (problems | unmeasured).items() if path.name != "good.jpg"}
    assert reasons == {
        "alone.jpg": "alone.jpg has no RAW file of the same name",
        "single.dng": "single.dng holds no preview; put the camera's JPEG of the same name beside it",
        **{name: f"{name} has more than one partner among two.dng, two.jpg, two.nef"
           for name in ("two.dng", "two.jpg", "two.nef")},
        "bad.jpg": "bad.jpg is not a readable JPEG, PNG, TIFF, HEIC, AVIF or WebP file; "
                   "use a complete one, of whole numbers of 8 or 16 bits",
        "size.jpg": "size.jpg is 320 x 240 and size.dng is 96 x 64 pixels; "
                    "use the JPEG of the same photograph, neither resized nor turned",
    }  # fmt: skip


def test_labels_of_no_photograph_are_named(photographs):
    _, pairs = photographs
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    for labels, named in (({"other": corners}, "other"), ({}, "no photograph")):
        with pytest.raises(InputError, match=f"the labels are of {named}; use labels of e 1, e 2, empty"):
            chart_table(pairs, labels)
    _, measured, _ = chart_table(pairs[:1], {"e 1.jpg": chart_table(pairs[:1])[1]["e 1"].corners})
    assert list(measured) == ["e 1"], "the name of the file does too"


def test_given_files_of_another_kind_are_named(tmp_path):
    pairs, problems = pair_photographs([tmp_path / "a.txt"])
    assert pairs == []
    assert "a.txt is neither RAW nor JPEG" in next(iter(problems.values()))
    assert "nowhere is neither RAW nor" in pair_photographs(tmp_path / "nowhere")[1][tmp_path / "nowhere"]


# --- labels


@st.composite
def quadrangles(draw):
    """Corners clockwise from anywhere on, on the four sides of a rectangle inside the image."""
    fractions = st.floats(0.05, 0.45)
    low, high = np.array([draw(fractions), draw(fractions)]), 1 - np.array([draw(fractions), draw(fractions)])
    corners = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
    return np.roll(corners, draw(st.integers(0, 3)), axis=0)


@given(st.dictionaries(st.text(st.characters(exclude_categories=()), min_size=1), quadrangles(), max_size=5))
def test_labels_come_back(tmp_path_factory, labels):
    path = tmp_path_factory.mktemp("labels") / "метки.json"
    save_labels(path, labels)
    loaded = load_labels(path)
    assert list(loaded) == sorted(labels)
    for name, corners in labels.items():
        np.testing.assert_array_equal(loaded[name], corners)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(["version", "labels", "photograph", "corners"]), inner)
    ),
    max_leaves=20,
)


@given(json_values | st.builds(lambda labels: {"version": 1, "labels": labels}, json_values))
def test_other_json_is_refused_or_valid(tmp_path_factory, document):
    path = tmp_path_factory.mktemp("labels") / "a.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    try:
        assert load_labels(path) == {}
    except FormatError as error:
        assert str(error).startswith("a.json holds no labels of version 1")  # noqa: PT017


LABEL = {"photograph": "a", "corners": [[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]]}


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff\xfe",
        b"[" * 100_000,
        json.dumps({"version": 2, "labels": []}).encode(),
        json.dumps({"version": True, "labels": []}).encode(),
        json.dumps({"version": 1, "labels": [LABEL, LABEL]}).encode(),
        b'{"version": 1, "version": 1, "labels": []}',
        json.dumps({"version": 1, "labels": [LABEL | {"photograph": ""}]}).encode(),
        json.dumps({"version": 1, "labels": [LABEL | {"more": 1}]}).encode(),
        *(
            json.dumps({"version": 1, "labels": [LABEL | {"corners": corners}]}).encode()
            for corners in (
                None,
                [[0.1, 0.1]] * 4,
                LABEL["corners"][::-1],
                LABEL["corners"][:3],
                [*LABEL["corners"][:3], [0.1, "0.9"]],
                [*LABEL["corners"][:3], [0.1, True]],
                [*LABEL["corners"][:3], [0.1, 1.01]],
                [*LABEL["corners"][:3], [0.1, float("nan")]],
                [*LABEL["corners"][:3], [0.1, 10**400]],
                [[0.1, 0.1], [0.9, 0.9], [0.9, 0.1], [0.1, 0.9]],
                [[0.1, 0.1], [0.9, 0.1], [0.3, 0.3], [0.1, 0.9]],
            )
        ),
    ],
)
def test_damaged_labels(tmp_path, content):
    path = tmp_path / "labels.json"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=r"^labels\.json holds no labels of version 1"):
        load_labels(path)


def test_labels_that_cannot_be_are_not_saved(tmp_path):
    path = tmp_path / "labels.json"
    for labels in ({"a": LABEL["corners"][::-1]}, {"": LABEL["corners"]}, {"a": "corner"}):
        with pytest.raises(InputError, match=r"; (list|use)"):
            save_labels(path, labels)
    assert not path.exists()
    with pytest.raises(FormatError, match=r"labels\.json cannot be read"):
        load_labels(path)


# --- the table


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    """Two exposures a stop apart, and one photograph without a chart."""
    folder = tmp_path_factory.mktemp("photographs")
    for step, name in enumerate(("e 1", "e 2")):
        lit = render_chart(GAMMA, 1, exposure=0.4 * 2**step)
        write_pair(folder, name, lit, exposure_time=0.01 * 2**step, model="Camera")
    empty = render_chart(GAMMA, 1, size=(96, 64))
    write_pair(folder, "empty", empty)
    return folder, pair_photographs(folder)[0]


def test_table(photographs):
    _, pairs = photographs
    frame, measured, problems = chart_table(pairs)
    assert [reason[:27] for reason in problems.values()] == ["empty.jpg: no chart of 24 p"]
    assert list(measured) == ["e 1", "e 2"]
    assert frame["patch"].tolist() == [*range(1, 25)] * 2
    assert frame["photograph"].tolist() == ["e 1"] * 24 + ["e 2"] * 24
    assert set(frame["camera"]) == {"Camera"}
    np.testing.assert_allclose(frame["exposure_step"], np.repeat([0.0, 1.0], 24), atol=1e-6)
    assert set(load_patches().columns) - set(frame.columns) == {"illumination", "exposure"}
    intensity = patch_intensity(frame)
    light = intensity.pivot_table(index="patch", columns="photograph", values="raw")
    np.testing.assert_allclose(light["e 2"] / light["e 1"], 2.0, rtol=0.02)


def test_a_photograph_without_two_patches_unclipped_is_named(tmp_path):
    scene = render_chart(GAMMA, 1, exposure=0.4)
    write_pair(tmp_path, "burnt", replace(scene, raw=np.ones_like(scene.raw)))
    _, measured, problems = chart_table(pair_photographs(tmp_path)[0])
    assert not measured
    assert next(iter(problems.values())) == "burnt.jpg: 24 of 24 patches are clipped; use another exposure"


def test_jpeg_patches_follow_the_response_to_raw_patches(photographs):
    """What calibration rests on: in every channel the JPEG patch is the response at the RAW patch."""
    frame = chart_table(photographs[1])[0]
    raw, jpeg = (frame[[f"{kind}_{channel}" for channel in "rgb"]].to_numpy() for kind in ("raw", "jpeg"))
    kept = (frame["raw_clipped"] < 0.02) & (frame["jpeg_clipped"] < 0.02)
    assert kept.sum() > 30
    error = np.abs(evaluate(GAMMA, raw[kept].ravel()) - jpeg[kept].ravel())
    assert error.mean() < 1 / 255
    assert error.max() < 5 / 255


def test_a_chart_is_tried_where_the_surest_lies(tmp_path):
    """Blur hides the gaps from the detector, not the patches; where there is no chart, none is taken."""
    scene = render_chart(GAMMA, 1)
    blurred = cv2.GaussianBlur(scene.jpeg, (0, 0), 10)
    images = {"a.png": blurred, "b.png": scene.jpeg, "c.png": render_chart(GAMMA, 5, turn=120).jpeg[::-1]}
    for name, image in images.items():
        cv2.imwrite(str(tmp_path / name), image[..., ::-1])
    with pytest.raises(InputError, match="no chart"):
        find_chart((blurred / 255).astype(np.float32))
    _, measured, problems = chart_table(pair_photographs(tmp_path)[0])
    assert list(measured) == ["a", "b"]
    np.testing.assert_array_equal(measured["a"].corners, measured["b"].corners)
    assert np.abs(measured["a"].jpeg.means - measured["b"].jpeg.means).max() < 0.05
    assert list(problems.values()) == [
        "c.png: no chart of 24 patches was found in the photograph (the nearest is mirrored); "
        "label its four corners by hand"
    ]
    (tmp_path / "b.png").unlink()
    labelled = chart_table(pair_photographs(tmp_path)[0], {"a": scene.corners})[1]
    assert list(labelled) == ["a"]


def test_labels_take_the_place_of_finding(photographs):
    folder, pairs = photographs
    corners = render_chart(GAMMA, 1).corners
    frame = chart_table([Pair("e 1", pairs[0].jpeg)], {"e 1": np.roll(corners, 1, axis=0)})[0]
    found = measure_photograph(pairs[0].jpeg, pairs[0].raw, corners)
    np.testing.assert_allclose(frame[["jpeg_r", "jpeg_g", "jpeg_b"]], found.jpeg.means)
    assert frame["raw_r"].isna().all()
    patches, _, problems = chart_table([Pair("e 1", folder / "e 1.jpg")], {"e 1": LABEL["corners"]})
    assert patches.empty
    assert "the patches are not a chart's" in next(iter(problems.values()))


def test_a_raw_file_of_another_size_is_refused(photographs):
    folder, _ = photographs
    with pytest.raises(FormatError, match=r"e 1\.jpg is 640 x 480 and empty\.dng is 96 x 64 pixels"):
        measure_photograph(folder / "e 1.jpg", folder / "empty.dng")


def test_no_photographs_make_an_empty_table():
    patches, measured, problems = chart_table([])
    assert patches.empty
    assert "jpeg_r" in patches.columns
    assert (measured, problems) == ({}, {})


# --- what scatters


def scattering(dark, photographs=4):
    """See 24 patches through a gamma, the darkest readings with that standard deviation of their brightness."""
    light = np.geomspace(0.2, 0.9, 24) * 2.0 ** -np.arange(photographs)[:, None]
    bright = light ** (1 / 2.2)
    noise = np.random.default_rng(2).standard_normal(bright.shape)
    return Observations(bright + np.where(bright < 0.3, dark, 0.004) * noise, light[0])


def test_readings_that_scatter_more_count_less():
    found = calibrate(load_model("Gamma-1"), scattering(0.04))
    weights, b = weighed_by_scatter(found).weights[0], found.observations.brightness[0]
    assert weights[b < 0.3].max() < 0.5
    assert weights[b > 0.4].min() > 0.7
    assert weights.max() == 1.0


def test_one_photograph_tells_no_scatter():
    found = calibrate(load_model("Gamma-1"), scattering(0.04, photographs=1))
    np.testing.assert_allclose(weighed_by_scatter(found).weights, 1.0)


def test_an_error_of_the_reference_is_no_scatter():
    seen = scattering(0.0)
    wrong = Observations(seen.brightness, seen.reference * np.where(np.arange(24) < 12, 1.5, 1.0))
    weights = weighed_by_scatter(calibrate(load_model("Gamma-1"), wrong)).weights
    assert weights.min() > 0.4
