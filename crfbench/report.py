"""The reproduction report as one HTML page that works from a file: claims, findings, figures, leaderboard, slider."""

import html
import io
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import crfbench
from crfbench import plots
from crfbench.datasets import load_responses
from crfbench.files import write_atomically
from crfbench.models import SLR
from crfbench.paper import CALIBRATION, STABILITY
from crfbench.tables.claims import RULES, claims_table, verdict_counts
from crfbench.tables.evidence import Evidence, load_evidence
from crfbench.tables.findings import Point, does_not_follow, holds
from crfbench.tables.leaderboard import MEANING, leaderboard
from crfbench.widgets import LatentExplorer, SortableTable
from crfbench.widgets.assets import join
from crfbench.widgets.page import document, island

TITLE = "One latent number for a camera response: a paper rebuilt and checked"
_PAPER = (
    "Zhao, Ferguson, Zhou and Rafferty 2022, “Representing Camera Response Function by a Single Latent Variable and "
    "Fully Connected Neural Network”"
)
_MARKS = {
    "reproduced": "✓",
    "holds": "✓",
    "differs": "✗",
    "does not hold": "✗",
    "undecided": "?",
    "not comparable": "–",
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
_HEADINGS = ("claim", "paper", "ours", "verdict", "why")
_LABELS = {
    "model": "model",
    "n_params": "parameters",
    "learned": "learned numbers",
    "in_sample_rmse": "RMSE in sample",
    "held_out_rmse": "RMSE held out",
    "nonmonotone": "falls somewhere",
    "out_of_range": "leaves 0 to 1",
    "steepest_slope": "steepest slope",
    "calibration_3": "calibration, 3 patches",
    "calibration_24": "calibration, 24 patches",
    "coverage": "band coverage",
    "fit_ms": "ms a fit",
}
_FORMATS = {
    "learned": "{:,}",
    "in_sample_rmse": "{:.4f}",
    "held_out_rmse": "{:.4f}",
    "nonmonotone": "{:.0%}",
    "out_of_range": "{:.0%}",
    "steepest_slope": "{:.1f}",
    "calibration_3": "{:.3f}",
    "calibration_24": "{:.3f}",
    "coverage": "{:.0%}",
    "fit_ms": "{:.2g}",
}


def write_report(path: Path) -> Path:
    """Write the report, replacing an older one, and return its path."""
    write_atomically(path, report_page().encode())
    return path


def write_figures(folder: Path) -> Iterator[Path]:
    """Write the report's figures as PDF files to print, replacing older ones, and yield each path."""
    mpl.use("agg")
    for name, (draw, *_) in _figures(load_evidence()).items():
        path, content = folder / f"{name}.pdf", io.BytesIO()
        _drawn(draw).savefig(content, format="pdf", metadata={"CreationDate": None})
        plt.close("all")
        write_atomically(path, content.getvalue())
        yield path


def report_page() -> str:
    """Return the page; it asks the network for nothing, and its tables and sliders need no Python."""
    return document(TITLE, report_body(), join("report.css"))


def report_body() -> str:
    """Return what the page holds, for a `crfbench.widgets.page.document` with report.css."""
    evidence = load_evidence()
    claims = claims_table(evidence)
    return "\n".join(
        [
            f"<header><h1>{html.escape(TITLE)}</h1>\n<p>{html.escape(_introduction(claims))}</p></header>",
            f"<main>\n<h2>Verdicts</h2>\n{_counts(claims)}\n{_rules()}",
            f"<h2>What holds</h2>\n{_points(holds(evidence))}",
            f"<h2>What does not follow, and why</h2>\n{_points(does_not_follow(evidence))}",
            f"<h2>Figures</h2>\n{''.join(_figure(*figure) for figure in _figures(evidence).values())}",
            "<h2>The latent slider</h2>\n<p>Drag the latent: the page decodes the response by itself.</p>",
            island(latent_slider(), name="latent"),
            f"<h2>Every model side by side</h2>\n{island(sortable_leaderboard(), name='leaderboard')}",
            f"<h2>Every claim</h2>\n{''.join(_claims(claims))}</main>",
            f"<footer><p>Made by crfbench {crfbench.__version__} with <code>crfbench report</code>.</p></footer>",
        ]
    )


def sortable_leaderboard() -> SortableTable:
    """Return the leaderboard as a table to sort."""
    caption = "Models of the inverse response: fits of DoRF, calibration of 14 cameras"
    return SortableTable(leaderboard(), caption, _LABELS, MEANING, _FORMATS)


def latent_slider() -> LatentExplorer:
    """Return the latent slider with the one-latent models of LDL and the monotone one, and OpenCRF to compare with."""
    models = {f"{name}-1-inverse": SLR.load(name, 1, "inverse") for name in ("ldl", "monotone")}
    return LatentExplorer(models, load_responses("opencrf"))


def calibration_figure(evidence: Evidence) -> Axes:
    """Draw the means of Table 3 beside ours by the paper's method."""
    rows = evidence.calibration.set_index(["model", "constraint", "n_params"]).loc[list(CALIBRATION)]
    names = [" ".join(map(str, filter(None, key))) for key in CALIBRATION]
    printed = [figures[0] for figures in CALIBRATION.values()]
    label = "mean RMSE over 14 cameras (share of full scale; bars: 95 %)"
    ax = plots.plot_against_paper(names, rows["mean"], rows[["low", "high"]].T, printed, label)
    ax.set_xlim(0, None)
    return ax


def stability_figure(evidence: Evidence) -> Axes:
    """Draw the total variances of Table 2 beside ours by the paper's method."""
    found = evidence.stability.groupby("model")["total_variance"].agg(["mean", "min", "max"]).loc[list(STABILITY)]
    label = "total variance of four inverse responses (bars: three seeds)"
    ax = plots.plot_against_paper(
        list(STABILITY), found["mean"], found[["min", "max"]].T, list(STABILITY.values()), label
    )
    ax.set_xscale("log")
    return ax


def _introduction(claims: pd.DataFrame) -> str:
    counts = verdict_counts(claims).loc["all"]
    comparable = len(claims) - counts["not comparable"]
    out = counts["reproduced"] + counts["holds"]
    return (
        f"{_PAPER}, represents a camera's response by one number and a small network. Here its {len(claims)} figures "
        "and claims stand beside ours, computed anew from the same data with every model fitted as well as it can be. "
        f"The idea holds up. Of the {comparable} that can be compared {out} come out, {counts['undecided']} stay "
        f"undecided, and {counts['differs'] + counts['does not hold']} do not come out; most of them are cells of "
        "Table 3. Where the paper leaves a choice open ours is stated, and a difference may lie in that choice."
    )


def _counts(claims: pd.DataFrame) -> str:
    table = verdict_counts(claims)
    head = "".join(f'<th scope="col">{_mark(name)}</th>' for name in table.columns)
    rows = "".join(
        f'<tr><th scope="row">{part}</th>{"".join(f"<td>{count}</td>" for count in row)}</tr>'
        for part, row in zip(table.index, table.to_numpy(), strict=True)
    )
    return (
        '<div class="scroll" role="region" tabindex="0" aria-label="Counts of verdicts"><table class="counts">'
        f'<caption>Claims by part of the paper and verdict</caption><thead><tr><th scope="col">part</th>{head}</tr>'
        f"</thead><tbody>{rows}</tbody></table></div>"
    )


def _rules() -> str:
    rules = "".join(f"<dt>{_mark(name)}</dt><dd>{html.escape(rule)}.</dd>" for name, rule in RULES.items())
    repeated = "<p>What the paper says in several places is judged, and counted, once for each place.</p>"
    return f"<details><summary>What the verdicts mean</summary><dl>{rules}</dl>{repeated}</details>"


def _points(points: Iterable[Point]) -> str:
    items = "".join(f"<li><b>{html.escape(title)}.</b> {html.escape(text)}</li>" for title, text in points)
    return f"<ul>{items}</ul>"


def _mark(verdict: str) -> str:
    """Return a verdict with its sign, which tells it without colour."""
    kind = {"✓": "yes", "✗": "no", "?": "none", "–": "none"}[_MARKS[verdict]]
    return f'<span class="verdict {kind}"><span aria-hidden="true">{_MARKS[verdict]}</span> {verdict}</span>'


def _claims(claims: pd.DataFrame) -> Iterator[str]:
    """Yield a table for the text and for each of the paper's tables; the long one is folded."""
    tables = {f"Table {number}": claims[claims["where"] == f"Table {number}"] for number in (1, 2, 3)}
    yield f"<h3>The text</h3>{_claim_rows(claims[~claims['where'].isin(tables)], 'Statements outside the tables')}"
    for name, rows in tables.items():
        table = _claim_rows(rows, f"{name}, cell by cell")
        yield f"<h3>{name}</h3><details><summary>{len(rows)} figures</summary>{table}</details>"


def _claim_rows(rows: pd.DataFrame, caption: str) -> str:
    """Return a table that becomes a list of cards where it is narrow; the roles keep it a table for screen readers."""
    head = "".join(f'<th scope="col" role="columnheader">{name}</th>' for name in _HEADINGS)
    body = "".join(_claim_row(row) for row in rows.to_dict("records"))
    return (
        f'<table class="claims" role="table"><caption>{caption}</caption><thead role="rowgroup"><tr role="row">{head}'
        f'</tr></thead><tbody role="rowgroup">{body}</tbody></table>'
    )


def _claim_row(row: dict[str, str]) -> str:
    text = {name: html.escape(value) for name, value in row.items()}
    section = "" if text["where"].startswith("Table") else f"<small>section {text['where']}</small>"
    section = section.replace("section abstract", "abstract")
    cells = {
        "paper": text["paper"] or "in words",
        "ours": f"{text['ours']}<small>{text['spread']}</small>",
        "verdict": _mark(row["verdict"]),
        "why": f"{text['why']}<small><code>{text['how'].replace('.', '.<wbr>')}</code></small>",
    }
    filled = "".join(f'<td role="cell" data-label="{name}">{cell}</td>' for name, cell in cells.items())
    return f'<tr role="row"><th scope="row" role="rowheader">{text["claim"]}{section}</th>{filled}</tr>'


def _figures(evidence: Evidence) -> dict[str, tuple[Callable[[], Axes], str, str]]:
    """Return what draws each figure, its caption, and what one sees in it, by the name of its file."""
    return {
        "report_fitting": (
            lambda: plots.plot_fitting(evidence.fitting),
            "Table 1: mean RMSE on DoRF by number of parameters. Our best fits as lines, the paper's figures as "
            "crosses.",
            "EMoR's crosses lie on its line; those of SLR, Gamma and most of Polynomial and GGCM lie off theirs.",
        ),
        "report_stability": (
            lambda: stability_figure(evidence),
            "Table 2: total variance with 3, 6, 12 and 24 patches, Canon PowerShot G9.",
            "Total variance, logarithmic: our means with long bars over the seeds, the paper's crosses beside them.",
        ),
        "report_calibration": (
            lambda: calibration_figure(evidence),
            "Table 3: mean RMSE of calibration from three patches, by the paper's method.",
            "Our bars overlap for most models; some of the paper's crosses lie in them, EMoR's lies far to the right.",
        ),
        "report_search": (
            lambda: plots.plot_search(evidence.search),
            "The search: accuracy of 156 candidates against complexity, one seed.",
            "The most accurate candidates have bars far longer than the differences between them.",
        ),
    }


def _figure(draw: Callable[[], Axes], caption: str, alt: str) -> str:
    """Return a figure as inline SVG in the colours of the page."""
    style: dict[Any, Any] = {
        "svg.fonttype": "path",
        "svg.hashsalt": caption,
        "legend.framealpha": 1.0,  # no line crosses the words
        "savefig.transparent": True,
    }
    content = io.StringIO()
    with mpl.rc_context(style):
        mpl.use("agg")
        figure = _drawn(draw)
        figure.savefig(content, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
        plt.close(figure)
    picture = _inline(content.getvalue(), re.sub(r"\W+", "-", caption.split(":", maxsplit=1)[0]).lower(), alt)
    region = f'<div class="scroll" role="region" tabindex="0" aria-label="{html.escape(caption)}">{picture}</div>'
    return f"<figure>{region}<figcaption>{html.escape(caption)}</figcaption></figure>"


def _drawn(draw: Callable[[], Axes]) -> Figure:
    figure = draw().get_figure(root=True)
    assert figure is not None  # noqa: S101  an Axes just drawn always lies in a figure
    return figure


def _inline(svg: str, prefix: str, alt: str) -> str:
    """Make an SVG file part of a page: identifiers of its own, black and white as the page has them, and a text."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\1{prefix}-", svg)
    for written, shown in _PAGE_COLOURS.items():
        svg = svg.replace(written, shown)
    return svg.replace("<svg ", f'<svg role="img" aria-label="{html.escape(alt)}" fill="currentColor" ', 1)
