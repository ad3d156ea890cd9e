"""Calibration of 14 cameras under both illuminations beside other searches of the same loss, and how it grows.

The loss is the paper's, in squared units of the chart's reference.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.optimize import differential_evolution, minimize

from benchmarks.timing import Growth, Row, median_seconds, row, seconds_of
from crfbench import Observations, calibrate, load_model, load_patches
from crfbench.calibration import Table, decode_table
from crfbench.curves import GRID, Array
from crfbench.datasets.middlebury import REFERENCE_IRRADIANCE, patch_intensity

SETS, STARTS = 28, 10  # calibrations and, as in the paper, random starts of each
CAMERAS, PATCHES = (1, 10, 100, 1_000), (3, 6, 12, 24, 48, 96, 192, 384)
GROWING = ("grid", "posterior")
MODEL = load_model("SLR-ldl-1")

Loss = Callable[[Array], float]


def rows(repeats: int = 3) -> list[Row]:
    """Time grid and MAP beside the paper's search one by one and SciPy's two; the notes tell the loss of each."""
    brightness, table = _brightness(), decode_table(MODEL)
    observations = Observations(brightness, REFERENCE_IRRADIANCE)
    ours = {
        "grid, table at hand": partial(calibrate, MODEL, observations, "grid", table=table),
        "map, table decoded too": partial(calibrate, MODEL, observations, "map"),
    }
    others = {
        f"the paper's search, one by one (1 start x {STARTS})": one_after_another(brightness),
        "SciPy L-BFGS-B, ten starts of each camera": each_alone(_ten_starts, table, brightness),
        "SciPy differential evolution, each camera": each_alone(_evolution, table, brightness),
    }
    found = []
    for name, run in ours.items():
        seconds = median_seconds(run, repeats)
        curves = MODEL.decode(run().params)  # of the best parameters, not the mean of a posterior
        loss = np.mean([paper_loss(curve, b) for curve, b in zip(curves, brightness, strict=True)])
        for other, (other_s, other_loss) in others.items():
            note = f"{SETS} calibrations of 4 x 24 patches; mean loss {loss:.0f} against {other_loss:.0f}"
            found.append(row(f"calibrate SLR-ldl-1, {name}", seconds, other, other_s, note))
    return found


def growths() -> list[Growth]:
    """Time the growing methods over two decades of cameras and of patches."""
    return [by_cameras(_brightness()), by_patches(_brightness())]


def _brightness() -> Array:
    return patch_intensity(load_patches())["jpeg"].to_numpy().reshape(SETS, 4, 24)


def one_after_another(brightness: Array) -> tuple[float, float]:
    """Run the paper's search as its program does, one start of one camera at a time; return seconds and mean loss.

    One start of each camera is run, and its time counts for all ten.
    """
    runs = [
        calibrate(MODEL, Observations(b, REFERENCE_IRRADIANCE), "paper", starts=1, seed=i)
        for i, b in enumerate(brightness)
    ]
    loss = np.mean([paper_loss(run.curves[0], b) for run, b in zip(runs, brightness, strict=True)])
    return STARTS * sum(run.seconds for run in runs), float(loss)


def each_alone(search: Callable[[Loss, Table], float], table: Table, brightness: Array) -> tuple[float, float]:
    """Search every camera alone; return seconds and mean loss."""
    seconds, losses = seconds_of(lambda: [search(partial(_loss_of, b), table) for b in brightness])
    return seconds, float(np.mean(losses))


def _loss_of(brightness: Array, params: Array) -> float:
    return paper_loss(MODEL.decode(np.atleast_2d(params))[0], brightness)


def _ten_starts(loss: Loss, table: Table) -> float:
    starts = np.random.default_rng(0).normal(size=STARTS)
    return float(min(minimize(loss, [z], method="L-BFGS-B").fun for z in starts))


def _evolution(loss: Loss, table: Table) -> float:
    bounds = (table.unconstrained.min(), table.unconstrained.max())
    return float(differential_evolution(loss, [bounds], seed=0).fun)


def paper_loss(curve: Array, brightness: Array) -> float:
    """The paper's loss of one curve for one camera (4, 24): photographs aligned by scale and offset."""
    g = np.interp(brightness, GRID, curve)
    g = g - g.mean(axis=1, keepdims=True)
    r = REFERENCE_IRRADIANCE - REFERENCE_IRRADIANCE.mean()
    gained = (g @ r) ** 2 / np.maximum((g * g).sum(axis=1), 1e-12)
    return float(np.linalg.norm(((r * r).sum() - gained) / r.size))


def by_cameras(brightness: Array) -> Growth:
    """Time the growing methods for more and more cameras: random mixtures of the real ones, with noise."""
    rng = np.random.default_rng(0)
    seconds = []
    for n in CAMERAS:
        mixed = np.tensordot(rng.dirichlet(np.ones(SETS), size=n), brightness, axes=1)
        seconds.append(_growing(mixed + rng.normal(scale=0.01, size=mixed.shape), REFERENCE_IRRADIANCE))
    return Growth("cameras", GROWING, CAMERAS, np.array(seconds))


def by_patches(brightness: Array) -> Growth:
    """Time the growing methods for all cameras and more and more patches: the real ones again and again, with noise."""
    rng = np.random.default_rng(1)
    seconds = []
    for p in PATCHES:
        chosen = np.arange(p) * (7 if p < 24 else 1) % 24  # a few of them, spread over the chart
        seen = brightness[..., chosen] + rng.normal(scale=0.01, size=(SETS, 4, p))
        seconds.append(_growing(seen, REFERENCE_IRRADIANCE[chosen]))
    return Growth("patches", GROWING, PATCHES, np.array(seconds))


def _growing(brightness: Array, reference: Array) -> Array:
    table, observations = decode_table(MODEL), Observations(np.clip(brightness, 0.0, 1.0), reference)
    repeats = 3 if brightness.size < 10**5 else 1
    runs = [partial(calibrate, MODEL, observations, method, table=table) for method in GROWING]
    return np.array([median_seconds(run, repeats) for run in runs])
