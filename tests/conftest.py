"""Fixtures that several test files share: the real data where they are, and a user cache that is always empty."""

import signal
import sys
import warnings
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, settings

from crfbench.datasets import Responses, load_dorf, registry

# spectral-film-lut has colour-science look into every loaded module as it loads, which fails where one of them loads
# others when looked into; so it is loaded here, before the tests load more. It also changes how NumPy prints: undone.
with warnings.catch_warnings(), suppress(ImportError), np.printoptions():
    import spectral_film_lut  # noqa: F401


# How long an example takes depends on what else the machine does, and says nothing of the code.
settings.register_profile("crfbench", deadline=None)
settings.load_profile("crfbench")
# For mutation testing: the same examples every time, nothing remembered from other mutants, no shrinking, no clock.
settings.register_profile(
    "mutation",
    derandomize=True,
    database=None,
    deadline=None,
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),
)


@pytest.fixture(scope="session", autouse=True)
def ctrl_c_is_heard() -> None:
    """Hear Ctrl-C where the shell had it ignored, as it does for what runs in the background; children inherit this."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def empty_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Hide the user's own cache, so that a run depends on CRFBENCH_DATA alone."""
    cache = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "user_cache_dir", lambda name: str(cache / name))
        yield cache / "crfbench"


@pytest.fixture(autouse=True)
def figures_are_closed() -> Iterator[None]:
    """Close what a test left open, so that the next may ask which figures are."""
    yield
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")


@pytest.fixture(scope="session")
def dorf_curves() -> Responses:
    if not registry.find("dorf/201_CRF_data.mat"):
        pytest.skip("DoRF is absent: run 'crfbench fetch dorf' into a folder and set CRFBENCH_DATA to it")
    return load_dorf()


@pytest.fixture(scope="session")
def emor_files() -> Path:
    path = registry.find("dorf/emor.txt")
    if path is None or not registry.find("dorf/invemor.txt"):
        pytest.skip("EMoR is absent: run 'crfbench fetch emor' into a folder and set CRFBENCH_DATA to it")
    return path.parent


@pytest.fixture(scope="session")
def middlebury_folder() -> Path:
    path = registry.find("middlebury/modified_Middlebury")
    if path is None:
        pytest.skip("the Middlebury images are absent: run 'crfbench fetch middlebury' and set CRFBENCH_DATA")
    return path


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site once."""
    import build_site
    import matplotlib.pyplot as plt

    folder, open_before = tmp_path_factory.mktemp("site"), plt.get_fignums()
    build_site.build(folder)
    assert plt.get_fignums() == open_before, "the build leaves a figure open"
    return folder
