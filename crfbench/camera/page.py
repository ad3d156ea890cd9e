"""The report of a calibration as one HTML page: pictures inside, no request leaves it."""

import base64
import html
import io
from string import Template

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crfbench.calibration import Calibration
from crfbench.camera.files import CameraCalibration
from crfbench.charts import SafeReader, read_image
from crfbench.plots import plot_calibration, plot_chart, plot_residuals

_GREYS = slice(18, 24)
_COLOURS = (
    "<p>Coloured patches lie off the curve by nature: each channel is bent by itself, and the mean of bent values is "
    "not the bent mean. They count for less, by how coloured they are; the grey patches decide.</p>"
)
_PAGE = Template(
    """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<meta name="color-scheme" content="light dark"><title>$title</title>
<style>
:root { color-scheme: light dark } body { font: 1rem/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto;
padding: 0 1rem } img { max-width: 100%; height: auto; background: #fff }
@media (prefers-color-scheme: dark) {
img[src^="data:image/svg"] { filter: invert(.94) hue-rotate(180deg) brightness(1.2) } }
table { border-collapse: collapse }
th, td { text-align: left; padding: .2rem .8rem .2rem 0; vertical-align: top; overflow-wrap: anywhere }
caption { text-align: left; font-weight: 600 }
</style></head><body><main>
<h1>$title</h1>
<table><caption>The calibration</caption><tbody>$facts</tbody></table>
<h2>Warnings</h2>
$warnings
<h2>Inverse response</h2>
<img alt="$curve_text" src="$curve">
<p>The bands tell what the photographs leave open within the model's family of curves. How far a camera departs from
that family they do not know. The passport holds the nearest curve that never falls.</p>
<h2>Residuals</h2>
<img alt="$residual_text" src="$residuals">
$note
$charts
<h2>Left out</h2>
$problems
</main></body></html>
"""
)


def report_page(result: CameraCalibration) -> str:
    """Return the page: facts, warnings, the curve with its band, residuals, and the chart with its boxes."""
    calibration, camera = result.calibration, result.passport.camera or "camera"
    with mpl.rc_context({"svg.hashsalt": "crfbench"}):
        curve = _picture(plot_calibration(calibration, ax=_axes(6.0, 4.5)))
        residuals = _picture(plot_residuals(calibration, ax=_axes(6.0, 3.0)))
    low, high = calibration.brightness_range[0]
    return _PAGE.substitute(
        title=html.escape(f"Response of {camera}"),
        facts="".join(_fact(name, value) for name, value in _facts(result)),
        warnings=_list(calibration.warnings[0], "None."),
        curve=curve,
        curve_text=f"Inverse response with its bands; measured from brightness {low:.2f} to {high:.2f}",
        residuals=residuals,
        residual_text="Residual of every patch against its brightness, in per cent of irradiance",
        note=_COLOURS if result.measured else "",
        charts=_charts(result),
        problems=_list([problem.reason for problem in result.problems], "No file was left out."),
    )


def _facts(result: CameraCalibration) -> list[tuple[str, str]]:
    passport, calibration = result.passport, result.calibration
    counts = calibration.observations.counts[0]
    rms = np.sqrt((calibration.residuals[0][counts] ** 2).mean())
    return [
        ("model", passport.model),
        ("photographs", ", ".join(result.photographs)),
        ("measurements", f"{int(counts.sum())}, {int((~counts).sum())} clipped or left out"),
        ("brightness measured", f"{passport.valid_range[0]:.3f} to {passport.valid_range[1]:.3f}"),
        (
            "root mean square residual",
            f"{100 * rms:.1f} % of irradiance{_of_greys(calibration) if result.measured else ''}",
        ),
        ("SHA-256 of the files", passport.data_sha256),
        ("crfbench", passport.version),
    ]


def _of_greys(calibration: Calibration) -> str:
    """Say how large the residual of the six grey patches is by itself."""
    counts = calibration.observations.counts[0][:, _GREYS]
    squares = calibration.residuals[0][:, _GREYS][counts] ** 2
    return f"; of the grey patches {100 * np.sqrt(squares.mean()):.1f} %" if squares.size else ""


def _fact(name: str, value: str) -> str:
    return f'<tr><th scope="row">{html.escape(name)}</th><td>{html.escape(value)}</td></tr>'


def _list(texts: list[str] | tuple[str, ...], none: str) -> str:
    items = "".join(f"<li>{html.escape(text)}</li>" for text in texts)
    return f"<ul>{items}</ul>" if items else f"<p>{none}</p>"


def _charts(result: CameraCalibration) -> str:
    """Show the chart where it was found most surely, with the boxes that were measured."""
    if not result.measured:
        return ""
    name, measured = max(result.measured.items(), key=lambda item: item[1].confidence)
    with SafeReader() as reader:
        pixels = reader.run(read_image, result.photographs[name]).pixels
    ax = plot_chart(pixels, measured.corners, _axes(8.0, 8.0 * pixels.shape[0] / pixels.shape[1]))
    text = html.escape(f"Photograph {name} with the 24 patches that were measured")
    return f'<h2>Chart in {html.escape(name)}</h2>\n<img alt="{text}" src="{_picture(ax, "png")}">'


def _axes(width: float, height: float) -> Axes:
    """Return axes of a figure that no notebook shows by itself."""
    return Figure(figsize=(width, height), layout="constrained").subplots()


def _picture(ax: Axes, kind: str = "svg") -> str:
    """Return a figure as a data address."""
    content = io.BytesIO()
    figure = ax.get_figure(root=True)
    assert figure is not None  # noqa: S101  an Axes just drawn always lies in a figure
    metadata = {"Date": None} if kind == "svg" else None
    figure.savefig(content, format=kind, bbox_inches="tight", dpi=110, metadata=metadata)
    media = "image/svg+xml" if kind == "svg" else f"image/{kind}"
    return f"data:{media};base64,{base64.b64encode(content.getvalue()).decode()}"
