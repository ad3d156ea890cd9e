"""Where the shipped data and notebooks lie: inside an installed package, or beside it in a checkout."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def shipped(name: str) -> Path:
    """Return the path of a shipped folder or file, for example ``data/opencrf.npz`` or ``notebooks``."""
    installed = _PACKAGE / name
    return installed if installed.exists() else _PACKAGE.parent / name
