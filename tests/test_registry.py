"""The registry knows every set, finds what is there and says what is not."""

import hashlib
import re
from pathlib import Path

import pytest
from platformdirs import user_cache_dir

from crfbench.datasets import registry
from crfbench.errors import MissingDataError


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("CRFBENCH_DATA", str(tmp_path))
    return tmp_path


def put(folder: Path, relative_path: str) -> Path:
    path = folder / relative_path
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"x")
    return path


def row(key):
    return next(entry for entry in registry.status() if entry["key"] == key)


def test_known_sets_and_counts():
    counts = {key: len(files) for key, files in registry.known().items()}
    assert counts == {"opencrf": 0, "dorf": 2, "emor": 2, "middlebury": 225}


def test_addresses_are_pinned_and_checksums_whole():
    for files in registry.known().values():
        for file in files:
            assert re.fullmatch(r"[0-9a-f]{64}", file.sha256 or "") or file.path == "dorf/dorfCurves.zip"
            assert re.search(r"/[0-9a-f]{40}/", file.url) or file.path == "dorf/dorfCurves.zip"
            assert file.url.endswith(file.path.rsplit("/", 1)[-1])
            assert not file.path.startswith("/")
            assert ".." not in file.path


def test_middlebury_layout():
    paths = [file.path.removeprefix("middlebury/modified_Middlebury/") for file in registry.known()["middlebury"]]
    images = [path for path in paths if re.fullmatch(r"[\w-]+/wb1i[12]e[1-4]-(jpg|raw)\.png", path)]
    assert len(set(images)) == 14 * 8 * 2
    assert set(paths) - set(images) == {"tags.json"}


def test_folder_of_the_user_goes_before_the_cache(folder, empty_cache):
    assert registry.folders() == [folder, empty_cache / "data"]
    cached = put(empty_cache / "data", "dorf/emor.txt")
    try:
        assert registry.find("dorf/emor.txt") == cached
        assert registry.find("dorf/emor.txt") != put(folder, "dorf/emor.txt")
        assert registry.find("dorf/emor.txt") == folder / "dorf/emor.txt"
    finally:
        cached.unlink()


def test_empty_variable_counts_as_unset(monkeypatch, empty_cache):
    monkeypatch.setenv("CRFBENCH_DATA", "")
    assert registry.folders() == [empty_cache / "data"]


def test_cache_follows_the_platform(monkeypatch, tmp_path):
    monkeypatch.setattr(registry, "user_cache_dir", user_cache_dir)
    monkeypatch.delenv("CRFBENCH_DATA", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert registry.folders()[-1].name == "data"
    assert registry.find("dorf/emor.txt") is None


def test_status_counts_files(folder):
    assert row("emor")["present"] == "absent"
    assert row("emor")["where"] == ""
    put(folder, "dorf/emor.txt")
    assert row("emor")["present"] == "partial (1 of 2)"
    put(folder, "dorf/invemor.txt")
    assert (row("emor")["present"], row("emor")["where"]) == ("complete", str(folder))


def test_a_set_that_lacks_only_what_nothing_here_needs_is_complete(folder):
    put(folder, "dorf/dorfCurves.zip")
    assert row("dorf")["present"] == "partial (1 of 2)"
    (folder / "dorf/dorfCurves.zip").unlink()
    put(folder, "dorf/201_CRF_data.mat")
    assert row("dorf")["present"] == "complete for everything here (names come with the official zip)"
    put(folder, "dorf/dorfCurves.zip")
    assert row("dorf")["present"] == "complete"


def test_status_names_both_folders_of_a_divided_set(folder, empty_cache):
    put(folder, "dorf/emor.txt")
    cached = put(empty_cache / "data", "dorf/invemor.txt")
    try:
        assert row("emor")["where"] == f"{folder} and {empty_cache / 'data'}"
    finally:
        cached.unlink()


def test_status_of_the_bundled_set():
    assert row("opencrf")["present"] == "bundled"
    assert Path(row("opencrf")["where"]).exists()


def test_require_says_what_to_do(folder):
    with pytest.raises(MissingDataError, match=r"dorf/emor\.txt is not in .*'crfbench fetch emor'.*CRFBENCH_DATA"):
        registry.require("dorf/emor.txt", "emor")


@pytest.mark.middlebury
def test_checksums_are_those_of_the_images(middlebury_folder):
    home = middlebury_folder.parents[1]
    for file in registry.known()["middlebury"]:
        assert hashlib.sha256((home / file.path).read_bytes()).hexdigest() == file.sha256


@pytest.mark.dorf
def test_checksums_are_those_of_the_text_files(emor_files):
    for file in registry.known()["emor"]:
        assert hashlib.sha256((emor_files.parent / file.path).read_bytes()).hexdigest() == file.sha256
