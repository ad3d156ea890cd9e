"""Write the site: notebooks, report, reference and floors, for any file server; no page asks another server."""

import ast
import base64
import html
import inspect
import io
import re
import sys
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from itertools import count
from pathlib import Path
from pkgutil import walk_packages

import anywidget
import matplotlib.pyplot as plt
import nbformat
import pdoc
from bs4 import BeautifulSoup, Tag
from draw_floors import first_sentence, floors_of_the_package
from nbconvert import HTMLExporter
from nbconvert.filters.markdown_mistune import IPythonRenderer, MarkdownWithMath
from nbformat import NotebookNode
from numpy.typing import ArrayLike
from pygments.formatters import HtmlFormatter

import crfbench
from crfbench import plots
from crfbench.files import write_atomically
from crfbench.history import load_history
from crfbench.models import MODELS
from crfbench.paper import figures, report
from crfbench.paper.results import load_recorded, load_results
from crfbench.widgets import EpochPlayer, LatentExplorer
from crfbench.widgets.assets import join
from crfbench.widgets.page import document, island
from crfbench.widgets.search_explorer import SearchExplorer

ROOT = Path(__file__).resolve().parent.parent
PAGES = {
    "index.html": "crfbench",
    "report.html": "Report",
    "paper.html": "Map of the paper",
    "own-model.html": "Your own model",
    "floors.html": "Floors",
    "contributing.html": "Contributing",
    "api/index.html": "API reference",
}
#: Functions whose figures hold pictures, which stay as they are on a dark page; line drawings are turned dark.
PICTURES = {"plot_chart", "plot_latent_epochs"}
NUMBER = re.compile(r"([-+−]?[\d.,]+(e[-+]?\d+)?( ?%)?|NaN|)", flags=re.IGNORECASE)


def build(folder: Path) -> None:
    """Write every page into a folder."""
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        write_page(folder, f"notebooks/{path.stem}.html", notebook_body(nbformat.read(path, as_version=4)))
    write_page(folder, "index.html", index_body())
    write_page(folder, "own-model.html", markdown_to_html((ROOT / "docs/own-model.md").read_text(encoding="utf-8")))
    write_page(folder, "floors.html", floors_body())
    write_page(folder, "contributing.html", contributing_body())
    write_reference(folder / "api")
    write_page(folder, "api/index.html", reference_body())
    write_page(folder, "report.html", report.report_body(site=True))
    write_page(folder, "paper.html", paper_body())


def write_page(folder: Path, name: str, body: str) -> None:
    """Write a page of the body, whose first heading is its title, below links to the site's pages."""
    up = "../" * name.count("/")
    links = "".join(f'<li><a href="{up}{page}">{label}</a></li>' for page, label in PAGES.items())
    title = html.unescape(re.sub("<[^>]+>", "", body[body.index("<h1") : body.index("</h1>")]))
    main = body if "<main>" in body else f"<main>{body}</main>"
    content = f'<nav aria-label="Site"><ul>{links}</ul></nav>\n{main}'
    page = document(title if title == "crfbench" else f"{title} – crfbench", content, style())
    write_atomically(folder / name, page.encode())


@cache
def style() -> str:
    """Return the styles: the report's, the site's own, and the colours of code by light and by dark."""
    light, dark = (
        HtmlFormatter(style=name, nobackground=True).get_style_defs(".highlight") for name in ("default", "github-dark")
    )
    own = (ROOT / "docs/site.css").read_text(encoding="utf-8")
    return f"{join('report.css')}\n{own}\n{light}\n@media (prefers-color-scheme: dark) {{\n{dark}\n}}"


def index_body() -> str:
    """Return the beginning of the README, with its figure, and the list of notebooks."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8").split("\n## ")[0]
    text = re.sub(
        r"\]\((docs/[^)]+\.png)\)", lambda found: f"]({_data_address((ROOT / found[1]).read_bytes())})", readme
    )
    items = "".join(
        f'<li><a href="notebooks/{path.stem}.html">{html.escape(title)}</a><br>{html.escape(question)}</li>'
        for path, title, question in _notebooks()
    )
    return f"{markdown_to_html(_page_links(text))}\n<h2>Notebooks</h2>\n<ul>{items}</ul>"


def paper_body() -> str:
    """Return the map of the paper, with its figures as they are rebuilt here."""
    shown = []
    for name, said in figures.captions().items():
        picture = _data_address(figures.picture(figures.PAPER_FIGURES[name](load_results()), "png", {}))
        alt, caption = map(html.escape, (said["alt"], said["caption"]))
        kind = ' class="as-it-is"' if name == "figure_3" else ""
        shown.append(
            f'<figure id="{name}"><img{kind} alt="{alt}" src="{picture}"><figcaption>{caption}</figcaption></figure>'
        )
        plt.close("all")
    return (
        "<h1>The paper, and where each part of it is rebuilt</h1>\n<p>What the paper numbers, then its claims; "
        '<a href="#figures">our figures</a> stand below, and what the verdicts rest on in the '
        f'<a href="report.html">report</a>.</p>\n{report.map_body(site=True)}\n<h2 id="figures">Our figures, in the '
        f"paper's layout</h2>\n{''.join(shown)}"
    )


def markdown_to_html(markdown: str) -> str:
    """Return Markdown as HTML, without a mark to link to behind each heading."""
    renderer = IPythonRenderer(escape=False, exclude_anchor_links=True)
    page = str(MarkdownWithMath(renderer=renderer).render(markdown))
    tables = re.compile("<table>.*?</table>", flags=re.DOTALL)
    number = count(1)
    return tables.sub(lambda table: _scrolling(table[0], f"Table {next(number)}"), page)


def _scrolling(table: str, label: str) -> str:
    """Let a wide table scroll, by keyboard too."""
    return f'<div class="scroll" role="region" tabindex="0" aria-label="{label}">{table}</div>'


def _notebooks() -> Iterator[tuple[Path, str, str]]:
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        first = nbformat.read(path, as_version=4).cells[0].source
        question = re.search(r"\*\*The question\.\*\*\s+(.*?)(?:\n\n|$)", first, flags=re.DOTALL)
        yield (
            path,
            first.splitlines()[0].lstrip("# "),
            " ".join(question[1].replace("*", "").split()) if question else "",
        )


def _data_address(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"


def _page_links(markdown: str) -> str:
    return re.sub(r"\]\(([^):]+)\.ipynb(#[^)]*)?\)", r"](\1.html\2)", markdown)


def notebook_body(notebook: NotebookNode) -> str:
    """Return a notebook as it is stored, with widgets that live without Python in the place of stored ones.

    Cells that check the prose, which JupyterLab shows collapsed, are left out.
    """
    heading = ""
    notebook.cells = [cell for cell in notebook.cells if "check" not in cell.metadata.get("tags", [])]
    for number, cell in enumerate(notebook.cells):
        if cell.cell_type == "markdown":
            heading = (re.findall(r"^#+ (.+)$", cell.source, flags=re.MULTILINE) or [heading])[-1]
            cell.source = _page_links(cell.source)
        for output in cell.get("outputs", []):
            if "data" in output:
                _show(output, f"cell-{number}", cell.source, heading)
    exporter = HTMLExporter(
        template_name="basic", exclude_anchor_links=True, exclude_input_prompt=True, exclude_output_prompt=True
    )
    return exporter.from_notebook_node(notebook)[0]


def _show(output: NotebookNode, name: str, source: str, heading: str) -> None:
    """Change an output to what a page without Python can show."""
    data = output.data
    if "text/markdown" in data:
        data["text/markdown"] = _page_links(data["text/markdown"])
    if "application/vnd.jupyter.widget-view+json" in data:
        output.data = NotebookNode({"text/html": _widget(data, name)})
    elif "<table" in data.get("text/html", ""):
        data["text/html"] = _scrolling(_table(data["text/html"]), f"Table of {name}")
    elif "image/png" in data:
        size = "".join(f' {side}="{n}"' for side, n in output.metadata.get("image/png", {}).items())
        text = html.escape(_figure_text(source, heading))
        kind = ' class="as-it-is"' if PICTURES & _called(source).keys() else ""
        picture = f'<img{kind} alt="{text}"{size} src="data:image/png;base64,{data["image/png"].strip()}">'
        output.data = NotebookNode({"text/html": picture})


def _table(text: str) -> str:
    """Return a table of pandas with the index named where its headings are, and with columns of numbers marked."""
    soup = BeautifulSoup(text, "html.parser")
    for style in soup(["style"]):
        style.decompose()
    for table in soup("table"):
        del table["border"]
        _merge_headings(table)
        _align(table)
        for cell in table("th"):
            if not cell.get_text(strip=True):
                cell.name = "td"
    return str(soup)


def _merge_headings(table: Tag) -> None:
    """Move the names of the index, which have a row of their own, into the headings above them."""
    rows = table.select("thead tr")
    if len(rows) > 1 and not any(cell.get_text(strip=True) for cell in rows[-1]("th")[_index_width(table) :]):
        for name, above in zip(rows.pop().extract()("th")[: _index_width(table)], rows[-1]("th"), strict=False):
            above.string = name.get_text(strip=True) or above.get_text(strip=True)


def _index_width(table: Tag) -> int:
    """Return how many headings each row begins with; the first row has them all."""
    return len(table.select("tbody tr:first-child th"))


def _align(table: Tag) -> None:
    """Mark the columns of numbers, counted from the right, for the first cells of a row may be joined to others."""
    rows = [row(["th", "td"])[::-1] for row in table("tr") if not row.select("[colspan]")]
    texts = [[cell.get_text(strip=True) for cell in row("td")[::-1]] for row in table.select("tbody tr")]
    for i, column in enumerate(zip(*texts, strict=True)):
        if any(column) and all(map(NUMBER.fullmatch, column)):
            for row in rows:
                row[i]["class"] = "number"


def _widget(data: NotebookNode, name: str) -> str:
    kind, stored = data["text/plain"].split("(", maxsplit=1)[0], data.get("text/html", "")
    if kind in LIVING:
        return island(LIVING[kind](), name=name)
    if frame := BeautifulSoup(stored, "html.parser").iframe:  # a page of the widget, from which it moves into this one
        content = re.search(
            '<script type="application/json" id="content">.*?</script>', str(frame["srcdoc"]), re.DOTALL
        )
        return f"<div></div>\n{content[0].replace('content', name, 1)}" if content else ""
    what = f"<code>{html.escape(kind)}</code>" if kind.isidentifier() else "A progress bar"
    stills = [_still(kind, media, content) for media, content in data.items() if media.startswith("image/")]
    still = STILL[kind]() if kind in STILL else "".join(stills)
    advice = "works with Python only: open this notebook with <code>make lab</code>."
    return f'<p class="needs-python">{what} {advice}</p>{still}'


def _still(kind: str, media: str, content: str) -> str:
    """Return the picture that a widget left; a photograph keeps its colours on a dark page, a drawing does not."""
    look = ' class="as-it-is"' if media == "image/jpeg" else ""
    text = f"{kind} as it stood at the end of its cell; the text tells what to do with it"
    return f'<img{look} alt="{text}" src="data:{media};base64,{content.strip()}">'


def _figure_text(source: str, heading: str) -> str:
    """Say what a figure shows: its section, and what the function that draws it says of itself."""
    for name in _called(source):
        for home in (plots, report, figures):
            function = getattr(home, name, None)
            if "Axes" in str(getattr(function, "__annotations__", {}).get("return")):
                return f"{heading} – {inspect.getdoc(function)}".split("\n", maxsplit=1)[0]
    return f"{heading} – drawn by the code above, described in the text below"


def _called(source: str) -> dict[str, None]:
    """Return the names of what is called, in order."""
    called = [node.func for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]
    return dict.fromkeys(node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "") for node in called)


def _fits_picture() -> str:
    """Draw what the model explorer would: one curve and the best fit of each model, as a picture with its text."""
    responses = crfbench.load_responses("opencrf")
    models = {
        str(kind.name): kind.from_curves(responses.curves, max(counts), "forward") for kind, counts in MODELS.items()
    }
    fits = {name: model.decode(model.fit(responses.curves[:1]))[0] for name, model in models.items()}
    figure, axes = plt.subplots(figsize=(6, 4.5), layout="constrained")
    plots.plot_comparison(responses.curves[0], fits, direction="forward", ax=axes)
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=200, bbox_inches="tight")
    plt.close(figure)
    text = f"{responses.names[0]} and the best fits of {', '.join(fits)}"
    return f'<img alt="{html.escape(text)}" width="450" src="{_data_address(picture.getvalue())}">'


def _search_explorer() -> SearchExplorer:
    seeds, table = load_recorded("search_seeds_dorf")[0], load_recorded("search_dorf")[0]
    spread = seeds.groupby(["h1", "h2", "h3"])["mse"].std()
    return SearchExplorer(table, m=10, spread=spread.loc[table.set_index(["h1", "h2", "h3"]).index])


def _epoch_player() -> EpochPlayer:
    return EpochPlayer({name: load_history(name.lower()) for name in ("LDL", "AUC", "AAE", "VAE", "baseline")})


#: What is made anew, to show more than the notebook's own page; other widgets with a page of their own come from there.
LIVING: dict[str, Callable[[], anywidget.AnyWidget]] = {
    "EpochPlayer": _epoch_player,
    "LatentExplorer": lambda: LatentExplorer.pretrained(crfbench.load_responses("opencrf")),
    "SearchExplorer": _search_explorer,
    "SortableTable": report.sortable_leaderboard,
}
#: What stands in the place of a widget that needs Python.
STILL = {"ModelExplorer": _fits_picture}


def floors_body() -> str:
    """Draw the floors that import-linter checks, the highest first, each module with what it says of itself."""
    return (
        "<h1>The floors</h1>\n<p>A module imports only from lower floors, and modules side by side do not import each "
        f"other. import-linter checks both at every test run.</p>\n{floors_list()}"
    )


def floors_list() -> str:
    """Return the floors as a list, the highest first, each module a box with a link to its page."""
    floors = "".join(f"<li>{''.join(map(_box, floor))}</li>" for floor in floors_of_the_package())
    return f'<ol class="floors" reversed>{floors}</ol>'


def contributing_body() -> str:
    """Return CONTRIBUTING.md, with the floors as they stand on their own page and links to pages of the site."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    text = re.sub(r"!\[[^]]+\]\(docs/floors\.svg\)\n", f"{floors_list()}\n", text)
    text = text.replace("](docs/own-model.md)", "](own-model.html)")
    return markdown_to_html(re.sub(r"\[([^]]+)\]\((?:data|scripts|tests)/[^)]*\)", r"\1", text))


def _box(name: str) -> str:
    return f'<div><a href="api/crfbench/{name}.html">{name}</a><p>{_says(f"crfbench.{name}")}</p></div>'


def _says(module: str) -> str:
    """Return the first sentence of a module's docstring as HTML."""
    return re.sub("``(.+?)``", r"<code>\1</code>", html.escape(first_sentence(module)))


def modules() -> list[str]:
    """Return the names of all modules of the package."""
    return ["crfbench", *(found.name for found in walk_packages(crfbench.__path__, "crfbench."))]


def write_reference(folder: Path) -> None:
    """Write a page for each module, from its docstrings."""
    for module in map(import_module, modules()):
        for name in getattr(module, "__all__", ()):  # some are found when first used, but pdoc looks before
            setattr(module, name, getattr(module, name))
    pdoc.render.configure(docformat="numpy", show_source=False, favicon="data:,", template_directory=ROOT / "docs/pdoc")
    with warnings.catch_warnings():  # modules named twice, and types that are there for the type checker only
        warnings.filterwarnings("ignore", message="The module specification|Error parsing type annotation")
        pdoc.pdoc(*modules(), output_directory=folder)
    for path in (*folder.rglob("*.html"), folder / "search.js"):
        path.write_text(_tidy(path.read_text(encoding="utf-8")), encoding="utf-8")


def _tidy(text: str) -> str:
    """Return a page of the reference without what does not help: paths of this machine, and types and headings of pdoc.

    Values that are modules tell where they lie. NumPy's ArrayLike is written out, over several lines. The parts of a
    docstring are headings five levels below the page's.
    """
    text = text.replace(f"{ROOT}/", "")
    text = re.sub(r'<h([56])(?: id="[\w-]+")?>(.*?)</h\1>', r'<h2 class="part">\2</h2>', text)
    kinds = str(ArrayLike).removeprefix("typing.Union[").removesuffix("]")
    for written, short in ((kinds, "ArrayLike"), ("typing.Union[ArrayLike]", "ArrayLike")):
        text = _finder(written).sub(short, text)
    return text


@cache
def _finder(written: str) -> re.Pattern[str]:
    """Return what finds a type with any markup between its letters, with or without "typing." before its names."""
    gap = "(?:<[^>]*>)*"
    parts = [
        "".join(f"{re.escape(letter)}{gap}" for letter in part) for part in re.split(r"(?<!\w)(typing\.)", written)
    ]
    return re.compile("".join(f"(?:{part})?" if i % 2 else part for i, part in enumerate(parts)).removesuffix(gap))


def reference_body() -> str:
    """List all modules."""
    items = "".join(
        f'<li><a href="{name.replace(".", "/")}.html">{name}</a><br>{_says(name)}</li>' for name in modules()
    )
    return f"<h1>API reference</h1>\n<ul>{items}</ul>"


if __name__ == "__main__":
    build(Path(sys.argv[1]) if sys.argv[1:] else ROOT / "site")
