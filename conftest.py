"""What `pytest --nbval` needs to run notebooks beside the tests, whichever folder and options it is called with."""

from typing import Any

import pytest


def pytest_configure(config: pytest.Config) -> None:
    """Run notebooks in the environment that runs pytest, unless a kernel is named."""
    if not config.getoption("nbval_kernel_name", None):
        config.option.nbval_current_env = True


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give each worker whole files, and one of them all that drive a browser: they share JupyterLab and Chromium.

    The cells of a notebook share their kernel, so that no other distribution would do.
    """
    from xdist.scheduler import LoadFileScheduling

    class OneBrowser(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            folder = "tests/test_browser/"
            return folder if nodeid.startswith(folder) else super()._split_scope(nodeid)

    return OneBrowser(config, log)
