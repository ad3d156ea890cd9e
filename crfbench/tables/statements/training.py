"""What the paper says of its networks: the search for them, their losses, their latents."""

import numpy as np
import pandas as pd

from crfbench.curves import GRID, N_SAMPLES
from crfbench.paper import STATEMENTS
from crfbench.search.result import architecture
from crfbench.search.space import SearchSpace
from crfbench.tables.evidence import CONSTRAINTS, Evidence
from crfbench.tables.statements.finding import Check, Finding, counted, is_least, judged

_TRAININGS = "crfbench.tables.evidence.trainings_by_seed"
_HERE = "crfbench.tables.statements.training"
#: Below it mean and s.d. are within a few per cent of 0 and 1.
_SMALL_KL = 1e-3


def smoothness_loss(curve: np.ndarray) -> float:
    """Return the paper's smoothness loss of a curve (1024,): the l2 norm of its first differences."""
    return float(np.linalg.norm(np.diff(curve)))


def printed_variance(n: int = 201) -> float:
    """Return the mean of what the paper's estimate of the variance gives for `n` draws from N(0, 1)."""
    draws = np.random.default_rng(0).normal(size=(1000, n))
    return float(((draws - draws.mean(axis=1, keepdims=True)) ** 2).sum(axis=1).mean())


def candidates(evidence: Evidence) -> Finding:
    """Count candidate architectures."""
    why = "6 x (1 + 5 x 5): no third layer without a second."
    return counted("candidates", len(SearchSpace()), "crfbench.search.SearchSpace", why)


def candidate_time(evidence: Evidence) -> Finding:
    """Compare the time of the slowest candidate."""
    slowest = float(evidence.search["seconds"].max())
    why = "The slowest candidate, three folds, one processor core, no graphics card."
    return judged(ours=f"{slowest:.0f} s", how="crfbench.search.naive_search", holds=slowest < 60, why=why)


def architecture_found(evidence: Evidence) -> Finding:
    """Compare the choices of the search, by seed, with the released program's."""
    chosen = evidence.search_seeds[evidence.search_seeds["chosen"]]
    by_seed = [str(architecture(row)) for _, row in chosen.iterrows()]
    same = sum(name == STATEMENTS["architecture"].figure for name in by_seed)
    verdict = "reproduced" if same > len(by_seed) / 2 else "differs"
    why = "The best candidates lie closer together than seeds do: the search does not settle an architecture."
    return Finding(by_seed[0], "crfbench.search.naive_search", verdict, why, f"{', '.join(by_seed)} (by seed)")


def smoothness(evidence: Evidence) -> Finding:
    """Compare the loss of a smooth curve and a rough one."""
    smooth, rough = GRID ** (1 / 2.2), GRID + 0.0004 * (-1.0) ** np.arange(N_SAMPLES)
    losses = smoothness_loss(smooth), smoothness_loss(rough)
    why = "The norm is least for the straight line, so it flattens curves; the second derivative would smooth them."
    ours = f"{losses[0]:.3f} for x^(1/2.2), {losses[1]:.3f} for a zigzag along the diagonal"
    return judged(ours=ours, how=f"{_HERE}.smoothness_loss", holds=losses[0] < losses[1], why=why)


def variance(evidence: Evidence) -> Finding:
    """Apply the printed estimate to draws of variance 1."""
    value = printed_variance()
    why = "The formula lacks 1/N; with it the estimate is right, and it is what we train with."
    ours = f"{value:.0f} for 201 draws of variance 1"
    return judged(ours=ours, how=f"{_HERE}.printed_variance", holds=abs(value - 1) < 0.1, why=why)


def ldl_accurate(evidence: Evidence) -> Finding:
    """Look at the largest KL divergence of the seeds."""
    kl = _means(evidence, "kl")
    others = ", ".join(f"{name} {kl[name]:.2g}" for name in CONSTRAINTS[1:])
    why = f"KL divergence of mean and s.d. to N(0, 1), which LDL minimises, mean of the seeds; {others}."
    holds = bool((evidence.trainings.query("constraint == 'ldl'")["kl"] < _SMALL_KL).all())
    return judged(ours=f"{kl['ldl']:.2g}", how=_TRAININGS, holds=holds, why=why, spread=_range(evidence, "kl", "ldl"))


def ldl_rapid(evidence: Evidence) -> Finding:
    """Compare the epochs from which the latents stay near their objective."""
    settled = evidence.trainings.fillna({"settled": np.inf}).groupby("constraint")["settled"].median()
    shown = {name: "never" if np.isinf(settled[name]) else f"{settled[name]:.0f}" for name in CONSTRAINTS}
    holds = settled["ldl"] < settled["vae"] < np.inf and settled["vae"] < settled["baseline"]
    others = ", ".join(f"{name} {epoch}" for name, epoch in shown.items() if name != "ldl")
    why = f"Epoch from which the KL divergence stays below 0.05, median of the seeds; {others}."
    own = evidence.trainings.query("constraint == 'ldl'")["settled"]
    spread = f"{own.min():.0f} to {own.max():.0f} ({len(own)} seeds)"
    return judged(ours=f"epoch {shown['ldl']}", how=_TRAININGS, holds=bool(holds), why=why, spread=spread)


def aae_unstable(evidence: Evidence) -> Finding:
    """Compare how much the latents' spread still moves late in training."""
    swing = _means(evidence, "swing").drop("baseline")
    others = ", ".join(f"{name} {value:.3f}" for name, value in swing.drop("aae").items())
    why = f"Range of the latents' s.d. after a third of the epochs, mean of the seeds; {others}."
    spread = _range(evidence, "swing", "aae")
    ranges = evidence.trainings.groupby("constraint")["swing"].agg(["min", "max"]).drop("baseline")
    steadiness = {name: (-most, -least) for name, least, most in ranges.itertuples(name=None)}
    holds = is_least(steadiness.pop("aae"), steadiness.values())
    return judged(ours=f"{swing['aae']:.3f}", how=_TRAININGS, holds=holds, why=why, spread=spread)


def auc_sharp(evidence: Evidence) -> Finding:
    """Say why the comparison is empty."""
    sd = _means(evidence, "sd")["auc"]
    why = "The labels are sums of up to hundreds; the paper does not say how they were scaled, and the scale decides."
    return Finding(f"s.d. {sd:.2f}", _TRAININGS, "not comparable", why, _range(evidence, "sd", "auc"))


def ldl_best(evidence: Evidence) -> Finding:
    """Compare how near the latents come to N(0, 1), by two measures."""
    kl, ks = _means(evidence, "kl"), _means(evidence, "ks")
    firsts = {kl.idxmin(), ks.idxmin()}
    others = ", ".join(f"{name} {ks[name]:.2g}" for name in CONSTRAINTS[1:])
    why = (
        f"By mean and s.d. (KL divergence) {kl.idxmin()} is nearest to N(0, 1); by the shape (Kolmogorov-Smirnov "
        f"distance, {others}) it is {ks.idxmin()}. Means of the seeds."
    )
    return judged(
        ours=f"KL {kl['ldl']:.2g}, KS {ks['ldl']:.2g}",
        how=_TRAININGS,
        holds=None if "ldl" in firsts and len(firsts) > 1 else firsts == {"ldl"},
        why=why,
        spread=f"KS {_range(evidence, 'ks', 'ldl')}",
    )


def _means(evidence: Evidence, column: str) -> "pd.Series[float]":
    return evidence.trainings.groupby("constraint")[column].mean()


def _range(evidence: Evidence, column: str, constraint: str) -> str:
    values = evidence.trainings.query("constraint == @constraint")[column]
    return f"{values.min():.2g} to {values.max():.2g} ({len(values)} seeds)"


CHECKS: dict[str, Check] = {
    "candidates": candidates,
    "candidate_time": candidate_time,
    "architecture": architecture_found,
    "smoothness": smoothness,
    "variance": variance,
    "ldl_accurate": ldl_accurate,
    "ldl_rapid": ldl_rapid,
    "aae_unstable": aae_unstable,
    "auc_sharp": auc_sharp,
    "ldl_best": ldl_best,
}
