"""What CONTRIBUTING.md says is so: commands, paths, tables, and the picture of the floors."""

import json
import re
import subprocess
import tomllib
from importlib import import_module
from xml.etree import ElementTree

import draw_floors
import pytest
from draw_floors import ROOT

TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
CODE = re.findall(r"`([^`]+)`", re.sub("```.*?```", "", TEXT, flags=re.DOTALL))
TABLES = re.findall(r"`([A-Z]+)`, `((?:crfbench|benchmarks)/[\w/]+\.py)`", TEXT)


def test_the_committed_picture_is_what_the_code_gives():
    assert draw_floors.TARGET.read_text(encoding="utf-8") == draw_floors.draw()


def test_the_picture_has_every_module_in_order_and_says_what_it_shows():
    root = ElementTree.fromstring(draw_floors.draw())  # noqa: S314  our own
    names = [text.text for text in root.findall(".//{*}text") if text.get("class") == "name"]
    assert names == [name for floor in draw_floors.floors_of_the_package() for name in floor]
    labels = {element.get("id"): element.text for element in root if element.get("id")}
    assert root.get("aria-labelledby").split() == list(labels)
    assert all(name in labels["desc"] for name in names)
    assert "prefers-color-scheme: dark" in draw_floors.draw()


def test_no_text_leaves_its_box():
    root = ElementTree.fromstring(draw_floors.draw())  # noqa: S314  our own
    boxes = [[float(box.get(key)) for key in ("x", "y", "width", "height")] for box in root.findall("{*}rect")[1:]]
    for text in root.findall(".//{*}text"):
        x, y = float(text.get("x")), float(text.get("y"))
        (home,) = [box for box in boxes if box[0] < x < box[0] + box[2] and box[1] < y < box[1] + box[3]]
        assert x + 6 * len(text.text) < home[0] + home[2]


def test_make_targets_exist():
    targets = set(re.findall(r"^([a-z-]+)(?= |:)", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE))
    named = set(re.findall(r"\bmake ([a-z-]+)", TEXT))
    assert len(named) >= 4
    assert named <= targets


def test_make_test_runs_what_is_said_in_that_order():
    config = subprocess.run(["make", "--dry-run", "test"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    said = ["ruff check", "ruff format --check", "mypy", "lint-imports", "pytest"]
    assert all(f"`{command}`" in TEXT for command in said)
    places = [config.index(command) for command in said]
    assert places == sorted(places)


def test_paths_exist():
    paths = [code for code in CODE if re.fullmatch(r"[\w./]+/[\w./]*|\w+\.(toml|lock|md)", code)]
    assert len(paths) > 15
    assert [path for path in paths if not (ROOT / path).exists()] == []
    for link in re.findall(r"\]\(([^)]+)\)", TEXT):
        assert (ROOT / link).exists(), link


def test_mutation_testing_names_files_and_tests_that_exist():
    config = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mutmut"]
    selected = config["pytest_add_cli_args_test_selection"]
    left_out = [arg[11:] for arg in config["pytest_add_cli_args"] if arg.startswith("--deselect=")]
    assert {name.partition("::")[0] for name in left_out} <= set(selected)
    for name in [*selected, *left_out]:
        path, _, test = name.partition("::")
        text = (ROOT / path).read_text(encoding="utf-8")
        assert not test or f"\ndef {test}(" in text, name


@pytest.mark.parametrize(("table", "path"), TABLES)
def test_the_tables_to_add_to_are_there(table, path):
    module = import_module(path.removesuffix(".py").removesuffix("/__init__").replace("/", "."))
    assert len(getattr(module, table)) > 1


def test_every_record_has_its_script():
    rows = dict(re.findall(r"^\| `(scripts/record_\w+\.py)` \| (.+) \|$", TEXT, flags=re.MULTILINE))
    files = [name for row in rows.values() for name in re.findall(r"`([^`]+)`", row)]
    assert sorted(files) == sorted(path.name for path in (ROOT / "data/recorded").iterdir())
    assert sorted(rows) == sorted(f"scripts/{path.name}" for path in (ROOT / "scripts").glob("record_*.py"))
    for script, row in rows.items():
        for name in re.findall(r"`([^`]+)`", row):
            provenance = json.loads((ROOT / "data/recorded" / name).read_text(encoding="utf-8"))["provenance"]
            assert script in provenance["command"], name
