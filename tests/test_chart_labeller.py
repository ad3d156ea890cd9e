"""The Python side of ChartLabeller; tests/test_browser drives it on a page."""

import json

import cv2
import ipywidgets
import numpy as np
import pytest

from crfbench.datasets.chart import load_labels
from crfbench.errors import FormatError, InputError, MissingDataError
from crfbench.widgets import ChartLabeller

CORNERS = np.array([(0.1, 0.2), (0.9, 0.15), (0.85, 0.8), (0.12, 0.75)])
WIDE = np.random.default_rng(0).integers(256, size=(30, 50, 3), dtype=np.uint8)
TALL = np.full((3000, 1500, 3), (200, 100, 50), np.uint8)


@pytest.fixture
def labeller():
    return ChartLabeller({"wide": WIDE, "tall": TALL})


def shown(labeller):
    return cv2.imdecode(np.frombuffer(labeller._picture["jpeg"], np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


def test_the_page_gets_one_photograph_at_a_time_and_a_light_one(labeller):
    assert {key: labeller._picture[key] for key in ("index", "name", "width", "height")} == {
        "index": 0, "name": "wide", "width": 50, "height": 30,
    }  # fmt: skip
    assert shown(labeller).shape == (30, 50, 3)
    labeller.index = 1
    assert (labeller._picture["name"], labeller._picture["width"], labeller._picture["height"]) == ("tall", 1500, 3000)
    assert shown(labeller).shape == (1200, 600, 3)
    assert np.abs(shown(labeller).mean(axis=(0, 1)) - (200, 100, 50)).max() < 2, "red stays red"


def test_files_are_shown_upright(tmp_path):
    ok = cv2.imwrite(str(tmp_path / "a.png"), TALL[..., ::-1])
    assert ok
    labeller = ChartLabeller({"a": tmp_path / "a.png", "b": str(tmp_path / "a.png")})
    assert np.abs(shown(labeller).mean(axis=(0, 1)) - (200, 100, 50)).max() < 2


def test_labels_are_saved_and_read_into_another(labeller, tmp_path):
    path = tmp_path / "labels.json"
    labeller.labels = {"wide": CORNERS, "elsewhere": np.roll(CORNERS, 1, axis=0)}
    assert repr(labeller) == "ChartLabeller(2 photographs, 1 labelled)"
    labeller.save(path)
    content = json.loads(path.read_text())
    assert content["version"] == 1
    assert {"photograph": "wide", "corners": CORNERS.tolist()} in content["labels"]
    fresh = ChartLabeller({"wide": WIDE})
    assert fresh.labels == {}
    fresh.load(path)
    assert set(fresh.labels) == {"wide", "elsewhere"}
    np.testing.assert_array_equal(fresh.labels["wide"], CORNERS)
    with pytest.raises(InputError, match=r"labels\.json exists already"):
        fresh.save(path)
    fresh.labels = {}
    fresh.save(path, overwrite=True)
    assert load_labels(path) == {}


def test_labels_given_out_are_read_only(labeller):
    given = CORNERS.copy()
    labeller.labels = {"wide": given}
    given[:] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        labeller.labels["wide"][:] = 0.0
    with pytest.raises(TypeError, match="item assignment"):
        labeller.labels["tall"] = CORNERS
    np.testing.assert_array_equal(labeller.labels["wide"], CORNERS)


def test_labels_and_index_of_the_page_are_heard_of(labeller):
    heard = []
    labeller.observe(lambda change: heard.append(change.name), ["labels", "index"])
    labeller.set_state({"labels": {"tall": CORNERS.tolist()}, "index": 1})
    assert sorted(heard) == ["index", "labels"]
    np.testing.assert_array_equal(labeller.labels["tall"], CORNERS)
    assert labeller._picture["name"] == "tall"
    assert labeller.get_state("labels") == {"labels": {"tall": CORNERS.tolist()}}


def test_labels_are_linked_to_another_labeller(labeller):
    other = ChartLabeller({"wide": WIDE})
    ipywidgets.link((labeller, "labels"), (other, "labels"))
    other.labels = {"wide": CORNERS}
    np.testing.assert_array_equal(labeller.labels["wide"], CORNERS)


@pytest.mark.parametrize("index", [-1, 2, 0.5, True, "wide"])
def test_an_index_of_no_photograph_changes_nothing(labeller, index):
    with pytest.raises(InputError, match=f"index={index!r} is out of range; use a whole number from 0 to 1"):
        labeller.index = index
    assert labeller.index == 0


@pytest.mark.parametrize("corners", [CORNERS[:3], CORNERS + 0.2, CORNERS * np.nan, "abcd", [[10**400] * 2] * 4])
def test_labels_that_are_not_valid_change_nothing(labeller, corners):
    labeller.labels = {"wide": CORNERS}
    with pytest.raises(InputError, match="corners="):
        labeller.labels = {"tall": corners}
    assert list(labeller.labels) == ["wide"]


@pytest.mark.parametrize(
    ("images", "error", "message"),
    [
        ({}, InputError, "no images to label"),
        ({"a": WIDE[..., 0]}, InputError, r"image 'a' is uint8 of shape \(30, 50\)"),
        ({"a": WIDE / 255}, InputError, "float64"),
        ({"a": WIDE[:0]}, InputError, r"shape \(0, 50, 3\)"),
        ({"a": 5}, InputError, "image 'a' is int"),
        ({"a": "nowhere.png"}, MissingDataError, "no file nowhere.png for 'a'"),
        ({"a": __file__}, FormatError, "is not an image that can be read"),
    ],
)
def test_what_is_not_a_photograph(images, error, message):
    with pytest.raises(error, match=message):
        ChartLabeller(images)


def test_front_end_needs_nothing_from_elsewhere():
    assert "import " not in ChartLabeller._esm
    assert "http" not in ChartLabeller._esm + ChartLabeller._css
