"""Whatever bytes come in, every parser gives a valid value or one error of ours, and the originals come back.

The formats of passports, labels of charts and the readers of photographs have further tests of this kind of their own.
DoRF's .mat is read only where its SHA-256 is the known one.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import build_patches
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from safetensors.numpy import save

from crfbench.camera.formats import FORMATS, decode
from crfbench.camera.passport import Passport
from crfbench.camera.photographs import Pair, _given_times
from crfbench.datasets import dorf, responses
from crfbench.datasets.chart import load_labels, save_labels
from crfbench.errors import CrfbenchError, FormatError
from crfbench.history import History
from crfbench.models import SLR, registry, slr
from crfbench.models.slr import read_weights
from crfbench.paper.results import load_recorded
from crfbench.search.result import Journal
from crfbench.search.space import Outcome
from tests.support.responses import file_of

CURVE = np.linspace(0.0, 1.0, 1024) ** 2


THREE = [Pair(name, Path(f"{name}.jpg")) for name in "abc"]


class Parser(NamedTuple):
    """How to make a good file, and how to read one."""

    write: Callable[[Path], None]
    read: Callable[[Path], object]


def _text(words: np.ndarray) -> str:
    return " ".join(map(repr, words.tolist()))


def write_dorf(path: Path) -> None:
    path.write_text(f"film\nscale\nI =\n{_text(np.linspace(0, 1, 1024))}\nB =\n{_text(CURVE)}\n")


def write_emor(path: Path) -> None:
    names = ["E", "f0", *(f"h({i})" for i in range(1, 26))]
    path.write_text("\n".join(f"{name} =\n{_text(CURVE)}" for name in names))


def write_boxes(path: Path) -> None:
    box = {"position": {"x": 0.25, "y": 0.5}, "rect": {"x": 100, "y": 50}}
    path.write_text(json.dumps([{"references": [box] * 24}]))


def write_history(path: Path) -> None:
    rows = np.arange(3.0)
    History("ldl", np.arange(3), {"mse": rows}, np.zeros((3, 4, 1)), np.zeros((3, 9, 65))).save(path)


def write_recorded(path: Path) -> None:
    path.write_text(json.dumps({"provenance": {"command": "x"}, "rows": [{"model": "Gamma", "rmse": 0.5}]}))


def write_journal(path: Path) -> None:
    book = Journal(path, {"seed": 0})
    book.append(Outcome((50, 20), 500, (1e-3,), (0.03,), 1.5))


PARSERS = {
    "DoRF text": Parser(write_dorf, lambda path: dorf.parse_dorf_text(path.read_text(encoding="latin-1"))),
    "EMoR": Parser(write_emor, lambda path: dorf.parse_emor(path.read_text(encoding="latin-1"))),
    "boxes": Parser(write_boxes, lambda path: build_patches.parse_boxes(path.read_text(encoding="latin-1"), 600, 400)),
    "weights": Parser(lambda path: SLR((2,)).save(path), read_weights),
    "history": Parser(write_history, History.load),
    "record": Parser(write_recorded, lambda path: load_recorded(path.stem, path.parent)),
    "journal": Parser(write_journal, lambda path: Journal(path, {"seed": 0}).outcomes),
    "labels": Parser(
        lambda path: save_labels(path, {"a": [(0.1, 0.1), (0.9, 0.1), (0.9, 0.9), (0.1, 0.9)]}), load_labels
    ),
    "times": Parser(lambda path: path.write_text("1,2.5,1e3"), lambda path: _given_times(path, THREE)[0]),
    **{
        f"passport as {name}": Parser(
            lambda path, name=name: path.write_bytes(file_of(name, Passport("inverse", CURVE))),
            lambda path, name=name: decode(name, path.read_bytes()),
        )
        for name in FORMATS
        if name != "hugin"  # needs the EMoR basis; tests/test_passport.py has it
    },
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("parsers")


def damage(content: bytes) -> st.SearchStrategy[bytes]:
    """Cut, overwrite or insert, near the head as often as anywhere."""
    place = st.integers(0, min(100, len(content))) | st.integers(0, len(content))
    words = [b"NaN", b"1e999", b"1e308", b"9" * 5000, b"\\ud800", b"null", b"[" * 3000, b"-1", b'"', b"\n", b"{}"]
    patch = st.binary(max_size=6) | st.sampled_from(words)
    cut = st.builds(lambda i, n, new: content[:i] + new + content[i + n :], place, st.integers(0, 40), patch)
    return st.binary(max_size=60) | place.map(lambda i: content[:i]) | cut


@pytest.mark.parametrize("name", PARSERS)
def test_a_good_file_is_read_twice_the_same(folder, name):
    path = folder / "good.json"
    path.unlink(missing_ok=True)
    PARSERS[name].write(path)
    first, second = PARSERS[name].read(path), PARSERS[name].read(path)
    assert str(first) == str(second)
    assert str(first)


@pytest.mark.parametrize("name", PARSERS)
@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_bytes_give_a_value_or_an_error_of_ours(folder, name, data):
    path = folder / "any.json"
    path.unlink(missing_ok=True)
    PARSERS[name].write(path)
    path.write_bytes(data.draw(damage(path.read_bytes())))
    try:
        PARSERS[name].read(path)
    except CrfbenchError as error:
        assert 10 < len(str(error)) < 400  # noqa: PT017
        assert "\n" not in str(error).strip()  # noqa: PT017


@pytest.mark.parametrize("card", ["", "no JSON", "[" * 5000, "[1]", "{}"])
def test_weights_with_metadata_of_another_kind_are_refused(folder, card):
    arrays = {"latents": np.zeros((2, 1), np.float32)}
    metadata = {"format": slr.FORMAT, "card": card, "sha256": slr._checksum(card, arrays)}
    (folder / "card.safetensors").write_bytes(save(arrays, metadata))
    with pytest.raises(CrfbenchError, match="lacks latents or one of"):
        read_weights(folder / "card.safetensors")


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04 cut"])
def test_a_damaged_bundled_file_asks_for_another_install(monkeypatch, folder, content):
    path = folder / "bundled.npz"
    path.write_bytes(content)
    for module, load in ((responses, responses.load_opencrf), (registry, lambda: registry.load_model("Gamma-1"))):
        monkeypatch.setattr(module, "bundled", lambda name: path)
        with pytest.raises(CrfbenchError, match="install crfbench again"):
            load()


def test_a_file_that_is_no_journal_is_left_as_it_is(folder):
    path = folder / "photograph.jpg"
    for content in (b"\xff\xd8 without a line", b"first\nsecond, cut", b'{"rows": []}\n{"x'):
        path.write_bytes(content)
        with pytest.raises(CrfbenchError, match="is not a journal of a search"):
            Journal(path, {"seed": 0})
        assert path.read_bytes() == content


def test_a_history_with_a_byte_zeroed_is_refused_or_read(folder):
    path = folder / "any.json"
    path.unlink(missing_ok=True)
    PARSERS["history"].write(path)
    content, refused = path.read_bytes(), 0
    for i in range(min(len(content), 200)):
        path.write_bytes(content[:i] + b"\0" + content[i + 1 :])
        try:
            PARSERS["history"].read(path)
        except FormatError:
            refused += 1
    assert refused > 100
