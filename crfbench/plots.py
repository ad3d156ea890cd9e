"""Figures: arrays and tables in, matplotlib Axes out. Nothing is fitted here.

The argument `ax` takes the Axes to draw on; by default those of a new figure.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike

from crfbench.curves import GRID, Direction, axis_labels
from crfbench.datasets.chart import chart_boxes, chart_colours
from crfbench.errors import InputError
from crfbench.models import ModelKey

if TYPE_CHECKING:
    from crfbench.calibration import Calibration
    from crfbench.history import History
    from crfbench.models import SLR

#: Okabe and Ito's colours, told apart by every kind of colour vision; the lines' styles and markers differ too.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_BESIDE = (PALETTE[6], PALETTE[2], PALETTE[3])  # far from the blue of the calibration and the red of its dots
_MOST_DOTS = 300  # that are told apart at full size: smaller ones leave the curve to be seen
_PICTURE_WIDTH = 900  # pixels; more make a figure heavy and show no more
STYLES = ("-", "--", "-.", ":", (0, (10, 2)), (0, (4, 1, 1, 1, 1, 1)), (0, (1, 3)))


def new_axes(ax: Axes | None, width: float = 6.0, height: float = 4.5) -> Axes:
    """Return the given Axes, or those of a new figure of that size in inches."""
    return ax if ax is not None else plt.subplots(figsize=(width, height), layout="constrained")[1]


def unit_square(ax: Axes, direction: Direction) -> None:
    """Name the axes after brightness and irradiance, from 0 to 1 each, and draw the diagonal."""
    x_label, y_label = axis_labels(direction)
    ax.set(xlabel=x_label, ylabel=y_label, xlim=(0, 1), ylim=(0, 1), aspect="equal")
    ax.plot([0, 1], [0, 1], color="0.6", lw=0.8, ls=":", zorder=0)


def plot_curves(
    curves: ArrayLike, kinds: Sequence[str] | None = None, *, direction: Direction, ax: Axes | None = None
) -> Axes:
    """Draw many curves (n, 1024) thinly, coloured by kind, and the median of each kind: the paper's data set.

    `kinds` gives the family of each curve, which the legend counts. `direction` names the axes, so it has no default.
    """
    ax, batch = new_axes(ax), np.atleast_2d(curves)
    labels = np.asarray(kinds if kinds is not None else [""] * len(batch))
    names, counts = np.unique(labels, return_counts=True)
    for i, (name, count) in enumerate(zip(names, counts, strict=True)):
        colour, family = PALETTE[i % len(PALETTE)], batch[labels == name]
        ax.plot(GRID, family.T, color=colour, lw=0.6, alpha=0.55 if len(names) == 1 else 0.3)
        median = np.median(family, axis=0) if len(names) > 1 else []
        ax.plot(GRID[: len(median)], median, color=colour, lw=2, ls=STYLES[i % len(STYLES)], label=f"{name} ({count})")
    if kinds is not None:
        title = "bold: the median" if len(names) > 1 else None
        ax.legend(loc="lower right", fontsize="small", title=title, title_fontsize="small", handlelength=3)
    unit_square(ax, direction)
    return ax


def plot_spread(sets: Mapping[str, ArrayLike], ax: Axes | None = None) -> Axes:
    """Draw the mean and the 5 to 95 % band of several sets of responses, each (n, 1024)."""
    ax = new_axes(ax)
    for (name, curves), colour, style in zip(sets.items(), PALETTE, STYLES, strict=False):
        low, high = np.percentile(np.asarray(curves), (5, 95), axis=0)
        ax.fill_between(GRID, low, high, color=colour, alpha=0.18, lw=0)
        ax.plot(GRID, np.mean(np.asarray(curves), axis=0), color=colour, ls=style, label=f"{name}: mean, 5 to 95 %")
    ax.legend(loc="lower right", fontsize="small")
    unit_square(ax, "forward")
    return ax


def plot_patches(patches: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Scatter JPEG against RAW intensity of colour chart patches, one colour and marker a camera.

    The table has the columns camera, jpeg and raw (intensities in [0, 1]).
    """
    ax = new_axes(ax, 7.0)
    for i, (camera, rows) in enumerate(patches.groupby("camera")):
        marker, colour = MARKERS[i % len(MARKERS)], PALETTE[i % (len(PALETTE) - 1)]
        filled = colour if i < len(MARKERS) else "none"
        ax.scatter(rows["raw"], rows["jpeg"], s=7, marker=marker, lw=0.6, ec=colour, fc=filled, label=str(camera))
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="x-small", markerscale=2.0)
    unit_square(ax, "forward")
    ax.set(xlabel="RAW intensity (share of full scale)", ylabel="JPEG intensity (share of full scale)")
    return ax


def plot_comparison(
    curve: ArrayLike, fits: Mapping[str, ArrayLike], *, direction: Direction, ax: Axes | None = None
) -> Axes:
    """Draw one curve in grey and fits of it, each (1024,), in colour."""
    ax = new_axes(ax)
    ax.plot(GRID, np.asarray(curve), color="0.7", lw=5, label="measured")
    for (name, fit), colour, style in zip(fits.items(), PALETTE, STYLES, strict=False):
        ax.plot(GRID, np.asarray(fit), color=colour, ls=style, lw=1.4, label=name)
    ax.legend(loc="lower right" if direction == "forward" else "upper left", fontsize="small")
    unit_square(ax, direction)
    ax.set_ylim(-0.02, 1.06)  # fits may leave the range of a response
    return ax


def plot_chart(pixels: ArrayLike, corners: ArrayLike, ax: Axes | None = None) -> Axes:
    """Draw a photograph, (h, w, 3) in [0, 1], with the outlines of the 24 patches; those in the corners are numbered.

    `corners`, shape (4, 2), are in chart order, see `crfbench.datasets.chart`.
    """
    picture, boxes = np.asarray(pixels), chart_boxes(np.asarray(corners))
    ax = new_axes(ax, 6.0, 6.0 * picture.shape[0] / picture.shape[1])
    step = -(-picture.shape[1] // _PICTURE_WIDTH)  # thinned to what a figure can show
    ax.imshow(picture[::step, ::step], extent=(0, 1, 1, 0), aspect=picture.shape[0] / picture.shape[1])
    ax.set_axis_off()
    for box in boxes:  # white within black, to be seen on a patch of any colour
        edge = [withStroke(linewidth=3, foreground="black")]
        ax.plot(*box[[0, 1, 2, 3, 0]].T, color="white", lw=1.2, path_effects=edge)
    for patch in (1, 6, 19, 24):
        label = {"facecolor": "black", "pad": 1.5, "lw": 0}
        x, y = boxes[patch - 1].mean(axis=0)
        ax.text(x, y, str(patch), color="white", ha="center", va="center", bbox=label)
    return ax


def plot_linearised(patches: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Draw how straight patches lie against their RAW values, as they are and linearised.

    The table has columns raw, jpeg and linear, in shares of full scale. Without a RAW file raw is NaN.
    """
    ax = new_axes(ax, 3.8, 3.5)
    looks = {"jpeg": ("JPEG", "0.6", "s"), "linear": ("linearised", PALETTE[0], "o")}
    for column, (label, colour, marker) in looks.items():
        ax.scatter(patches["raw"], patches[column], s=10, color=colour, marker=marker, label=label)
    unit_square(ax, "forward")
    ax.set(xlabel="RAW (share of full scale)", ylabel="share of full scale")
    ax.legend(fontsize="small")
    return ax


def plot_residuals(result: "Calibration", index: int = 0, ax: Axes | None = None) -> Axes:
    """Draw the residuals of one calibration against brightness, in per cent of irradiance."""
    ax = new_axes(ax, 6.0, 3.0)
    counts = result.observations.counts[index]
    ax.axhline(0.0, color="0.6", lw=0.8)
    brightness, residuals = result.observations.brightness[index][counts], result.residuals[index][counts]
    ax.plot(brightness, 100 * residuals, "o", ms=3, color=PALETTE[0])
    ax.set(xlabel="brightness (relative, 0 to 1)", ylabel="residual (% of irradiance)", xlim=(0, 1))
    return ax


def plot_vignetting(coefficients: ArrayLike, ax: Axes | None = None) -> Axes:
    """Draw the light that `Passport.vignetting` leaves from the middle of a photograph to its corners."""
    ax, r = new_axes(ax, 6.0, 3.0), np.linspace(0.0, 1.0, 101)
    powers = r[:, None] ** (2.0 * np.arange(1, len(np.asarray(coefficients)) + 1))
    ax.plot(r, 100 * np.exp(powers @ coefficients), color=PALETTE[0])
    ax.set(xlabel="distance from the middle (corners: 1)", ylabel="light left (%)", xlim=(0, 1), ylim=(0, None))
    return ax


def plot_calibration(
    result: "Calibration",
    index: int = 0,
    ax: Axes | None = None,
    beside: Mapping[str, ArrayLike] | None = None,
    patches: Sequence[int] | None = None,
) -> Axes:
    """Draw one inverse response of a calibration, its bands, and the patches where reference and exposure put them.

    `beside` holds other inverse responses (1024,) to compare with, such as the known truth, by their names. `patches`
    says which of a colour chart, from 1 to 24, the observed ones are; their dots are painted so.
    """
    brightness, irradiance = result.dots(index)
    ax = new_axes(ax)
    for level, shade in zip(sorted(result.bands, reverse=True), (0.15, 0.3), strict=False):
        low, high = result.bands[level]
        label = f"{100 * level:.0f} % of the posterior"
        ax.fill_between(GRID, low[index], high[index], color=PALETTE[0], alpha=shade, lw=0, label=label)
    ax.plot(GRID, result.curves[index], color=PALETTE[0], label=f"{ModelKey.of(result.model)}, {result.method}")
    size = 10 if len(brightness) <= _MOST_DOTS else 2
    dots: dict[str, Any] = {"s": size, "color": PALETTE[1], "label": "measured, aligned"}
    if patches is not None:
        counts = result.observations.counts[index]  # where all photographs count as one, the chart comes once for each
        seen = np.resize(patches, counts.shape[1])[np.nonzero(counts)[1]] - 1
        paints = np.clip(chart_colours(), 0.0, 1.0) ** (1 / 2.2)
        dots = {"s": 25, "c": paints[seen], "ec": "black", "lw": 0.6, "label": "patches in their colours, aligned"}
    ax.scatter(brightness, irradiance, zorder=3, **dots)
    for (name, curve), colour, style in zip((beside or {}).items(), _BESIDE, STYLES[1:], strict=False):
        ax.plot(GRID, np.asarray(curve), color=colour, ls=style, label=name, zorder=4)
    unit_square(ax, "inverse")
    ax.legend(loc="upper left", fontsize="small")
    return ax


def plot_posterior(result: "Calibration", index: int = 0, ax: Axes | None = None) -> Axes:
    """Draw what is known of a model's one parameter: prior, likelihood (scaled to the same area) and posterior.

    The calibration is by the method "posterior" with ``discrepancy=False``, whose samples lie in even steps.
    """
    samples, prior = result.samples, result.model.prior_
    if (
        samples is None
        or prior is None
        or result.model.n_params > 1
        or np.ptp(np.diff(samples.unconstrained[0, :, 0])) > 1e-6
    ):
        raise InputError(
            f"{result!r} has no posterior in even steps; use one parameter, 'posterior', discrepancy=False"
        )
    ax, z, posterior = new_axes(ax, 6.0, 3.6), samples.unconstrained[0, :, 0], samples.weights[index]
    before = np.exp(-0.5 * (z - prior.mean[0]) ** 2 / prior.covariance[0, 0])
    rows = {"prior": before, "likelihood (scaled)": posterior / before, "posterior": posterior}
    for (name, row), colour, style in zip(
        rows.items(), (PALETTE[1], PALETTE[2], PALETTE[0]), ("--", ":", "-"), strict=True
    ):
        ax.plot(z, row / row.sum() / (z[1] - z[0]), color=colour, ls=style, lw=2, label=name)
    ax.fill_between(z, posterior / posterior.sum() / (z[1] - z[0]), color=PALETTE[0], alpha=0.2, lw=0)
    ax.set(xlabel=f"{result.model.param_names[0]} (no unit)", ylabel="density (per unit)", ylim=(0, None))
    ax.legend(fontsize="small")
    return ax


_REACH = 5.0  # latents shown to either side of 0; those beyond count in the outermost bins
_BINS = np.linspace(-_REACH, _REACH, 41)
_NORMAL = np.exp(-(_BINS**2) / 2) / np.sqrt(2 * np.pi)
_MOST = 0.8  # density at the end of the colour scale: twice the peak of N(0, 1)


def plot_latent_epochs(histories: "Mapping[str, History]", axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw the density of the training curves' latents, epoch by epoch, beside their objective: the paper's figure.

    Epochs are spaced by their logarithm, for most happens early; all pictures share one scale of colours. Histories
    come by the titles to give them; of several latents the first is drawn. `axes` are one more than histories, for the
    objective N(0, 1) comes first.
    """
    panels = list(axes) if axes is not None else _latent_panels(len(histories) + 1)
    last = max(int(history.epochs[-1]) for history in histories.values())
    objective = (_NORMAL[:-1] + _NORMAL[1:]) / 2
    pictures = [("objective N(0, 1)", np.array([0, last]), np.tile(objective, (2, 1)))]
    pictures += [(title, h.epochs, _densities(h.latents[:, :, 0])) for title, h in histories.items()]
    for ax, letter, (title, epochs, densities) in zip(panels, "abcdefghijklmnopqrstuvwxyz", pictures, strict=False):
        edges = np.append(epochs + 1.0, epochs[-1] + 2.0)  # each column lasts until the next epoch that was kept
        mesh = ax.pcolormesh(edges, _BINS, densities.T, vmin=0, vmax=_MOST, cmap="viridis", rasterized=True)
        ax.set(title=f"({letter}) {title}", xscale="log", xlim=(1, last + 1), yticks=range(-4, 5, 2))
        ax.xaxis.set_major_formatter("{x:.0f}")
    for ax in panels[-3:]:
        ax.set_xlabel("epochs trained (log scale)")
    for ax in panels[::3]:
        ax.set_ylabel("latent z (no unit)")
    colours = ax.figure.colorbar(mesh, ax=panels, extend="max", pad=0.015, aspect=40)
    colours.set_label(f"density of the latent (beyond ±{_REACH:.0f}: in the outermost bins)")
    return panels


def _latent_panels(count: int) -> list[Axes]:
    rows = -(-count // 3)
    figure, grid = plt.subplots(
        rows, 3, figsize=(10.5, 2.9 * rows), sharex=True, sharey=True, squeeze=False, layout="constrained"
    )
    for ax in grid.flat[count:]:
        figure.delaxes(ax)
    return list(grid.flat[:count])


def _densities(latents: np.ndarray) -> np.ndarray:
    """Return histograms (e, 40) of latents (e, n) as densities."""
    counts = [np.histogram(np.clip(row, -_REACH, _REACH), _BINS)[0] for row in latents]
    return np.array(counts) / (latents.shape[1] * (_BINS[1] - _BINS[0]))


def plot_network(model: "SLR", curve: ArrayLike, ax: Axes | None = None) -> Axes:
    """Draw an SLR as the paper's figure 1: a curve (1024,), the layers with their neurons, and the decoded curve.

    Below the waist are the latents of the training curves beside their objective N(0, 1).
    """
    ax, encoder = new_axes(ax, 10.0, 4.6), [len(GRID), *model.hidden]
    sizes, waist = [*encoder, model.n_params, *encoder[::-1]], len(encoder)
    heights = 0.06 + np.log(sizes) / np.log(len(GRID))
    ax.fill_between(range(len(sizes)), heights, -heights, color="0.5", alpha=0.15, lw=0)
    ax.plot([waist, waist], [-0.5, -1.6], color="0.6", lw=0.8, ls=":")
    for i, (size, height) in enumerate(zip(sizes, heights, strict=True)):
        dots, colour = min(size, 2 + int(20 * height)), PALETTE[1] if i < waist else PALETTE[0]
        ax.plot(np.full(dots, i), np.linspace(-height, height, dots) if dots > 1 else [0], "o", ms=5, color=colour)
        ax.text(i, -height - 0.22, str(size), ha="center")
        ax.text(i, 1.2, {waist - 1: "encoder", waist: "z", waist + 1: "decoder"}.get(i, ""), ha="center")
    ends = ((-2.2, curve, "in"), (len(sizes) - 0.4, model.decode(model.encode(curve))[0], "out"))
    for (x, samples, title), colour in zip(ends, (PALETTE[1], PALETTE[0]), strict=True):
        inset = ax.inset_axes((x, -0.6, 1.6, 1.2), transform=ax.transData, xticks=(), yticks=(), title=title)
        inset.plot(GRID, np.asarray(samples), color=colour)
    plot_latent_histogram(model.weights_["latents"], ax.inset_axes((waist - 1.5, -3.0, 3, 1.3), transform=ax.transData))
    ax.set(xlim=(-2.3, len(sizes) + 1.3), ylim=(-3.4, 1.4))
    ax.set_axis_off()
    return ax


def plot_latent_histogram(latents: ArrayLike, ax: Axes | None = None) -> Axes:
    """Draw the histogram of latents, shape (n,) or (n, 1), as a density over the outline of N(0, 1)."""
    ax = new_axes(ax, 5.0, 3.0)
    values = np.ravel(np.asarray(latents))
    ax.stairs(_densities(values[None])[0], _BINS, fill=True, color=PALETTE[0], alpha=0.6, label=f"{len(values)} curves")
    ax.plot(_BINS, _NORMAL, color=PALETTE[1], ls="--", label="N(0, 1)")
    ax.set(xlabel=f"latent z (no unit; beyond ±{_REACH:.0f}: outermost bins)", ylabel="density (per unit of z)")
    ax.legend(fontsize="small")
    return ax


def plot_search(table: pd.DataFrame, m: int = 10, spread: ArrayLike | None = None, ax: Axes | None = None) -> Axes:
    """Draw accuracy against complexity of an architecture search: the M best, the choice and the Pareto front.

    The table is that of `crfbench.search_architectures`, or a recorded one. `spread`, shape (n,), is half the height of
    the bars of the M best, in units of MSE; by default the standard deviation over the folds.
    """
    from crfbench.search.result import architecture, mark_choice, pareto_front

    ax, table = new_axes(ax, 7.0), mark_choice(table, m)
    bars = table["mse_sd"] if spread is None else np.asarray(spread)
    best = (table["rank"] <= m).to_numpy()
    front, choice = pareto_front(table), table[table["chosen"]].iloc[0]
    ax.scatter(table["complexity"], table["mse"], s=12, color="0.6", label=f"{len(table)} candidates")
    ax.step(front["complexity"], front["mse"], where="post", color=PALETTE[2], ls="--", label="Pareto front")
    x, y = table["complexity"][best], table["mse"][best]
    ax.errorbar(x, y, yerr=bars[best], fmt="D", ms=5, lw=1, color=PALETTE[0], label=f"the {m} most accurate")
    label = f"choice: {architecture(choice)}"
    ax.scatter(choice["complexity"], choice["mse"], s=90, marker="s", color=PALETTE[1], zorder=3, label=label)
    ax.set(xlabel="complexity (weights and biases of the encoder)", ylabel="held-out MSE", xscale="log", yscale="log")
    ax.legend(fontsize="small")
    ax.grid(which="both", lw=0.3)
    return ax
