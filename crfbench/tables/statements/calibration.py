"""What the paper says of calibration: how stable, accurate and quick it is."""

import numpy as np
import pandas as pd

from crfbench.paper import CALIBRATION, SIGNIFICANT_RMSE
from crfbench.tables.evidence import Evidence
from crfbench.tables.statements.finding import Check, Finding, counted, is_least, judged

_CALIBRATION = "crfbench.tables.calibration.calibration_table"
_STABILITY = "crfbench.tables.evidence.stability_by_seed"
_HERE = "crfbench.tables.statements.calibration"
_CLASSICAL = [("Gamma", "", 1), ("Polynomial", "", 3), ("GGCM", "", 3), ("EMoR", "", 3)]
_LDL, _AUC, _BASELINE = ("SLR", "ldl", 1), ("SLR", "auc", 1), ("SLR", "baseline", 1)
_NO_DIFFERENCE = (0.0, 0.0)
#: The ratio from which on "twice as fast" is taken to hold.
_NEARLY_TWICE = 1.8


def papers_impossible_spreads() -> list[str]:
    """Name the rows of the paper's Table 3 that no values of 0 or more can have.

    Of values from 0 to M with mean m, the standard deviation is at most sqrt((M - m) m) (Bhatia and Davis 2000,
    doi:10.1080/00029890.2000.12005203), times sqrt(14/13) where it is divided by 13; every figure is taken at the end
    of its rounding that allows most.
    """
    found = []
    for (model, constraint, k), (mean, _, sd, largest, *_) in CALIBRATION.items():
        means = mean + np.linspace(-0.0005, 0.0005, 11)
        most = float(np.sqrt(((largest + 0.0005 - means) * means).max() * 14 / 13))
        if sd - 0.0005 > most:
            found.append(f"{model} {constraint} d={k}: s.d. {sd}, but at most {most:.4f} by its mean and maximum")
    return found


def speed_ratio(calibration: pd.DataFrame, rivals: list[tuple[str, str, int]]) -> float:
    """Return how many times as long as SLR with LDL the quickest of the rivals takes."""
    seconds = calibration.set_index(["model", "constraint", "n_params"])["seconds"]
    return float(seconds[rivals].min() / seconds[_LDL])


def most_stable(evidence: Evidence) -> Finding:
    """Compare the total variances."""
    return _by_camera(evidence, "total_variance", "Total variance, mean over seeds")


def nearest_to_truth(evidence: Evidence) -> Finding:
    """Compare the RMSE of the curves of Table 2."""
    return _by_camera(evidence, "mean_rmse", "Mean RMSE of the same four curves against RAW")


def _by_camera(evidence: Evidence, column: str, what: str) -> Finding:
    groups = evidence.stability.groupby("model")[column]
    mean, low, high = groups.mean(), groups.min(), groups.max()
    others = ", ".join(f"{name} {mean[name]:.2g}" for name in ("EMoR", "GGCM", "Polynomial"))
    spread = f"{low['SLR']:.2g} to {high['SLR']:.2g} (3 seeds)"
    ranges = dict(zip(low.index, zip(low, high, strict=True), strict=True))
    holds = is_least(ranges.pop("SLR"), ranges.values())
    why = f"{what}; {others}."
    return judged(ours=f"{mean['SLR']:.2g}", how=_STABILITY, holds=holds, why=why, spread=spread)


def most_accurate(evidence: Evidence) -> Finding:
    """Rank the calibrations."""
    table = _accuracy(evidence)
    mean = table["mean"].sort_values()
    rank = list(mean.index).index(_LDL) + 1
    best = " ".join(map(str, filter(None, mean.index[0])))
    near = int((~table["beyond_0.005"]).sum()) - 1
    why = f"{best} has {mean.iloc[0]:.3f}; for {near} of 12 models the bounds do not exclude a difference below 0.005."
    spread = _bounds(table.loc[_LDL])
    rivals = table.drop([_LDL])[["difference_low", "difference_high"]].itertuples(index=False, name=None)
    holds = is_least(_NO_DIFFERENCE, rivals)
    return judged(ours=f"rank {rank} of {len(mean)}", how=_CALIBRATION, holds=holds, why=why, spread=spread)


def ldl_helps(evidence: Evidence) -> Finding:
    """Compare LDL with no constraint, camera by camera."""
    row = _accuracy(evidence).loc[_BASELINE]
    low, high = row["difference_low"], row["difference_high"]
    why = "Baseline less LDL in mean RMSE, paired by camera; in the paper it is +0.013."
    spread = f"{low:+.3f} to {high:+.3f} (bootstrap)"
    holds = is_least(_NO_DIFFERENCE, [(low, high)])
    return judged(ours=f"{row['difference']:+.3f}", how=_CALIBRATION, holds=holds, why=why, spread=spread)


def significant(evidence: Evidence) -> Finding:
    """Compare the threshold with what a bootstrap over the cameras can tell apart."""
    rows = _accuracy(evidence).drop([_LDL])
    half = (rows["difference_high"] - rows["difference_low"]) / 2
    why = "Half the width of the 95 % interval of a paired difference over 14 cameras, median over the rows."
    spread = f"{half.min():.3f} to {half.max():.3f} (12 rows)"
    holds = half.median() <= SIGNIFICANT_RMSE
    return judged(ours=f"{half.median():.3f}", how=_CALIBRATION, holds=bool(holds), why=why, spread=spread)


def auc_trades(evidence: Evidence) -> Finding:
    """Compare AUC with LDL in time and RMSE."""
    table = _accuracy(evidence)
    row, ldl = table.loc[_AUC], table.loc[_LDL]
    low, high = row["difference_low"], row["difference_high"]
    why = "AUC less LDL in mean RMSE, paired by camera, and in seconds."
    ours = f"{row['difference']:+.3f}, {row['seconds'] - ldl['seconds']:+.1f} s"
    spread = f"{low:+.3f} to {high:+.3f} (bootstrap)"
    holds = is_least(_NO_DIFFERENCE, [(low, high)]) if row["seconds"] < ldl["seconds"] else False
    return judged(ours=ours, how=_CALIBRATION, holds=holds, why=why, spread=spread)


def impossible_spread(evidence: Evidence) -> Finding:
    """Check the printed statistics against each other."""
    found = papers_impossible_spreads()
    why = (
        f"{'; '.join(found)}; the printed s.d. equals the printed median, so it may be a slip."
        if found
        else "All of them can."
    )
    ours = f"{len(found)} of {len(CALIBRATION)} rows cannot"
    return judged(ours=ours, how=f"{_HERE}.papers_impossible_spreads", holds=not found, why=why)


def metrics(evidence: Evidence) -> Finding:
    """Count the columns of Table 3."""
    n = len(next(iter(CALIBRATION.values())))
    why = "The text counts five, four of them of accuracy; the table and its caption have six, with the median."
    return counted("metrics", n, _CALIBRATION, why)


def calibration_images(evidence: Evidence) -> Finding:
    """Count the photographs of one illumination."""
    n = len(evidence.patches["exposure"].unique())
    why = "The released program calibrates on four and tests on the other four, as 'double cross-validation' needs."
    return counted("calibration_images", n, _CALIBRATION, why)


def almost_twice(evidence: Evidence) -> Finding:
    """Compare the seconds of all rivals and SLR."""
    return _speed(evidence, _CLASSICAL, _NEARLY_TWICE)


def half_the_time(evidence: Evidence) -> Finding:
    """Compare the same with a stricter word."""
    more = "; in the paper's Table 3 it is 57.4 s against 112.6 s, more than half"
    return _speed(evidence, _CLASSICAL, 2.0, more)


def faster_than_gamma(evidence: Evidence) -> Finding:
    """Compare the seconds of Gamma and SLR."""
    return _speed(evidence, _CLASSICAL[:1], _NEARLY_TWICE)


def _speed(evidence: Evidence, rivals: list[tuple[str, str, int]], least: float, more: str = "") -> Finding:
    ratio = speed_ratio(evidence.calibration, rivals)
    quickest = "Gamma" if len(rivals) == 1 else f"the quickest of {len(rivals)} classical models"
    why = f"Seconds of {quickest} over those of SLR with LDL, by the paper's method in one program{more}."
    return judged(ours=f"{ratio:.2f} times", how=f"{_HERE}.speed_ratio", holds=ratio > least, why=why)


def _accuracy(evidence: Evidence) -> pd.DataFrame:
    """Return the calibration table of what the paper has, without floors and models of ours."""
    table = evidence.calibration.set_index(["model", "constraint", "n_params"])
    return table.loc[list(CALIBRATION)]


def _bounds(row: "pd.Series[float]") -> str:
    return f"{row['low']:.3f} to {row['high']:.3f} (bootstrap)"


CHECKS: dict[str, Check] = {
    "most_stable": most_stable,
    "nearest_to_truth": nearest_to_truth,
    "most_accurate": most_accurate,
    "ldl_helps": ldl_helps,
    "significant": significant,
    "auc_trades": auc_trades,
    "impossible_spread": impossible_spread,
    "metrics": metrics,
    "calibration_images": calibration_images,
    "almost_twice": almost_twice,
    "half_the_time": half_the_time,
    "faster_than_gamma": faster_than_gamma,
    "around_twice": almost_twice,
}
