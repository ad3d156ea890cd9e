"""The reproduction report as one HTML page that works from a file: claims, findings, figures, leaderboard, slider."""

import html
import io
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.axes import Axes

import crfbench
from crfbench import plots
from crfbench.datasets import load_responses
from crfbench.files import write_atomically
from crfbench.paper.claims import claims_table, verdict_counts
from crfbench.paper.figures import calibration_figure, figure_of, plot_fitting, stability_figure
from crfbench.paper.findings import does_not_follow, holds
from crfbench.paper.results import LEADERBOARD, PaperResults, leaderboard, load_results
from crfbench.paper.verdicts import RULES
from crfbench.widgets import LatentExplorer, SortableTable
from crfbench.widgets.assets import join
from crfbench.widgets.page import document, island

TITLE = "One latent number for a camera response: a paper rebuilt and checked"
#: A sign and a class of each verdict, which tell it without colour.
_MARKS = {
    "reproduced": ("✓", "yes"),
    "holds": ("✓", "yes"),
    "differs": ("✗", "no"),
    "does not hold": ("✗", "no"),
    "undecided": ("?", "none"),
    "not comparable": ("–", "none"),
}
#: What stands for matplotlib's colours in a page, which may be dark: there the palette is lighter.
_PAGE_COLOURS = {
    "#000000": "currentColor",
    "#ffffff": "Canvas",
    "#b0b0b0": "var(--line)",
    "#cccccc": "var(--line)",
    "#666666": "var(--soft)",
    "#0072b2": "light-dark(#0072b2, #3d9ae0)",
    "#d55e00": "light-dark(#d55e00, #f28a3a)",
    "#009e73": "light-dark(#009e73, #2ec495)",
    "#56b4e9": "light-dark(#56b4e9, #a5dbff)",
}
#: The figures by the name of their file: what draws each, its caption, and what one sees in it.
_FIGURES: dict[str, tuple[Callable[[PaperResults], Axes], str, str]] = {
    "report_fitting": (
        lambda results: plot_fitting(results.fitting, "forward"),
        "Table 1: mean RMSE on DoRF by number of parameters. Our best fits as lines, the paper's figures as crosses.",
        "EMoR's crosses lie on its line; those of SLR, Gamma and most of Polynomial and GGCM lie off theirs.",
    ),
    "report_stability": (
        stability_figure,
        "Table 2: total variance with 3, 6, 12 and 24 patches, Canon PowerShot G9.",
        "Total variance, logarithmic: our means with long bars over the seeds, the paper's crosses beside them.",
    ),
    "report_calibration": (
        calibration_figure,
        "Table 3: mean RMSE of calibration from three patches, by the paper's method.",
        "Our bars overlap for most models; some of the paper's crosses lie in them, EMoR's lies far to the right.",
    ),
    "report_search": (
        lambda results: plots.plot_search(results.search),
        "The search: accuracy of 156 candidates against complexity, one seed.",
        "The most accurate candidates have bars far longer than the differences between them.",
    ),
}


def write_report(path: Path) -> Path:
    """Write the report, replacing an older one, and return its path."""
    page = document(TITLE, report_body(), join("report.css"))
    write_atomically(path, page.encode())
    return path


def write_figures(folder: Path) -> Iterator[Path]:
    """Write the report's figures as PDF files to print, replacing older ones, and yield each path."""
    results = load_results()
    for name, (draw, *_) in _FIGURES.items():
        path = folder / f"{name}.pdf"
        write_atomically(path, _picture(draw, results, "pdf", {"CreationDate": None}))
        yield path


def report_body() -> str:
    """Return what the page holds, for a `crfbench.widgets.page.document` with report.css.

    It asks the network for nothing, and its tables and sliders need no Python.
    """
    results = load_results()
    claims = claims_table(results)
    tables = {name: claims[claims["where"] == name].to_dict("records") for name in ("Table 1", "Table 2", "Table 3")}
    # The template escapes whatever it is given, but for what it calls safe: our own pictures and widgets.
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.jinja").render(
        title=TITLE,
        version=crfbench.__version__,
        counts=verdict_counts(claims),
        rules=RULES,
        marks=_MARKS,
        findings={"What holds": holds(results), "What does not follow, and why": does_not_follow(results)},
        figures=[(caption, _svg(draw, results, caption, alt)) for draw, caption, alt in _FIGURES.values()],
        slider=island(latent_slider(), name="latent"),
        leaderboard=island(sortable_leaderboard(), name="leaderboard"),
        text_claims=claims[~claims["where"].isin(tables)].to_dict("records"),
        table_claims=tables,
    )


def sortable_leaderboard() -> SortableTable:
    """Return the leaderboard as a table to sort."""
    caption = "Models of the inverse response: fits of DoRF, calibration of 14 cameras"
    labels, formats, notes = ({name: column[i] for name, column in LEADERBOARD.items() if column[i]} for i in range(3))
    return SortableTable(leaderboard(), caption, labels, notes, formats)


def latent_slider() -> LatentExplorer:
    """Return the latent slider with the one-latent models of LDL and the monotone one, and OpenCRF to compare with."""
    return LatentExplorer(["SLR-ldl-1", "SLR-monotone-1"], load_responses("opencrf"))


def _picture(draw: Callable[[PaperResults], Axes], results: PaperResults, kind: str, metadata: dict[str, Any]) -> bytes:
    """Draw a figure and return it as a file of that kind, the same at each run."""
    mpl.use("agg")
    content, figure = io.BytesIO(), figure_of(draw(results))
    figure.savefig(content, format=kind, metadata=metadata)
    plt.close(figure)
    return content.getvalue()


def _svg(draw: Callable[[PaperResults], Axes], results: PaperResults, caption: str, alt: str) -> str:
    """Return a figure as SVG to put into a page: identifiers of its own, colours of the page, and a text."""
    style: dict[Any, Any] = {
        "svg.fonttype": "path",
        "svg.hashsalt": caption,
        "legend.framealpha": 1.0,  # no line crosses the words
        "savefig.transparent": True,
    }
    with mpl.rc_context(style):
        metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        svg = _picture(draw, results, "svg", metadata).decode()
    prefix = re.sub(r"\W+", "-", caption.split(":", maxsplit=1)[0]).lower()
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\1{prefix}-", svg[svg.index("<svg") :])
    for written, shown in _PAGE_COLOURS.items():
        svg = svg.replace(written, shown)
    return svg.replace("<svg ", f'<svg role="img" aria-label="{html.escape(alt)}" fill="currentColor" ', 1)
