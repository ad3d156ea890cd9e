"""Fetching from a server with faults: a clear error, nothing half-written, and a second try that succeeds."""

import _thread
import hashlib
import io
import os
import re
import signal
import subprocess
import sys
import threading
import time
import zipfile
from collections import Counter
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest

from crfbench.curves import GRID
from crfbench.datasets import dorf, registry
from crfbench.datasets import fetch as fetch_module
from crfbench.datasets.fetch import fetch
from crfbench.datasets.registry import RemoteFile
from crfbench.errors import FetchError, InputError

CURVES = np.array([GRID**0.5, GRID**2.0])


def dorf_zip(name=dorf.MEMBER, curves=CURVES, padding=0) -> bytes:
    row = "   ".join(map(repr, GRID.tolist()))
    text = "".join(
        f"film{n}\nlabel\nI =\n{row}\nB =\n{'   '.join(map(repr, c.tolist()))}\n" for n, c in enumerate(curves)
    )
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, text + " " * padding)
    return buffer.getvalue()


CONTENT = {f"set/{n}.bin": os.urandom(40_000) for n in range(3)} | {"dorf/a.mat": b"m" * 5000}
ZIP = "dorf/dorfCurves.zip"


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


class Server(ThreadingHTTPServer):
    """Serves CONTENT and a good zip; `faults` gives what happens to a path instead."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server_address[1]}"
        self.content = CONTENT | {ZIP: dorf_zip()}
        self.faults: dict[str, str | bytes] = {}
        self.requests: Counter[str] = Counter()
        self.half_sent, self.go_on = threading.Event(), threading.Event()


class Handler(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        path = self.path.lstrip("/")
        self.server.requests[path] += 1
        fault = self.server.faults.get(path)
        if fault == "404":
            self.send_error(404)
            return
        body = fault if isinstance(fault, bytes) else self.server.content[path]
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body[: len(body) // 2])
        self.rest(fault, body[len(body) // 2 :])

    def rest(self, fault: str | bytes | None, body: bytes) -> None:
        self.wfile.flush()
        self.server.half_sent.set()
        if fault == "truncated":
            self.close_connection = True
            return
        if fault == "interrupted":
            _thread.interrupt_main()
        if fault in ("stalled", "interrupted"):
            self.server.go_on.wait(20)
        if fault == "slow":
            time.sleep(0.3)
        self.wfile.write(body)

    def log_message(self, *args: object) -> None:
        pass

    def handle(self) -> None:
        try:
            super().handle()
        except ConnectionError:
            self.close_connection = True


@pytest.fixture
def server():
    server = Server()
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    yield server
    server.go_on.set()
    server.shutdown()
    server.server_close()
    thread.join()


def known(url: str) -> dict[str, tuple[RemoteFile, ...]]:
    files = tuple(RemoteFile(p, f"{url}/{p}", sha256(c)) for p, c in CONTENT.items() if p.startswith("set/"))
    mat = RemoteFile("dorf/a.mat", f"{url}/dorf/a.mat", sha256(CONTENT["dorf/a.mat"]))
    names = RemoteFile(ZIP, f"{url}/{ZIP}", None, "names come with the zip")
    return {"opencrf": (), "dorf": (mat, names), "one": files[:1], "set": files}


@pytest.fixture
def folder(server, tmp_path, monkeypatch):
    """Give an empty data folder, in a world where the test server holds every data set."""
    monkeypatch.setattr(fetch_module, "known", lambda: known(server.url))
    monkeypatch.setattr(fetch_module, "TIMEOUT", (0.5, 0.5))
    monkeypatch.setattr(dorf, "known_fingerprint", lambda: dorf.fingerprint(CURVES))
    monkeypatch.setenv("CRFBENCH_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


def files_in(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def refused(key: str) -> str:
    """Fetch, which must fail with one sentence on one line, and return that."""
    with pytest.raises(FetchError) as failure:
        fetch(key, progress=False)
    message = str(failure.value)
    assert "\n" not in message
    assert ". " not in message
    return message


# --- healthy


def test_fetch_writes_what_is_served_and_resumes(server, folder):
    paths = fetch("set", progress=False)
    assert [path.read_bytes() for path in paths] == [CONTENT[f"set/{n}.bin"] for n in range(3)]
    assert server.requests.total() == 3
    paths[1].unlink()
    paths[2].write_bytes(b"damaged")
    assert fetch("set", progress=False) == paths
    assert server.requests == {"set/0.bin": 1, "set/1.bin": 2, "set/2.bin": 2}
    assert files_in(folder) == ["set/0.bin", "set/1.bin", "set/2.bin"]


def test_all_and_bundled(server, folder):
    assert fetch("opencrf", progress=False) == []
    assert not folder.exists()
    assert len(fetch(progress=False)) == 6
    assert files_in(folder) == sorted([*CONTENT, ZIP])
    before = server.requests.total()
    assert len(fetch("all", progress=False)) == 6
    assert server.requests.total() == before


def test_mirror_and_folder(server, folder, tmp_path, monkeypatch):
    monkeypatch.setattr(fetch_module, "known", lambda: known("http://127.0.0.1:9/never"))
    (path,) = fetch("one", tmp_path / "elsewhere", mirror=f"{server.url}/", progress=False)
    assert path == tmp_path / "elsewhere" / "set" / "0.bin"
    assert not folder.exists()


def test_the_cache_is_filled_without_a_folder(server, folder, monkeypatch, empty_cache):
    monkeypatch.delenv("CRFBENCH_DATA")
    (path,) = fetch("one", progress=False)
    assert path == empty_cache / "data" / "set" / "0.bin"
    path.unlink()


def test_progress_counts_the_bytes_of_few_files(folder, capfd):
    fetch("set")
    assert capfd.readouterr().err.count("40.0k/40.0k") == 3


def test_progress_counts_many_files(folder, monkeypatch, capfd):
    monkeypatch.setattr(fetch_module, "_FEW", 2)
    fetch("set")
    assert "3/3" in capfd.readouterr().err


def test_silence(server, folder, capfd):
    fetch("set", progress=False)
    assert capfd.readouterr() == ("", "")


def test_unknown_key_and_mirror(folder):
    with pytest.raises(InputError, match="'kodak' is not known; use one of all, opencrf, dorf"):
        fetch("kodak")
    with pytest.raises(InputError, match="'ftp://x' is not a web address"):
        fetch("one", mirror="ftp://x")


# --- faults


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("404", "the server answered 404 Not Found"),
        ("truncated", "the connection failed or broke off"),
        (b"wrong bytes" * 999, "another SHA-256"),
        (b"", "another SHA-256"),
        ("stalled", r"silent for more than 0\.5 s"),
    ],
)
def test_a_fault_then_a_second_try(server, folder, fault, message):
    server.faults["set/1.bin"] = fault
    said = refused("set")
    assert server.url in said
    assert "'crfbench fetch set'" in said
    assert re.search(message, said)
    assert files_in(folder) == ["set/0.bin"]
    server.faults.clear()
    server.go_on.set()
    assert len(fetch("set", progress=False)) == 3
    assert server.requests["set/0.bin"] == 1
    assert files_in(folder) == ["set/0.bin", "set/1.bin", "set/2.bin"]


def test_a_slow_server_is_waited_for(server, folder):
    server.faults["set/0.bin"] = "slow"
    assert len(fetch("one", progress=False)) == 1


def test_no_server(folder, monkeypatch):
    monkeypatch.setattr(fetch_module, "known", lambda: known("http://127.0.0.1:9"))
    assert "the connection failed" in refused("one")
    assert files_in(folder) == []


def test_senseless_mirror(folder):
    with pytest.raises(FetchError, match="could not be fetched"):
        fetch("one", mirror="http://", progress=False)


def test_a_wrong_file_stays_until_the_right_one_is_there(server, folder):
    (path,) = fetch("one", progress=False)
    path.write_bytes(b"old")
    server.faults["set/0.bin"] = "404"
    refused("one")
    assert path.read_bytes() == b"old"


@pytest.mark.skipif(os.name == "nt", reason="limits of a process are set another way")
def test_a_full_disk_is_told_and_what_is_complete_stays(server, folder):
    import resource

    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))  # what is larger fails as on a full disk
    try:
        said = refused("all")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert "set/0.bin cannot be written (File too large)" in said
    assert "dorf/a.mat" in files_in(folder)
    assert not [name for name in files_in(folder) if name.startswith("set/")]
    assert len(fetch("all", progress=False)) == len(CONTENT) + 2
    assert len(files_in(folder)) == len(CONTENT) + 1


def test_two_processes_fetch_the_same_files(server, folder, monkeypatch):
    """The second begins and ends while the first has half a file."""
    monkeypatch.setattr(fetch_module, "TIMEOUT", (300, 300))
    server.faults["set/0.bin"] = "stalled"
    slow = threading.Thread(target=fetch, args=("set",), kwargs={"progress": False})
    slow.start()
    assert server.half_sent.wait(300)
    server.faults.clear()
    fetch("set", progress=False)
    server.go_on.set()
    slow.join()
    assert {path.name: path.read_bytes() for path in (folder / "set").iterdir()} == {
        name.removeprefix("set/"): content for name, content in CONTENT.items() if name.startswith("set/")
    }


def test_a_folder_that_cannot_be_written(server, folder):
    folder.parent.mkdir(exist_ok=True)
    folder.write_text("a file, not a folder")
    assert "cannot be written" in refused("one")


def test_all_goes_on_after_a_failure(server, folder):
    server.faults["dorf/a.mat"] = "404"
    assert "dorf/a.mat" in refused("all")
    assert files_in(folder) == ["set/0.bin", "set/1.bin", "set/2.bin"]


# --- the official DoRF zip, which has no checksum


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (dorf_zip("../dorfCurves.txt"), "unsafe name '../dorfCurves.txt'"),
        (dorf_zip("/tmp/dorfCurves.txt"), "unsafe name"),  # noqa: S108
        (dorf_zip(padding=3_000_000), "more than the 1000000 bytes"),
        (dorf_zip(curves=CURVES[:1]), "1 curves where DoRF has 2"),
        (dorf_zip(curves=CURVES**1.1), "other curves than DoRF"),
        (dorf_zip()[:-900], "the zip cannot be read"),
        (b"<html>moved</html>", "the zip cannot be read"),
        ("404", "404 Not Found"),
    ],
)
def test_a_bad_zip_then_a_second_try(server, folder, monkeypatch, content, message):
    monkeypatch.setattr(dorf, "MAX_TEXT_BYTES", 1_000_000)
    server.faults[ZIP] = content
    said = refused("dorf")
    assert message in said
    assert "(all else is in place; names come with the zip)" in said
    assert files_in(folder) == ["dorf/a.mat"]
    assert files_in(folder.parent) == ["data/dorf/a.mat"]
    server.faults.clear()
    fetch("dorf", progress=False)
    assert files_in(folder) == ["dorf/a.mat", ZIP]
    assert server.requests == {"dorf/a.mat": 1, ZIP: 2}


def test_a_bad_zip_on_disk_is_replaced(server, folder):
    _, path = fetch("dorf", progress=False)
    path.write_bytes(b"damaged")
    fetch("dorf", progress=False)
    assert path.read_bytes() == server.content[ZIP]
    assert server.requests[ZIP] == 2


# --- interrupted half-way


def test_ctrl_c_leaves_nothing(server, folder):
    server.faults["set/1.bin"] = "interrupted"
    threading.Timer(0.2, server.go_on.set).start()
    with pytest.raises(KeyboardInterrupt):
        fetch("set", progress=False)
    assert files_in(folder) == ["set/0.bin"]
    server.faults.clear()
    assert len(fetch("set", progress=False)) == 3


CHILD = """
import sys
from crfbench.datasets import fetch as module
from crfbench.datasets.registry import RemoteFile
url, sha256 = sys.argv[1:]
module.known = lambda: {"one": (RemoteFile("set/0.bin", url, sha256),)}
module.fetch("one")
"""


@pytest.mark.parametrize("kill", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_killed_process_does_no_harm(server, folder, kill):
    """Only SIGTERM and SIGKILL, which Python cannot clean up after, leave the temporary file; nothing reads it."""
    server.faults["set/0.bin"] = "stalled"
    arguments = (f"{server.url}/set/0.bin", sha256(CONTENT["set/0.bin"]))
    with subprocess.Popen([sys.executable, "-c", CHILD, *arguments], stderr=subprocess.DEVNULL) as child:
        assert server.half_sent.wait(300)
        time.sleep(0.2)
        child.send_signal(kill)
        assert child.wait(300) != 0
    left = files_in(folder)
    assert all(name.startswith("set/tmp") for name in left)
    assert len(left) == (0 if kill == signal.SIGINT else 1)
    server.faults.clear()
    (path,) = fetch("one", progress=False)
    assert path.read_bytes() == CONTENT["set/0.bin"]
    assert files_in(folder) == sorted(["set/0.bin", *left])


# --- the real registry


def test_only_the_official_dorf_has_no_checksum():
    files = [file for known in registry.known().values() for file in known if file.sha256 is None]
    assert [file.path for file in files] == [ZIP]
