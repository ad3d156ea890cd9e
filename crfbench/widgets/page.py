"""Widgets in one HTML page that works from a file: no Python, no server, and no request leaves it.

For widgets whose JavaScript does all the work by itself.
"""

import base64
import html
import json
from collections.abc import Mapping
from string import Template
from typing import Any

import anywidget
import traitlets

from crfbench.widgets.assets import ONE_THREAD, StoredWidget, bundle, join


class LivingWidget(StoredWidget):
    """A widget that the page moves by itself, with Python or without it, and that Python moves too."""

    _title: str  # of the page that holds the widget by itself
    #: How often Python has moved it.
    _python_moves = traitlets.Int(0).tag(sync=True)
    #: That number as the page knew it when it made its last move, and how many moves the page has made.
    _page_moves = traitlets.List([0, 0]).tag(sync=True)
    # Whether traits are changing because the page said so.
    _receiving = False
    _moved_by_both: frozenset[str] = frozenset()

    def notify_change(self, change: Any) -> None:
        """Count Python's moves; the page hears of the move and of its number in one message.

        The message has all that both move: what the page had under way and is not taken may have changed the rest.
        """
        if change["name"] in self._moved_by_both and not self._receiving:
            with self.hold_sync():
                self._python_moves += 1
                super().notify_change(change)
                self._states_to_send |= self._moved_by_both
        else:
            super().notify_change(change)

    def set_state(self, sync_data: dict[str, Any]) -> None:
        """Take what the page sends, unless it was sent before the page heard of Python's last move.

        While a cell runs, messages of the page wait; without this, such an old one would undo what the cell has set.
        """
        with ONE_THREAD:
            known, _ = sync_data.get("_page_moves", (self._python_moves, 0))
            if known < self._python_moves:
                return
            self._receiving = True
            try:
                super().set_state(sync_data)
            finally:
                self._receiving = False

    def _alone(self) -> str:
        """Return a page of the widget for notebooks made into HTML."""
        return page(self, self._title)

    def _still(self) -> dict[str, str]:
        return {"text/html": frame(self._alone(), f"{self!r}: run this cell to see it.")}


def page(widget: anywidget.AnyWidget, title: str, state: Mapping[str, object] | None = None) -> str:
    """Return a page of one widget, holding its module, styles and synchronised traits.

    `title` is plain text; `state` has values to take instead of the widget's own, by the name of their traits.
    """
    return document(title, f"<h1>{html.escape(title)}</h1>\n{island(widget, state)}")


def document(title: str, body: str, style: str = "") -> str:
    """Return a page around `body`, trusted HTML with a first heading and any number of islands; `title` is text."""
    parts = {"title": html.escape(title), "style": style, "body": body, "script": bundle("page.js")}
    return Template(join("page.html")).substitute(parts)


def island(widget: anywidget.AnyWidget, state: Mapping[str, object] | None = None, name: str = "content") -> str:
    """Return a place for a widget and all it needs, to put into a `document`; `name` differs from other islands'."""
    content = {"module": str(widget._esm), "css": str(widget._css), "state": {**_state(widget), **(state or {})}}
    # No "<" means that nothing in the JSON can end the script element it lies in.
    text = json.dumps(content, default=_base64, sort_keys=True).replace("<", "\\u003c")
    return f'<div></div>\n<script type="application/json" id="{name}">{text}</script>'


def frame(document: str, instead: str) -> str:
    """Return a page as a frame in another page, as high as its content; `instead` is shown where frames are not.

    Notebooks that are not trusted yet show none.
    """
    style = "width: 100%; height: 640px; border: 0"
    return f'<iframe srcdoc="{html.escape(document)}" style="{style}">{html.escape(instead)}</iframe>'


def _state(widget: anywidget.AnyWidget) -> dict[str, object]:
    """Return what the widget itself synchronises, without what every widget does."""
    common = {*anywidget.AnyWidget.class_trait_names(sync=True), "_anywidget_id", "_esm", "_css"}
    state: dict[str, object] = widget.get_state(set(widget.trait_names(sync=True)) - common)
    return state


def _base64(value: bytes | memoryview) -> dict[str, str]:
    return {"base64": base64.b64encode(value).decode()}
