"""The site as files: nothing from elsewhere, every link leads somewhere, and the model it teaches is a model."""

import inspect
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import build_site
import draw_floors
import nbformat
import numpy as np
import pandas as pd
import pytest
import test_models
from bs4 import BeautifulSoup

import crfbench
from crfbench.metrics import rmse
from crfbench.models import Gamma, ModelKey

LOADING = {"img", "script", "iframe", "source", "video", "audio", "embed", "object"}


class Page(HTMLParser):
    """Notes the elements of a page and the text of its code."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.codes: list[str] = []
        self._in_code = False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag == "pre":
            self._in_code = True
            self.codes.append("")

    def handle_endtag(self, tag):
        self._in_code = self._in_code and tag != "pre"

    def handle_data(self, data):
        if self._in_code:
            self.codes[-1] += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.found if name == tag]

    def names(self) -> set[str | None]:
        return {attributes["id"] for _, attributes in self.found if "id" in attributes}


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    return {path: Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}


@pytest.fixture(scope="module")
def own(site: Path, pages: dict[Path, Page]) -> dict[Path, Page]:
    """Return all pages but those that pdoc makes."""
    return {
        path: page for path, page in pages.items() if "crfbench" not in path.relative_to(site).with_suffix("").parts
    }


@pytest.mark.slow
def test_every_notebook_and_module_has_a_page(site, pages):
    notebooks = [path.stem for path in (build_site.ROOT / "notebooks").glob("*.ipynb")]
    assert {path.stem for path in pages if path.parent.name == "notebooks"} == set(notebooks)
    index = {link["href"] for link in pages[site / "index.html"].all("a")}
    assert {f"notebooks/{name}.html" for name in notebooks} | {*build_site.PAGES} <= index
    modules = {link["href"] for link in pages[site / "api/index.html"].all("a")}
    assert {f"{name.replace('.', '/')}.html" for name in build_site.modules()} <= modules


@pytest.mark.slow
def test_every_link_leads_somewhere(pages, own):
    for path, page in pages.items():
        for _, attributes in page.found:
            parts = urlsplit(attributes.get("href") or attributes.get("src") or "")
            if parts.scheme in {"http", "https", "data"}:
                continue
            assert not parts.scheme, (path.name, parts)
            assert not parts.path.startswith("/"), (path.name, parts)
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            assert target.is_file(), (path.name, parts)
            if parts.fragment and path in own:  # pdoc links to what a class inherits and does not show
                assert unquote(parts.fragment) in pages[target].names(), (path.name, parts)


@pytest.mark.slow
def test_nothing_is_loaded_from_elsewhere(site, pages, own):
    for path, page in pages.items():
        loaded = [attributes for tag, attributes in page.found if tag in LOADING] + page.all("link")
        addresses = [
            attributes[name] for attributes in loaded for name in ("src", "href", "data") if name in attributes
        ]
        assert not any(re.match(r"(https?:)?//", address) for address in addresses), path.name
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"""(@import|url\(\s*["']?https?:|import\(["']https?:|from ["']https?:)""", text), (
            path.name
        )
    for path in own:
        assert "default-src 'none'" in path.read_text(encoding="utf-8"), path.name


@pytest.mark.slow
def test_no_page_tells_where_it_was_made(site):
    for path in site.rglob("*.*"):
        assert str(build_site.ROOT) not in path.read_text(encoding="utf-8"), path.name


@pytest.mark.slow
def test_language_titles_and_headings(pages, own):
    for path, page in pages.items():
        assert page.all("html")[0]["lang"] == "en", path.name
        assert len(page.all("title")) == 1, path.name
    titles = [re.search("<title>(.+?)</title>", path.read_text(encoding="utf-8"))[1] for path in own]
    assert len(set(titles)) == len(own)
    for path, page in own.items():
        levels = [int(tag[1]) for tag, _ in page.found if re.fullmatch(r"h\d", tag)]
        assert levels[0] == levels.count(1) == 1, path.name
        assert (np.diff(levels) <= 1).all(), path.name


@pytest.mark.slow
def test_headings_of_the_reference_skip_no_level(pages, own):
    for path in pages.keys() - own.keys():
        levels = [int(tag[1]) for tag, _ in pages[path].found if re.fullmatch(r"h\d", tag)]
        assert levels.count(1) == 1, path.name
        assert (np.diff([*levels[levels.index(1) :]]) <= 1).all(), path.name


@pytest.mark.slow
def test_the_reference_does_not_write_arraylike_out(site):
    text = re.sub("<[^>]+>", "", (site / "api/crfbench/plots.html").read_text(encoding="utf-8"))
    assert "curves: ArrayLike" in text
    assert "sets: Mapping[str, ArrayLike]" in text
    assert "_array_like" not in text


TWO_HEADINGS = pd.DataFrame(
    {"mean": [-1.5, 20.0], "verdict": ["differs", "holds"]},
    index=pd.MultiIndex.from_tuples([("SLR", ""), ("EMoR", "x")], names=["model", "constraint"]),
)


@pytest.mark.parametrize("frame", [TWO_HEADINGS, TWO_HEADINGS.reset_index(), TWO_HEADINGS.set_index("verdict")])
def test_tables_have_named_headings_and_numbers_to_the_right(frame):
    soup = BeautifulSoup(build_site._table(frame.to_html()), "html.parser")
    head = [cell.get_text() for cell in soup.select("thead th")]
    assert head == [*filter(None, frame.index.names), *frame.columns]
    assert len(soup.select("thead tr")) == 1
    assert all(cell.get_text(strip=True) for cell in soup("th"))
    assert [cell.get_text() for cell in soup.select("tbody .number")] == ["-1.5", "20.0"]
    assert [cell.get_text() for cell in soup.select("thead .number")] == ["mean"]
    assert not soup("style")


def test_joined_headings_stay():
    frame = pd.DataFrame({("rmse", "min"): [0.1], ("rmse", "max"): [0.2]}, index=pd.Index(["SLR"], name="model"))
    soup = BeautifulSoup(build_site._table(frame.to_html()), "html.parser")
    rows = [[cell.get_text() for cell in row(["th", "td"])] for row in soup.select("thead tr")]
    assert rows == [["", "rmse"], ["model", "min", "max"]]


@pytest.mark.slow
def test_pictures_have_texts(own):
    texts = [picture.get("alt") or "" for page in own.values() for picture in page.all("img")]
    assert len(texts) > 15
    assert all(len(text) > 30 and "No description" not in text for text in texts), texts


@pytest.mark.slow
def test_widgets_live_or_say_what_they_need(site, pages):
    for path in (build_site.ROOT / "notebooks").glob("*.ipynb"):
        outputs = [o for cell in nbformat.read(path, 4).cells for o in cell.get("outputs", []) if "data" in o]
        plain = [o.data["text/plain"] for o in outputs if any("widget-view" in kind for kind in o.data)]
        pages_of_their_own = [o.data["text/plain"] for o in outputs if "srcdoc=" in o.data.get("text/html", "")]
        living = sum(text.startswith(tuple(build_site.LIVING)) or text in pages_of_their_own for text in plain)
        page = pages[site / f"notebooks/{path.stem}.html"]
        assert len([s for s in page.all("script") if s.get("type") == "application/json"]) == living, path.name
        assert len([p for p in page.all("p") if p.get("class") == "needs-python"]) == len(plain) - living, path.name
        left = sum(any(kind.startswith("image/") for kind in o.data) and "widget-view" in str(o.data) for o in outputs)
        assert len([i for i in page.all("img") if "as it stood" in i["alt"]]) + (path.stem[0] in "01") == left, (
            path.name
        )


@pytest.mark.slow
def test_floors_are_those_of_pyproject(site, pages):
    floors = draw_floors.floors_of_the_package()
    assert [floors[0], floors[-1]] == [["__main__"], ["errors", "lazy"]]
    boxes = [link["href"] for link in pages[site / "floors.html"].all("a") if "api/crfbench/" in link["href"]]
    assert boxes == [f"api/crfbench/{name}.html" for floor in floors for name in floor]


OWN_MODEL = re.findall(
    r"```python\n(.*?)```", (build_site.ROOT / "docs/own-model.md").read_text(encoding="utf-8"), re.DOTALL
)


@pytest.fixture(scope="module")
def example() -> dict:
    """Run the two pieces of Python of the page on models, as it shows them, and return what they define."""
    names: dict = {}
    for code in OWN_MODEL[:2]:
        exec(code, names)  # noqa: S102
    return names


@pytest.mark.slow
def test_the_page_shows_the_python_that_is_tested(site, pages):
    assert [code.strip() for code in pages[site / "own-model.html"].codes[:2]] == [c.strip() for c in OWN_MODEL[:2]]


def test_the_model_takes_20_lines():
    assert len([line for line in OWN_MODEL[0].splitlines() if line.strip()]) <= 20


@pytest.mark.parametrize("direction", ["forward", "inverse"])
def test_the_model_passes_the_contract_of_all_models(example, direction):
    kind, k = example["Bend"], 1
    curves = test_models.TRAIN[direction][test_models.SAMPLE]
    model = kind.from_curves(curves, k, direction).learn_prior(curves)
    drawn = model.sample(40, seed=5)
    given = {"model": model, "drawn": drawn, "key": ModelKey("Bend", "", k, direction), "k": k, "direction": direction}
    contract = [check for name, check in vars(test_models.TestContract).items() if name.startswith("test_")]
    assert len(contract) >= 5
    for check in contract:
        check(**{name: given.get(name) for name in inspect.signature(check).parameters})


def test_the_model_does_what_the_page_says(example):
    curves = example["responses"].in_direction("inverse")
    gamma = Gamma("inverse")
    assert rmse(example["fitted"], curves).mean() < 2 * rmse(gamma.decode(gamma.fit(curves)), curves).mean()
    assert example["found"].curves.shape == (1, 1024)
    assert (np.diff(example["found"].curves) >= 0).all()


@pytest.mark.slow
def test_the_page_says_where_models_are_listed(site, pages):
    assert "crfbench/models/registry.py" in (site / "own-model.html").read_text(encoding="utf-8")
    assert "MODELS: dict" in inspect.getsource(crfbench.models.registry)
    assert pages[site / "own-model.html"].codes[2].strip().splitlines()[-1].startswith("Bend: (1,),")
