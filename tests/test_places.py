"""The map of the paper: everything it names is there, and it leaves nothing of the paper out."""

import re
from importlib import import_module
from pathlib import Path

import nbformat
import pandas as pd
import pytest
import typer

from crfbench import cli
from crfbench.paper.claims import claims_table, verdict_counts
from crfbench.paper.figures import PAPER_FIGURES
from crfbench.paper.findings import claims_by_verdict, paper_map
from crfbench.paper.verdicts import RULES

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def places() -> pd.DataFrame:
    return paper_map()


def test_everything_of_the_paper_has_a_row(places):
    items = " ".join(places["item"])
    for number in range(1, 5):
        assert f"Figure {number}" in items
    for name in ("Table 1", "Table 2", "Table 3", "Algorithm 1", "Equation 1 ", "Equations 11-13", "Equation 15"):
        assert name in items
    claims = claims_table()
    claims = claims[~claims["where"].isin(["Table 1", "Table 2", "Table 3"])]
    found = places[places["verdict"].isin(list(RULES))]
    assert sorted(found["what"]) == sorted(claims["claim"] + (": " + claims["paper"]).where(claims["paper"] != "", ""))
    assert (places[["item", "what", "function", "cell", "command", "verdict"]] != "").all(axis=None)


def test_what_is_numbered_says_what_became_of_it_and_where_it_is_judged(places):
    numbered = places[~places["verdict"].isin(list(RULES))].set_index("item")
    assert set(numbered["verdict"][numbered.index.str.startswith("Figure")]) == {"drawn"}
    assert set(numbered["verdict"][numbered.index.str.contains("Equation|Algorithm")]) == {"rebuilt"}
    counts = verdict_counts(claims_table())
    for name in ("Table 1", "Table 2", "Table 3"):
        row = counts.loc[name]
        assert numbered["verdict"][name] == f"{row['reproduced']} of {row.drop('not comparable').sum()} reproduced"
    sections = " ".join(places["item"][places["verdict"].isin(list(RULES))])
    assert all(f"section {section}" in sections for section in numbered["judged"] if section)


def test_every_cell_exists(places):
    for cell in places["cell"].unique():
        name, cell_id = cell.split("#")
        notebook = nbformat.read(ROOT / f"notebooks/{name}.ipynb", as_version=4)
        found = [found.cell_type for found in notebook.cells if found.id == cell_id]
        assert found == ["code"], cell


def test_every_function_exists(places):
    for name in places["function"].unique():
        parent, function = name.rsplit(".", 1)
        assert callable(getattr(import_module(parent), function)), name


def test_every_command_is_taken(places):
    group = typer.main.get_command(cli.app)
    for command in places["command"].unique():
        program, *words = command.split()
        found, context = group, None
        while hasattr(found, "commands"):
            context = found.make_context(program, words, parent=context, resilient_parsing=True)
            program, found, words = found.resolve_command(context, words)
        assert found.make_context(program, words, parent=context).params  # a wrong option would raise


def test_every_file_exists(places):
    recorded = [name for name in places["recorded"].unique() if name]
    assert all((ROOT / "data/recorded" / name).is_file() for name in recorded)
    assert {Path(name).stem for name in places["figure"] if name} <= set(PAPER_FIGURES)
    # What was recorded for the paper is in the map, but for what stands behind other rows or is ours.
    behind = {"leaderboard", "search_halving_dorf", "slr_heldout_dorf"}
    behind |= {"slr_forward_trainings_dorf"}
    assert {path.stem for path in (ROOT / "data/recorded").glob("*.json")} - behind == {Path(n).stem for n in recorded}


def test_claims_are_browsed_by_verdict_and_none_is_lost():
    claims = claims_table()
    text = claims_by_verdict(claims)
    assert text.count("\n- **") == len(claims)
    for verdict, rows in claims.groupby("verdict"):
        part = text[text.index(f"<summary>{verdict} ({len(rows)})") :].split("</details>")[0]
        assert all(f"- **{claim}**" in part for claim in rows["claim"])
    assert len(re.findall(r"\]\(\d-[\w-]+\.ipynb#cell-id=[\w-]+\)", text)) == len(claims)
    assert "nan" not in text.split()
