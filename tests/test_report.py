"""The report as a file: complete, well-formed, the same at each run, and with nothing from elsewhere."""

import re
from html.parser import HTMLParser

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from markupsafe import escape

from crfbench.paper import figures, report
from crfbench.paper.claims import claims_table, verdict_counts
from crfbench.paper.figures import plot_against_paper
from crfbench.paper.findings import does_not_follow, holds, paper_map, summary
from crfbench.paper.results import leaderboard, load_results

VOID = {"meta", "wbr", "br", "path", "use", "rect"}


class Outline(HTMLParser):
    """Notes what a page holds and checks that its elements nest."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.found if name == tag]


def escaped(text: str) -> str:
    return str(escape(text))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    return report.write_report(tmp_path_factory.mktemp("report") / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def outline(page: str) -> Outline:
    return Outline(page)


def test_nothing_comes_from_elsewhere(page, outline):
    assert "default-src 'none'" in page
    assert not outline.all("link") + outline.all("img") + outline.all("iframe")
    assert not any("src" in script for script in outline.all("script"))
    addresses = set(re.findall(r"""https?://[^"'\s<)]+""", page))
    assert addresses <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}  # names, never fetched


def test_headings_go_down_one_step_at_a_time(outline):
    levels = [int(tag[1]) for tag, _ in outline.found if re.fullmatch(r"h\d", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert (np.diff(levels) <= 1).all()


def test_tables_have_captions_and_scopes_and_figures_texts(outline):
    assert len(outline.all("table")) == len(outline.all("caption")) == 7
    assert all(heading.get("scope") in {"col", "row"} for heading in outline.all("th"))
    pictures = outline.all("svg")
    assert len(pictures) == len(outline.all("figcaption")) == 4
    assert all(picture["role"] == "img" and len(picture["aria-label"]) > 30 for picture in pictures)


def test_identifiers_are_unique_and_found(page, outline):
    names = [attributes["id"] for _, attributes in outline.found if "id" in attributes]
    assert len(names) == len(set(names))
    assert set(re.findall(r'(?:href="|url\()#([^")]+)', page)) <= set(names)


def test_every_claim_and_finding_is_on_the_page(page):
    results = load_results()
    claims = claims_table(results)
    for row in claims.to_dict("records"):
        assert escaped(row["claim"]) in page
        assert escaped(row["why"]) in page
    for title, text in (does_not_follow(results) | holds(results)).items():
        assert f"<b>{escaped(title)}.</b> {escaped(text)}" in page
    for name, count in verdict_counts(claims).loc["all"].items():
        assert page.count(f"</span> {name}</span></td>") == count + (paper_map()["verdict"] == name).sum()
    assert escaped(summary(claims)) in page
    for model in leaderboard()["model"]:
        assert f'"{model}"' in page


def test_text_is_escaped_wherever_it_stands(monkeypatch):
    rows = claims_table().iloc[[0, -1]].copy()
    for column in rows.columns.drop(["where", "verdict", "how", "group"]):
        rows[column] = f"<script>{column}</script>"
    monkeypatch.setattr(report, "claims_table", lambda results: rows)
    monkeypatch.setattr(report, "holds", lambda results: {"<i>": '"&'})
    body = report.report_body()
    assert "<b>&lt;i&gt;.</b> &#34;&amp;</li>" in body
    for column in rows.columns.drop(["where", "verdict", "how", "group"]):
        assert f"<script>{column}" not in body
        assert body.count(f"&lt;script&gt;{column}&lt;/script&gt;") == 2


def test_every_run_writes_the_same_and_leaves_no_figure_open(page, tmp_path):
    path = report.write_report(tmp_path / "new" / "report.html")
    assert path.read_text(encoding="utf-8") == page
    assert plt.get_fignums() == []
    assert [found.name for found in path.parent.iterdir()] == ["report.html"]


def test_figures_take_the_colours_of_the_page(page):
    pictures = re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL)
    assert not any("#000000" in picture or "#ffffff" in picture for picture in pictures)


def test_figures_show_the_figures_of_the_tables():
    printed = {"a": 3.0, "b": 0.1}
    ax = plot_against_paper(pd.Series([1.0, 2.0], ["a", "b"]), [[0.5, 1.0], [2.0, 2.5]], printed, "size")
    crosses = ax.get_lines()[-1]
    np.testing.assert_array_equal(crosses.get_xdata(), [3.0, 0.1])
    bars = np.array(ax.collections[0].get_segments())[:, :, 0]
    np.testing.assert_allclose(bars, [[0.5, 2.0], [1.0, 2.5]])
    assert [text.get_text() for text in ax.get_yticklabels()] == ["a", "b"]
    plt.close("all")


@pytest.mark.slow
def test_figures_are_written_as_pdf_and_png(tmp_path):
    paths = list(figures.write_figures(tmp_path / "figures"))
    assert {path.name for path in paths} >= {name for name in paper_map()["figure"] if name}
    assert {path.suffix for path in paths} == {".pdf", ".png"}
    for path in paths:
        content = path.read_bytes()
        assert content.startswith(b"%PDF" if path.suffix == ".pdf" else b"\x89PNG")
        pixels = path.suffix == ".png" or path.stem == "figure_3"
        assert pixels or b"/Subtype /Image" not in content  # lines and letters
    again = figures.write_figures(tmp_path / "again")
    assert [next(again).read_bytes() for _ in paths] == [path.read_bytes() for path in paths]
    assert plt.get_fignums() == []


@pytest.mark.parametrize(("name", "panels"), [("figure_1", 0), ("figure_2", 2), ("figure_3", 6), ("figure_4_ours", 4)])
def test_figures_have_the_papers_panels(name, panels):
    axes = figures.figure_of(figures.PAPER_FIGURES[name](load_results())).axes
    titles = [ax.get_title() for ax in axes if ax.get_title()]
    assert [title[:3] for title in titles] == [f"({letter})" for letter in "abcdef"[:panels]]
    plt.close("all")


def test_the_page_of_the_map_links_to_cells_and_the_file_names_them(page):
    body = report.map_body(site=True)
    assert 'href="notebooks/5-dorf-fitting.html#cell-id=cell-05"' in body
    assert "5-dorf-fitting, cell <code>cell-05</code>" in page
    targets = re.findall(r'see <a href="#([^"]+)"', body)
    assert targets
    assert all(body.count(f'id="{target}"') == 1 for target in targets)
    for row in paper_map().to_dict("records"):
        assert escaped(row["what"]) in body
        assert f"<code>{escaped(row['command'])}</code>" in page
