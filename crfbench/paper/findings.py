"""What the claims add up to, as ``findings.jinja`` puts it, and the map of the paper: where all of it is rebuilt.

The places stand in ``places.csv``.
"""

import re
from pathlib import Path

import pandas as pd
from jinja2 import Environment, StrictUndefined

from crfbench.paper import claims, claims_data, verdicts
from crfbench.paper.results import PaperResults, latent_table, leaderboard
from crfbench.paper.verdicts import FITTING, RULES, scientific


def holds(results: PaperResults) -> dict[str, str]:
    """Say what of the paper holds: from a title to the finding."""
    return _findings("holds", results)


def does_not_follow(results: PaperResults) -> dict[str, str]:
    """Say what of the paper does not follow from its data and method, and why: from a title to the finding."""
    return _findings("does not follow", results)


def _findings(kind: str, results: PaperResults) -> dict[str, str]:
    rmse = results.fits()["mean_rmse"]
    figures = {name: float(figure) for name, figure in FITTING.items() if not name.startswith(("SLR", "EMoR"))}
    source = Path(__file__).with_name("findings.jinja").read_text(encoding="utf-8")
    template = Environment(undefined=StrictUndefined).from_string(source)  # noqa: S701  plain text, not HTML
    below = {name: figure < rmse[name] for name, figure in figures.items()}  # below the best fit that there is
    about = latent_table().set_index("model")
    rooms = {"latents": about, "claims": claims, "data": claims_data, "verdicts": verdicts, "scientific": scientific}
    text = template.render(results=results, leaderboard=leaderboard().set_index("model"), classical=below, **rooms)
    found = re.findall(r"^# (.+?): (.+)\n([^#]+)", text, re.MULTILINE)
    return {title: " ".join(finding.split()) for which, title, finding in found if which == kind}


def summary(table: pd.DataFrame) -> str:
    """Say in a paragraph what the verdicts on the claims (of `claims_table`) add up to, and that the idea holds."""
    every, once = (_added_up(claims.verdict_counts(table, distinct=distinct)) for distinct in (False, True))
    differs = table["claim"][table["where"].str.startswith("Table 3") & (table["verdict"] == "differs")]
    slr = differs.str.contains("SLR-").sum()
    return (
        "The idea holds: one number stands for a response, and calibrates a camera as well as the models with more "
        f"do. The paper's own numbers hold less often. Of {every}. Now count once what the paper says in several "
        f"places, and once each row of a table (in Table 3 by its mean): of {once}. Of the {len(differs)} cells of "
        f"Table 3 that differ, {slr} are those of SLR's variants and {len(differs) - slr} those of classical models; "
        f"of SLR with LDL and one latent, {differs.str.endswith('SLR-ldl-1').sum()} of five differs."
    )


def _added_up(counts: pd.DataFrame) -> str:
    n = counts.loc["all"]
    good, bad = n["reproduced"] + n["holds"], n["differs"] + n["does not hold"]
    return (
        f"{n.sum()} numbers and claims {n.sum() - n['not comparable']} can be compared: {good} are reproduced or hold, "
        f"{n['undecided']} stay undecided, and {bad} differ or do not hold"
    )


def paper_map(results: PaperResults | None = None) -> pd.DataFrame:
    """Say where everything that the paper shows or claims is rebuilt, in the order of the paper's kinds.

    Returns
    -------
    DataFrame
        One row an item, all text: ``item`` (such as "Figure 2" or, of a claim, "section 4.4"), ``what`` it says, the
        ``cell`` of a notebook (``name#id``) that shows ours, the ``function`` that computes it, the ``command`` that
        does, the file in ``data/recorded`` it is ``recorded`` in, the ``figure`` that ``crfbench report --figures``
        writes, the ``verdict`` on a claim, and of the rest the section of the claims by which it is ``judged``. A
        figure is "drawn", an algorithm or equation "rebuilt", and of a table it says how many numbers are reproduced.
        What does not apply is empty. The cells of the tables are no rows.
    """
    table = claims.claims_table(results)
    found = located(table[~table["where"].str.fullmatch(r"Table \d")])
    section = found["where"].where(found["where"] == "abstract", "section " + found["where"])
    what = found["claim"] + (": " + found["paper"]).where(found["paper"] != "", "")
    found = found.assign(item=section, what=what).rename(columns={"how": "function"}).sort_values("item", kind="stable")
    places = _places().query("item != ''")
    places["verdict"] = [_state(item, table["verdict"][table["where"] == item]) for item in places["item"]]
    return pd.concat([places, found.assign(judged="")[places.columns]], ignore_index=True).fillna("")


def _state(item: str, cells: "pd.Series[str]") -> str:
    if len(judged := cells[cells != "not comparable"]):
        return f"{(judged == 'reproduced').sum()} of {len(judged)} reproduced"
    return "drawn" if item.startswith("Figure") else "rebuilt"


def located(table: pd.DataFrame) -> pd.DataFrame:
    """Add to claims (of `crfbench.paper.claims_table`) where each is rebuilt: cell, command, recorded and figure."""
    # A claim is found by the function that computes it, so each function has one place, that of its first row.
    places = _places().drop(columns=["item", "what"]).rename(columns={"function": "how"}).drop_duplicates("how")
    return table.merge(places, how="left", on="how", validate="many_to_one")


def _places() -> pd.DataFrame:
    return pd.read_csv(Path(__file__).with_name("places.csv"), dtype=str, keep_default_na=False)


def claims_by_verdict(table: pd.DataFrame) -> str:
    """Return claims as Markdown: under each verdict, folded, what the paper says, what we find, and a link to where.

    The links are to cells of the notebooks, from a notebook beside them.
    """
    parts = []
    for verdict, rows in located(table).groupby(pd.Categorical(table["verdict"], list(RULES)), observed=True):
        listed = "\n".join(map(_line, rows.to_dict("records")))
        parts.append(f"<details><summary>{verdict} ({len(rows)})</summary>\n\n{listed}\n\n</details>")
    return "\n".join(parts)


def _line(claim: dict[str, str]) -> str:
    name, cell = claim["cell"].split("#")
    where = claim["where"] if claim["where"][0].isalpha() else f"section {claim['where']}"
    spread = f" ({claim['spread']})" if claim["spread"] else ""
    return (
        f"- **{claim['claim']}** ({where}). The paper: {claim['paper'] or 'in words'}; here: {claim['ours']}{spread}. "
        f"{claim['why']} [{name}]({name}.ipynb#cell-id={cell})"
    )
