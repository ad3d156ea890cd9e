"""Bad arguments of every kind get one sentence of ours that repeats what came in, wherever they come in."""

import re
from functools import partial

import numpy as np
import pytest

import crfbench
from crfbench import camera, curves, metrics
from crfbench.calibration.posterior import Noise
from crfbench.calibration.table import decode_table
from crfbench.camera import Passport, merge_series, pair_photographs, render_series
from crfbench.camera.series import sample_series
from crfbench.curves import GRID
from crfbench.datasets.chart import as_corners
from crfbench.datasets.responses import grouped_folds, near_copies
from crfbench.errors import InputError
from crfbench.history import load_history
from crfbench.models import SLR, EMoR, Gamma, Prior, load_model
from crfbench.paper.stability import stability_table
from crfbench.search.space import SearchSpace
from crfbench.search.strategies import halving, optuna, random
from crfbench.training import TrainingConfig

RGB = np.stack([GRID**2, GRID, GRID**0.5])
SEEN = crfbench.Observations([[0.2, 0.5, 0.8], [0.3, 0.7, 0.97]], reference=[27, 112.7, 328.3])
GAMMA = load_model("Gamma-1")
SPACE = SearchSpace()
SERIES = [np.full((8, 8), level, np.uint8) for level in (50, 100)]

NO_NUMBERS = [None, "abc", np.full(1024, "0.5"), GRID + 1j, [[1.0], [1.0, 2.0]], np.array([object()]), {"a": 1}]

# The last word of each name is what the argument is called in the message.

#: Takes an array as its one argument.
ARRAYS = {
    "as_curves curves": curves.as_curves,
    "as_valid_curves curves": curves.as_valid_curves,
    "invert curves": curves.invert,
    "repair curves": curves.repair,
    "evaluate x": partial(curves.evaluate, RGB),
    "resample x": lambda x: curves.resample(x, GRID),
    "resample y": lambda y: curves.resample(GRID, y),
    "mse b": partial(metrics.mse, GRID),
    "rmse a": lambda a: metrics.rmse(a, GRID),
    "summarise values": metrics.summarise,
    "total_variance curves": metrics.total_variance,
    "nonmonotone curves": metrics.nonmonotone,
    "out_of_range curves": metrics.out_of_range,
    "decode params": GAMMA.decode,
    "fit curves": GAMMA.fit,
    "encode curves": SLR((3,)).encode,
    "EMoR curves": lambda basis: EMoR(GRID, basis, 1),
    "hidden": SLR,
    "brightness": lambda b: crfbench.Observations(b, [1, 2, 3]),
    "from_rgb rgb": lambda rgb: crfbench.Observations.from_rgb(rgb, [1, 2, 3]),
    "Passport curves": lambda c: Passport("inverse", c),
    "corners": as_corners,
    "near_copies curves": near_copies,
    "sample_series exposures": lambda e: sample_series(SERIES, e),
    "merge_series exposures": lambda e: merge_series(SERIES, e, GRID),
    "stops": lambda stops: render_series(GRID, size=(4, 4), stops=stops),
}

#: Takes a number, 0 or more.
TOLERANCES = {
    "as_valid_curves tolerance": lambda tolerance: curves.as_valid_curves(GRID, tolerance),
    "near_copies tolerance": lambda tolerance: near_copies([GRID], tolerance),
}

#: Takes a whole number as its one argument; 0 is none of them.
COUNTS = {
    "n_params": lambda n: EMoR.from_curves(RGB, n, "forward"),
    "SLR n_params": lambda n: SLR((3,), n),
    "starts": lambda n: crfbench.calibrate(GAMMA, SEEN, "paper", starts=n),
    "n_folds": lambda n: grouped_folds(np.arange(5), n),
    "random n": lambda n: random(SPACE, 500, {}, n),
    "halving rounds": lambda n: halving(SPACE, 500, {}, n),
    "batch": lambda n: optuna(SPACE, 500, {}, batch=n),
    "h1": lambda n: SearchSpace(h1=(n,)),
    "epochs": lambda n: TrainingConfig(epochs=n),
    "thin count": load_history("ldl").thin,
    "size": lambda n: render_series(GRID, size=(n, 4)),
}

#: Takes a seed as its one argument.
SEEDS = {
    "SLR seed": lambda seed: SLR((3,), seed=seed),
    "prior seed": lambda seed: GAMMA.prior_.sample(3, seed),
    "calibrate seed": lambda seed: crfbench.calibrate(GAMMA, SEEN, seed=seed),
    "decode_table seed": lambda seed: decode_table(GAMMA, seed=seed),
    "render_series seed": lambda seed: render_series(GRID, seed),
    "stability_table seed": lambda seed: stability_table(seed=seed),
    "random seed": lambda seed: random(SPACE, 500, {}, seed=seed),
    "TrainingConfig seed": lambda seed: TrainingConfig(seed=seed),
}

#: Takes one of some names as its one argument.
CHOICES = {
    "direction": curves.check_direction,
    "axis_labels direction": curves.axis_labels,
    "load_responses which": crfbench.load_responses,
    "load_model name": load_model,
    "fetch key": crfbench.fetch,
    "calibrate method": lambda method: crfbench.calibrate(GAMMA, SEEN, method),
    "constraint": lambda name: TrainingConfig(constraint=name),
}


def cases(table, values):
    return [
        pytest.param(call, value, name.split()[-1], id=f"{name}-{i}")
        for name, call in table.items()
        for i, value in enumerate(values)
    ]


@pytest.mark.parametrize(
    ("call", "value", "name"),
    [
        *cases(ARRAYS, NO_NUMBERS),
        *cases(TOLERANCES, [-1, "a", None, np.nan]),
        *cases(COUNTS, [0, -1, 1.5, "a", None, np.nan, [1]]),
        *cases(SEEDS, [-1, 1.5, "a", None]),
        *cases(CHOICES, ["sideways", "", None, 3, ["forward"]]),
    ],
)
def test_a_bad_argument_gets_one_sentence(call, value, name):
    with pytest.raises(InputError) as caught:
        call(value)
    sentence = str(caught.value)
    assert re.match(rf"{name}\b", sentence), sentence
    assert re.search("; (use|there are|list)|there are", sentence), sentence
    assert len(sentence) < 400
    assert "\n" not in sentence.rstrip()


def test_a_selection_that_is_out_of_range():
    responses = crfbench.load_responses("opencrf")
    for which in ([151], [0.5], "a", None, [True], [[0], [1, 2]]):
        with pytest.raises(InputError, match=r"which=.* use a mask of 151 or whole numbers below 151"):
            responses.select(which)


@pytest.mark.parametrize("check", [metrics.nonmonotone, metrics.out_of_range])
def test_of_a_curve_with_nan_nothing_is_said(check):
    with pytest.raises(InputError, match="holds NaN"):
        check(np.where(GRID > 0.5, np.nan, GRID))


def test_objects_of_another_kind_are_named():
    for given, made in (({"noise": 0.02}, "Noise()"), ({"table": 3}, "decode_table(model)")):
        with pytest.raises(InputError, match=re.escape(f"use what {made} gives")):
            crfbench.calibrate(GAMMA, SEEN, **given)
    with pytest.raises(InputError, match=re.escape("use what load_model(name) gives")):
        decode_table("Gamma")
    for value in ("a", None, [1.0], np.nan):
        with pytest.raises(InputError, match="noise brightness="):
            Noise(brightness=value)


@pytest.mark.parametrize("curves", [RGB[:1], GRID])
def test_one_curve_teaches_no_prior_and_no_components(curves):
    with pytest.raises(InputError, match="two or more curves"):
        Gamma().learn_prior(curves)
    with pytest.raises(InputError, match="1 curve has no components"):
        EMoR.from_curves(curves, 1, "forward")


def test_patches_that_are_not_there():
    for patches in ([3], [-1], [], [0.5], "a", None, [[0, 1]]):
        with pytest.raises(InputError, match=r"patches=.*use one or more whole numbers from 0 to 2"):
            SEEN.take(patches)


def test_numbers_of_any_kind_are_taken():
    for given in (GRID.tolist(), GRID.astype(np.float32), GRID.astype(object), np.linspace(0, 1023, 1024).astype(int)):
        assert curves.as_curves(given).shape == (1, 1024)
    assert np.isnan(metrics.rmse(np.full(4, np.nan), 0.0))
    assert SLR((np.int64(3),), np.int32(1), seed=np.uint8(1)).n_params == 1
    with pytest.raises(InputError, match=r"^n=-1"):
        Prior(np.zeros(1), np.eye(1)).sample(-1, 0)
    assert Prior(np.zeros(1), np.eye(1)).sample(0, 0).shape == (0, 1)


def test_paths_may_be_text(tmp_path):
    assert pair_photographs(str(tmp_path))[0] == []
    for chart in ("auto", "none"):
        with pytest.raises(InputError, match="there is no nowhere; use a folder"):
            camera.calibrate("nowhere", chart)
        with pytest.raises(InputError, match="there is no photograph"):
            camera.calibrate(str(tmp_path), chart)
    path = str(tmp_path / "a.safetensors")
    SLR((3,)).save(path)
    assert SLR.load(path).hidden == (3,)
    load_history("ldl").save(str(tmp_path / "h.npz"))
    assert len(type(load_history("ldl")).load(str(tmp_path / "h.npz"))) > 1
