"""What the paper says of fits and calibration, every cell of its tables, and the table of all claims beside ours.

Claims on its data, search and networks stand in `crfbench.paper.claims_data`.
"""

from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path

import numpy as np
import pandas as pd

# Before the claims below, for claims are listed in the order of their registration.
from crfbench.paper import claims_data  # noqa: F401
from crfbench.paper.calibration import bootstrap_bounds
from crfbench.paper.fitting import papers_rising_rows
from crfbench.paper.results import PaperResults, load_results
from crfbench.paper.verdicts import (
    CALIBRATION,
    CALIBRATION_COLUMNS,
    CHECKS,
    FITTING,
    RULES,
    SIGNIFICANT_RMSE,
    STABILITY,
    Check,
    Claim,
    claim,
    in_words,
    is_least,
    scientific,
    verdict,
)

_FITS = "crfbench.paper.fitting.fitting_table"
_CALIBRATIONS = "crfbench.paper.calibration.calibration_table"
_STABILITIES = "scripts.record_report.stability_by_seed"
_HERE = "crfbench.paper.claims"
_SLR, _EMOR = "SLR-ldl-1-forward", "EMoR-published-1-forward"
_LDL, _CLASSICAL = "SLR-ldl-1", ["Gamma-1", "Polynomial-3", "GGCM-3", "EMoR-3"]
#: Models for which the search of the released program, as we repeat it, ends far from its best.
_SEARCH_FAILS = ("Polynomial-3",)
_NO_DIFFERENCE = (0.0, 0.0)
_STATISTICS = {
    "mean": "mean RMSE",
    "median": "median RMSE",
    "sd": "s.d. of the RMSE",
    "max": "largest RMSE",
    "p95": "95th percentile of the RMSE",
    "seconds": "seconds for all cameras",
}
#: Why numbers of Tables 1 and 3 are as they are, by the table and the beginning of the model's name.
_WHY: dict[str, str] = pd.read_csv(Path(__file__).with_name("causes.csv"), index_col="cell")["why"].to_dict()
_WHY_PERCENT = "Judged by whether the 95 % bounds (bootstrap over cameras, paired) lie on one side of zero."


def claims_table(results: PaperResults | None = None) -> pd.DataFrame:
    """Hold every figure and claim of the paper against ours, one row a claim with the fields of `Claim` as columns.

    Our tables are by default those that are bundled, so that neither DoRF nor a network is needed.
    """
    known = results or load_results()
    text = [check(known) for check in CHECKS]
    return pd.DataFrame([*text, *_table_1(known), *_table_2(known), *_table_3(known)], columns=list(Claim._fields))


def verdict_counts(claims: pd.DataFrame, distinct: bool = False) -> pd.DataFrame:
    """Count the verdicts of each part of the paper: its text and its three tables by verdict, with a row of totals.

    `distinct` counts once what the paper says in several places, and each row of a table: by the verdict on its first,
    which in Table 3 is the mean, "the overall performance" in the paper's words.
    """
    claims = claims.drop_duplicates("group") if distinct else claims
    parts = claims["where"].where(claims["where"].str.fullmatch(r"Table \d"), "text").rename("part")
    order = ["text", "Table 1", "Table 2", "Table 3"]
    counts = pd.crosstab(parts, claims["verdict"]).reindex(index=order, columns=list(RULES), fill_value=0)
    counts.loc["all"] = counts.sum()
    return counts


@claim("4.4", "mean RMSE of SLR, in the text as in Table 1", how=_FITS, printed="5.61E-4")
def one_figure(results: PaperResults) -> Claim:
    ours = results.fits().loc[_SLR]
    squared = scientific(ours["mean_mse"])
    why = f"Table 1 prints {FITTING[_SLR]}; one of the two is a slip, and both have the size of our MSE, {squared}."
    return Claim(ours=scientific(ours["mean_rmse"]), verdict="differs", why=why)


@claim("4.4", "SLR is more than ten-folds better than most of the others", how=_FITS, group="ten-folds")
def ten_folds(results: PaperResults) -> Claim:
    ours = results.fits()["mean_rmse"]
    others = [name for name in FITTING if name != _SLR]
    above = sum(ours[name] > 10 * ours[_SLR] for name in others)
    ratio = ours[_EMOR] / ours[_SLR]
    why = f"With best parameters on both sides, EMoR with one component lies {ratio:.1f} times above SLR."
    return Claim(ours=f"{above} of {len(others)}", verdict=in_words(2 * above > len(others)), why=why)


@claim("5", "ten-folds better in cross-validation", how=_FITS, group="ten-folds")
def ten_folds_unseen(results: PaperResults) -> Claim:
    emor = results.fits("grouped-5fold")["mean_rmse"]["EMoR-1-forward"]
    slr = results.held_out.query("model == @_SLR")["mean_rmse"]
    ratio = emor / slr
    why = "EMoR with one component over SLR, curves of grouped folds that neither learned from."
    spread = f"{ratio.min():.2f} to {ratio.max():.2f} ({len(ratio)} seeds)"
    return Claim(ours=f"{emor / slr.mean():.1f} times", spread=spread, verdict=in_words(ratio.mean() > 10), why=why)


@claim("abstract", "SLR represents responses with state-of-the-art accuracy", how=_FITS)
def state_of_the_art(results: PaperResults) -> Claim:
    ours = results.fits()["mean_rmse"][list(FITTING)]
    one, better = ours[ours.index.str.endswith("-1-forward")], ours[ours < ours[_SLR]]
    rank = int((one < ours[_SLR]).sum()) + 1
    shown = f"rank {rank} of {len(one)} with one parameter, {len(better) + 1} of {len(ours)} in all"
    why = f"More accurate, with more parameters: {', '.join(name.removesuffix('-forward') for name in better.index)}."
    holds = None if rank == 1 and len(better) else rank == 1
    return Claim(ours=shown, verdict=in_words(holds), why=why)


@claim(
    "4.4",
    "every curve is fitted with the optimal parameters of each model",
    how="crfbench.paper.fitting.papers_rising_rows",
)
def optimal(results: PaperResults) -> Claim:
    rising = papers_rising_rows()
    why = "A best fit cannot get worse by one more parameter, since that could be zero; ours never do."
    return Claim(ours=f"{len(rising)} of 9 steps rise in Table 1", verdict=in_words(not rising), why=why)


@claim("4.4", "Gamma, and GGCM with one parameter, fit as Table 1 says", how=_FITS)
def gamma_within_ggcm(results: PaperResults) -> Claim:
    ours, names = results.fits()["mean_rmse"], ("Gamma-1-forward", "GGCM-1-forward")
    printed = [FITTING[name] for name in names]
    why = f"x^w is both models, so the numbers must agree; Table 1 prints {' and '.join(printed)}."
    shown = ", ".join(scientific(ours[name]) for name in names)
    return Claim(ours=shown, verdict=in_words(printed[0] == printed[1]), why=why)


@claim("4.5", "SLR is the most stable with varied numbers of patches", how=_STABILITIES)
def most_stable(results: PaperResults) -> Claim:
    return _least_of_table_2(results, "total_variance", "Total variance, mean over seeds")


@claim("4.5", "SLR comes nearest to the measured values of the Canon PowerShot G9", how=_STABILITIES)
def nearest_to_truth(results: PaperResults) -> Claim:
    return _least_of_table_2(results, "mean_rmse", "Mean RMSE of the same four curves against RAW")


def _least_of_table_2(results: PaperResults, column: str, what: str) -> Claim:
    groups = results.stability.groupby("model")[column]
    mean, low, high = groups.mean(), groups.min(), groups.max()
    others = ", ".join(f"{name} {mean[name]:.2g}" for name in mean.index.drop(_LDL))
    spread = f"{low[_LDL]:.2g} to {high[_LDL]:.2g} (3 seeds)"
    ranges = dict(zip(low.index, zip(low, high, strict=True), strict=True))
    holds = is_least(ranges.pop(_LDL), ranges.values())
    why = f"{what}; {others}. Judged by whether the ranges over the seeds overlap."
    return Claim(ours=f"{mean[_LDL]:.2g}", spread=spread, verdict=in_words(holds), why=why)


@claim("4.5", "SLR with LDL and one latent clearly outperforms the others, some with three parameters", _CALIBRATIONS)
def outperforms(results: PaperResults) -> Claim:
    table = _accuracy(results)
    rank, rows = int(table["mean"].rank()[_LDL]), table.loc[_CLASSICAL].drop(list(_SEARCH_FAILS))
    bounds = list(rows[["difference_low", "difference_high"]].itertuples(index=False, name=None))
    best = rows.loc[rows["mean"].idxmin()]
    why = (
        f"{best.name} minus SLR is {best['difference']:+.3f} ({best['difference_low']:+.3f} to "
        f"{best['difference_high']:+.3f}) in mean RMSE. {_WHY_PERCENT} With the paper's other networks, which are as "
        f"good, SLR with LDL has rank {rank} of {len(table)}."
    )
    ours = f"better than {sum(low > 0 for low, _ in bounds)} of {len(rows)} classical models that our search serves"
    return Claim(ours=ours, verdict=in_words(is_least(_NO_DIFFERENCE, bounds)), why=why)


def _paired(results: PaperResults, name: str, holds: bool = True) -> Claim:
    """Judge whether SLR with LDL has the lower mean RMSE, and that what else the claim says `holds`."""
    row = _accuracy(results).loc[name]
    low, high = row["difference_low"], row["difference_high"]
    judged = is_least(_NO_DIFFERENCE, [(low, high)]) if holds else False
    spread = f"{low:+.3f} to {high:+.3f} (95 %, bootstrap)"
    return Claim(ours=f"{row['difference']:+.3f}", spread=spread, verdict=in_words(judged))


@claim("4.5", "LDL improves calibration over the baseline", how=_CALIBRATIONS)
def ldl_helps(results: PaperResults) -> Claim:
    why = f"Baseline minus LDL in mean RMSE; in the paper it is +0.013. {_WHY_PERCENT}"
    return _paired(results, "SLR-baseline-1")._replace(why=why)


@claim("4.2", "a difference in RMSE above this counts as significant", how=_CALIBRATIONS, printed="0.005")
def significant(results: PaperResults) -> Claim:
    rows = _accuracy(results).drop(_LDL)
    half = (rows["difference_high"] - rows["difference_low"]) / 2
    why = (
        "A convention of the paper, not a finding, and the tolerance that we judge Table 3 by. Ours is what chance may "
        "make: half the width of the 95 % interval of a paired difference over 14 cameras, median over the rows."
    )
    spread = f"{half.min():.3f} to {half.max():.3f} ({len(half)} rows)"
    return Claim(ours=f"{half.median():.3f}", spread=spread, verdict="not comparable", why=why)


@claim("4.5", "AUC calibrates faster than LDL but less accurately", how=_CALIBRATIONS)
def auc_trades(results: PaperResults) -> Claim:
    more = results.calibration["seconds"]["SLR-auc-1"] - results.calibration["seconds"][_LDL]
    found = _paired(results, "SLR-auc-1", holds=more < 0)
    why = f"AUC minus LDL in mean RMSE, and in seconds. {_WHY_PERCENT}"
    return found._replace(ours=f"{found.ours}, {more:+.1f} s", why=why)


def papers_impossible_spreads() -> list[str]:
    """Name the rows of the paper's Table 3 that no values of 0 or more can have.

    Of values from 0 to M with mean m, the standard deviation is at most sqrt((M - m) m) (Bhatia and Davis 2000,
    doi:10.1080/00029890.2000.12005203), times sqrt(14/13) where it is divided by 13; every figure is taken at the end
    of its rounding that allows most.
    """
    found = []
    for name, (mean, _, sd, largest, *_) in CALIBRATION.items():
        means = mean + np.linspace(-0.0005, 0.0005, 11)
        most = float(np.sqrt(((largest + 0.0005 - means) * means).max() * 14 / 13))
        if sd - 0.0005 > most:
            found.append(f"{name}: s.d. {sd}, but at most {most:.4f} by its mean and maximum")
    return found


@claim(
    "4.5, Table 3",
    "14 cameras can have the printed mean, s.d. and maximum of RMSE",
    how=f"{_HERE}.papers_impossible_spreads",
)
def impossible_spread(results: PaperResults) -> Claim:
    found = papers_impossible_spreads()
    why = f"{'; '.join(found)}; the printed s.d. equals the printed median, so it may be a slip."
    return Claim(ours=f"{len(found)} of {len(CALIBRATION)} rows cannot", verdict=in_words(not found), why=why)


@claim("4.2", "number of metrics in the second experiment, in the text as in Table 3", how=_CALIBRATIONS, printed="5")
def metrics(results: PaperResults) -> Claim:
    why = "The text counts five, four of them of accuracy; the table and its caption have six, with the median."
    return Claim(ours=str(len(CALIBRATION_COLUMNS)), why=why)


@claim("4.5, Table 3", "photographs that one calibration uses", how=_CALIBRATIONS, printed="8")
def calibration_images(results: PaperResults) -> Claim:
    why = (
        "All eight of a camera are used, but not at once: the released program calibrates on the four of one light and "
        "tests on the four of the other, both ways, as “double cross-validation” needs."
    )
    return Claim(ours=f"{results.patches['exposure'].nunique()} at a time", why=why)


def speed_ratio(calibration: pd.DataFrame, rivals: list[str]) -> float:
    """Return how many times as long as SLR with LDL the quickest of the rivals takes."""
    return float(calibration["seconds"][rivals].min() / calibration["seconds"][_LDL])


def _speed(where: str, text: str, rivals: list[str] = _CLASSICAL, printed: str = "") -> Check:
    quickest = "Gamma" if len(rivals) == 1 else f"the quickest of {len(rivals)} classical models"
    why = (
        f"Seconds of {quickest} over those of SLR with LDL, by the paper's method in our program on one computer. How "
        "long a network takes beside a power depends on the program more than on the models."
    )

    @claim(where, text, how=f"{_HERE}.speed_ratio", printed=printed, group="speed")
    def check(results: PaperResults) -> Claim:
        ratio = speed_ratio(results.calibration, rivals)
        return Claim(ours=f"{ratio:.2f} times", verdict="not comparable", why=why)

    return check


almost_twice = _speed("abstract", "calibration is almost twice as fast as with the best other models")


@claim("1", "calibration takes less than half the time of the best other models", how=f"{_HERE}.half_the_time")
def half_the_time(results: PaperResults) -> Claim:
    seconds = {name: CALIBRATION[name][CALIBRATION_COLUMNS.index("seconds")] for name in (_LDL, *_CLASSICAL)}
    quickest = min(seconds[name] for name in _CLASSICAL)
    why = "By the paper's own Table 3, since seconds of ours cannot be compared: a little more than half."
    ours = f"{seconds[_LDL]} s of {quickest} s"
    return Claim(ours=ours, verdict=in_words(2 * seconds[_LDL] < quickest), why=why)


faster_than_gamma = _speed("4.5", "how many times as long Gamma takes as SLR with LDL", _CLASSICAL[:1], printed="1.96")
around_twice = _speed("5", "calibration is around twice as fast as with the best other models")


def _accuracy(results: PaperResults) -> pd.DataFrame:
    """Return the calibration table of what the paper has, without floors and models of ours."""
    return results.calibration.loc[list(CALIBRATION)]


def _table_1(results: PaperResults) -> Iterator[Claim]:
    seeds = results.forward_trainings["mean_rmse"]
    spread = {_SLR: f"{scientific(seeds.min())} to {scientific(seeds.max())} ({len(seeds)} seeds)"}
    for name, printed in FITTING.items():
        fits, family = results.fits(), name.split("-")[0]
        row, inverse = fits.loc[name], fits["mean_rmse"][name.removesuffix("-forward")]
        ours = float(row["mean_rmse"])
        why = _WHY.get(f"Table 1, {family}") or _WHY[f"Table 1, {'below' if float(printed) < ours else 'above'}"]
        why = why.format(mse=scientific(float(row["mean_mse"])), inverse=scientific(inverse))
        found = Claim(f"mean RMSE of {name}", "Table 1", printed, scientific(ours), spread.get(name, ""), _FITS)
        yield found._replace(verdict=verdict(ours, printed), why=why, group=f"Table 1, {family}")


def _table_2(results: PaperResults) -> Iterator[Claim]:
    for name, printed in STABILITY.items():
        values = results.stability.query("model == @name")["total_variance"]
        mean, low, high = values.mean(), values.min(), values.max()
        yield Claim(
            claim=f"total variance of {name}",
            where="Table 2",
            paper=f"{printed:.2f}",
            ours=f"{mean:.2f}",
            spread=f"{low:.2f} to {high:.2f} ({len(values)} seeds)",
            how=_STABILITIES,
            verdict="not comparable" if name in _SEARCH_FAILS else verdict(mean, f"{printed:.2f}", (low, high)),
            why=_WHY[f"Table 3, {name}" if name in _SEARCH_FAILS else "Table 2"],
            group=f"Table 2, {name}",
        )


def _table_3(results: PaperResults) -> Iterator[Claim]:
    for name, figures in CALIBRATION.items():
        bounds = _bounds(results, name)
        for column, figure in zip(CALIBRATION_COLUMNS, figures, strict=True):
            ours = float(str(results.calibration.loc[name, column]))
            judge = Claim(paper=f"{figure}", ours=f"{ours:.1f}", verdict="not comparable", why=_WHY["Table 3, seconds"])
            if column != "seconds":
                judge = _judge_rmse(figure, ours, bounds[column])
            if judge.verdict == "differs" and column in ("max", "p95") and figure > bounds[column][1]:
                judge = judge._replace(verdict="not comparable", why=_WHY["Table 3, largest"])
            if judge.verdict == "differs" and name in _SEARCH_FAILS:
                judge = judge._replace(verdict="not comparable", why=_WHY[f"Table 3, {name}"])
            if judge.verdict == "differs":
                copied = "The paper prints its mean once more. " if column == "median" and figure == figures[0] else ""
                cause = _WHY.get(f"Table 3, {name}") or _WHY[f"Table 3, {name.split('-')[0]}"]
                judge = judge._replace(why=f"{judge.why} {copied}{cause}")
            what = f"{_STATISTICS[column]}, {name}"
            yield judge._replace(claim=what, where="Table 3", how=_CALIBRATIONS, group=f"Table 3, {name}")


def means_reproduced(results: PaperResults) -> int:
    """Count the means of Table 3 that are reproduced."""
    return sum(each.verdict == "reproduced" for each in _table_3(results) if each.claim.startswith("mean RMSE"))


def _bounds(results: PaperResults, name: str) -> dict[str, tuple[float, float]]:
    """Return the least and the greatest of the 95 % bounds over resampled cameras that the seeds of the search give."""
    seeds = [bootstrap_bounds(rows.to_numpy()) for _, rows in results.cameras[name].groupby("seed")]
    return {column: (min(b[column][0] for b in seeds), max(b[column][1] for b in seeds)) for column in seeds[0]}


def _judge_rmse(printed: float, ours: float, bounds: tuple[float, float]) -> Claim:
    # Decimals, since 0.062 - 0.057 is more than 0.005 in binary.
    apart = abs(Decimal(f"{printed:.3f}") - Decimal(f"{ours:.3f}"))
    low, high = bounds
    inside = f"{'inside' if low <= printed <= high else 'outside'} the 95 % bounds of ours"
    near = f"within the {SIGNIFICANT_RMSE} that the paper calls not significant"
    return Claim(
        paper=f"{printed:.3f}",
        ours=f"{ours:.3f}",
        spread=f"{low:.3f} to {high:.3f} (95 %, bootstrap of 3 seeds)",
        verdict=verdict(ours, f"{printed:.3f}", bounds, SIGNIFICANT_RMSE),
        why=f"The two are {apart} apart, {near if apart <= Decimal(str(SIGNIFICANT_RMSE)) else inside}.",
    )
