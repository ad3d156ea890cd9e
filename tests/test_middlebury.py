"""The patch table: bundled, checked, and measured again from images."""

import json

import cv2
import numpy as np
import pandas as pd
import pytest
from build_patches import measure_patches, parse_boxes

from crfbench.datasets import load_patches, middlebury
from crfbench.datasets.middlebury import COLUMNS, REFERENCE_IRRADIANCE, patch_intensity
from crfbench.errors import FormatError, MissingDataError

BOX = {"position": {"x": 0.1, "y": 0.35}, "rect": {"x": 60, "y": 60}}


def tags(references) -> str:
    return json.dumps([{"imagePath": "any.png", "references": references}])


def grid_tags() -> str:
    positions = [(0.05 + 0.16 * column, 0.1 + 0.25 * row) for row in range(4) for column in range(6)]
    return tags([{"position": {"x": x, "y": y}, "rect": {"x": 60, "y": 60}} for x, y in positions])


def write_chart(path, offset):
    """Write 24 flat patches in red, green, blue; patch p has red p, green 2 p and blue 100, plus an offset."""
    red = np.repeat(np.repeat(np.arange(24).reshape(4, 6), 65, axis=0), 65, axis=1)
    chart = np.stack([red, 2 * red, np.full_like(red, 100)], axis=2) + offset
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), chart[:, :, ::-1].astype(np.uint8))


@pytest.fixture
def images(tmp_path):
    (tmp_path / "tags.json").write_text(grid_tags())
    for camera in ("B", "A"):
        for illumination in (1, 2):
            for exposure in (1, 2, 3, 4):
                stem = tmp_path / camera / f"wb1i{illumination}e{exposure}"
                write_chart(stem.with_name(f"{stem.name}-jpg.png"), 1 + 10 * illumination + exposure)
                write_chart(stem.with_name(f"{stem.name}-raw.png"), 0)
    return tmp_path


# --- the bundled table


def test_bundled_table():
    frame = load_patches()
    assert tuple(frame.columns) == COLUMNS
    assert len(frame) == 14 * 8 * 24
    pd.testing.assert_frame_equal(frame, frame.sort_values(list(middlebury.KEYS), ignore_index=True))


def test_exposures_brighten():
    intensity = patch_intensity(load_patches()).groupby(["camera", "illumination", "exposure"])[["jpeg", "raw"]].mean()
    steps = intensity.groupby(level=["camera", "illumination"]).diff().dropna()
    assert (steps > 0).all(axis=None)


def test_reference_follows_raw():
    """RAW is linear, so over all cameras it must follow the reference: this holds the order of the patches."""
    frame = patch_intensity(load_patches())
    raw = frame[frame["exposure"] == 2].pivot_table(index="patch", columns="camera", values="raw").to_numpy()
    assert np.corrcoef(raw.mean(axis=1), REFERENCE_IRRADIANCE)[0, 1] > 0.98
    assert REFERENCE_IRRADIANCE.shape == (24,)
    assert not REFERENCE_IRRADIANCE.flags.writeable


def damage(frame, how):
    if how == "column":
        return frame.drop(columns="raw_g")
    if how == "row":
        return frame.drop(index=7)
    if how == "double":
        return pd.concat([frame.drop(index=7), frame.loc[[8]]])
    return frame.assign(raw_g=1.5 if how == "range" else np.nan)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("column", "has the columns camera, .*; use camera"),
        ("row", "has 2687 rows"),
        ("double", "has 2688 rows"),
        ("range", r"outside \[0, 1\]"),
        ("nan", r"outside \[0, 1\]"),
    ],
)
def test_damaged_table(monkeypatch, tmp_path, how, message):
    path = tmp_path / "patches.csv"
    damage(load_patches(), how).to_csv(path, index=False)
    monkeypatch.setattr(middlebury, "bundled", lambda name: path)
    with pytest.raises(FormatError, match=message):
        load_patches()


@pytest.mark.parametrize(
    "content", [b"", b"\xff\xfe\x00", (",".join(COLUMNS) + "\nA,1,1,1,x,0,0,0,0,0,0,0").encode(), b'a,b\n1,2,3,4\n"x']
)
def test_unreadable_table(monkeypatch, tmp_path, content):
    path = tmp_path / "patches.csv"
    path.write_bytes(content)
    monkeypatch.setattr(middlebury, "bundled", lambda name: path)
    with pytest.raises(FormatError):
        load_patches()


# --- measuring


def test_measured_values_of_a_drawn_chart(images):
    frame = measure_patches(images)
    assert len(frame) == 2 * 8 * 24
    assert frame["camera"].unique().tolist() == ["A", "B"]
    first = frame.query("camera == 'A' and illumination == 2 and exposure == 3").set_index("patch")
    patch = first.index.to_numpy() - 1
    np.testing.assert_allclose(first["jpeg_r"], (patch + 24) / 255, atol=1e-6)
    np.testing.assert_allclose(first["jpeg_g"], (2 * patch + 24) / 255, atol=1e-6)
    np.testing.assert_allclose(first["jpeg_b"], 124 / 255, atol=1e-6)
    assert first["raw_clipped"].tolist() == [1.0] + [0.0] * 23
    assert (first["jpeg_clipped"] == 0).all()


def test_clipping_counts_pixels(images):
    path = images / "A" / "wb1i1e1-jpg.png"
    chart = np.full((260, 390, 3), 100, np.uint8)
    chart[26:29, 19:24, 0] = 254
    chart[29, 19, 1] = 0
    chart[30, 19, 2] = 253
    cv2.imwrite(str(path), chart)
    frame = measure_patches(images)
    assert frame["jpeg_clipped"][0] == round(16 / (23 * 15), 6)


def test_missing_photograph(images):
    (images / "B" / "wb1i2e4-raw.png").unlink()
    with pytest.raises(MissingDataError, match=r"wb1i2e4-raw\.png is missing; run 'crfbench fetch middlebury'"):
        measure_patches(images)


def test_missing_folder(tmp_path):
    with pytest.raises(MissingDataError, match=r"tags\.json is missing"):
        measure_patches(tmp_path / "nowhere")


def test_no_camera(tmp_path):
    (tmp_path / "tags.json").write_text(grid_tags())
    with pytest.raises(MissingDataError, match="holds no camera"):
        measure_patches(tmp_path)


def test_unreadable_photograph(images):
    (images / "B" / "wb1i2e4-raw.png").write_bytes(b"no image")
    with pytest.raises(FormatError, match="not a readable image"):
        measure_patches(images)


def test_position_is_the_top_left_corner():
    assert parse_boxes(tags([BOX] * 24), 390, 260)[0] == (39, 91, 23, 15)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        "null",
        "[1]",
        "[" * 100_000,
        tags([]),
        tags([BOX] * 23),
        tags([{"position": {"x": 0.1}, "rect": {"x": 60, "y": 60}}] * 24),
        tags([BOX | {"position": {"x": "left", "y": 0.1}}] * 24),
        tags([BOX | {"position": {"x": 0.99, "y": 0.1}}] * 24),
        tags([BOX | {"position": {"x": -0.1, "y": 0.1}}] * 24),
        tags([BOX | {"position": {"x": float("nan"), "y": 0.1}}] * 24),
        tags([BOX | {"position": {"x": float("inf"), "y": 0.1}}] * 24),
        tags([BOX | {"rect": {"x": 0, "y": 60}}] * 24),
    ],
)
def test_bad_tags(text):
    with pytest.raises(FormatError, match=r"tags\.json"):
        parse_boxes(text, 390, 260)


@pytest.mark.middlebury
def test_measured_again_equals_bundled(middlebury_folder):
    pd.testing.assert_frame_equal(measure_patches(middlebury_folder), load_patches(), check_exact=True)
