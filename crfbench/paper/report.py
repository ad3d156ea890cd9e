"""The reproduction report as one HTML page that works from a file: claims, findings, figures, leaderboard, slider."""

import html
import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
from jinja2 import Environment, FileSystemLoader, StrictUndefined

import crfbench
from crfbench.datasets import load_responses
from crfbench.files import write_atomically
from crfbench.paper.claims import claims_table, verdict_counts
from crfbench.paper.figures import PAPER_FIGURES, captions, picture
from crfbench.paper.findings import does_not_follow, holds, located, paper_map, summary
from crfbench.paper.results import LEADERBOARD, PaperResults, leaderboard, load_results
from crfbench.paper.verdicts import MARKS, RULES
from crfbench.widgets import LatentExplorer, SortableTable
from crfbench.widgets.assets import join
from crfbench.widgets.page import document, island

TITLE = "One latent number for a camera response: a paper rebuilt and checked"
#: What of `crfbench.paper.figures.PAPER_FIGURES` the page shows: what is recorded, as lines and letters.
_SHOWN = ("table_1", "table_2", "table_3", "algorithm_1")


def write_report(path: Path) -> Path:
    """Write the report, replacing an older one, and return its path."""
    page = document(TITLE, report_body(), join("report.css"))
    write_atomically(path, page.encode())
    return path


def report_body(site: bool = False) -> str:
    """Return what the page holds, for a `crfbench.widgets.page.document` with report.css.

    It asks the network for nothing, and its tables and sliders need no Python. On the site it links to the pages of
    notebooks and figures; elsewhere these are named.
    """
    results = load_results()
    claims = located(claims_table(results))
    tables = {name: claims[claims["where"] == name].to_dict("records") for name in ("Table 1", "Table 2", "Table 3")}
    return _rendered(
        "report",
        site=site,
        title=TITLE,
        version=crfbench.__version__,
        summary=summary(claims),
        counted={
            "Everything, by part of the paper and verdict": verdict_counts(claims),
            "Each claim once, however often it is made, and each row of a table": verdict_counts(claims, distinct=True),
        },
        rules=RULES,
        findings={"holds": holds(results), "does-not-follow": does_not_follow(results)},
        figures=[
            (said["caption"], _svg(name, said["alt"], results)) for name, said in captions().items() if name in _SHOWN
        ],
        slider=island(latent_slider(), name="latent"),
        leaderboard=island(sortable_leaderboard(), name="leaderboard"),
        places=paper_map(results).to_dict("records"),
        text_claims=claims[~claims["where"].isin(tables)].to_dict("records"),
        table_claims=tables,
    )


def map_body(site: bool = False) -> str:
    """Return the map of the paper for a page with report.css; `site` is that of `report_body`."""
    return _rendered("map", site=site, places=paper_map().to_dict("records"))


def _rendered(template: str, **content: object) -> str:
    # The template escapes whatever it is given, but for what it calls safe: our own pictures and widgets.
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(f"{template}.html.jinja").render(content, marks=MARKS)


def sortable_leaderboard() -> SortableTable:
    """Return the leaderboard as a table to sort."""
    caption = "Models of the inverse response: fits of DoRF, calibration of 14 cameras"
    labels, formats, notes = ({name: column[i] for name, column in LEADERBOARD.items() if column[i]} for i in range(3))
    return SortableTable(leaderboard(), caption, labels, notes, formats)


def latent_slider() -> LatentExplorer:
    """Return the latent slider with the one-latent models of LDL and the monotone one, and OpenCRF to compare with."""
    return LatentExplorer(["SLR-ldl-1", "SLR-monotone-1"], load_responses("opencrf"))


def _svg(name: str, alt: str, results: PaperResults) -> str:
    """Return a figure as SVG to put into a page: identifiers of its own, colours of the page, and a text."""
    mpl.use("agg")
    style: dict[Any, Any] = {
        "svg.fonttype": "path",
        "svg.hashsalt": name,
        "legend.framealpha": 1.0,  # no line crosses the words
        "savefig.transparent": True,
    }
    with mpl.rc_context(style):
        svg = picture(
            PAPER_FIGURES[name](results), "svg", dict.fromkeys(("Date", "Creator", "Format", "Type"))
        ).decode()
    plt.close("all")
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\1{name}-", svg[svg.index("<svg") :])
    for colour in re.findall(r"--figure-(\w{6}):", join("report.css")):
        svg = svg.replace(f"#{colour}", f"var(--figure-{colour})")
    return svg.replace("<svg ", f'<svg role="img" aria-label="{html.escape(alt)}" fill="currentColor" ', 1)
