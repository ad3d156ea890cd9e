import io
import re

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest

mpl.use("agg")

from crfbench import plots
from crfbench.calibration import Observations, calibrate
from crfbench.curves import GRID
from crfbench.datasets import load_opencrf, load_patches
from crfbench.datasets.middlebury import patch_intensity
from crfbench.models import load_model
from crfbench.models.registry import ModelKey
from crfbench.paper import FITTING, comparison_figure, load_recorded, plot_fitting, plot_validity


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plots.plt.close("all")


@pytest.fixture(scope="module")
def fitting():
    return load_recorded("fitting_dorf")[0]


def drawn(ax):
    return np.array([line.get_ydata() for line in ax.get_lines() if len(line.get_ydata()) == len(GRID)])


def test_curves_are_drawn_as_they_are_and_counted_by_kind():
    responses = load_opencrf()
    ax = plots.plot_curves(responses.curves, responses.families, direction="forward")
    thin = np.array([line.get_ydata() for line in ax.get_lines() if line.get_linewidth() < 0.7])
    assert sorted(map(tuple, thin.round(9))) == sorted(map(tuple, responses.curves.round(9)))
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert "film-negative (94)" in legend
    assert ax.get_xlabel().startswith("irradiance")
    assert plots.plot_curves(responses.curves[:1], direction="inverse").get_xlabel().startswith("brightness")


def test_families_are_told_apart_without_colours():
    responses = load_opencrf()
    ax = plots.plot_curves(responses.curves, responses.families, direction="forward")
    medians = [line for line in ax.get_lines() if line.get_linewidth() == 2]
    negatives = responses.curves[np.asarray(responses.families) == "film-negative"]
    by_label = {line.get_label().split()[0]: line.get_ydata() for line in medians}
    np.testing.assert_allclose(by_label["film-negative"], np.median(negatives, axis=0))
    drawing = io.StringIO()
    ax.figure.savefig(drawing, format="svg")
    dashes = set(re.findall(r"stroke-dasharray: ([\d., ]+); [^\"]*stroke-width: 2\b", drawing.getvalue()))
    assert len(dashes) + 1 == len(medians) == len(set(responses.families))  # one is solid


def test_spread_draws_the_mean():
    curves = load_opencrf().curves
    assert np.allclose(drawn(plots.plot_spread({"all": curves}))[0], curves.mean(axis=0))


def test_patches_draw_every_patch_of_every_camera():
    patches = patch_intensity(load_patches())
    ax = plots.plot_patches(patches)
    offsets = np.concatenate([np.asarray(c.get_offsets()) for c in ax.collections])
    assert len(offsets) == len(patches)
    assert np.allclose(np.sort(offsets[:, 1]), np.sort(patches["jpeg"]))
    looks = {
        (tuple(c.get_edgecolor()[0]), len(c.get_facecolor()), c.get_paths()[0].vertices.tobytes())
        for c in ax.collections
    }
    assert len(looks) == 14  # no two cameras look alike


def test_fitting_shows_our_figures_and_the_papers(fitting):
    ax = plot_fitting(fitting, "forward")
    by_label = {line.get_label(): line for line in ax.get_lines()}
    rows = fitting.query("model.str.startswith('GGCM') and direction == 'forward' and split == 'in-sample'")
    assert np.allclose(by_label["GGCM"].get_ydata(), rows["mean_rmse"])
    crosses = np.concatenate([np.asarray(c.get_offsets()).reshape(-1, 2) for c in ax.collections])
    shown = {(int(k), round(v, 9)) for k, v in crosses if np.isfinite(v)}
    assert shown == {(ModelKey.parse(name).n_params, float(figure)) for name, figure in FITTING.items()}
    named = [name for text in ax.texts for name in text.get_text().split("\n")]
    assert sorted(set(named)) == ["GGCM", "Gamma", "Polynomial", "SLR"]  # EMoR's crosses lie on its line
    assert len(named) == sum(not name.startswith("EMoR") for name in FITTING)
    inverse = plot_fitting(fitting)  # of which the paper says nothing
    assert sum(len(np.asarray(c.get_offsets())) for c in inverse.collections) == 0


def test_validity_bars_are_shares_in_percent(fitting):
    ax = plot_validity(fitting, "forward")
    rows = fitting.query("direction == 'forward' and split == 'in-sample'")
    lengths = [bar.get_width() for bar in ax.containers[0]]
    assert np.allclose(lengths, 100 * rows["nonmonotone"])


def test_comparison_takes_the_curve_that_gamma_fits_worst_and_names_every_model():
    responses = load_opencrf().select(range(0, 151, 6))
    ax = comparison_figure(responses)
    assert ax.get_title() in responses.names
    assert len(drawn(ax)) == 6
    assert comparison_figure(responses, 3).get_title() == responses.names[3]


def test_chart_outlines_the_patches_where_the_corners_say_and_numbers_four():
    corners = np.array([(0.9, 0.1), (0.9, 0.8), (0.1, 0.8), (0.1, 0.1)])  # patch 1 at the upper right
    ax = plots.plot_chart(np.zeros((40, 2000, 3)), corners)
    outlines = np.array([line.get_xydata() for line in ax.get_lines()])
    assert outlines.shape == (24, 5, 2)
    np.testing.assert_allclose(
        [outlines[i, j] for i, j in zip((0, 5, 23, 18), range(4), strict=True)], corners, atol=1e-6
    )
    numbers = {text.get_text(): text.get_position() for text in ax.texts}
    assert numbers["1"][0] > numbers["19"][0]
    assert numbers["1"][1] < numbers["6"][1]
    assert set(numbers) == {"1", "6", "19", "24"}
    assert max(ax.get_images()[0].get_array().shape) <= 900, "large photographs are thinned"


def test_linearised_shows_the_patches_before_and_after():
    patches = pd.DataFrame({"raw": [0.1, 0.2], "jpeg": [0.5, 0.8], "linear": [0.1, 0.2]})
    before, after = (np.asarray(dots.get_offsets()) for dots in plots.plot_linearised(patches).collections)
    np.testing.assert_allclose(before, patches[["raw", "jpeg"]])
    np.testing.assert_allclose(after, patches[["raw", "linear"]])


def test_network_names_its_neurons_and_decodes_the_curve_through_the_waist():
    model = load_model("SLR-monotone-1")
    curve = load_opencrf().in_direction("inverse")[3]
    ax = plots.plot_network(model, curve)
    texts = [text.get_text() for text in ax.texts]
    assert texts[::2] == ["1024", "50", "20", "1", "20", "50", "1024"]
    assert texts[1::2] == ["", "", "encoder", "z", "decoder", "", ""]
    before, after, latents = ax.child_axes
    np.testing.assert_allclose(before.get_lines()[0].get_ydata(), curve)
    np.testing.assert_allclose(after.get_lines()[0].get_ydata(), model.decode(model.encode(curve))[0])
    assert "201 curves" in [text.get_text() for text in latents.get_legend().get_texts()]


def test_calibration_draws_what_is_put_beside_it_and_residuals_leave_clipped_patches_out():
    clipped = np.zeros((2, 3), bool)
    clipped[1, 2] = True
    brightness, reference = np.array([[0.2, 0.4, 0.6], [0.4, 0.6, 1.0]]), np.array([0.05, 0.15, 0.4])
    result = calibrate(load_model("Gamma-1"), Observations(brightness, reference, clipped=clipped), "map")
    ax = plots.plot_calibration(result, beside={"truth": GRID**2})
    assert np.allclose(drawn(ax)[-1], GRID**2)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["Gamma-1, map", "measured, aligned", "truth"]
    shown = plots.plot_residuals(result).get_lines()[-1]
    np.testing.assert_allclose(shown.get_xdata(), brightness[~clipped])
    np.testing.assert_allclose(shown.get_ydata(), 100 * result.residuals[0][~clipped])
