"""The map of the paper: where each figure, table, algorithm, equation and claim is rebuilt, from ``places.csv``."""

from pathlib import Path

import pandas as pd

from crfbench.paper.claims import claims_table
from crfbench.paper.results import PaperResults
from crfbench.paper.verdicts import RULES


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
    claims = claims_table(results)
    found = located(claims[~claims["where"].str.fullmatch(r"Table \d")])
    section = found["where"].where(found["where"] == "abstract", "section " + found["where"])
    what = found["claim"] + (": " + found["paper"]).where(found["paper"] != "", "")
    found = found.assign(item=section, what=what).rename(columns={"how": "function"}).sort_values("item", kind="stable")
    places = _places().query("item != ''")
    places["verdict"] = [_state(item, claims["verdict"][claims["where"] == item]) for item in places["item"]]
    return pd.concat([places, found.assign(judged="")[places.columns]], ignore_index=True).fillna("")


def _state(item: str, cells: "pd.Series[str]") -> str:
    if len(judged := cells[cells != "not comparable"]):
        return f"{(judged == 'reproduced').sum()} of {len(judged)} reproduced"
    return "drawn" if item.startswith("Figure") else "rebuilt"


def located(claims: pd.DataFrame) -> pd.DataFrame:
    """Add to claims (of `crfbench.paper.claims_table`) where each is rebuilt: cell, command, recorded and figure."""
    # A claim is found by the function that computes it, so each function has one place, that of its first row.
    places = _places().drop(columns=["item", "what"]).rename(columns={"function": "how"}).drop_duplicates("how")
    return claims.merge(places, how="left", on="how", validate="many_to_one")


def _places() -> pd.DataFrame:
    return pd.read_csv(Path(__file__).with_name("places.csv"), dtype=str, keep_default_na=False)


def claims_by_verdict(claims: pd.DataFrame) -> str:
    """Return claims as Markdown: under each verdict, folded, what the paper says, what we find, and a link to where.

    The links are to cells of the notebooks, from a notebook beside them.
    """
    parts = []
    for verdict, rows in located(claims).groupby(pd.Categorical(claims["verdict"], list(RULES)), observed=True):
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
