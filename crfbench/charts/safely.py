"""Run what reads untrusted files in a process of its own, so that a decoder that crashes or hangs ends that one alone.

The process is started by import, so a script that reads photographs needs its ``if __name__ == "__main__":``.
"""

import multiprocessing
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from crfbench.errors import CrfbenchError, FormatError

Result = TypeVar("Result")


class SafeReader:
    """One worker process, started when first needed and again after a crash.

    Parameters
    ----------
    timeout : float
        Seconds that one file may take.

    Examples
    --------
    >>> from pathlib import Path
    >>> from crfbench.charts import SafeReader, read_size
    >>> with SafeReader() as reader:
    ...     reader.run(read_size, Path("nowhere.jpg"))
    Traceback (most recent call last):
    crfbench.errors.FormatError: nowhere.jpg cannot be read (No such file or directory); use a file that is there
    """

    def __init__(self, timeout: float = 120.0) -> None:
        self._timeout = timeout
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def run(self, function: Callable[..., Result], path: Path, *arguments: object) -> Result:
        """Return ``function(path, *arguments)``, computed in the worker.

        Parameters
        ----------
        function : callable
            Of a module, as `read_raw`; its result should be small, as it is copied.
        path : path
            The file that it reads; errors name it.
        *arguments
            What else `function` takes.

        Raises
        ------
        FormatError
            If the worker crashed or took too long; the next file gets a new one.
        CrfbenchError
            Whatever `function` raises of this kind.
        """
        pipe = self._connection()
        try:
            pipe.send((function, (path, *arguments)))
            if not pipe.poll(self._timeout):
                raise FormatError(f"{path.name} took its decoder more than {self._timeout:g} s; use another file")
            succeeded, answer = pipe.recv()
        except (EOFError, OSError):
            self.close()
            raise FormatError(f"{path.name} crashed its decoder; use another file") from None
        except BaseException:
            self.close()  # whatever it does now, its answer would be taken for that to the next file
            raise
        if not succeeded:
            raise answer
        return answer

    def close(self) -> None:
        """End the worker; the next file starts another."""
        if self._process and self._pipe:
            self._pipe.close()
            self._process.kill()
            self._process.join()
            self._process.close()
        self._process = self._pipe = None

    def _connection(self) -> Connection:
        if self._pipe and self._process and self._process.is_alive():
            return self._pipe
        self.close()
        context = multiprocessing.get_context("spawn")  # a fork would copy locks that other threads hold
        ours, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()
        self._pipe = ours
        return ours


def _serve(pipe: Connection) -> None:
    """Answer until the other side is closed or gone; Ctrl-C is for the main process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while True:
        try:
            function, arguments = pipe.recv()
        except EOFError:
            return
        answer: tuple[bool, Any]
        try:
            answer = True, function(*arguments)
        except CrfbenchError as error:
            answer = False, error
        pipe.send(answer)
