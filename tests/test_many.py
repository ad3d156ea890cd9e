"""Many cameras at once, and the processes that they and the search run in."""

import errno
import os
import re
import signal
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from crfbench import parallel
from crfbench.camera import Passport, calibrate_cameras, outputs, read_response, render_series, write_response
from crfbench.curves import GRID
from crfbench.errors import InputError, WorkerError
from tests.support.command import run_command

EXPOSURES = "1,2,4"
GAMMAS = {"bright": 1.6, "dark": 2.4}


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return folders of two cameras, and one with a picture that says nothing."""
    root = tmp_path_factory.mktemp("cameras")
    for name, gamma in GAMMAS.items():
        series = render_series(GRID ** (1 / gamma), size=(240, 160), stops=(-1.0, 0.0, 1.0))
        (root / name).mkdir()
        for i, image in enumerate(series.images):
            Image.fromarray(image).save(root / name / f"{i}.png")
    (root / "broken").mkdir()
    (root / "broken" / "0.png").write_bytes(b"no picture")
    return [root / "bright", root / "broken", root / "dark"]


def passports(out: Path) -> dict[str, Passport]:
    return {path.parent.name: read_response(path) for path in sorted(out.glob("*/passport.json"))}


def calibrated(folders: list[Path], out: Path, **options: object) -> dict[str, str]:
    return {
        folder.name: problem
        for folder, problem in calibrate_cameras(folders, out, chart="none", exposures=EXPOSURES.split(","), **options)
    }


def test_each_folder_is_a_camera_and_one_that_fails_ends_no_other(folders: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    with ThreadPoolExecutor(1) as executor:
        found = calibrated(folders, out, executor=executor)
    assert "(0.png)" in found.pop("broken")
    assert found == {"bright": "", "dark": ""}
    assert sorted(path.name for path in out.iterdir()) == ["bright", "dark"]
    for name, passport in passports(out).items():
        assert np.abs(passport.curves - GRID ** GAMMAS[name]).max() < 0.08


def test_what_is_done_is_not_done_again(folders: list[Path], tmp_path: Path) -> None:
    (tmp_path / "bright").mkdir()
    with ThreadPoolExecutor(1) as executor:
        assert calibrated(folders[::2], tmp_path, executor=executor) == {"bright": "", "dark": ""}
    assert list((tmp_path / "bright").iterdir()) == []


def test_folders_of_one_name_are_refused(folders: list[Path], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="2 folders, and 1 different names"):
        list(calibrate_cameras([folders[0], folders[0]], tmp_path))


def test_folders_are_not_taken_for_their_own_results(folders: list[Path]) -> None:
    with pytest.raises(InputError, match="holds bright itself"):
        list(calibrate_cameras(folders[:1], folders[0].parent))


def test_what_would_be_replaced_is_removed_by_hand(folders: list[Path], tmp_path: Path) -> None:
    told = run_command("calibrate", folders[0], "--each", "--force", "--out", tmp_path)
    assert (told.returncode, "remove the folders" in told.stderr) == (2, True)


def test_a_full_disk_is_told_for_the_camera_that_met_it(
    folders: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_arguments: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(outputs, "write_outputs", full)
    with ThreadPoolExecutor(1) as executor:
        found = calibrated(folders[:1], tmp_path, executor=executor)
    assert "No space left" in found["bright"]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", [[], ["passport.json"]])
def test_of_two_processes_with_one_folder_the_first_counts(
    folders: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: list[str]
) -> None:
    def meanwhile(_result: object, folder: Path) -> list[Path]:
        for each, names in ((tmp_path / "bright", content), (folder, ["report.html"])):
            each.mkdir(parents=True)
            for name in names:
                (each / name).touch()
        return []

    monkeypatch.setattr(outputs, "calibrate", lambda *_arguments, **_options: None)
    monkeypatch.setattr(outputs, "write_outputs", meanwhile)
    with ThreadPoolExecutor(1) as executor:
        assert calibrated(folders[:1], tmp_path, executor=executor) == {"bright": ""}
    assert [path.name for path in tmp_path.iterdir()] == ["bright"]
    assert [path.name for path in (tmp_path / "bright").iterdir()] == (content or ["report.html"])


def test_workers_that_cannot_start_are_told(folders: list[Path], tmp_path: Path) -> None:
    class Unable(ThreadPoolExecutor):
        def submit(self, *_arguments):
            raise OSError("no processes")

    with Unable(1) as executor, pytest.raises(WorkerError, match="did not start"):
        calibrated(folders[:1], tmp_path, executor=executor)


def test_the_command_names_each_camera_and_what_failed(folders: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "bright").mkdir(parents=True)
    arguments = ["--each", "--chart", "none", "--exposures", EXPOSURES, "--out", out]
    told = run_command("calibrate", *folders, *arguments)
    assert told.returncode == 2
    assert next(line for line in told.stdout.splitlines() if "broken" in line).endswith("use one time above 0 for each")
    assert "1 of 3 folders gave no response" in told.stderr
    assert run_command("calibrate", *folders[::2], *arguments).returncode == 0
    assert set(passports(out)) == {"dark"}
    doubtful = replace(passports(out)["dark"], warnings=("it is doubtful",))
    write_response(doubtful, out / "bright" / "passport.json")
    again = run_command("calibrate", *folders[::2], *arguments).stdout
    assert re.search(r"of 2: \S*bright\nwarning: it is doubtful\n", again), again


def test_a_worker_that_is_lost_is_told_and_the_next_call_goes_on(folders: list[Path], tmp_path: Path) -> None:
    class Crashing(ThreadPoolExecutor):
        def submit(self, function, *arguments):
            if arguments[0].name == "bright":
                return super().submit(function, *arguments)
            future: Future = Future()
            super().submit(future.set_exception, BrokenExecutor("killed"))
            return future

    with Crashing(1) as executor, pytest.raises(WorkerError, match="calibrate the same folders again to go on"):
        calibrated(folders[::2], tmp_path, executor=executor)
    with ThreadPoolExecutor(1) as executor:
        assert calibrated(folders[::2], tmp_path, executor=executor) == {"bright": "", "dark": ""}
    assert set(passports(tmp_path)) == set(GAMMAS)


@pytest.fixture
def cluster() -> Iterator:
    distributed = pytest.importorskip("distributed", reason="dask is absent: pip install 'crfbench[cluster]'")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.mark.slow
def test_a_cluster_replaces_a_worker_that_is_killed(folders: list[Path], tmp_path: Path, cluster) -> None:
    killed = cluster.submit(os.kill, next(iter(cluster.run(os.getpid).values())), signal.SIGKILL)
    assert calibrated(folders[::2], tmp_path, executor=cluster.get_executor()) == {"bright": "", "dark": ""}
    killed.cancel()
    assert set(passports(tmp_path)) == set(GAMMAS)


def test_no_more_workers_than_windows_can_wait_for(monkeypatch):
    asked = []
    monkeypatch.setattr(parallel, "cpu_count", lambda: 128)
    monkeypatch.setattr(parallel, "ProcessPoolExecutor", lambda n, **options: asked.append(n) or pytest.skip.Exception)
    with pytest.raises(AttributeError), parallel.local_workers():
        pass
    assert asked == [61]
