"""Rebuild every table and figure into a folder, without a browser."""

import json
from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from crfbench import plots
from crfbench.datasets import Responses, load_emor_basis, load_patches, load_responses, registry
from crfbench.datasets.middlebury import patch_intensity
from crfbench.files import write_atomically
from crfbench.history import load_history
from crfbench.models import GGCM, PPISP, EMoR, Gamma, Polynomial
from crfbench.tables.calibration import calibration_table, camera_rmse_table
from crfbench.tables.chart_free import chart_free_table
from crfbench.tables.claims import claims_table
from crfbench.tables.fitting import fitting_tables
from crfbench.tables.latents import latent_table
from crfbench.tables.leaderboard import leaderboard
from crfbench.tables.recorded import load_recorded, to_rows
from crfbench.tables.stability import CAMERA, SIZES, stability_curves, stability_table
from crfbench.tables.stability import ROWS as STABILITY_ROWS

_HISTORIES = ("LDL", "AUC", "AAE", "VAE", "baseline")  # in the order of the paper's figure


_SHOWN = (("SLR", "ldl", 1), ("SLR", "monotone", 1), ("Polynomial", "", 3), ("GGCM", "", 3), ("EMoR", "", 3))


def build_results(folder: Path) -> Iterator[Path]:
    """Write every table (JSON and CSV) and every figure (PNG and PDF), yielding each path as it is written.

    Parameters
    ----------
    folder : Path
        Made if it is not there; files of the same names are replaced.
    """
    folder.mkdir(parents=True, exist_ok=True)  # before minutes of work
    mpl.use("agg")
    tables = fitting_tables()
    for title, table in tables.items():
        yield from _write_table(folder / f"fitting_{title.split(',')[0]}", table)
    yield from _write_table(folder / "latents", latent_table())
    yield from _write_table(folder / "claims", claims_table())
    yield from _write_table(folder / "leaderboard", leaderboard())
    yield from _calibrations(folder)
    for name, ax in _figures(load_responses("auto"), tables):
        yield from _write_figure(folder / name, ax)


def _calibrations(folder: Path) -> Iterator[Path]:
    """Write the stability, calibration and chart-free tables and their figures."""
    tables = {(p, m): calibration_table(p, m) for m in ("map", "posterior") for p in ("3", "24", "random")}
    for (patches, method), table in tables.items():
        yield from _write_table(folder / f"calibration_{patches}_{method}", table)
    yield from _write_table(folder / "calibration_paper_recorded", load_recorded("calibration_paper")[0])
    yield from _write_table(folder / "stability", stability_table())
    yield from _write_table(folder / "chart_free", chart_free_table())
    for row in STABILITY_ROWS[:4]:
        name = "_".join(map(str, filter(None, row)))
        yield from _write_figure(folder / f"stability_{name}", stability_figure(row))
    for patches in ("3", "24"):
        cameras = camera_rmse_table(patches, rows=_SHOWN)
        yield from _write_figure(folder / f"calibration_cameras_{patches}", plots.plot_camera_rmse(cameras))
    coverages = {f"{patches} patches": tables[patches, "posterior"] for patches in ("3", "24")}
    yield from _write_figure(folder / "calibration_coverage", plots.plot_coverage(coverages))


def stability_figure(
    row: tuple[str, str, int], camera: str = CAMERA, method: str = "map", ax: Axes | None = None
) -> Axes:
    """Draw the inverse responses of a camera from 3, 6, 12 and 24 patches over what was measured.

    Parameters
    ----------
    row : (model, constraint, number of parameters)
    camera : str
    method : str
        Of `crfbench.calibration.calibrate`.
    ax : Axes, optional
        By default those of a new figure.
    """
    seen = patch_intensity(load_patches()).query("camera == @camera")
    curves = stability_curves(camera, row, method)
    ax = plots.plot_patch_counts(curves, SIZES, seen["jpeg"], seen["raw"], ax)
    ax.set_title(f"{camera}: {' '.join(map(str, filter(None, row)))}, {method}")
    return ax


def _write_table(stem: Path, table: pd.DataFrame) -> Iterator[Path]:
    texts = {".csv": table.to_csv(index=False), ".json": json.dumps(to_rows(table), indent=1) + "\n"}
    for suffix, text in texts.items():
        path = stem.with_suffix(suffix)
        write_atomically(path, text.encode())
        yield path


def _write_figure(stem: Path, ax: Axes) -> Iterator[Path]:
    figure = ax.get_figure(root=True)
    assert figure is not None  # noqa: S101  an Axes just drawn always lies in a figure
    for suffix in (".png", ".pdf"):
        figure.savefig(stem.with_suffix(suffix), dpi=200)
        yield stem.with_suffix(suffix)
    plt.close("all")


def _figures(responses: Responses, tables: dict[str, pd.DataFrame]) -> Iterator[tuple[str, Axes]]:
    opencrf = load_responses("opencrf")
    yield "curves_opencrf", plots.plot_curves(opencrf.curves, opencrf.families)
    if responses.dataset != "opencrf":
        yield f"curves_{responses.dataset}", plots.plot_curves(responses.curves, responses.families)
        yield "spread", plots.plot_spread({"DoRF": responses.curves, "OpenCRF": opencrf.curves})
    yield "patches", plots.plot_patches(patch_intensity(load_patches()))
    yield "comparison", comparison(responses)
    yield "latent_epochs", plots.plot_latent_epochs({name: load_history(name.lower()) for name in _HISTORIES})[0]
    yield "search", plots.plot_search(load_recorded("search_dorf")[0])
    for title, table in tables.items():
        yield f"fitting_{title.split(',')[0]}", plots.plot_fitting(table)
        yield f"validity_{title.split(',')[0]}", plots.plot_validity(table)


def comparison(responses: Responses, index: int | None = None) -> Axes:
    """Draw one response and the best fit of every model to it.

    Parameters
    ----------
    responses : Responses
    index : int, optional
        Which curve; by default the one that a gamma curve fits worst.
    """
    curves = responses.curves
    if index is None:
        gamma = Gamma()
        index = int(np.argmax(((gamma.decode(gamma.fit(curves)) - curves) ** 2).sum(axis=1)))
    target = curves[index]
    basis = load_emor_basis("forward") if registry.find("dorf/emor.txt") else None
    emor = EMoR(*basis, 3) if basis else EMoR.from_curves(curves, 3, "forward")
    models = [Gamma(), Polynomial(3), GGCM(3), emor, PPISP()]
    fits = {f"{m.name}, {m.n_params} parameter{'s' * (m.n_params > 1)}": m.decode(m.fit(target))[0] for m in models}
    ax = plots.plot_comparison(target, fits)
    ax.set_title(responses.names[index])
    return ax
