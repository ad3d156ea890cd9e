"""Work on many things at once, in processes of this machine that never import the script that called."""

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from multiprocessing.connection import Connection

from loky import ProcessPoolExecutor, cpu_count
from loky.backend.context import get_context

from crfbench.errors import WorkerError

_MOST_WORKERS = 61  # that Windows can wait for


@contextmanager
def local_workers() -> Iterator[Executor]:
    """Start one process a core; they end with the block, however it ends, or with this process.

    loky's workers import what they run and never the script that called, which therefore needs no `__main__` guard.
    """
    listen, hold = get_context("loky").Pipe(duplex=False)
    try:
        executor = ProcessPoolExecutor(min(cpu_count(), _MOST_WORKERS), initializer=_start, initargs=(listen,))
    except OSError as error:
        raise worker_error(error, "close other programs") from error
    try:
        yield executor
    finally:
        hold.close()  # busy workers end at once
        executor.shutdown()
        listen.close()


def worker_error(error: Exception, how: str) -> WorkerError:
    """Return what to raise when a worker is lost; `how` says how to go on."""
    reason = str(error).partition(". ")[0]  # loky adds a paragraph of what may be the matter
    return WorkerError(f"a worker process did not start or ended by itself ({reason}); {how} to go on")


def _start(lifeline: Connection) -> None:
    """Leave Ctrl-C to the main process, and end when that closes its end of the pipe or dies."""

    def wait() -> None:
        lifeline.poll(None)  # nothing is ever sent: this returns when there is no one left to send
        os._exit(0)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=wait, daemon=True).start()
