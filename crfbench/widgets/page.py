"""Widgets in one HTML page that works from a file: no Python, no server, and no request leaves it.

For widgets whose JavaScript does all the work by itself.
"""

import base64
import html
import json
from collections.abc import Mapping
from string import Template

import anywidget

from crfbench.widgets.assets import join


def page(widget: anywidget.AnyWidget, title: str, state: Mapping[str, object] | None = None) -> str:
    """Return a page of one widget, holding its module, styles and synchronised traits.

    Parameters
    ----------
    widget : AnyWidget
    title : str
        Plain text.
    state : mapping, optional
        Values to take instead of the widget's own, by the name of their traits.
    """
    return document(title, f"<h1>{html.escape(title)}</h1>\n{island(widget, state)}")


def document(title: str, body: str, style: str = "") -> str:
    """Return a page around `body`, which is HTML with a first heading and any number of islands.

    Parameters
    ----------
    title : str
        Plain text.
    body, style : str
        HTML and CSS that may be trusted.
    """
    parts = {"title": html.escape(title), "style": style, "body": body, "script": join("controls.js", "page.js")}
    return Template(join("page.html")).substitute(parts)


def island(widget: anywidget.AnyWidget, state: Mapping[str, object] | None = None, name: str = "content") -> str:
    """Return a place for a widget and all it needs, to put into a `document`.

    Parameters
    ----------
    widget : AnyWidget
    state : mapping, optional
        Values to take instead of the widget's own, by the name of their traits.
    name : str
        Unlike that of any other island of the page.
    """
    content = {"module": str(widget._esm), "css": str(widget._css), "state": {**_state(widget), **(state or {})}}
    # No "<" means that nothing in the JSON can end the script element it lies in.
    text = json.dumps(content, default=_base64, sort_keys=True).replace("<", "\\u003c")
    return f'<div></div>\n<script type="application/json" id="{name}">{text}</script>'


def frame(document: str, instead: str) -> str:
    """Return a page as a frame to put into another page, which it fits to its own height.

    Parameters
    ----------
    document : str
        A page.
    instead : str
        Text for where frames are not shown, as in notebooks that are not trusted yet.
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
