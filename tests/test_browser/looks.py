"""What the tests of several widgets do on a page and look at."""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

PATIENCE = 240  # seconds until what does not come is held to be missing, also on a machine with much else to do

TWO_FRAMES = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"


def eventually(page, look: Callable[[], Any], right: Callable[[Any], bool]) -> Any:
    """Look again and again until what is seen is right, and return it."""
    end = time.monotonic() + PATIENCE
    while not right(seen := look()):
        assert time.monotonic() < end, f"last seen: {seen}"
        page.wait_for_timeout(50)
    return seen


def picture(page, within: str = ".crf") -> str:
    return page.evaluate(f"document.querySelector('{within} canvas').toDataURL()")


def readout(page, name: str) -> str:
    return page.locator(".crf-readouts div").filter(has=page.get_by_text(name, exact=True)).locator("dd").inner_text()


def settled(page) -> None:
    """Wait until Python has answered all that the page asked, and the answer is painted."""
    page.wait_for_function("() => document.querySelector('.crf') && !document.querySelector('.crf[aria-busy=true]')")
    page.evaluate(TWO_FRAMES)


def drag(page, slider, share: float) -> None:
    """Drag the thumb from the middle by that share of the slider's length, in many small moves."""
    box = slider.bounding_box()
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + box["width"] / 2, y)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * (0.5 + share), y, steps=25)
    page.mouse.up()


def screenshot(page, name: str, part: str = ".jp-OutputArea:has(.crf)") -> None:
    """Keep a picture of the widget for a look at it, where CRFBENCH_SHOTS names a folder."""
    if folder := os.environ.get("CRFBENCH_SHOTS"):
        Path(folder).mkdir(parents=True, exist_ok=True)
        page.locator(part).screenshot(path=Path(folder) / f"{name}.png")


def switch_theme(page, theme: str, before: str) -> None:
    page.evaluate("(theme) => jupyterapp.commands.execute('apputils:change-theme', { theme })", theme)
    page.wait_for_function("(before) => document.querySelector('.crf canvas').toDataURL() !== before", arg=before)
    page.wait_for_function(
        """(dark) => [...document.querySelectorAll(".crf")]
            .every((node) => node.style.colorScheme === (dark ? "dark" : "light"))""",
        arg=theme.endswith("Dark"),
    )
    page.wait_for_selector("#jupyterlab-splash", state="detached")
    settled(page)


def colours(page, within: str = ".crf") -> dict[str, bool]:
    """Say which of the two blues is on the canvas."""
    return page.evaluate(
        """(within) => {
            const canvas = document.querySelector(`${within} canvas`);
            const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
            const seen = new Set();
            for (let i = 0; i < data.length; i += 4) if (data[i + 3] === 255) {
                seen.add("#" + [0, 1, 2].map((k) => data[i + k].toString(16).padStart(2, "0")).join("").toUpperCase());
            }
            return Object.fromEntries(["#0072B2", "#56B4E9"].map((name) => [name, seen.has(name)]));
        }""",
        within,
    )


def overflowing(page, within: str = "body") -> list[str]:
    """Name the elements whose content is wider than they are."""
    return page.evaluate(
        """(within) => [...document.querySelector(within).querySelectorAll(".crf, .crf *, .jp-OutputArea-output")]
            .filter((node) => node.clientWidth > 0 && node.scrollWidth > node.clientWidth + 1)
            .map((node) => `${node.tagName} ${node.className}`)""",
        within,
    )
