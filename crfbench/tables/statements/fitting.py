"""What the paper says of how its model fits DoRF."""

import numpy as np
import pandas as pd

from crfbench.curves import N_SAMPLES
from crfbench.models import load_model
from crfbench.paper import FITTING, STATEMENTS, scientific
from crfbench.tables.evidence import Evidence
from crfbench.tables.fitting import papers_rising_rows
from crfbench.tables.statements.finding import Check, Finding, judged

_FITTING = "crfbench.tables.fitting.fitting_table"
_HERE = "crfbench.tables.statements.fitting"
#: The ratio up to which "slightly worse" is taken to hold.
_SLIGHTLY = 1.5


def emor_energy(fitting: pd.DataFrame, k: int = 3) -> float:
    """Return the percentage of the variance of DoRF's responses that `k` of the four shipped components hold.

    Parameters
    ----------
    fitting : DataFrame
        The recorded fits, whose mean MSE with `k` components is what these leave over.
    k : int
    """
    prior = load_model("EMoR", 4, "forward").prior_
    held = np.trace(prior.covariance[:k, :k]) if prior else np.nan
    rows = fitting.query("model == 'EMoR-PCA' and n_params == @k and direction == 'forward' and split == 'in-sample'")
    return float(100 * held / (held + rows["mean_mse"].item() * N_SAMPLES))


def energy(evidence: Evidence) -> Finding:
    """Compare the energy of three components."""
    share = emor_energy(evidence.fitting)
    agrees = abs(share - float(STATEMENTS["energy"].figure)) <= 0.1
    why = "Principal components of the same 201 curves."
    return Finding(f"{share:.1f}", f"{_HERE}.emor_energy", "reproduced" if agrees else "differs", why)


def classical_models(evidence: Evidence) -> Finding:
    """Compare the classical models with EMoR, as many parameters each."""
    ours = _means(evidence)
    pairs = [(ours["Gamma", 1], ours["EMoR", 1]), *((ours["Polynomial", k], ours["EMoR", k]) for k in (2, 3, 4))]
    gamma, *polynomial = (rival / emor for rival, emor in pairs)
    shown = f"Gamma {gamma:.1f} times EMoR's RMSE, Polynomial {min(polynomial):.1f} to {max(polynomial):.1f} times"
    why = (
        "Worse they are, as many parameters each, but only Gamma slightly. With one parameter Table 1 prints the "
        "opposite, Gamma five times better than EMoR."
    )
    slightly = [1 < ratio < _SLIGHTLY for ratio in (gamma, *polynomial)]
    holds = None if any(slightly) and not all(slightly) else all(slightly)
    return judged(ours=shown, how=_FITTING, holds=holds, why=why)


def one_figure(evidence: Evidence) -> Finding:
    """Compare the text with the table."""
    table = FITTING["SLR", 1]
    why = f"Table 1 prints {table}; one of the two is a slip, and ours is of another size."
    ours = _means(evidence)["SLR-ldl", 1]
    return Finding(scientific(ours), _FITTING, "differs", why)


def ten_folds(evidence: Evidence) -> Finding:
    """Count the other figures of Table 1 that lie ten times above SLR's."""
    ours = _means(evidence)
    above = [key for key in FITTING if key[0] != "SLR" and ours[key] > 10 * ours["SLR-ldl", 1]]
    ratio = ours["EMoR", 1] / ours["SLR-ldl", 1]
    why = f"With best parameters on both sides, EMoR with one component lies {ratio:.1f} times above SLR."
    shown = f"{len(above)} of {len(FITTING) - 1}"
    return judged(ours=shown, how=_FITTING, holds=2 * len(above) > len(FITTING) - 1, why=why)


def ten_folds_unseen(evidence: Evidence) -> Finding:
    """Compare SLR with EMoR on unseen curves."""
    emor = _means(evidence, "grouped-5fold")["EMoR-PCA", 1]
    slr = evidence.held_out.query("model == 'SLR-ldl' and n_params == 1 and direction == 'forward'")["mean_rmse"]
    ratio = emor / slr
    why = "EMoR with one component over SLR, curves of grouped folds that neither learned from."
    spread = f"{ratio.min():.2f} to {ratio.max():.2f} ({len(ratio)} seeds)"
    return judged(ours=f"{emor / slr.mean():.1f} times", how=_FITTING, holds=ratio.mean() > 10, why=why, spread=spread)


def optimal(evidence: Evidence) -> Finding:
    """Count the steps of Table 1 where one more parameter makes things worse."""
    rising = papers_rising_rows()
    why = "A best fit cannot get worse by one more parameter, since that could be zero; ours never do."
    ours = f"{len(rising)} of 9 steps rise in Table 1"
    return judged(ours=ours, how="crfbench.tables.fitting.papers_rising_rows", holds=not rising, why=why)


def gamma_within_ggcm(evidence: Evidence) -> Finding:
    """Compare two names of one model."""
    ours = _means(evidence)
    same = FITTING["Gamma", 1] == FITTING["GGCM", 1]
    printed = f"{FITTING['Gamma', 1]} and {FITTING['GGCM', 1]}"
    why = f"x^w is both models, so the figures must agree; Table 1 prints {printed}."
    return judged(
        ours=f"{scientific(ours['Gamma', 1])}, {scientific(ours['GGCM', 1])}", how=_FITTING, holds=same, why=why
    )


def _means(evidence: Evidence, split: str = "in-sample") -> "pd.Series[float]":
    """Return the mean RMSE of the forward fits by model and number of parameters."""
    rows = evidence.fitting.query("direction == 'forward' and split == @split")
    return rows.set_index(["model", "n_params"])["mean_rmse"]


CHECKS: dict[str, Check] = {
    "energy": energy,
    "classical_models": classical_models,
    "one_figure": one_figure,
    "ten_folds": ten_folds,
    "ten_folds_unseen": ten_folds_unseen,
    "optimal": optimal,
    "gamma_within_ggcm": gamma_within_ggcm,
}
