import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

from crfbench import files
from crfbench.camera.merging import write_hdr
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
def test_of_several_that_write_one_file_the_first_counts(tmp_path, monkeypatch, links):
    """All begin where nothing is there yet, and but one is told that it is not the first."""
    together, refused = threading.Barrier(4), []
    check = files.check_new

    def check_together(path, overwrite):
        found = check(path, overwrite)
        if threading.current_thread() not in seen:
            seen.add(threading.current_thread())
            together.wait(300)
        return found

    def write(content):
        try:
            write_new(tmp_path / "a.txt", content, overwrite=False)
        except InputError as error:
            refused.append((content, str(error)))

    def no_link(*_paths):
        raise PermissionError

    seen = set()
    monkeypatch.setattr(files, "check_new", check_together)
    if not links:
        monkeypatch.setattr(os, "link", no_link)
    threads = [threading.Thread(target=write, args=(1000 * bytes([65 + i]),)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    content = (tmp_path / "a.txt").read_bytes()
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert content in [1000 * bytes([65 + i]) for i in range(4)], "whole"
    if links:
        assert len(refused) == 3
        assert all(other != content and "a.txt exists already" in told for other, told in refused)


KILLED = """
import os, signal, sys
from pathlib import Path
from crfbench.files import write_new
os.link = Path.replace = lambda *paths: os.kill(os.getpid(), signal.SIGKILL)
write_new(sys.argv[1], b"new", overwrite=bool(sys.argv[2]))
"""


@pytest.mark.skipif(os.name == "nt", reason="there is no such signal")
@pytest.mark.parametrize("force", ["", "force"])
def test_a_killed_process_leaves_the_old_file_or_none(tmp_path, force):
    path = tmp_path / "a.txt"
    if force:
        path.write_bytes(b"old")
    done = subprocess.run([sys.executable, "-c", KILLED, path, force], check=False)
    assert done.returncode == -signal.SIGKILL
    assert path.exists() == bool(force)
    assert not force or path.read_bytes() == b"old"
    write_new(path, b"newer", overwrite=bool(force))
    assert path.read_bytes() == b"newer"
    assert [p.name[0] for p in tmp_path.iterdir() if p != path] == ["."], "what is left is hidden"


@pytest.fixture
def full():
    """Let every file that is larger than 5000 bytes fail, as on a full disk."""
    resource = pytest.importorskip("resource", reason="limits of a process are set another way")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.usefixtures("full")
def test_a_full_disk_leaves_the_old_file_and_no_trace(tmp_path):
    path = tmp_path / "a.txt"
    write_atomically(path, b"old")
    with pytest.raises(OSError, match=r"a\.txt"):
        write_atomically(path, bytes(6000))
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.usefixtures("full")
@pytest.mark.parametrize("name", ["a.exr", "a.tif", "a.hdr"])
def test_a_full_disk_takes_no_merged_image(tmp_path, name):
    with pytest.raises(OSError, match=name):
        write_hdr(tmp_path / name, np.random.default_rng(0).random((60, 60, 3)))
    assert list(tmp_path.iterdir()) == []


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
