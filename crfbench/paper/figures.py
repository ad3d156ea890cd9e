"""The paper's figures beside ours, and every table and figure written into a folder without a browser."""

import io
import json
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike

from crfbench import plots
from crfbench.curves import GRID, Direction
from crfbench.datasets import Responses, load_emor_basis, load_patches, load_responses, registry
from crfbench.datasets.middlebury import patch_intensity
from crfbench.files import write_atomically
from crfbench.history import load_history
from crfbench.models import GGCM, PPISP, SLR, EMoR, Gamma, Polynomial, load_model
from crfbench.paper.calibration import calibration_table, camera_rmse_table, chart_free_table
from crfbench.paper.claims import claims_table
from crfbench.paper.findings import paper_map
from crfbench.paper.fitting import fitting_tables
from crfbench.paper.results import PaperResults, latent_table, leaderboard, load_recorded, load_results, to_rows
from crfbench.paper.stability import CAMERA, SIZES, stability_curves, stability_table
from crfbench.paper.verdicts import CALIBRATION, STABILITY
from crfbench.plots import MARKERS, PALETTE, STYLES, new_axes, unit_square

_HISTORIES = ("LDL", "AUC", "AAE", "VAE", "baseline")  # in the order of the paper's figure
_CAMERA_MODELS = ("SLR-ldl-1", "SLR-monotone-1", "Polynomial-3", "GGCM-3", "EMoR-3")
#: The models that `plot_fitting` draws; EMoR stands for itself, learned here or published, as the two coincide.
_FITTING_MODELS = ("Gamma", "Polynomial", "GGCM", "EMoR", "PPISP", "SLR-ldl", "SLR-monotone")
_OFF = 0.05  # in the logarithm: a cross that lies so far from its line needs a name
_APART = 0.3  # in the logarithm: names of crosses so far apart do not touch


def plot_fitting(table: pd.DataFrame, direction: Direction = "inverse", ax: Axes | None = None) -> Axes:
    """Draw mean RMSE by number of parameters: in sample filled, held out hollow, the paper's figures as crosses.

    The table is from `crfbench.paper.fitting_table`, of which the rows of one direction are drawn.
    """
    ax = new_axes(ax, 7.5, 5.0)
    rows = table[table["direction"] == direction]
    rows = rows.assign(kind=rows["model"].str.replace(r"-\d+(-forward)?$", "", regex=True))
    for i, kind in enumerate(_FITTING_MODELS):
        # Gamma's one dot lies under GGCM's, so it is the larger.
        look = {"color": PALETTE[i], "marker": MARKERS[i], "ms": 11 if kind == "Gamma" else 6}
        _fitting_lines(ax, rows[rows["kind"] == kind], kind, look)
        # The paper's EMoR is that of the published basis.
        printed = rows[(rows["kind"].str.removesuffix("-published") == kind) & rows["paper"].notna()]
        seen: dict[str, Any] = {"path_effects": [withStroke(linewidth=4, foreground="white")], "zorder": 3}
        ax.scatter(printed["n_params"], printed["paper"], marker="x", s=70, color=PALETTE[i], **seen)
    ax.plot([], [], color="0.4", ls=":", marker="o", mfc="white", label="held out (grouped 5-fold),\nwhere it differs")
    if rows["paper"].notna().any():
        ax.scatter([], [], marker="x", s=60, color="0.4", label="the paper's number, named\nwhere off our line")
        _name_crosses(ax, rows[rows["paper"].notna()])
    ax.set(xlabel="number of parameters", ylabel="mean RMSE (share of the curve's range)", yscale="log")
    ax.set(xticks=[1, 2, 3, 4], xlim=(0.8, 4.7))
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    ax.grid(axis="y", which="both", lw=0.3)
    return ax


def _name_crosses(ax: Axes, rows: pd.DataFrame) -> None:
    """Write the models' names beside crosses that lie off their lines, those of near crosses below each other."""
    paper = np.log(rows["paper"])
    off = rows.assign(log=paper)[np.abs(paper - np.log(rows["mean_rmse"])) > _OFF].sort_values("log", ascending=False)
    for k, column in off.groupby("n_params"):
        for _, near in column.groupby((column["log"].diff() < -_APART).cumsum()):
            ax.annotate(
                "\n".join(name.split("-")[0] for name in near["kind"]),
                (float(k), float(np.exp(near["log"].mean()))),
                xytext=(8, 0),
                textcoords="offset points",
                va="center",
                fontsize="x-small",
                path_effects=[withStroke(linewidth=3, foreground="white")],
            )


def _fitting_lines(ax: Axes, rows: pd.DataFrame, kind: str, look: dict[str, Any]) -> None:
    inside, outside = (rows[rows["split"] == split].sort_values("n_params") for split in ("in-sample", "grouped-5fold"))
    if len(inside):
        ax.plot(inside["n_params"], inside["mean_rmse"], label=kind, **look)
    if list(outside["mean_rmse"]) != list(inside["mean_rmse"]):  # what learns nothing has one line for both
        ax.plot(outside["n_params"], outside["mean_rmse"], ls=":", mfc="white", **look)


def plot_validity(table: pd.DataFrame, direction: Direction = "inverse", ax: Axes | None = None) -> Axes:
    """Draw the share of in-sample fits of a fitting table that are not monotone or leave [0, 1]: no responses."""
    rows = table[(table["direction"] == direction) & (table["split"] == "in-sample")]
    ax = new_axes(ax, 7.0, 1.2 + 0.2 * len(rows))
    place = np.arange(len(rows))
    ax.barh(place - 0.2, 100 * rows["nonmonotone"], 0.4, color=PALETTE[0], label="not monotone")
    ax.barh(place + 0.2, 100 * rows["out_of_range"], 0.4, color=PALETTE[4], hatch="////", label="leaves 0 to 1")
    ax.set_yticks(place, rows["model"], fontsize="small")
    ax.set(xlabel="share of fitted curves (%)", ylabel="model", xlim=(0, 100))
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.grid(axis="x", lw=0.3)
    ax.set_axisbelow(True)
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False, fontsize="small")
    return ax


def comparison_figure(responses: Responses, index: int | None = None) -> Axes:
    """Draw one response and the best fit of every model to it; by default the one that a gamma curve fits worst."""
    curves = responses.curves
    if index is None:
        gamma = Gamma("forward")
        index = int(np.argmax(((gamma.decode(gamma.fit(curves)) - curves) ** 2).sum(axis=1)))
    basis = load_emor_basis("forward") if registry.find("dorf/emor.txt") else None
    emor = EMoR(*basis, 3, "forward") if basis else EMoR.from_curves(curves, 3, "forward")
    models = [Gamma("forward"), Polynomial(3, "forward"), GGCM(3, "forward"), emor, PPISP("forward")]
    names = [f"{model.name}, {model.n_params} parameter{'s' * (model.n_params > 1)}" for model in models]
    fits = [model.decode(model.fit(curves[index]))[0] for model in models]
    ax = plots.plot_comparison(curves[index], dict(zip(names, fits, strict=True)), direction="forward")
    ax.set_title(responses.names[index])
    return ax


def patch_counts_figure(model: str, camera: str = CAMERA, method: str = "map", ax: Axes | None = None) -> Axes:
    """Draw the inverse responses of a camera from 3, 6, 12 and 24 patches over what was measured: the paper's figure.

    `model` is the name of an inverse model, `method` one of `crfbench.calibrate`.
    """
    curves = stability_curves(camera, model, method)
    seen = patch_intensity(load_patches()).query("camera == @camera")
    ax = new_axes(ax)
    ax.scatter(seen["jpeg"], seen["raw"], s=6, color="0.6", label="measured (JPEG, RAW)")
    for curve, size, colour, style in zip(curves, SIZES, PALETTE, STYLES, strict=False):
        ax.plot(GRID, curve, color=colour, ls=style, label=f"{size} patches")
    unit_square(ax, "inverse")
    ax.legend(loc="upper left", fontsize="small")
    ax.set_title(f"{camera}: {model}, {method}")
    return ax


def plot_camera_rmse(table: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Draw the RMSE of every camera, one marker a model; the table is from `crfbench.paper.camera_rmse_table`."""
    ax = new_axes(ax, 8.0, 5.0)
    ranked = table.sort_values(table.columns[0])
    for i, name in enumerate(table.columns):
        colour, marker = PALETTE[i % len(PALETTE)], MARKERS[i % len(MARKERS)]
        ax.plot(ranked[name], range(len(table)), ls="", marker=marker, color=colour, alpha=0.8, label=name)
    ax.set_yticks(range(len(table)), ranked.index)
    ax.set(xlabel="RMSE on the other illumination (share of full scale)", xlim=(0, None))
    ax.grid(axis="y", lw=0.3)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    return ax


def plot_coverage(tables: Mapping[str, pd.DataFrame], ax: Axes | None = None) -> Axes:
    """Draw how much of held-out RAW the 90 % bands hold, model by model.

    The tables are from `crfbench.paper.calibration_table` by the method "posterior", each under its label.
    """
    ax = new_axes(ax, 8.0, 5.0)
    ax.axvspan(0.85, 0.95, color="0.9", label="calibrated: 0.85 to 0.95")
    for (label, table), colour, marker in zip(tables.items(), PALETTE, MARKERS, strict=False):
        rows = table[table["coverage"].notna()]
        ax.plot(rows["coverage"], range(len(rows)), ls="", color=colour, marker=marker, label=label)
        ax.set_yticks(range(len(rows)), rows["model"])
    ax.set(xlabel="share of held-out RAW inside the 90 % band", xlim=(0, 1))
    ax.invert_yaxis()
    ax.grid(axis="y", lw=0.3)
    ax.legend(loc="lower left", fontsize="small")
    return ax


def plot_against_paper(ours: "pd.Series[float]", bounds: ArrayLike, printed: Mapping[str, float], label: str) -> Axes:
    """Draw our figures with their low and high bounds (2, n), and the paper's as crosses, one row a model."""
    ax = new_axes(None, 7.0, 1.0 + 0.28 * len(printed))
    place, centre = np.arange(len(printed)), ours.to_numpy()
    spans = np.abs(np.asarray(bounds) - centre)
    ax.errorbar(centre, place, xerr=spans, fmt="o", ms=5, color=PALETTE[0], capsize=3, label="ours")
    ax.plot(list(printed.values()), place, ls="", marker="x", ms=8, mew=2, color=PALETTE[1], label="the paper's")
    ax.set_yticks(place, list(printed))
    ax.set(xlabel=label, ylim=(len(printed) - 0.5, -0.5))
    ax.grid(axis="y", lw=0.3)
    ax.legend(fontsize="small")
    return ax


def calibration_figure(results: PaperResults) -> Axes:
    """Draw the means of Table 3 beside ours by the paper's method."""
    rows = results.calibration.loc[list(CALIBRATION)]
    printed = {name: figures[0] for name, figures in CALIBRATION.items()}
    label = "mean RMSE over 14 cameras (share of full scale; bars: 95 %)"
    ax = plot_against_paper(rows["mean"], rows[["low", "high"]].T, printed, label)
    ax.set_xlim(0, None)
    return ax


def stability_figure(results: PaperResults) -> Axes:
    """Draw the total variances of Table 2 beside ours by the paper's method."""
    found = results.stability.groupby("model")["total_variance"].agg(["mean", "min", "max"]).loc[list(STABILITY)]
    label = "total variance of four inverse responses (bars: three seeds)"
    ax = plot_against_paper(found["mean"], found[["min", "max"]].T, STABILITY, label)
    ax.set_xscale("log")
    return ax


def figure_of(ax: Axes) -> Figure:
    """Return the figure that axes lie in."""
    figure = ax.get_figure(root=True)
    assert figure is not None  # noqa: S101  an Axes just drawn always lies in a figure
    return figure


def _network(_: PaperResults) -> Axes:
    model = load_model("SLR-ldl-1")
    assert isinstance(model, SLR)  # noqa: S101  all pretrained models are
    return plots.plot_network(model, load_responses("opencrf").in_direction("inverse")[0])


def _data_sets(_: PaperResults) -> Axes:
    responses = load_responses("auto")
    left, right = plt.subplots(1, 2, figsize=(13, 5), layout="constrained", width_ratios=(1.3, 1))[1]
    plots.plot_curves(responses.curves, responses.families, direction="forward", ax=left)
    left.set_title(f"(a) {len(responses.curves)} responses of {responses.dataset}")
    plots.plot_patches(patch_intensity(load_patches()), ax=right).set_title("(b) patches of 14 cameras")
    return right


def _one_camera(_: PaperResults, method: str = "paper") -> Axes:
    grid = plt.subplots(2, 2, figsize=(10, 10), layout="constrained")[1].flat
    for ax, letter, name in zip(grid, "abcd", STABILITY, strict=True):
        patch_counts_figure(name, method=method, ax=ax).set_title(f"({letter}) {name}, method {method}")
    return ax


#: What the paper numbers, in its layout, by the name of the file; then Figure 4 by our method.
PAPER_FIGURES: dict[str, Callable[[PaperResults], Axes]] = {
    "figure_1": _network,
    "figure_2": _data_sets,
    "figure_3": lambda _: plots.plot_latent_epochs({name: load_history(name.lower()) for name in _HISTORIES})[0],
    "figure_4": _one_camera,
    "figure_4_ours": partial(_one_camera, method="map"),
    "table_1": lambda results: plot_fitting(results.fitting, "forward"),
    "table_2": stability_figure,
    "table_3": calibration_figure,
    "algorithm_1": lambda results: plots.plot_search(results.search),
}


def captions() -> dict[str, dict[str, str]]:
    """Return of each of `PAPER_FIGURES` its ``caption``, and what one sees in it, ``alt``."""
    return pd.read_csv(Path(__file__).with_name("figures.csv"), index_col="figure").to_dict("index")


def picture(ax: Axes, kind: str, metadata: Mapping[str, None]) -> bytes:
    """Return the figure that axes lie in as a file of that kind; `metadata` names what would differ at each run."""
    content = io.BytesIO()
    figure_of(ax).savefig(content, format=kind, dpi=200, metadata=dict(metadata))
    return content.getvalue()


def write_figures(folder: Path) -> Iterator[Path]:
    """Write what the paper numbers (`PAPER_FIGURES`) as PDF and PNG, replacing older ones, and yield each path."""
    mpl.use("agg")
    for name, draw in PAPER_FIGURES.items():
        yield from _written(folder / name, draw(load_results()))


def build_results(folder: Path) -> Iterator[Path]:
    """Write every table (JSON and CSV) and every figure (PNG and PDF), yielding each path as it is written.

    The folder is made if it is not there; files of the same names are replaced.
    """
    folder.mkdir(parents=True, exist_ok=True)  # before minutes of work
    mpl.use("agg")
    for name, made in _everything():
        yield from _written(folder / name, made)
    yield from write_figures(folder)


def _written(path: Path, made: pd.DataFrame | Axes) -> Iterator[Path]:
    if isinstance(made, pd.DataFrame):
        csv, rows = made.to_csv(index=False), json.dumps(to_rows(made), indent=1) + "\n"
        files = {"csv": csv.encode(), "json": rows.encode()}
    else:
        files = {"png": picture(made, "png", {}), "pdf": picture(made, "pdf", {"CreationDate": None})}
        plt.close("all")
    for kind, content in files.items():
        write_atomically(path.with_name(f"{path.name}.{kind}"), content)
        yield path.with_name(f"{path.name}.{kind}")


def _everything() -> Iterator[tuple[str, pd.DataFrame | Axes]]:
    """Compute every table, and the figures that the paper lacks, one at a time, by the name of its file."""
    fits = {title.split(",")[0]: table for title, table in fitting_tables().items()}
    for name, table in fits.items():
        yield f"fitting_{name}", table
        yield f"fitting_{name}", plot_fitting(table, "forward")
        yield f"validity_{name}", plot_validity(table, "forward")
    yield "latents", latent_table()
    yield "claims", claims_table()
    yield "paper_map", paper_map()
    yield "leaderboard", leaderboard()
    yield from _calibrations()
    responses, opencrf = load_responses("auto"), load_responses("opencrf")
    if responses.dataset != opencrf.dataset:
        yield "spread", plots.plot_spread({"DoRF": responses.curves, "OpenCRF": opencrf.curves})
    yield "curves_opencrf", plots.plot_curves(opencrf.curves, opencrf.families, direction="forward")
    yield "comparison", comparison_figure(responses)


def _calibrations() -> Iterator[tuple[str, pd.DataFrame | Axes]]:
    bands = {}
    for method in ("map", "posterior"):
        for patches in ("3", "24", "random"):
            bands[f"{patches} patches"] = table = calibration_table(patches, method)
            yield f"calibration_{patches}_{method}", table
    yield "calibration_paper_recorded", load_recorded("calibration_paper")[0]
    yield "stability", stability_table()
    yield "chart_free", chart_free_table()
    for patches in ("3", "24"):
        yield f"calibration_cameras_{patches}", plot_camera_rmse(camera_rmse_table(patches, rows=_CAMERA_MODELS))
    yield "calibration_coverage", plot_coverage({name: bands[name] for name in ("3 patches", "24 patches")})
