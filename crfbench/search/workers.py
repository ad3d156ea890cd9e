"""Worker processes of a search on one machine; for more machines, hand in an executor of your own."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection


@contextmanager
def local_workers(count: int | None = None) -> Iterator[Executor]:
    """Start one process a core (or `count`); they end with the block, however it ends, or with this process."""
    context = multiprocessing.get_context("spawn")  # a forked PyTorch may wait for threads that it no longer has
    listen, hold = context.Pipe(duplex=False)
    with ProcessPoolExecutor(count or os.cpu_count(), context, initializer=_start, initargs=(listen,)) as executor:
        try:
            yield executor
        finally:
            hold.close()
            executor.shutdown(wait=False, cancel_futures=True)


def _start(lifeline: Connection) -> None:
    """Leave Ctrl-C to the main process, and end when it closes its end of the pipe or dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()


def _end_with(lifeline: Connection) -> None:
    lifeline.poll(None)  # nothing is ever sent: this returns when there is no one left to send
    os._exit(0)
