"""What the claims add up to: what of the paper holds, what does not follow and why, as ``findings.jinja`` puts it."""

import re
from pathlib import Path

import pandas as pd
from jinja2 import Environment, StrictUndefined

from crfbench.paper import claims, claims_data, printed
from crfbench.paper.results import PaperResults, latent_table, leaderboard
from crfbench.paper.verdicts import scientific


def holds(results: PaperResults) -> dict[str, str]:
    """Say what of the paper holds: from a title to the finding."""
    return _findings("holds", results)


def does_not_follow(results: PaperResults) -> dict[str, str]:
    """Say what of the paper does not follow from its data and method, and why: from a title to the finding."""
    return _findings("does not follow", results)


def _findings(kind: str, results: PaperResults) -> dict[str, str]:
    rmse = results.fits()["mean_rmse"]
    figures = {name: float(figure) for name, figure in printed.FITTING.items() if not name.startswith(("SLR", "EMoR"))}
    source = Path(__file__).with_name("findings.jinja").read_text(encoding="utf-8")
    template = Environment(undefined=StrictUndefined).from_string(source)  # noqa: S701  plain text, not HTML
    below = {name: figure < rmse[name] for name, figure in figures.items()}  # below the best fit that there is
    about = latent_table().set_index("model")
    rooms = {"latents": about, "claims": claims, "data": claims_data, "printed": printed, "scientific": scientific}
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
