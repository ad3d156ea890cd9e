"""Run what reads untrusted files in a process of its own, so that a decoder that crashes or hangs ends that one alone.

One worker serves all files that a Python process reads. A script that uses it needs no ``__main__`` guard.
"""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, TypeVar

from loky.backend.context import get_context

from crfbench.errors import CrfbenchError, FormatError

Result = TypeVar("Result")

_START_SECONDS = 120.0  # that a worker may take to start, on the slowest machine
_DAEMON_LOCK = threading.Lock()


class Worker:
    """One worker process, started when first needed and again after a crash; a file may take `timeout` seconds."""

    def __init__(self, timeout: float = 120.0) -> None:
        self.timeout = timeout
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self._owner = os.getpid()
        self._lock = threading.Lock()  # answers come in the order of the questions, so one thread asks at a time

    def run(self, function: Callable[..., Result], path: Path, *arguments: object) -> Result:
        """Return ``function(path, *arguments)``, computed in the worker, or raise what it raises.

        The function is one of a module, such as `read_raw`, and reads the file `path`. If it crashes the worker or
        takes too long, this is a `FormatError` that names the file, and the next file gets a new worker. If no worker
        can start or import its modules, this is a plain `CrfbenchError`, as it is not the fault of a file.
        """
        with self._lock:
            pipe = self._started()
            try:
                pipe.send((function, (path, *arguments)))
                if not pipe.poll(self.timeout):
                    raise FormatError(f"{path.name} took its decoder more than {self.timeout:g} s; use another file")
                succeeded, answer = pipe.recv()
            except (EOFError, OSError):
                self.close()
                raise FormatError(f"{path.name} crashed its decoder; use another file") from None
            except BaseException:
                self.close()  # whatever it does now, its answer would be taken for that to the next file
                raise
        if isinstance(answer, ImportError):
            raise CrfbenchError(f"the worker process cannot read photographs ({answer}); install crfbench again")
        if not succeeded:
            raise answer
        return answer

    def close(self) -> None:
        """End the worker; the next file starts another."""
        if self._process and self._pipe and self._owner == os.getpid():
            self._pipe.close()
            self._process.terminate()
            self._process.join()
        self._process = self._pipe = None

    def _started(self) -> Connection:
        if self._owner != os.getpid():  # this process was forked, and the worker is that of its parent
            self._process, self._pipe, self._owner = None, None, os.getpid()
        if self._pipe and self._process and self._process.is_alive():
            return self._pipe
        self.close()
        # loky's processes import what they run and never the script that calls, which so needs no guard and may come
        # from stdin. A fork would copy locks that other threads hold.
        context = get_context("loky")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        try:
            _start(self._process)
            theirs.close()  # so that the end of the worker ends the pipe
            if self._pipe.poll(_START_SECONDS) and self._pipe.recv():
                return self._pipe
        except (EOFError, OSError):
            pass
        self._process = self._pipe = None
        raise CrfbenchError(
            f"the worker process that reads photographs did not start; check that {sys.executable} can start processes"
        )


def _start(process: BaseProcess) -> None:
    """Start a process, also from a worker of a cluster: a daemon, which by rights may leave no process behind."""
    config = multiprocessing.current_process()._config  # type: ignore[attr-defined]
    with _DAEMON_LOCK:
        daemon, config["daemon"] = config.get("daemon"), False
        try:
            process.start()
        finally:
            config["daemon"] = daemon


def _serve(pipe: Connection) -> None:
    """Answer until the other side is closed or gone; Ctrl-C is for the main process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Decoders in C write about damage to file 2, beside our sentence; Python keeps a copy for what is a bug.
    sys.stderr = os.fdopen(os.dup(2), "w", buffering=1, errors="backslashreplace")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    pipe.send(True)
    while True:
        answer: tuple[bool, Any]
        try:
            function, arguments = pipe.recv()
            answer = True, function(*arguments)
        except EOFError:
            return
        except (CrfbenchError, ImportError) as error:
            answer = False, error
        except MemoryError:
            answer = False, FormatError(f"{arguments[0].name} needs more memory than there is; use another file")
        pipe.send(answer)


WORKER = Worker()
