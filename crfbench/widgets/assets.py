"""What all widgets share: joined front-end files, traits that check their values, what a stored notebook shows."""

import base64
import html
import inspect
import io
import re
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import anywidget
import traitlets

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STATIC = Path(__file__).parent / "static"
# The only forms that the modules use; a test holds them to it.
_IMPORT = re.compile(r'^import \{[^}]*\} from "\./(.+)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?!default)", re.MULTILINE)
# JupyterLab lets another thread than the cells' take what the page sends. One lock for all widgets, since two that are
# linked would wait for each other's.
ONE_THREAD = threading.RLock()


def bundle(entry: str) -> str:
    """Return a JavaScript module and all that it imports as one module.

    A widget must work offline and in exported pages, where a module has no address to import others from. So the text
    of each module comes once, after those that it imports, and import and export lines are left out. Top-level names
    must differ between the modules of a bundle.
    """
    modules: list[str] = []

    def add(name: str) -> None:
        for imported in _IMPORT.findall(join(name)):
            add(imported)
        if name not in modules:
            modules.append(name)

    add(entry)
    return _EXPORT.sub("", _IMPORT.sub("", join(*modules)))


def join(*names: str) -> str:
    """Return the static files of those names as one text."""
    return "\n".join((_STATIC / name).read_text(encoding="utf-8") for name in names)


class StoredWidget(anywidget.AnyWidget):
    """A widget that leaves something to look at in a stored notebook, for viewers and HTML without a kernel."""

    def _still(self) -> dict[str, str]:
        """Return what is shown instead of the widget, by media type."""
        raise NotImplementedError

    def set_state(self, sync_data: dict[str, Any]) -> None:
        """Take what the page sends, while no other thread changes a widget."""
        with ONE_THREAD:
            super().set_state(sync_data)

    def _repr_mimebundle_(self, **kwargs: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        data, metadata = super()._repr_mimebundle_(**kwargs) or ({}, {})
        return {**data, **self._still()}, metadata


def picture(axes: "Axes") -> dict[str, str]:
    """Return the figure of these Axes as a small PNG, and close it, so that the notebook does not show it as well."""
    from matplotlib import pyplot as plt

    figure, file = axes.figure.get_figure(root=True), io.BytesIO()
    figure.savefig(file, format="png", dpi=72, bbox_inches="tight")
    plt.close(figure)
    return {"image/png": base64.b64encode(file.getvalue()).decode()}


def table(caption: str, rows: Iterable[Iterable[str]]) -> dict[str, str]:
    """Return texts as a table of HTML, whose first row is the heading."""
    head, *body = ["".join(f"<td>{html.escape(text)}</td>" for text in row) for row in rows]
    lines = [head.replace("td>", "th>"), *body]
    text = "\n".join(f"<tr>{line}</tr>" for line in lines)
    return {"text/html": f"<table>\n<caption>{html.escape(caption)}</caption>\n{text}\n</table>"}


_T = TypeVar("_T")


class SyncedTrait(traitlets.TraitType[_T, Any]):
    """A trait made of the method that checks its values: ``@SyncedTrait`` above it, its docstring is the help.

    The method returns the value to keep, or raises `InputError`. Unlike ``traitlets.validate``, it runs before the
    value is kept: a page, or a slider linked to the trait, sends values that traitlets would keep and refuse later.

    Examples
    --------
    >>> from crfbench.checks import check_count
    >>> class Lamp(traitlets.HasTraits):
    ...     @SyncedTrait
    ...     def level(self, level: object) -> int:
    ...         "Brightness from 0 to 10."
    ...         return check_count("level", level, least=0, most=10)
    >>> Lamp(level=3).level
    3
    """

    def __init__(self, check: Callable[[Any, Any], _T]) -> None:
        super().__init__(help=inspect.getdoc(check))
        self._check = check
        self.tag(sync=True)

    def validate(self, obj: Any, value: Any) -> _T:
        """Return the value to keep."""
        return self._check(obj, value)

    def set(self, obj: Any, value: Any) -> None:
        """Keep a value and tell of it, while no other thread changes a widget."""
        with ONE_THREAD:
            super().set(obj, value)
