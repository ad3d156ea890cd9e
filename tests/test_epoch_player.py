"""The Python side of EpochPlayer; tests/test_browser drives it on a page."""

import ipywidgets
import numpy as np
import pytest

from crfbench.errors import InputError
from crfbench.history import History, latent_statistics, load_history
from crfbench.widgets import EpochPlayer

NAMES = ("LDL", "AUC", "AAE", "VAE", "baseline")
RNG = np.random.default_rng(0)


def made_up(epochs: int = 4, n: int = 12, k: int = 1) -> History:
    probes = np.tile(np.linspace(0, 1, 65), (epochs, 9, 1))
    return History("vae", np.arange(epochs), {"mse": np.ones(epochs)}, RNG.normal(size=(epochs, n, k)), probes)


def unpacked(column: dict, key: str, kind: str) -> np.ndarray:
    return np.frombuffer(column[key], kind).reshape(len(column["epochs"]), -1)


def size(player: EpochPlayer) -> int:
    return sum(len(v) for column in player._columns for v in column.values() if isinstance(v, bytes))


def test_columns_hold_the_history() -> None:
    history = load_history("auc")
    (column,) = EpochPlayer({"AUC": history})._columns
    assert column["name"] == "AUC"
    assert column["epochs"] == (history.epochs + 1).tolist()
    assert (column["xLabel"], column["yLabel"]) == ("brightness", "irradiance")
    # The bundled latents are in half precision already, so the page gets them exactly.
    np.testing.assert_array_equal(unpacked(column, "latents", "<f2"), history.latents[:, :, 0])
    probes = unpacked(column, "probes", "u1").reshape(-1, 9, 33) / 255
    np.testing.assert_allclose(probes, history.probes[:, :, ::2], atol=0.5001 / 255)
    expected = list(latent_statistics(history.latents[20].astype(float)).values())
    np.testing.assert_allclose(unpacked(column, "figures", "<f4")[20], expected, rtol=1e-6)


def test_a_page_of_five_histories_is_light() -> None:
    player = EpochPlayer({name: load_history(name.lower()) for name in NAMES})
    assert size(player) < 550_000
    assert len(player._repr_mimebundle_()[0]["text/html"]) < 800_000


def test_long_histories_are_thinned_and_keep_their_ends() -> None:
    epochs = EpochPlayer({"long": made_up(1000)})._columns[0]["epochs"]
    assert len(epochs) <= 151
    assert (epochs[0], epochs[-1]) == (1, 1000)


def test_add_appends_a_column_and_replaces_one_of_the_same_name() -> None:
    player = EpochPlayer({"a": made_up(), "b": made_up()})
    player.add(made_up())
    assert repr(player) == "EpochPlayer(a, b, vae)"
    player.add(made_up(7), "a", "forward")
    assert list(player.histories) == ["b", "vae", "a"] == [column["name"] for column in player._columns]
    assert len(player.histories["a"]) == 7
    assert player._columns[-1]["xLabel"] == "irradiance"


def test_latents_all_at_one_place_have_infinite_kl() -> None:
    history = made_up()
    history.latents[1] = 0.5
    assert np.isinf(unpacked(EpochPlayer({"a": history})._columns[0], "figures", "<f4")[1, 2])


def test_epoch_starts_at_the_last_and_is_heard_and_linked() -> None:
    player = EpochPlayer({"a": made_up(4), "b": made_up(9)})
    assert player.epoch == 1
    heard = []
    player.observe(lambda change: heard.append(change["new"]), "epoch")
    player.set_state({"epoch": 3, "_page_moves": [player._python_moves, 1]})
    slider = ipywidgets.IntSlider(min=1, max=9)
    ipywidgets.link((slider, "value"), (player, "epoch"))
    slider.value = 7
    assert heard[0] == 3
    assert heard[-1] == player.epoch == 7
    for wrong in (0, 2.5, "3"):
        with pytest.raises(InputError, match=f"epoch={wrong!r}.* use a whole number from 1"):
            player.epoch = wrong


def test_a_saved_notebook_can_still_play() -> None:
    data = EpochPlayer({"a": made_up()})._repr_mimebundle_()[0]
    assert data["text/plain"] == "EpochPlayer(a)"
    assert data["text/html"].startswith("<iframe")


def with_nan() -> History:
    history = made_up()
    history.latents[2, 3] = np.nan
    return history


@pytest.mark.parametrize(
    ("history", "message"),
    [
        (made_up(k=3), "new has 3 latents; use a history of one latent"),
        (with_nan(), "not finite"),
        (History("ldl", np.arange(2), {}, np.zeros((2, 5, 1)), np.zeros((2, 9, 3))), "shape \\(9, 3\\)"),
    ],
)
def test_what_cannot_be_played_is_refused_and_changes_nothing(history: History, message: str) -> None:
    player = EpochPlayer({"a": made_up()})
    with pytest.raises(InputError, match=message):
        player.add(history, "new")
    assert list(player.histories) == ["a"]
    assert len(player._columns) == 1


def test_unknown_direction_and_no_history_are_refused() -> None:
    with pytest.raises(InputError, match="direction='up'"):
        EpochPlayer({"a": made_up()}, "up")
    with pytest.raises(InputError, match="use one or more"):
        EpochPlayer({})
