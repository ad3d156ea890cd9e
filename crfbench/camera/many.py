"""Many cameras at once: a folder of photographs each, on every core of this machine or on a cluster."""

import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, as_completed
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
    paths = list(map(Path, folders))
    given = {path.resolve().name: path for path in paths}
    if len(given) < len(paths):
        raise InputError(f"{len(paths)} folders have but {len(given)} names; use folders of different names")
    done = {name for name in given if (Path(out) / name).exists()}
    yield from ((given[name], "") for name in given if name in done)
    todo = {name: folder for name, folder in given.items() if name not in done}
    Path(out).mkdir(parents=True, exist_ok=True)
    with nullcontext(executor) if executor else local_workers() as workers:
        futures = {workers.submit(_calibrate, todo[name], Path(out) / name, options): todo[name] for name in todo}
        try:
            yield from ((futures[future], future.result()) for future in as_completed(futures))
        except (BrokenExecutor, OSError) as error:
            raise worker_error(error, "calibrate the same folders again") from error
        finally:
            for future in futures:
                future.cancel()


def _calibrate(folder: Path, out: Path, options: dict[str, Any]) -> str:
    """Return why a camera could not be calibrated, which must not end the others."""
    try:
        result = calibrate(folder, **options)
    except CrfbenchError as error:
        return str(error)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent) as part:
        complete = Path(part) / "complete"
        list(write_outputs(result, complete))
        if not out.exists():  # another process may have been faster
            complete.rename(out)
    return ""
