"""The front-end files that lie in ``static``, joined into what one widget loads."""

from pathlib import Path

_STATIC = Path(__file__).parent / "static"


def join(*names: str) -> str:
    """Return the static files of those names as one text.

    A widget must work offline and in exported pages, where a module has no address to import others from, so
    shared files come first, declare and export nothing, and the widget's own module comes last.
    """
    return "\n".join((_STATIC / name).read_text(encoding="utf-8") for name in names)
