"""Run the command ``crfbench`` in this process, which takes no second of starting up."""

import io
import os
from contextlib import redirect_stderr, redirect_stdout
from subprocess import CompletedProcess
from unittest import mock

from crfbench.cli import main


def run_command(*arguments: object) -> CompletedProcess[str]:
    """Run ``crfbench ARGUMENTS`` without the real data, and return what a process would: status, stdout and stderr."""
    out, err, status = io.StringIO(), io.StringIO(), 0
    without_data = {name: value for name, value in os.environ.items() if name != "CRFBENCH_DATA"}
    with mock.patch.dict(os.environ, without_data, clear=True), redirect_stdout(out), redirect_stderr(err):
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 0
    return CompletedProcess(list(arguments), status, out.getvalue(), err.getvalue())
