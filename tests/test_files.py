import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from crfbench.camera.photographs import list_photographs
from crfbench.errors import InputError
from crfbench.files import write_atomically, write_new


def test_replaces_the_file_and_leaves_nothing_else(tmp_path):
    path = tmp_path / "new" / "a.txt"
    write_atomically(path, b"one")
    write_atomically(path, b"two")
    assert path.read_bytes() == b"two"
    assert [p.name for p in path.parent.iterdir()] == ["a.txt"]


def test_a_failed_write_leaves_the_old_file_and_no_trace(tmp_path):
    path = tmp_path / "a.txt"
    write_atomically(path, b"old")
    with pytest.raises(TypeError):
        write_atomically(path, "not bytes")
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_file_that_is_there_is_kept_unless_told(tmp_path):
    path = tmp_path / "a.txt"
    write_new(path, b"one", overwrite=False)
    with pytest.raises(InputError, match=r"a\.txt exists already.*--force"):
        write_new(path, b"two", overwrite=False)
    assert path.read_bytes() == b"one"
    write_new(path, b"two", overwrite=True)
    assert path.read_bytes() == b"two"


@pytest.mark.parametrize("links", [True, False])
def test_what_another_process_writes_meanwhile_is_kept(tmp_path, monkeypatch, links):
    """Whether the file system has links or not, as that of a memory card."""

    looked = Path.exists

    def exists(path):
        there = looked(path)
        (tmp_path / "a.txt").write_bytes(b"theirs")
        return there

    def no_links(*_paths):
        raise PermissionError

    monkeypatch.setattr(Path, "exists", exists)
    if not links:
        monkeypatch.setattr(os, "link", no_links)
    with pytest.raises(InputError, match=r"a\.txt exists already.*--force"):
        write_new(tmp_path / "a.txt", b"ours", overwrite=False)
    write_new(tmp_path / "b.txt", b"ours", overwrite=False)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a.txt": b"theirs", "b.txt": b"ours"}


@pytest.mark.skipif(os.name == "nt", reason="processes are ended another way")
@pytest.mark.parametrize(("step", "overwrite"), [("Path.replace", True), ("os.link", False)])
def test_a_killed_process_leaves_the_old_file_and_one_that_nothing_reads(tmp_path, step, overwrite):
    code = f"""import os, signal
from pathlib import Path
from crfbench.files import write_new
{step} = lambda *_paths: os.kill(os.getpid(), signal.SIGKILL)
write_new("a.png", b"new", {overwrite})"""
    before = {"a.png": b"old"} if overwrite else {}
    for name, content in before.items():
        (tmp_path / name).write_bytes(content)
    assert subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=False).returncode == -signal.SIGKILL
    assert {path.name: path.read_bytes() for path in list_photographs(tmp_path)} == before
    (left,) = tmp_path.glob(".crfbench-*")
    write_new(tmp_path / "a.png", b"newer", overwrite)
    assert sorted(tmp_path.iterdir()) == [left, tmp_path / "a.png"]
    assert (tmp_path / "a.png").read_bytes() == b"newer"


def test_what_cannot_be_written_is_named_and_leaves_no_trace(tmp_path):
    for path in (tmp_path / "folder", tmp_path / "file" / "a.txt"):
        (tmp_path / "folder").mkdir(exist_ok=True)
        (tmp_path / "file").touch()
        with pytest.raises(OSError, match=path.relative_to(tmp_path).parts[0]) as caught:
            write_atomically(path, b"new")
        assert "->" not in str(caught.value)
        assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]


def test_names_may_be_as_long_as_the_system_lets_them(tmp_path):
    path = tmp_path / ("x" * 251 + ".exr")
    write_atomically(path, b"one")
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.skipif(os.name == "nt", reason="links need rights, and there is no umask")
def test_links_are_written_through_and_the_umask_holds(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to("there/a.txt")
    before = os.umask(0o077)
    try:
        for content in (b"new", b"newer"):
            write_atomically(tmp_path / "link", content)
    finally:
        os.umask(before)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "there" / "a.txt").read_bytes() == b"newer"
    assert (tmp_path / "there" / "a.txt").stat().st_mode & 0o777 == 0o600
    write_atomically(tmp_path / "b.txt", b"")
    assert (tmp_path / "b.txt").stat().st_mode & 0o777 == 0o666 & ~before
