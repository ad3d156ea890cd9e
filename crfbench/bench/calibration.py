"""Calibration of 14 cameras under both illuminations beside other searches of the same loss, and how it grows.

Run it with: python -m crfbench.bench.calibration. The ratios are the claim; the seconds are of this
machine and this minute. The loss is the paper's, in squared units of the chart's reference.
"""

import argparse
import resource
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import differential_evolution, minimize

from crfbench.bench.growth import Growth, plot, print_growth
from crfbench.bench.timing import Row, median_seconds, row
from crfbench.calibration import Calibration, Observations, Table, calibrate, decode_table
from crfbench.curves import GRID, Array
from crfbench.datasets import load_patches
from crfbench.datasets.middlebury import REFERENCE_IRRADIANCE, patch_intensity
from crfbench.models import SLR, ResponseModel

SETS, STARTS = 28, 10  # calibrations and, as in the paper, random starts of each
CAMERAS, PATCHES = (1, 10, 100, 1_000, 10_000), (3, 6, 12, 24, 48, 96, 192, 384)
GROWING = ("grid", "posterior")

Run = Callable[[], Calibration]
Loss = Callable[[Array], float]
Search = Callable[[Loss, Table], float]


class Timed(NamedTuple):
    """What took how long for all 28, and the mean loss it reached."""

    name: str
    seconds: float
    loss: float


def main() -> None:
    """Print all tables; draw how the time grows where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--plot", type=Path, help="write the growth as a figure")
    options = parser.parse_args()
    brightness = _brightness()
    _print_timed("SLR-ldl, 1 parameter", one_parameter(brightness, options.repeats))
    _print_timed("SLR-ldl, 3 parameters", three_parameters(brightness, options.repeats))
    found = [by_cameras(brightness, CAMERAS), by_patches(brightness)]
    for growth in found:
        print_growth(growth)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"\npeak memory of all this: {peak:.1f} GiB")
    if options.plot:
        plot(found, options.plot)


def rows(repeats: int = 3) -> list[Row]:
    """Time grid and MAP beside the paper's search one by one and SciPy's two; the notes tell the loss of each."""
    timed = one_parameter(_brightness(), repeats)
    ours = [timed[0], next(each for each in timed if each.name.startswith("map"))]
    return [_row(mine, other) for mine in ours for other in timed[-3:]]


def _row(mine: Timed, other: Timed) -> Row:
    note = f"{SETS} calibrations of 4 x 24 patches; mean loss {mine.loss:.0f} against {other.loss:.0f}"
    return row(f"calibrate SLR(1), {mine.name}", mine.seconds, other.name, other.seconds, note)


def growths() -> list[Growth]:
    """Time the growing methods over two decades of cameras and of patches."""
    return [by_cameras(_brightness(), CAMERAS[:-1]), by_patches(_brightness())]


def _brightness() -> Array:
    return patch_intensity(load_patches())["jpeg"].to_numpy().reshape(SETS, 4, 24)


def one_parameter(brightness: Array, repeats: int) -> list[Timed]:
    """Time the methods of crfbench, the paper's two ways and SciPy's searches, side by side."""
    model = SLR.load("ldl", 1)
    table, observations = decode_table(model), Observations(brightness, REFERENCE_IRRADIANCE)
    run = partial(calibrate, model, observations)
    rows = [_timed("grid, table at hand", partial(run, "grid", table=table), brightness, repeats)]
    cold = ("grid", "map", "posterior")
    rows += [_timed(f"{method}, table decoded too", partial(run, method), brightness, repeats) for method in cold]
    rows += [
        _timed("the paper's search, all at once", partial(run, "paper", starts=STARTS), brightness, 1),
        one_after_another(model, brightness),
        scipy_search("SciPy L-BFGS-B, ten starts of each camera", _ten_starts, model, table, brightness),
        scipy_search("SciPy differential evolution, each camera", _evolution, model, table, brightness),
    ]
    return rows


def three_parameters(brightness: Array, repeats: int) -> list[Timed]:
    """Time the searches of a model with three parameters."""
    model, observations = SLR.load("ldl", 3), Observations(brightness, REFERENCE_IRRADIANCE)
    run = partial(calibrate, model, observations, table=decode_table(model))
    methods = ("lm", "map", "posterior")
    return [_timed(f"{method}, table at hand", partial(run, method), brightness, repeats) for method in methods]


def one_after_another(model: ResponseModel, brightness: Array) -> Timed:
    """Run the paper's search as its program does, one start of one camera at a time: a sample of one start each."""
    runs = [
        calibrate(model, Observations(b, REFERENCE_IRRADIANCE), "paper", starts=1, seed=i)
        for i, b in enumerate(brightness)
    ]
    loss = np.mean([paper_loss(run.curves[0], b) for run, b in zip(runs, brightness, strict=True)])
    seconds = STARTS * sum(run.seconds for run in runs)
    return Timed(f"the paper's search, one by one (1 start x {STARTS})", seconds, float(loss))


def scipy_search(name: str, search: Search, model: ResponseModel, table: Table, brightness: Array) -> Timed:
    """Search every camera alone."""
    losses: list[float] = []

    def run() -> None:
        for b in brightness:
            losses.append(search(partial(_loss_of, model, b), table))

    seconds = median_seconds(run, 1)
    return Timed(name, seconds, float(np.mean(losses)))


def _loss_of(model: ResponseModel, brightness: Array, params: Array) -> float:
    return paper_loss(model.decode(np.atleast_1d(params)), brightness)


def _ten_starts(loss: Loss, table: Table) -> float:
    starts = np.random.default_rng(0).normal(size=STARTS)
    return float(min(minimize(loss, [z], method="L-BFGS-B").fun for z in starts))


def _evolution(loss: Loss, table: Table) -> float:
    return float(differential_evolution(loss, [(table.free.min(), table.free.max())], seed=0).fun)


def paper_loss(curve: Array, brightness: Array) -> float:
    """The paper's loss of one curve for one camera (4, 24): photographs aligned by scale and offset."""
    g = np.interp(brightness, GRID, curve)
    g = g - g.mean(axis=1, keepdims=True)
    r = REFERENCE_IRRADIANCE - REFERENCE_IRRADIANCE.mean()
    gained = (g @ r) ** 2 / np.maximum((g * g).sum(axis=1), 1e-12)
    return float(np.linalg.norm(((r * r).sum() - gained) / r.size))


def _timed(name: str, run: Run, brightness: Array, repeats: int) -> Timed:
    found = run()
    curves = found.model.decode(found.params)  # of the best parameters, not the mean of a posterior
    loss = np.mean([paper_loss(curve, b) for curve, b in zip(curves, brightness, strict=True)])
    return Timed(name, median_seconds(run, repeats), float(loss))


def _print_timed(title: str, rows: list[Timed]) -> None:
    print(f"\n{title}: {SETS} calibrations of 4 photographs of 24 patches")
    print(f"{'':<44}{'seconds':>9}{'mean loss':>11}{'x first':>9}")
    for name, seconds, loss in rows:
        print(f"{name:<44}{seconds:9.3f}{loss:11.1f}{seconds / rows[0].seconds:9.1f}")


def by_cameras(brightness: Array, counts: tuple[int, ...]) -> Growth:
    """Time the growing methods for more and more cameras: random mixtures of the real ones, with noise."""
    rng = np.random.default_rng(0)
    seconds = []
    for n in counts:
        mixed = np.tensordot(rng.dirichlet(np.ones(SETS), size=n), brightness, axes=1)
        seconds.append(_growing(mixed + rng.normal(scale=0.01, size=mixed.shape), REFERENCE_IRRADIANCE))
    return Growth("cameras", GROWING, counts, np.array(seconds))


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
    model = SLR.load("ldl", 1)
    table, observations = decode_table(model), Observations(np.clip(brightness, 0.0, 1.0), reference)
    repeats = 3 if brightness.size < 10**5 else 1
    run = partial(calibrate, model, observations, table=table)
    return np.array([median_seconds(partial(run, method), repeats) for method in GROWING])


if __name__ == "__main__":
    main()
