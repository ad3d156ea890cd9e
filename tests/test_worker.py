"""Untrusted files are read in a process of its own: a crash or a hang costs one file, and no script needs a guard."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from crfbench import camera
from crfbench.camera.worker import WORKER, Worker
from crfbench.errors import CrfbenchError, FormatError, InputError
from crfbench.files import bundled

PATH = Path("a.jpg")
SYNTHETIC = bundled("data/synthetic_camera")


def crash(path):
    os.kill(os.getpid(), signal.SIGSEGV)


def hang(path):
    time.sleep(3600)


def refuse(path, reason):
    raise InputError(reason)


def lack(path):
    raise ImportError("no module of that name")


def exhaust(path):
    raise MemoryError


def process_id(path):
    return os.getpid()


def compare(first):
    print(WORKER.run(process_id, PATH) == first, flush=True)


@pytest.fixture
def worker():
    worker = Worker()
    yield worker
    worker.close()


def test_a_crash_costs_one_file(worker):
    first = worker.run(process_id, PATH)
    assert first == worker.run(process_id, PATH) != os.getpid()
    with pytest.raises(FormatError, match=r"^a\.jpg crashed its decoder"):
        worker.run(crash, PATH)
    second = worker.run(process_id, PATH)
    assert second != first
    with pytest.raises(FormatError, match=r"^a\.jpg needs more memory than there is"):
        worker.run(exhaust, PATH)
    with pytest.raises(InputError, match=r"^too dark$"):
        worker.run(refuse, PATH, "too dark")
    assert worker.run(process_id, PATH) == second


def test_a_hang_costs_one_file(worker):
    worker.run(process_id, PATH)
    worker.timeout = 0.2
    with pytest.raises(FormatError, match=r"a\.jpg took its decoder more than 0\.2 s"):
        worker.run(hang, PATH)
    worker.timeout = 600
    assert worker.run(process_id, PATH) != os.getpid()


@pytest.fixture
def broken_start(request, monkeypatch):
    """Let Python start something else than Python."""
    WORKER.close()
    monkeypatch.setattr(sys, "executable", request.param)


@pytest.mark.skipif(os.name == "nt", reason="there are no such programs")
@pytest.mark.parametrize("broken_start", ["/bin/false", "/nowhere/python"], indirect=True)
@pytest.mark.usefixtures("broken_start")
def test_a_worker_that_cannot_start_is_not_a_damaged_photograph(capfd):
    for chart in ("auto", "none"):
        with pytest.raises(CrfbenchError, match=r"the worker process .* did not start; check that") as caught:
            camera.calibrate(SYNTHETIC, chart)
        assert caught.type is CrfbenchError
    capfd.readouterr()


def test_modules_that_are_missing_in_the_worker_are_not_a_damaged_photograph(worker):
    with pytest.raises(CrfbenchError, match=r"cannot read photographs \(no module of that name\); install") as caught:
        worker.run(lack, PATH)
    assert caught.type is CrfbenchError
    assert worker.run(process_id, PATH)


TWO_LINES = f"from crfbench import camera\nprint(camera.calibrate({str(SYNTHETIC)!r}).passport)\n"


@pytest.mark.parametrize("way", ["stdin", pytest.param("file", marks=pytest.mark.slow)])
def test_a_script_needs_no_guard(tmp_path, way):
    (tmp_path / "script.py").write_text(TWO_LINES)
    command, given = ([tmp_path / "script.py"], None) if way == "file" else (["-"], TWO_LINES)
    done = subprocess.run(
        [sys.executable, *command], input=given, capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert (done.stdout, done.returncode) == ("Passport('crfbench synthetic', inverse, red, green, blue)\n", 0), (
        done.stderr
    )


def script(code):
    """Start a script that has a worker; its output ends when both have."""
    code = f"import os, sys\nsys.path.append({str(Path(__file__).parent)!r})\nimport test_worker as t\n{code}"
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.skipif(os.name == "nt", reason="processes are ended another way")
def test_the_worker_ends_with_a_process_that_is_killed():
    with script("print(t.WORKER.run(t.process_id, t.PATH), flush=True); t.time.sleep(3600)") as process:
        assert int(process.stdout.readline())
        process.kill()
        assert process.stdout.read() == ""


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C is sent another way")
def test_ctrl_c_ends_script_and_worker():
    code = "t.WORKER.run(t.process_id, t.PATH); print('go', flush=True); t.WORKER.run(t.hang, t.PATH)"
    with script(code) as process:
        assert process.stdout.readline() == "go\n"
        process.send_signal(signal.SIGINT)
        assert process.stdout.read() == ""
        assert process.stderr.read().count("KeyboardInterrupt") == 1


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_after_a_fork_each_process_has_its_own_worker():
    code = """import multiprocessing
first = t.WORKER.run(t.process_id, t.PATH)
child = multiprocessing.get_context("fork").Process(target=t.compare, args=(first,))
child.start(), child.join(), t.compare(first)"""
    with script(code) as process:
        assert process.stdout.read() == "False\nTrue\n"
