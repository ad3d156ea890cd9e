"""From files to a passport: synthetic cameras of known response, and what goes wrong with files."""

import hashlib
import json
import os
import re
import shutil
import stat
import tempfile
from dataclasses import replace
from itertools import islice
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
import pytest
import tifffile
from PIL import Image

mpl.use("agg")
import matplotlib.pyplot as plt

from crfbench import camera
from crfbench.camera import outputs
from crfbench.camera.measuring import chart_table, observe_chart, separate
from crfbench.camera.photographs import pair_photographs
from crfbench.camera.series import calibrate_series, reduce_photograph
from crfbench.camera.worker import WORKER
from crfbench.curves import GRID, invert
from crfbench.datasets import load_opencrf
from crfbench.datasets.chart import N_PATCHES, chart_boxes, save_labels
from crfbench.errors import InputError
from crfbench.metrics import rmse
from crfbench.models import DEFAULT_MODEL
from tests.support.command import run_command
from tests.support.photographs import write_pair
from tests.support.scenes import render_chart

EXPOSURES = (0.15, 0.4, 1.1)
KNOWN = 70


@pytest.fixture(scope="module")
def truth():
    return load_opencrf().curves[KNOWN]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, truth):
    """Three RAW and JPEG pairs with a name that is neither short nor Latin."""
    folder = tmp_path_factory.mktemp("my photos ü 写真")
    for i, exposure in enumerate(EXPOSURES):
        scene = render_chart(truth, seed=i, size=(480, 360), exposure=exposure)
        write_pair(folder, f"写真 {i}", scene, exposure_time=0.01 * exposure)
    (folder / "notes.txt").write_text("not a photograph")
    (folder / "broken.jpg").write_bytes((folder / "写真 0.jpg").read_bytes()[:3000])
    return folder


@pytest.fixture(scope="module")
def result(folder):
    return camera.calibrate(folder, created="2026-01-31")


def test_a_known_response_comes_back(result, truth):
    assert rmse(result.calibration.responses[0], truth) < 0.02
    assert rmse(result.passport.in_direction("forward")[0], truth) < 0.02
    assert (result.passport.low <= result.passport.curves).all()
    assert result.passport.camera
    assert result.passport.created == "2026-01-31"


def test_the_broken_file_is_named_and_the_rest_goes_on(result):
    assert list(result.photographs) == [f"写真 {i}" for i in range(3)]
    assert [path.name for path in result.problems] == ["broken.jpg"]


def test_without_raw_files_the_chart_and_exif_do(folder, truth):
    result = camera.calibrate(sorted(folder.glob("写真*.jpg")), exposures="exif")
    assert result.calibration.observations.absolute is False
    np.testing.assert_allclose(
        np.diff(result.calibration.observations.exposures[0]), np.diff(np.log2(EXPOSURES)), atol=0.02
    )
    assert rmse(result.calibration.responses[0], truth) < 0.05


def test_exposures_by_hand_and_corners_by_hand(folder, tmp_path, result):
    jpegs = sorted(folder.glob("写真*.jpg"))
    save_labels(tmp_path / "labels.json", {name: measured.corners for name, measured in result.measured.items()})
    by_hand = camera.calibrate(jpegs, tmp_path / "labels.json", exposures=[15, 40, 110])
    np.testing.assert_allclose(by_hand.calibration.observations.exposures[0], np.log2([1, 40 / 15, 110 / 15]))
    with pytest.raises(InputError, match=r"exposures=\[1.0, 2.0\] do not match 3 photographs \(写真 0"):
        camera.calibrate(jpegs, exposures=[1, 2])


def test_a_folder_without_a_chart_says_what_to_do(tmp_path):
    with pytest.raises(InputError, match=r"no photograph with a chart is left .*ChartLabeller, or .* --chart none"):
        camera.calibrate(tmp_path)
    for arrays in (None, [np.zeros((4, 4))]):
        with pytest.raises(InputError, match="use a folder or files, and calibrate_series for arrays"):
            camera.calibrate(arrays)
    with pytest.raises(InputError, match=r"there is no .*nowhere"):
        camera.calibrate(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"there is no .*nowhere"):
        camera.calibrate(path for path in [tmp_path / "nowhere"])
    with pytest.raises(InputError, match="0 photographs of a series left"):
        camera.calibrate(tmp_path, chart="none")


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ("magic", "model='magic' is not a valid name of a model"),
        ("SLR-ldl-7", "no model 'SLR-ldl-7' is bundled; use one of SLR-"),
        ("SLR-ldl-3-forward", "has direction 'forward'; use one of direction 'inverse'"),
    ],
)
def test_models_that_cannot_calibrate(tmp_path, model, message):
    for chart in ("auto", "none"):
        with pytest.raises(InputError, match=message):
            camera.calibrate(tmp_path, chart, model=model)


def test_raw_intensities_are_patches_times_exposures():
    rng = np.random.default_rng(0)
    light, exposure = rng.uniform(0.01, 0.4, 24), np.array([1.0, 2.0, 0.25])
    raw = light * exposure[:, None]
    clipped = rng.uniform(size=raw.shape) < 0.2
    clipped[:, 3] = True
    irradiance, stops = separate(np.where(clipped, 0.9, raw), clipped)
    first = irradiance[0] / light[0]
    measured = np.arange(24) != 3
    np.testing.assert_allclose(irradiance[measured], first * light[measured], rtol=1e-3)
    np.testing.assert_allclose(stops, np.log2(exposure), atol=2e-3)
    assert irradiance[3] == 0.0


def test_raw_and_chart_agree_on_a_neutral_camera(folder):
    patches = chart_table(pair_photographs(sorted(folder.glob("写真*")))[0])[0]
    raw = observe_chart(patches)
    chart = observe_chart(patches.assign(**{c: np.nan for c in patches if c.startswith("raw")}))
    greys = slice(18, 23)
    ratio = raw.reference[0, greys] / chart.reference[0, greys]
    np.testing.assert_allclose(ratio / ratio.mean(), 1.0, atol=0.15)


def test_exposures_that_contradict_the_photographs_can_be_estimated(tmp_path):
    series = camera.render_series(GRID ** (1 / 2.2), 4, size=(96, 64))
    for name, image in zip("abcde", series.images, strict=True):
        cv2.imwrite(str(tmp_path / f"{name}.png"), image[..., ::-1])
    wrong = camera.calibrate(tmp_path, "none", [1, 2, 16, 32, 64])
    assert "--exposures estimate" in wrong.warnings[-1]
    assert any(text.startswith("c.png is ") and "its exposure says 3.0" in text for text in wrong.warnings)
    right = camera.calibrate(tmp_path, "none", "estimate")
    assert not any("stops" in text for text in right.warnings)
    stops = right.calibration.observations.exposures[0]
    np.testing.assert_allclose(np.diff(stops), np.diff(stops).mean(), atol=0.15)
    light = right.merged.radiance[right.merged.weight > 0]
    assert np.isfinite(light).all()


def test_without_raw_files_the_chart_estimates_the_exposures(folder, tmp_path):
    for path in sorted(folder.glob("*.jpg")):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    found = camera.calibrate(tmp_path, exposures="estimate")
    assert found.calibration.observations.exposures is None


def jpegs(result):
    return sorted(result.photographs.values())


def digest_of(paths):
    return hashlib.sha256(b"".join(hashlib.sha256(path.read_bytes()).digest() for path in paths)).hexdigest()


@pytest.fixture(scope="module")
def written(result, tmp_path_factory):
    """Write the outputs once, into a folder; no figure may stay open, which a notebook would show."""
    folder, before = tmp_path_factory.mktemp("written"), plt.get_fignums()
    list(camera.write_outputs(result, folder))
    assert plt.get_fignums() == before
    return folder


def test_outputs_are_complete_and_never_replaced_unasked(result, written, tmp_path, truth):
    tmp_path = Path(shutil.copytree(written, tmp_path / "out"))
    names = {path.name for path in tmp_path.iterdir()}
    assert {"passport.json", "response.csv", "response.cube", "report.html"} <= names
    passport = camera.read_response(tmp_path / "passport.json")
    assert passport.data_sha256 == digest_of(
        path.with_suffix(end) for path in jpegs(result) for end in (".dng", ".jpg")
    )
    assert passport.model == DEFAULT_MODEL
    for name in ("response.csv", "response.npy", "response.cube"):
        assert rmse(camera.read_response(tmp_path / name).in_direction("forward")[0], truth) < 0.02
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(InputError, match=r"exists already.*--force"):
        list(camera.write_outputs(result, tmp_path))
    assert before == {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    list(camera.write_outputs(result, tmp_path, overwrite=True))


def test_the_report_asks_for_nothing_elsewhere(written):
    page = (written / "report.html").read_text()
    assert not re.findall(r'(?:src|href)="(?!data:)', page)
    assert page.count("<img alt=") == 7  # curve and residuals of three channels, and the chart
    assert "broken.jpg" in page


def test_a_linearised_photograph_is_straight_against_its_raw_file(result):
    for name in result.measured:
        patches = camera.linearised_patches(result, name)
        assert rmse(patches["linear"], patches["raw"]) < 0.2 * rmse(patches["jpeg"], patches["raw"])
        assert (patches["jpeg"] < 254 / 255).all()
    with pytest.raises(InputError, match="name='broken' is not a photograph with a chart"):
        camera.linearised_patches(result, "broken")


def test_without_raw_files_there_is_nothing_to_be_straight_against(folder):
    result = camera.calibrate(sorted(folder.glob("写真*.jpg")))
    patches = camera.linearised_patches(result, "写真 0")
    assert patches["raw"].isna().all()
    assert patches["linear"].between(0, 1).all()


def test_boxes_lie_where_the_corners_say():
    corners = np.array([(0.1, 0.1), (0.9, 0.1), (0.9, 0.8), (0.1, 0.8)])
    boxes = chart_boxes(corners)
    assert boxes.shape == (N_PATCHES, 4, 2)
    np.testing.assert_allclose([boxes[0, 0], boxes[5, 1], boxes[23, 2], boxes[18, 3]], corners, atol=1e-6)


def test_one_command_goes_from_files_to_passport(folder, tmp_path):
    out = tmp_path / "out folder"
    done = run_command("calibrate", folder, "--out", out)
    assert done.returncode == 0, done.stderr
    assert "left out: broken.jpg" in done.stderr
    assert "measured from brightness" in done.stdout
    assert json.loads((out / "passport.json").read_text())
    again = run_command("calibrate", folder, "--out", out)
    assert again.returncode == 2
    assert "--force" in again.stderr


def test_exposures_alone_and_their_use(tmp_path, truth):
    series = camera.render_series(truth, 1, size=(96, 64))
    folder = tmp_path / "series"
    folder.mkdir()
    for i, image in enumerate(series.images):
        assert cv2.imwrite(str(folder / f"{i}.png"), image[..., ::-1])
    times = ",".join(str(2.0**stop) for stop in series.stops)
    done = run_command("calibrate", folder, "--chart", "none", "--exposures", times, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    curves, inverse = camera.read_response(tmp_path / "out" / "passport.json").curves, invert(truth)
    assert len(curves) == 3
    for curve in curves:
        scale = (curve @ inverse) / (curve @ curve)
        assert rmse(scale * curve, inverse) < 0.02
    assert (tmp_path / "out" / "merged.exr").stat().st_size > 1000
    linear = tmp_path / "linear.tif"
    args = ("linearise", folder / "1.png", "--response", tmp_path / "out" / "passport.json", "--out", linear)
    assert run_command(*args).returncode == 0
    pixels = tifffile.imread(linear)
    channels = zip(np.moveaxis(series.images[1], 2, 0) / 255, curves, strict=True)
    expected = np.stack([np.interp(values, GRID, curve) for values, curve in channels], axis=-1)
    np.testing.assert_allclose(pixels, expected, atol=1e-5)
    again = run_command(*args)
    assert again.returncode == 2
    assert "--force" in again.stderr


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_of_two_processes_with_one_folder_the_second_leaves_it_to_the_first(result, tmp_path, monkeypatch):
    """The first begins to write while the second draws its report, or before the second looks."""

    def meanwhile(drawn):
        if drawn is second:
            begun.append(next(first))
        return drawn.passport.camera

    monkeypatch.setattr(outputs, "report_page", meanwhile)
    second = replace(result, passport=replace(result.passport, camera="another"))
    out, alone = tmp_path / "out", tmp_path / "alone"
    first, begun = camera.write_outputs(result, out), []
    for _ in range(2):
        with pytest.raises(InputError, match=r"passport\.json exists already.*--force"):
            list(camera.write_outputs(second, out))
    assert [path.name for path in (*begun, *first)] == [path.name for path in camera.write_outputs(result, alone)]
    assert contents(out) == contents(alone)


def test_what_a_killed_process_wrote_is_complete_and_force_writes_the_rest(result, tmp_path, monkeypatch):
    monkeypatch.setattr(outputs, "report_page", lambda drawn: "drawn")
    out, alone = tmp_path / "out", tmp_path / "alone"
    names = [path.name for path in camera.write_outputs(result, alone)]
    list(islice(camera.write_outputs(result, out), 3))  # and nothing after the third file
    assert contents(out) == {name: (alone / name).read_bytes() for name in names[:3]}
    list(camera.write_outputs(result, out, overwrite=True))
    assert contents(out) == contents(alone)


@pytest.mark.skipif(os.name == "nt", reason="limits of a process are set another way")
@pytest.mark.parametrize("target", ["out", "a.exr", "a.hdr", "a.tif", "a.cube"])
def test_a_full_disk_leaves_nothing_half_written(folder, written, tmp_path, monkeypatch, target):
    import resource

    out, passport = tmp_path / target, written / "passport.json"
    arguments = {
        "out": ("calibrate", folder, "--out", out),
        "a.cube": ("convert", passport, out),
    }.get(target, ("linearise", folder / "写真 0.jpg", "--response", passport, "--out", out))
    aside = tmp_path / "aside"
    aside.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(aside))
    monkeypatch.setenv("OPENCV_TEMP_PATH", str(aside))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))  # what is larger fails as on a full disk
    try:
        done = run_command(*arguments)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        WORKER.close()  # one that started meanwhile has the same limit
    assert done.returncode == 2
    assert re.search("File too large|No space left|cannot be used: .*writ", done.stderr)
    assert "Traceback" not in done.stderr
    assert target == "out" or not out.exists()
    assert target == "a.hdr" or list(aside.iterdir()) == []  # there OpenCV leaves what it wrote aside itself
    left = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert all(path.stat().st_size <= 20_000 and not path.name.startswith(".") for path in left)


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="the system lets this user write anywhere")
def test_a_read_only_folder_is_named(result, tmp_path):
    tmp_path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.raises(PermissionError):
        list(camera.write_outputs(result, tmp_path))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--exposures", "a,b"), "times above 0 such as 0.5 or 1/60"),
        (("--exposures", "1,2,4"), "RAW files tell them better"),
        (("--model", "x"), "SLR-ldl-1"),
        (("--chart", "no.json"), "no.json"),
    ],
)
def test_mistakes_are_one_sentence_and_status_2(folder, tmp_path, arguments, words):
    done = run_command("calibrate", folder, "--out", tmp_path / "out", *arguments)
    assert done.returncode == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_the_band_of_a_series_allows_for_where_white_lies(tmp_path):
    """Exposures do not tell the scale, and lossy files leave white uneven."""
    response = np.where(GRID <= 0.0031308, 12.92 * GRID, 1.055 * np.maximum(GRID, 1e-9) ** (1 / 2.4) - 0.055)
    series, truth, held = camera.render_series(response, 2, size=(480, 320), stops=range(-3, 4)), invert(response), []
    for i, image in enumerate(series.images):
        Image.fromarray(image).save(tmp_path / f"{i}.jpg", quality=95)
    result = camera.calibrate(tmp_path, "none", (2.0**series.stops).tolist())
    shape = calibrate_series([reduce_photograph(tmp_path / f"{i}.jpg") for i in range(7)], series.stops)
    for low, high in ((result.passport.low, result.passport.high), shape.bands[0.9]):
        held.append(np.mean((low <= truth) & (truth <= high)))
    assert held[0] > 0.95 > held[1]
