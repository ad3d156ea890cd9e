"""SLR beyond the contract: shapes of network, validity by construction, weights files."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.numpy import load_file, save_file
from scipy.stats import kstest, uniform

from crfbench.curves import as_valid_curves
from crfbench.errors import FormatError, InputError, MissingDataError
from crfbench.metrics import nonmonotone, rmse
from crfbench.models import SLR, ModelKey, load_model, pretrained_models
from crfbench.models.slr import read_weights, save_weights
from tests.support.curves import off_endpoints

SOME = {ModelKey("SLR", "ldl", 1), ModelKey("SLR", "vae", 3), ModelKey("SLR", "monotone", 1, "forward")}


def test_the_promised_networks_are_bundled():
    one = {ModelKey("SLR", constraint, 1) for constraint in ("baseline", "ldl", "auc", "aae", "vae")}
    three = {ModelKey("SLR", constraint, 3) for constraint in ("baseline", "ldl", "aae", "vae")}
    forward = {ModelKey("SLR", constraint, k, "forward") for constraint in ("baseline", "ldl") for k in (1, 3)}
    monotone = {ModelKey("SLR", name, 1, side) for name in ("monotone", "open") for side in ("forward", "inverse")}
    assert one | three | forward | monotone <= set(pretrained_models())


@pytest.mark.parametrize(
    "key",
    [pytest.param(key, id=str(key), marks=[pytest.mark.slow] * (key not in SOME)) for key in pretrained_models()],
)
def test_bundled_networks_have_honest_metadata(key):
    model, monotone = load_model(key), key.constraint in {"monotone", "open"}
    metadata = model.metadata_
    assert metadata["n_latent"] == model.n_params == key.n_params
    assert metadata["direction"] == model.direction == key.direction
    assert metadata["monotone"] == model.monotone == monotone
    assert metadata["data"] == ("opencrf" if key.constraint == "open" else "dorf")
    assert len(metadata["sha256 of the curves (float32)"]) == 64
    latents = model.weights_["latents"].astype(float)
    assert len(latents) == metadata["n_curves"]
    sd = latents.std(axis=0)
    kl = 0.5 * (latents.mean(axis=0) ** 2 + sd**2 - 2 * np.log(sd) - 1)
    assert metadata["figures"]["kl"] == pytest.approx(kl.max(), rel=1e-6)
    if metadata["constraint"] == "ldl":
        assert np.abs(latents.mean(axis=0)).max() <= 0.05
        assert np.abs(sd - 1).max() <= 0.05
        assert kl.max() <= 0.005
    drawn = np.random.default_rng(1).normal(size=(10_000, key.n_params))
    falls = int(nonmonotone(model.decode(drawn)).sum())
    assert falls == metadata["figures"]["nonmonotone_of_10000"]
    assert falls == 0 or not monotone


@pytest.mark.dorf
@pytest.mark.parametrize("direction", [pytest.param("forward", marks=pytest.mark.slow), "inverse"])
def test_metadata_hold_the_figures_that_the_curves_give(direction, dorf_curves):
    curves = dorf_curves.in_direction(direction)
    for key in (ModelKey("SLR", "ldl", 1, direction), ModelKey("SLR", "monotone", 3, direction)):
        model = load_model(key)
        distance = rmse(model.decode(model.fit(curves)), curves)
        assert (distance**2).mean() == pytest.approx(model.metadata_["figures"]["best_mse"], rel=5e-3)
        encoder = rmse(model.decode(model.encode(curves)), curves)
        assert (encoder**2).mean() == pytest.approx(model.metadata_["figures"]["encoder_mse"], rel=5e-3)
        assert np.abs(model.encode(curves) - model.weights_["latents"]).max() < 2e-5


@settings(max_examples=40)
@given(
    st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=2),
    st.integers(0, 50),
    st.sampled_from([(8,), (8, 4), (8, 4, 4)]),
)
def test_monotone_decodes_every_latent_to_a_response(latent, seed, hidden):
    curve = SLR(hidden, n_latent=2, monotone=True, seed=seed).decode(latent)
    as_valid_curves(curve, tolerance=1e-12)
    assert not off_endpoints(curve, tolerance=0.0).any()


@pytest.mark.parametrize("name", ["SLR-ldl-1", "SLR-ldl-3", "SLR-monotone-1"])
def test_fit_beats_a_brute_force_search(name):
    model = load_model(name)
    rng = np.random.default_rng(3)
    curves = model.decode(rng.normal(size=(5, model.n_params))) ** 1.1
    found = rmse(model.decode(model.fit(curves)), curves)
    tried = model.decode(rng.normal(0, 1.5, size=(4000, model.n_params)))
    brute = rmse(curves[:, None], tried[None]).min(axis=1)
    assert (found <= brute + 1e-9).all()


@pytest.mark.parametrize("name", ["SLR-ldl-1", "SLR-vae-3", "SLR-monotone-3", "SLR-monotone-3-forward"])
def test_single_precision_decodes_the_same(name):
    model = load_model(name)
    z = np.random.default_rng(2).normal(0, 3, size=(300, model.n_params))
    fast = model.decode(z, np.float32)
    assert fast.dtype == np.float32
    assert np.abs(fast - model.decode(z)).max() < 1e-5
    assert np.array_equal(model.decode(z.reshape(3, 100, -1), np.float32).reshape(fast.shape), fast)
    assert np.array_equal(model.decode(z[7], np.float32), model.decode(z[7:8], np.float32)[0])
    far = np.random.default_rng(3).uniform(-10, 10, size=(500, model.n_params))
    assert np.abs(model.decode(far, np.float32) - model.decode(far)).max() < 1e-4
    assert np.isfinite(model.decode(1e4 * far, np.float32)).all()


def test_a_fit_is_the_same_every_time():
    curve = load_model("SLR-vae-3").decode([[0.4, -0.3, 0.2]]) ** 1.1
    assert np.array_equal(*(load_model("SLR-ldl-3").fit(curve) for _ in range(2)))


def test_seeds_decide_new_weights():
    assert np.array_equal(SLR(seed=3).decode([0.5]), SLR(seed=3).decode([0.5]))
    assert not np.array_equal(SLR(seed=3).decode([0.5]), SLR(seed=4).decode([0.5]))


def test_new_weights_are_spread_as_pytorch_spreads_them():
    """Uniform within 1 / sqrt(inputs), weights and biases alike; by SciPy's Kolmogorov-Smirnov test."""
    model = SLR((300, 200), n_latent=2, seed=2)
    shapes = {name: array.shape for name, array in model.weights_.items() if name.startswith("decoder")}
    assert shapes["decoder.0.weight"] == (200, 2)
    assert shapes["decoder.1.weight"] == (300, 200)
    assert shapes["decoder.2.weight"] == (1024, 300)
    for name, (_, inputs) in [(name, shape) for name, shape in shapes.items() if name.endswith("weight")]:
        for array in (model.weights_[name], model.weights_[name.replace("weight", "bias")]):
            scaled = array.ravel().astype(float) * np.sqrt(inputs)
            assert np.abs(scaled).max() <= 1 + 1e-6
            assert kstest(scaled, uniform(-1, 2).cdf).pvalue > 1e-3


@pytest.mark.parametrize("hidden", [(), (5, 5, 5, 5), (0,), (10, -1)])
def test_impossible_networks_are_refused(hidden):
    with pytest.raises(InputError, match=r"one to three layers|hidden=.* use a whole number from 1"):
        SLR(hidden)


def test_it_says_how_to_make_it_again():
    assert repr(SLR((6, 4), 2, "inverse", True)) == "SLR(hidden=(6, 4), n_latent=2, direction='inverse', monotone=True)"
    assert repr(SLR((6,))) == "SLR(hidden=(6,), n_latent=1, direction='inverse')"


def header_of(path):
    """Read the JSON at the start of a safetensors file."""
    content = path.read_bytes()
    return json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])


@pytest.fixture
def saved(tmp_path):
    model = SLR((6, 4), n_latent=2, direction="inverse", monotone=True, seed=5)
    model.metadata_ = {"data": "nothing", "constraint": "ldl"}
    model.save(tmp_path / "new" / "w.safetensors")
    return model, tmp_path / "new" / "w.safetensors"


def test_saved_weights_come_back_whole(saved):
    model, path = saved
    again = SLR.load(path)
    assert repr(again) == repr(model)
    assert again.metadata_["data"] == "nothing"
    assert np.array_equal(again.decode([[0.3, -1.0]]), model.decode([[0.3, -1.0]]))
    assert [p.name for p in path.parent.iterdir()] == ["w.safetensors"]


@pytest.mark.parametrize("keep", [0, 3, 100, 0.5, 0.999])
def test_truncated_weights_are_refused(saved, keep):
    _, path = saved
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * keep) if isinstance(keep, float) else keep])
    with pytest.raises(FormatError, match=r"w\.safetensors is damaged"):
        SLR.load(path)


@settings(max_examples=60)
@given(st.data())
def test_altered_weights_are_refused(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("weights") / "w.safetensors"
    model = SLR((3,), seed=1)
    model.save(path)
    content = bytearray(path.read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] ^= 1 << data.draw(st.integers(0, 7))
    path.write_bytes(content)
    try:
        again = SLR.load(path)
    except (FormatError, InputError):
        return
    assert np.array_equal(again.decode([0.1]), model.decode([0.1]))  # the flipped bit was of no consequence


def test_weights_that_were_altered_say_so(saved):
    path = saved[1]
    path.write_bytes(path.read_bytes()[:-1] + b"\x7f")
    with pytest.raises(FormatError, match=r"w\.safetensors was altered after it was written \(its checksum differs\)"):
        SLR.load(path)


def test_foreign_weights_are_refused(tmp_path, saved):
    foreign = tmp_path / "foreign.safetensors"
    save_file({"a": np.zeros(3, np.float32)}, foreign)
    with pytest.raises(FormatError, match="format None; use a weights file of format 'crfbench-slr-1'"):
        SLR.load(foreign)
    save_file({"a": np.zeros(3, np.float32)}, foreign, metadata={"format": "pt"})
    with pytest.raises(FormatError, match="format 'pt'; use a weights file of format 'crfbench-slr-1'"):
        SLR.load(foreign)
    text = tmp_path / "text.safetensors"
    text.write_text("not weights at all, but long enough to look like a header")
    with pytest.raises(FormatError, match=r"text\.safetensors is damaged or not a safetensors file"):
        SLR.load(text)
    with pytest.raises(MissingDataError, match=r"no weights file .*gone\.safetensors"):
        SLR.load(tmp_path / "gone.safetensors")


def test_weights_are_held_and_saved_in_single_precision(saved, tmp_path):
    weights, metadata = read_weights(saved[1])
    double = {name: array.astype(np.float64) for name, array in weights.items()}
    assert {array.dtype for array in SLR.from_weights(double, metadata).weights_.values()} == {np.dtype(np.float32)}
    save_weights(tmp_path / "double.safetensors", double, metadata)
    again = SLR.load(tmp_path / "double.safetensors").weights_
    assert all(again[name].dtype == np.float32 and np.array_equal(again[name], weights[name]) for name in weights)


@pytest.mark.parametrize("lacking", ["hidden", "n_latent", "direction", "monotone", "latents"])
def test_weights_that_lack_something_are_refused(saved, tmp_path, lacking):
    weights, metadata = read_weights(saved[1])
    parts = [{name: part for name, part in each.items() if name != lacking} for each in (weights, metadata)]
    save_weights(tmp_path / "lacking.safetensors", *parts)
    with pytest.raises(FormatError, match=r"lacks latents or one of hidden, n_latent, direction, monotone; use"):
        SLR.load(tmp_path / "lacking.safetensors")


def test_the_order_of_weights_and_metadata_changes_neither_text_nor_checksum(saved, tmp_path):
    weights, metadata = read_weights(saved[1])
    save_weights(tmp_path / "w", *(dict(reversed(each.items())) for each in (weights, metadata)))
    assert header_of(tmp_path / "w")["__metadata__"] == header_of(saved[1])["__metadata__"]


def test_weights_of_another_network_are_refused(saved):
    model, path = saved
    with pytest.raises(InputError, match="have the wrong shapes"):
        SLR.from_weights(
            load_file(path), {**model.metadata_, "hidden": [6], "n_latent": 2, "direction": "inverse", "monotone": True}
        )


def test_metadata_are_plain_json(saved):
    _, path = saved
    assert json.loads(header_of(path)["__metadata__"]["card"])["hidden"] == [6, 4]
