"""Many cameras at once: a folder of photographs each, on every core of this machine or on a cluster."""

import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, as_completed
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from crfbench.camera.calibrate import calibrate
from crfbench.camera.outputs import write_outputs
from crfbench.errors import CrfbenchError, InputError
from crfbench.parallel import local_workers, worker_error


def calibrate_cameras(
    folders: Iterable[str | Path], out: str | Path, executor: Executor | None = None, **options: Any
) -> Iterator[tuple[Path, str]]:
    """Calibrate each folder as a camera of its own, and write its files into a folder of the same name.

    A camera whose folder is there counts as done, so that a second call goes on where the first one stopped. A worker
    process that ends by itself is a `WorkerError`; what was done stays.

    Parameters
    ----------
    folders : iterable of path
        Of different names.
    out : path
        Where their folders go. Each appears when it is complete.
    executor : Executor, optional
        Any executor of the kind of `concurrent.futures`, whose workers see the same files; by default one process a
        core of this machine.
    **options
        Of `calibrate`, the same for all cameras.

    Yields
    ------
    tuple of Path and str
        Each folder as it is done, with what was wrong with its photographs, or "".
    """
    paths, out = list(map(Path, folders)), Path(out).resolve()
    given = {path.resolve().name: path for path in paths}
    if len(given) < len(paths):
        raise InputError(f"{len(paths)} folders, and {len(given)} different names; use folders of different names")
    if inside := [path for path in paths if path.resolve().parent == out]:
        raise InputError(f"out={str(out)!r} holds {inside[0].name} itself; use another folder")
    out.mkdir(parents=True, exist_ok=True)
    todo = {name: path for name, path in given.items() if not (out / name).exists()}
    yield from ((path, "") for name, path in given.items() if name not in todo)
    with nullcontext(executor) if executor else local_workers() as workers:
        futures: dict[Future[str], Path] = {}
        try:
            for name, path in todo.items():
                futures[workers.submit(_calibrate, path, out / name, options)] = path
            yield from ((futures[future], future.result()) for future in as_completed(futures))
        except (BrokenExecutor, OSError) as error:
            raise worker_error(error, "calibrate the same folders again") from error
        finally:
            for future in futures:
                future.cancel()


def _calibrate(folder: Path, out: Path, options: dict[str, Any]) -> str:
    """Return why a camera gave no response, which must not end the others: its files, or a full disk."""
    try:
        result = calibrate(folder, **options)
        with tempfile.TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent) as part:
            complete = Path(part) / "complete"
            list(write_outputs(result, complete))
            complete.rename(out)
    except (CrfbenchError, OSError) as error:
        return "" if out.exists() else str(error)  # another process may have been faster
    return ""
