"""Responses from single RAW photographs: rendered scenes whose truth is known, and the real pairs of Middlebury.

A scene has a random OpenCRF response, colour matrix, white balance and gain, and is written as a DNG with the camera's
JPEG inside: cropped by 2 %, distorted by 1 %, colours halved, quality 85. Of Middlebury, photographs under one light
are calibrated from their flat blocks, and predict the JPEG patches under the other light from the RAW ones.
"""

from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.timing import Row, noted
from crfbench import camera
from crfbench.camera.pairs import ScenePairs, calibrate_pairs, scene_pairs
from crfbench.camera.photographs import Pair
from crfbench.camera.reading import read_image
from crfbench.curves import GRID, Array, invert
from crfbench.datasets import load_opencrf, load_patches, registry
from crfbench.datasets.middlebury import EXPOSURES, ILLUMINATIONS, PatchArrays, patch_arrays
from crfbench.metrics import rmse
from crfbench.models import DEFAULT_MODEL, load_model
from tests.support.photographs import BLACK, WHITE, write_linear, write_raw
from tests.support.scenes import MATRIX, render_photograph

Measured = dict[tuple[int, ...], ScenePairs]  # by camera, light and exposure

_NEAR = 0.01  # RMSE of a curve that counts as found
_SEEN = GRID < 0.95  # where white lies may be a guess, and ends here


def rows(scenes: int = 200) -> list[Row]:
    """Measure both."""
    return [_scenes(scenes), *_middlebury()]


def _scenes(count: int) -> Row:
    found = np.array(list(_errors(count)))
    shares = [f"{share:.0%}" for share in (found[:, :3] <= _NEAR).mean(axis=0)]
    sizes = [f"{median:.4f} and {p95:.4f}" for median, p95 in np.percentile(found[:, :3], [50, 95], axis=0).T]
    note = (
        f"RMSE of the inverse response <= {_NEAR}: {shares[0]} of {count}, up to scale {shares[1]}, of the response "
        f"{shares[2]}; median and 95 %: {sizes[0]}, up to scale {sizes[1]}, of the response {sizes[2]}; "
        f"90 % bands hold {found[:, 3].mean():.0%}"
    )
    return noted("responses of rendered RAW photographs", note)


def _errors(count: int) -> Iterator[tuple[float, float, float, float]]:
    """Yield RMSE of the inverse responses, the same up to scale, RMSE of the responses, and what the bands hold."""
    curves = load_opencrf().curves
    for seed in range(count):
        rng = np.random.default_rng([seed, 1])
        truth, gain = curves[rng.integers(len(curves))], float(rng.uniform(1.0, 1.5))
        red, blue = rng.uniform(1.2, 2.4, 2).tolist()
        matrix = np.eye(3) + rng.uniform(0.3, 1.0) * (MATRIX - np.eye(3))
        taken = render_photograph(truth, seed, matrix=matrix, balance=(red, 1.0, blue), gain=gain)
        with TemporaryDirectory() as folder:
            path = write_raw(Path(folder) / "a.dng", *taken, balance=(red, 1.0, blue))
            passport = camera.calibrate(path, "none").passport
        inverse, found = invert(truth), passport.in_direction("inverse")
        held = (np.asarray(passport.low) <= inverse + 1e-9) & (inverse <= np.asarray(passport.high) + 1e-9)
        scaled = _scaled(found, inverse)
        yield (
            _rms(found - inverse),
            _rms(scaled[:, _SEEN] - inverse[_SEEN]),
            float(rmse(passport.in_direction("forward"), truth).mean()),
            float(held.mean()),
        )


def _scaled(curves: Array, truth: Array) -> Array:
    """Scale curves to what is nearest the truth."""
    seen = curves[:, _SEEN]
    return np.asarray(curves * (seen @ truth[_SEEN] / (seen**2).sum(axis=1))[:, None])


def _rms(off: Array) -> float:
    return float(np.sqrt(np.mean(off**2)))


def _middlebury() -> list[Row]:
    folder = registry.find("middlebury/modified_Middlebury")
    if folder is None:
        return [noted("photographs of Middlebury", "skipped: run 'crfbench fetch middlebury'")]
    patches, every = patch_arrays(load_patches()), range(len(EXPOSURES))
    pairs = _measured(folder, patches.cameras)
    one = np.array([_off(patches, pairs, [exposure]) for exposure in every])
    four = _off(patches, pairs, every)
    steps = ", ".join(f"{each:.4f}" for each in np.nanmean(one[..., 1], axis=(1, 2)))
    return [
        noted(
            "Middlebury under one light from one photograph under the other", f"{_summary(one)}; {steps} by exposure"
        ),
        noted("Middlebury under one light from four photographs under the other", _summary(four)),
    ]


def _measured(folder: Path, cameras: Sequence[str]) -> Measured:
    """Write the RAW pictures, which have 8 bits, as linear DNG, and measure them beside the JPEGs."""
    found: Measured = {}
    with TemporaryDirectory() as copies:
        for key in product(range(len(cameras)), range(len(ILLUMINATIONS)), range(len(EXPOSURES))):
            stem = folder / cameras[key[0]] / f"wb1i{ILLUMINATIONS[key[1]]}e{EXPOSURES[key[2]]}"
            levels = BLACK + read_image(Path(f"{stem}-raw.png")) * (WHITE - BLACK)
            raw = write_linear(Path(copies) / "a.dng", np.rint(levels).astype(np.uint16))
            measured, _ = scene_pairs([Pair("", Path(f"{stem}-jpg.png"), raw)])
            found.update(zip([key], measured.values(), strict=False))  # none where too little is flat
    return found


def _off(patches: PatchArrays, pairs: Measured, exposures: Sequence[int]) -> Array:
    """Return the RMSE of channels and intensity (cameras, lights, 2) from photographs of those exposures."""
    model, off = load_model(DEFAULT_MODEL), np.full((len(patches.cameras), len(ILLUMINATIONS), 2), np.nan)
    for row, light in np.ndindex(off.shape[:2]):
        photographs = {Path(str(e)): pairs[row, light, e] for e in exposures if (row, light, e) in pairs}
        if not photographs:
            continue
        found = calibrate_pairs(photographs, model)[0]
        seen = ~patches.clipped[row, 1 - light]
        made = found.develop(patches.raw[row, 1 - light][seen])[0] - patches.jpeg[row, 1 - light][seen]
        off[row, light] = _rms(made), _rms(made.mean(axis=1))
    return off


def _summary(off: Array) -> str:
    runs = off.reshape(-1, 2)
    told = runs[np.isfinite(runs[:, 0])]
    (channels, intensity), median = told.mean(axis=0), np.median(told[:, 1])
    rmse_ = f"RMSE of channels {channels:.4f}, of intensity {intensity:.4f}, median {median:.4f}"
    return f"{rmse_}, in {len(told)} of {len(runs)} runs"
