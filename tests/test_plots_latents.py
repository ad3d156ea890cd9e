import matplotlib as mpl
import numpy as np
import pytest

mpl.use("agg")

from crfbench import plots
from crfbench.history import History, load_history

RNG = np.random.default_rng(0)


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plots.plt.close("all")


def made_up(epochs=(0, 1, 4, 9), n=30, k=1):
    latents = RNG.normal(size=(len(epochs), n, k))
    return History("ldl", np.array(epochs), {"mse": np.ones(len(epochs))}, latents, np.zeros((len(epochs), 9, 65)))


def test_epochs_by_latents_with_the_objective_first():
    histories = {"one": made_up(), "two": made_up((0, 5, 19))}
    axes = plots.plot_latent_epochs(histories)
    assert [ax.get_title() for ax in axes] == ["(a) objective N(0, 1)", "(b) one", "(c) two"]
    assert {ax.get_xlim() for ax in axes} == {(1.0, 20.0)}
    assert {ax.get_xscale() for ax in axes} == {"log"}
    assert {ax.collections[0].get_clim() for ax in axes} == {(0.0, 0.8)}


def test_each_column_is_a_density_and_latents_far_out_are_counted_at_the_edge():
    history = made_up()
    history.latents[2, :3] = 12.0
    axes = plots.plot_latent_epochs({"one": history})
    densities = axes[1].collections[0].get_array().reshape(40, 4)
    assert np.allclose(densities.sum(axis=0) * 0.25, 1.0)
    assert densities[-1, 2] * 0.25 * 30 == pytest.approx(3)
    expected = np.histogram(history.latents[0], bins=40, range=(-5, 5), density=True)[0]
    assert np.allclose(densities[:, 0], expected)
    objective = axes[0].collections[0].get_array().reshape(40, -1)
    assert np.allclose(objective.sum(axis=0) * 0.25, 1.0, atol=1e-3)


def test_columns_last_until_the_next_epoch_kept():
    mesh = plots.plot_latent_epochs({"one": made_up()})[1].collections[0]
    assert mesh.get_coordinates()[0, :, 0].tolist() == [1, 2, 5, 10, 11]


def test_the_papers_figure_from_the_bundled_histories_has_names_on_its_axes():
    names = ("LDL", "AUC", "AAE", "VAE", "baseline")
    axes = plots.plot_latent_epochs({name: load_history(name.lower()) for name in names})
    assert [ax.get_title()[:3] for ax in axes] == ["(a)", "(b)", "(c)", "(d)", "(e)", "(f)"]
    assert [ax.get_xlabel() for ax in axes] == [""] * 3 + ["epochs trained (log scale)"] * 3
    assert [ax.get_ylabel() for ax in axes[::3]] == ["latent z (no unit)"] * 2
    assert "density" in axes[0].figure.axes[-1].get_ylabel()


def test_axes_can_be_given():
    given = plots.plt.subplots(1, 2)[1]
    assert plots.plot_latent_epochs({"one": made_up()}, given) == list(given)


def test_histogram_holds_all_latents_and_the_objective():
    latents = np.append(RNG.normal(size=99), 40.0)[:, None]
    ax = plots.plot_latent_histogram(latents)
    values, edges, _ = ax.patches[0].get_data()
    assert (values * np.diff(edges)).sum() == pytest.approx(1)
    assert values[-1] * 0.25 * 100 == pytest.approx(1)
    outline = ax.get_lines()[0]
    assert max(outline.get_ydata()) == pytest.approx(1 / np.sqrt(2 * np.pi))
    assert ax.get_xlabel().startswith("latent z")
    assert "100 curves" in [text.get_text() for text in ax.get_legend().get_texts()]
