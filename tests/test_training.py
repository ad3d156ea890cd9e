"""Training: recover known truth, keep every promise of the loop, and agree with NumPy."""

import json
import signal
import threading

import numpy as np
import pytest
import torch

from crfbench.constraints import CONSTRAINTS
from crfbench.constraints.auc import area
from crfbench.constraints.base import kl_to_standard_normal
from crfbench.curves import GRID
from crfbench.datasets import load_opencrf
from crfbench.errors import FormatError, InputError, MissingDataError
from crfbench.history import PROBES, History, load_history
from crfbench.metrics import mse, nonmonotone
from crfbench.models import EMoR, ModelKey, load_model
from crfbench.training import CONFIGS, Trainer, TrainingConfig, roughness, to_torch, train
from tests.support.curves import off_endpoints

GAMMAS = GRID ** np.exp(np.linspace(-1, 1, 40))[:, None]
QUICK = TrainingConfig(hidden=(12, 6), epochs=40)


def quick(**changes):
    return TrainingConfig(**{"hidden": (12, 6), "epochs": 40, **changes})


@pytest.mark.parametrize("monotone", [pytest.param(False, marks=pytest.mark.slow), True])
def test_one_latent_learns_a_family_of_one_parameter(monotone):
    model, history = train(GAMMAS, "forward", TrainingConfig(hidden=(30, 20), epochs=300, monotone=monotone))
    linear = EMoR.from_curves(GAMMAS, 1, "forward")
    assert (
        mse(model.decode(model.fit(GAMMAS)), GAMMAS).mean()
        < 0.1 * mse(linear.decode(linear.fit(GAMMAS)), GAMMAS).mean()
    )
    assert history.losses["mse"][-1] < 0.02 * history.losses["mse"][0]
    # The latent orders the curves as gamma does.
    latents = model.encode(GAMMAS)[:, 0]
    assert abs(np.corrcoef(np.argsort(np.argsort(latents)), np.arange(40))[0, 1]) > 0.99


@pytest.mark.parametrize("constraint", CONSTRAINTS)
@pytest.mark.parametrize("n_latent", [1, pytest.param(3, marks=pytest.mark.slow)])
class TestEveryConstraint:
    def test_trains_and_repeats_itself(self, constraint, n_latent):
        if constraint == "auc" and n_latent == 3:
            with pytest.raises(InputError, match="n_latent=3 is out of range for 'auc'"):
                train(GAMMAS, "forward", quick(constraint=constraint, n_latent=3))
            return
        config = quick(constraint=constraint, n_latent=n_latent, dropout=0.05)
        model, history = train(GAMMAS, "inverse", config)
        again, _ = train(GAMMAS, "inverse", config)
        assert all(np.array_equal(model.weights_[name], again.weights_[name]) for name in model.weights_)
        assert history.latents.shape == (40, 40, n_latent)
        assert history.losses["mse"][-1] < history.losses["mse"][0]
        assert {"total", "mse", "constraint", "smoothness", "learning rate"} <= set(history.losses)
        assert ("discriminator" in history.losses) == (constraint == "aae")
        assert model.metadata_["constraint"] == constraint
        assert model.direction == "inverse"
        other, _ = train(GAMMAS, "inverse", quick(constraint=constraint, n_latent=n_latent, seed=1))
        assert not np.array_equal(model.weights_["latents"], other.weights_["latents"])


@pytest.mark.parametrize("monotone", [False, True])
@pytest.mark.parametrize(("hidden", "n_latent"), [((12,), 1), ((12, 6), 3), ((12, 6, 4), 1)])
def test_numpy_inference_equals_pytorch(monotone, hidden, n_latent):
    model, _ = train(GAMMAS, "forward", quick(hidden=hidden, n_latent=n_latent, monotone=monotone, epochs=20))
    network, z = to_torch(model), np.random.default_rng(0).normal(size=(50, n_latent)).astype(np.float32)
    tensor = torch.tensor(z, requires_grad=True)
    decoded = network.decode(tensor)
    assert np.abs(decoded.detach().numpy() - model.decode(z)).max() < 1e-6
    codes = network.encode(torch.as_tensor(GAMMAS, dtype=torch.float32)).detach().numpy()
    assert np.abs(codes - model.encode(GAMMAS)).max() < 1e-5 * max(1.0, np.abs(codes).max())
    slope = torch.autograd.grad(decoded[:, 300].sum(), tensor)[0].numpy()
    assert np.abs(slope - model.jacobian(z)[:, 300]).max() < 1e-5


def test_bundled_inference_equals_pytorch():
    curves = load_opencrf().in_direction("inverse")
    for name in ("SLR-ldl-1", "SLR-monotone-1"):
        model = load_model(name)
        latents = model.encode(curves)
        decoded = to_torch(model).decode(torch.as_tensor(latents, dtype=torch.float32)).detach().numpy()
        assert np.abs(decoded - model.decode(latents.astype(np.float32))).max() < 1e-6


def test_monotone_stays_valid_far_from_the_data():
    model, _ = train(GAMMAS, "forward", quick(monotone=True))
    curves = model.decode(np.random.default_rng(1).normal(0, 10, size=(500, 1)))
    assert not nonmonotone(curves).any()
    assert not off_endpoints(curves).any()


def test_ldl_brings_the_latents_to_a_standard_normal_and_baseline_does_not():
    ldl, _ = train(GAMMAS, "forward", quick(epochs=300, constraint="ldl"))
    free, _ = train(GAMMAS, "forward", quick(epochs=300, constraint="baseline"))
    assert abs(ldl.weights_["latents"].mean()) < 0.05
    assert abs(ldl.weights_["latents"].std() - 1) < 0.05
    assert abs(free.weights_["latents"].std() - 1) > 0.1


def test_auc_latents_are_the_scaled_areas():
    model, _ = train(GAMMAS, "forward", quick(epochs=400, constraint="auc"))
    areas = (GAMMAS - np.arange(1, 1025) / 1024).sum(axis=1)
    assert np.allclose(area(torch.as_tensor(GAMMAS)).numpy(), areas)
    assert np.corrcoef(model.weights_["latents"][:, 0], areas)[0, 1] > 0.99


def test_kl_against_a_numerical_integral():
    z = torch.linspace(-12, 12, 200_001, dtype=torch.float64)
    p, q = torch.distributions.Normal(0.7, 0.4), torch.distributions.Normal(0.0, 1.0)
    integral = torch.trapezoid(p.log_prob(z).exp() * (p.log_prob(z) - q.log_prob(z)), z)
    closed = kl_to_standard_normal(torch.tensor([0.7]), torch.tensor([0.16]))
    assert float(closed) == pytest.approx(float(integral), abs=1e-6)


def test_roughness_of_a_straight_line_is_its_slope():
    assert float(roughness(torch.tensor(GRID)[None])) == pytest.approx(1.0)
    assert float(roughness(torch.as_tensor(GRID / 2)[None])) == pytest.approx(0.5)


def test_smoothness_makes_decoded_curves_smoother():
    rough, _ = train(GAMMAS, "forward", quick(smoothness=0.0))
    smooth, _ = train(GAMMAS, "forward", quick(smoothness=1e-2))
    z = np.linspace(-1, 1, 9)[:, None]
    assert roughness(torch.as_tensor(smooth.decode(z))) < roughness(torch.as_tensor(rough.decode(z)))


def test_mini_batches_use_every_curve_once():
    trainer = Trainer(GAMMAS, "forward", quick(batch_size=7))
    batches = trainer._batches(shuffle=True)
    assert sorted(torch.cat(batches).tolist()) == list(range(40))
    assert min(len(batch) for batch in batches) >= 7
    _, history = train(GAMMAS, "forward", quick(batch_size=7, epochs=10))
    assert history.losses["mse"][-1] < history.losses["mse"][0]


@pytest.mark.parametrize("epochs", [1, 2, 9, 10, 11])
def test_short_trainings_run_to_their_end(epochs):
    assert len(train(GAMMAS, "forward", quick(epochs=epochs))[1]) == epochs


def test_a_stop_keeps_the_best_so_far():
    seen = []

    def stop_at_20(epoch, trainer):
        seen.append(trainer.losses[-1]["total"])
        return epoch == 19

    model, history = train(GAMMAS, "forward", quick(), on_epoch=stop_at_20)
    assert len(history) == 20
    assert model.metadata_["trained_epochs"] == 20
    best = int(np.argmin(seen))
    assert np.allclose(model.weights_["latents"], history.latents[best], atol=1e-6)


@pytest.mark.skipif(threading.current_thread() is not threading.main_thread(), reason="signals reach the main thread")
def test_ctrl_c_keeps_the_best_so_far():
    def interrupt(epoch, trainer):
        if epoch == 9:
            signal.raise_signal(signal.SIGINT)

    _, history = train(GAMMAS, "forward", quick(), on_epoch=interrupt)
    assert 9 <= len(history) <= 11


def test_training_leaves_the_callers_random_numbers_and_threads_alone():
    torch.manual_seed(0)
    expected, threads = torch.rand(1), torch.get_num_threads()
    torch.manual_seed(0)
    train(GAMMAS, "forward", quick(epochs=2, dropout=0.1))
    assert torch.equal(torch.rand(1), expected)
    assert torch.get_num_threads() == threads


@pytest.mark.parametrize(
    "changes",
    [{"constraint": "nonsense"}, {"epochs": 0}, {"dropout": 1.0}, {"learning_rate": 0.0}, {"batch_size": 1}],
)
def test_impossible_configs_are_refused(changes):
    with pytest.raises(InputError, match=f"{next(iter(changes))}="):
        TrainingConfig(**changes)


def test_bad_curves_are_refused():
    with pytest.raises(InputError, match="1 curve cannot train"):
        train(GRID, "forward", QUICK)
    with pytest.raises(InputError, match="falls"):
        train([GRID, 1 - GRID], "forward", QUICK)


def test_histories_come_back_and_thin(tmp_path):
    _, history = train(GAMMAS, "forward", quick(constraint="aae"))
    history.save(tmp_path / "h.npz")
    again = History.load(tmp_path / "h.npz")
    assert again.constraint == "aae"
    assert np.allclose(again.latents, history.latents, atol=2e-3)
    assert np.allclose(again.losses["discriminator"], history.losses["discriminator"], rtol=1e-5)
    thin = history.thin(10)
    assert thin.epochs[0] == 0
    assert thin.epochs[-1] == 39
    assert len(thin) <= 11
    assert np.array_equal(thin.latents[-1], history.latents[-1])
    assert [p.name for p in tmp_path.iterdir()] == ["h.npz"]


def test_probes_are_what_the_network_decodes():
    model, history = train(GAMMAS, "forward", quick(n_latent=2))
    best = int(np.argmin(history.losses["total"]))
    latents = np.stack([PROBES, np.zeros_like(PROBES)], axis=1)
    assert np.allclose(
        history.probes[best], model.decode(latents)[:, np.append(np.arange(0, 1023, 16), 1023)], atol=1e-5
    )


@pytest.mark.parametrize("content", [b"", b"PK", b"not a zip file at all"])
def test_damaged_histories_are_refused(tmp_path, content):
    (tmp_path / "h.npz").write_bytes(content)
    with pytest.raises(FormatError, match=r"h\.npz is not a training history"):
        History.load(tmp_path / "h.npz")
    with pytest.raises(MissingDataError, match="no history"):
        load_history("nonsense")


@pytest.mark.parametrize("constraint", CONSTRAINTS)
def test_bundled_histories_end_at_the_bundled_weights(constraint):
    history, model = load_history(constraint), load_model(ModelKey("SLR", constraint, 1))
    assert history.constraint == constraint
    assert 100 <= len(history) <= 151
    assert np.abs(history.latents[-1] - model.weights_["latents"]).max() < 0.05 * model.weights_["latents"].std() + 0.01


def test_histories_with_unequal_columns_are_refused():
    with pytest.raises(InputError, match="one row an epoch"):
        History("ldl", np.arange(3), {}, np.zeros((2, 4, 1)), np.zeros((3, 9, 65)))


@pytest.mark.slow
@pytest.mark.dorf
def test_training_again_gives_the_bundled_figures(dorf_curves):
    """Bit by bit on the machine that trained them; elsewhere sums round otherwise and the training goes its own way."""
    bundled = load_model("SLR-ldl-1")
    curves = dorf_curves.in_direction("inverse")
    model, history = train(curves, "inverse", CONFIGS["SLR-ldl-1"])
    metadata = json.loads(json.dumps(model.metadata_))
    assert metadata == {key: bundled.metadata_[key] for key in metadata}
    best = mse(model.decode(model.fit(curves)), curves).mean()
    assert best == pytest.approx(bundled.metadata_["figures"]["best_mse"], rel=0.3)
    assert best <= 5.57e-4
    assert abs(history.latents[-1].std() - 1) < 0.05
