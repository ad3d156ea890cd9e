"""From RAW files, and what the camera made of them, to its response: photographs of any scene, without a chart.

The RAW file is laid over the JPEG, and what is flat in both is compared.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from crfbench.calibration import Calibration
from crfbench.calibration.colour import RAW_FULL, ColourCalibration, calibrate_colour
from crfbench.calibration.observations import SATURATED
from crfbench.calibration.posterior import Noise
from crfbench.camera.photographs import Pair, Problems
from crfbench.camera.reading import read_balance, read_image, read_raw, reduced
from crfbench.camera.worker import WORKER
from crfbench.curves import GRID, Array, evaluate
from crfbench.errors import FormatError
from crfbench.models import ResponseModel

Pixels = NDArray[np.float32]
#: What one photograph of a scene says of its camera: brightness (m, 3); RAW (m, 3), balanced by the camera's factors,
#: at most 1, the full scale of green; and those factors (3,).
ScenePairs = tuple[Array, Array, Array]

_LONGEST_SIDE = 2048  # larger photographs are reduced to it
# Coarse to fine: longer side, degree of the shifts, steps.
_LEVELS = ((128, 1, 8), (256, 1, 5), (512, 3, 5), (1024, 3, 3))
_SHIFT = 0.02  # standard deviation of the coefficients of the shifts, in half widths, before anything is seen
_PARTS = 16  # of the longer side, in each of which brightness and contrast are made equal
_WILD = 0.5  # standard deviations from which on a pixel counts for less
_SIDE = 8  # pixels of a block
_UNEVEN, _NOISY = 4 / 255, 0.15  # greatest standard deviation in a block: brightness; RAW, as a share of its mean
# The cube of colours has 16 equal steps a side, and finer ones where responses are steep and end.
_EDGES = np.sort([*np.arange(1, 16) / 16, 1e-6, 0.01, 0.02, 0.04, 0.955, 0.97, 0.98, 0.988, SATURATED])
_GAMMA = 2.2  # of a typical response: what is averaged is nearly straight then
_LEAST_LIKE, _LEAST_CELLS = 0.8, 24
_TELLING = 400  # independent pairs that one photograph tells, at most
# Standard deviations of where white lies: of the log light beyond the brightest colour, and over cameras.
_BEYOND, _SCALE = 0.5, 0.25
# What is left out: this often the usual residual, in brightness, and more than cameras leave anyway.
_ODD, _ALIKE = 2.0, 0.02
_SCATTER = 0.005  # of brightness about the curves, that is expected at the least


def scene_pairs(pairs: Sequence[Pair], white_level: int | None = None) -> tuple[dict[Path, ScenePairs], Problems]:
    """Measure photographs, by the path of their JPEG; one that cannot be measured is reported, the rest goes on."""
    measured: dict[Path, ScenePairs] = {}
    problems: Problems = {}
    for pair in pairs:
        try:
            measured[pair.jpeg] = WORKER.run(measure_pairs, pair.jpeg, pair.raw, white_level)
        except FormatError as error:
            problems[pair.jpeg] = str(error)
    return measured, problems


def calibrate_pairs(
    measured: Mapping[Path, ScenePairs], model: ResponseModel
) -> tuple[ColourCalibration, Problems, str]:
    """Find matrix and curves from photographs of one camera; what is unlike most of three or more is left out.

    Returned with those left out, and a sentence on what remains unexplained, by which bands are wider. The matrix is
    for RAW values as they are in the first photograph.
    """
    jpeg, raw, weights = _padded(list(measured.values()))
    used = np.ones(len(jpeg), dtype=bool)
    while True:
        found = calibrate_colour(jpeg[used], raw[used], weights[used], model=model, method="map")
        rms = _unexplained(found, jpeg, raw, weights)
        worst = int(np.argmax(np.where(used, rms, 0.0)))
        if used.sum() < 3 or rms[worst] <= max(_ODD * np.median(rms[used]), _ALIKE):
            break
        used[worst] = False
    # Where little scatters, the slope at the brightest colours tells where white lies; where much does, it says less.
    scatter = float(np.clip(np.sqrt((rms[used] ** 2).mean()), _SCATTER, Noise.brightness))
    found = calibrate_colour(jpeg[used], raw[used], weights[used], model=model, scatter=scatter)
    rms = _unexplained(found, jpeg, raw, weights)
    unlike = "counts of 255 off what most others tell; calibrate one picture style"
    odd = {
        path: f"{path.name} is {255 * each:.0f} {unlike}"
        for path, each, kept in zip(measured, rms, used, strict=True)
        if not kept
    }
    rest = float(np.sqrt((rms[used] ** 2).mean()))
    calibration = widened(found.calibration, rest)
    stops = np.sqrt((calibration.residuals[calibration.observations.counts] ** 2).mean()) / np.log(2)
    files = f"{used.sum()} RAW file{'s' if used.sum() > 1 else ''}"
    off = f"{255 * rest:.1f} counts of 255 ({stops:.2f} stops)"
    note = f"without a chart: matrix and curves of {files} are off the JPEG by {off}, for which the bands allow"
    balance = next(iter(measured.values()))[2]
    return replace(found, matrix=found.matrix * balance, calibration=calibration), odd, note


def _padded(photographs: list[ScenePairs]) -> tuple[Array, Array, Array]:
    """Return brightness and RAW, (e, longest, 3) each, and what each pair counts for, 0 where there is none."""
    longest = max(len(brightness) for brightness, _, _ in photographs)
    jpeg, raw = np.full((2, len(photographs), longest, 3), 0.5)
    weights = np.zeros(jpeg.shape[:2])
    for i, (brightness, light, _) in enumerate(photographs):
        m = len(brightness)
        jpeg[i, :m], raw[i, :m], weights[i, :m] = brightness, light, min(1.0, _TELLING / m)
    return jpeg, raw, weights


def _unexplained(found: ColourCalibration, jpeg: Array, raw: Array, weights: Array) -> Array:
    """Return how far brightness is off what matrix and curves make of the RAW values of each photograph, RMS, (e,)."""
    seen = (weights[..., None] > 0) & (jpeg > 0) & (jpeg < SATURATED) & (raw.max(axis=2, keepdims=True) < RAW_FULL)
    off = jpeg - found.develop(raw.reshape(1, -1, 3)).reshape(jpeg.shape)
    return np.asarray(np.sqrt(np.where(seen, off**2, 0.0).sum(axis=(1, 2)) / np.maximum(seen.sum(axis=(1, 2)), 1)))


def widened(calibration: Calibration, rest: float = 0.0) -> Calibration:
    """Widen the bands by what is no noise that averages out.

    That is brightness unexplained, as by local tones and vignetting, and where white lies: a share of the light between
    the brightest observation and (1, 1), to which the curve is drawn on.
    """
    curves, bands = calibration.curves, {}
    beyond = -np.log(evaluate(curves, calibration.brightness_range[:, 1:]))
    light = np.hypot(rest * np.gradient(curves, GRID, axis=1), np.minimum(_BEYOND * beyond, _SCALE) * curves)
    for level, (low, high) in calibration.bands.items():
        more = NormalDist().inv_cdf(0.5 + level / 2) * light
        wider = curves - np.hypot(curves - low, more), curves + np.hypot(high - curves, more)
        bands[level] = np.maximum(wider[0], 0.0), np.minimum(wider[1], 1.0)
    return replace(calibration, bands=bands)


def measure_pairs(jpeg: Path, raw: Path, white_level: int | None = None) -> ScenePairs:
    """Lay a RAW file over the image of the same photograph and average what is flat in both, by colours.

    The image may be the RAW file's own preview (`jpeg` is then the RAW file too), smaller, cropped by some per cent,
    turned, and its distortion corrected. Blocks of 8 x 8 pixels that are flat, and clipped in neither, are averaged by
    cells of a cube of 16^3 colours of the image, so that no background outweighs the rest. Files are decoded in this
    process. `FormatError` where the files do not show the same, or too little.
    """
    image, linear = reduced(read_image(jpeg, white_level), _LONGEST_SIDE), read_raw(raw, half=True)
    for path, pixels in ((jpeg, image), (raw, linear)):
        if pixels.ndim == 2:
            raise FormatError(f"{path.name} is grey; use a photograph in colour, or a series (--exposures)")
    balance = read_balance(raw).astype(np.float32)
    linear = reduced(linear, max(image.shape))
    laid, likeness = lay_over(linear, image, balance)
    if likeness < _LEAST_LIKE:
        names = raw.name if jpeg == raw else f"{jpeg.name} and {raw.name}"
        raise FormatError(
            f"RAW and image of {names} do not show the same (likeness {likeness:.2f}); use one photograph's"
        )
    brightness, light = _flat_blocks(image, laid)
    brightness, light = _by_colour(brightness, light * balance)
    if len(light) < _LEAST_CELLS:
        raise FormatError(
            f"{jpeg.name} has flat areas of {len(light)} colours, neither black nor white, and {_LEAST_CELLS} are "
            "needed; use a photograph with more of them"
        )
    return brightness, np.minimum(light, 1.0), balance.astype(np.float64)


def lay_over(linear: Pixels, image: Pixels, balance: NDArray[np.float32]) -> tuple[Pixels, float]:
    """Shift a RAW picture (h, w, 3) so that it covers the image (height, width, 3), NaN beyond its edges.

    Whichever way it is turned. The shifts are cubic in the place, as lenses distort. Returned with the likeness.
    """
    turned = [np.ascontiguousarray(np.rot90(linear, turn)) for turn in range(4)]
    bright = [(np.minimum(picture * balance, 1.0) ** np.float32(1 / _GAMMA)).mean(axis=2) for picture in turned]
    seen, still = image.mean(axis=2), np.zeros((4, 4, 2))
    first = [_registered(grey, seen, still, *_LEVELS[0]) for grey in bright]
    best = int(np.argmax([likeness for _, likeness in first]))
    shifts, likeness = first[best]
    for level in _LEVELS[1:]:
        shifts, likeness = _registered(bright[best], seen, shifts, *level)
    return _shifted(turned[best], image.shape, shifts), likeness


def _registered(raw: Pixels, image: Pixels, shifts: Array, side: int, degree: int, steps: int) -> tuple[Array, float]:
    """Improve shifts by Gauss-Newton steps on pictures of that longer side, and say how alike they are then.

    Lucas and Kanade 1981, "An iterative image registration technique", with brightness and contrast made equal
    everywhere, as the response and local tones change both.
    """
    raw, image = reduced(raw, side), reduced(image, side)
    seen, (v, u) = _equalised(image), _places(image.shape)
    part = slice(None, None, max(1, side // 512))
    powers = np.array([(i, j) for i in range(4) for j in range(4) if i + j <= degree])
    basis = np.stack([np.outer(v[part] ** i, u[part] ** j) for i, j in powers]).astype(np.float32)
    shifts, (i, j) = shifts.copy(), powers.T
    for _ in range(steps):
        laid = _shifted(raw, image.shape, shifts)
        inside = np.isfinite(laid)
        equal = _equalised(np.where(inside, laid, image))
        slopes = [np.gradient(equal, axis=axis)[part, part] * (max(image.shape) / 2) for axis in (0, 1)]
        columns = np.concatenate([slope * basis for slope in slopes]).reshape(2 * len(powers), -1)
        off = (seen - equal)[part, part]
        weight = inside[part, part] / (1.0 + (off / _WILD) ** 2)
        normal = (columns * weight.ravel()) @ columns.T + np.eye(len(columns)) / _SHIFT**2
        pull = columns @ (weight * off).ravel() - shifts[i, j].T.ravel() / _SHIFT**2
        shifts[i, j] += np.linalg.solve(normal, pull).reshape(2, -1).T
    laid = _shifted(raw, image.shape, shifts)
    inside = np.isfinite(laid)
    if inside.mean() < 0.5 or not np.ptp(image[inside]) or not np.ptp(laid[inside]):
        return shifts, 0.0
    return shifts, float(np.corrcoef(laid[inside], image[inside])[0, 1])


def _equalised(grey: Pixels) -> Pixels:
    """Return a picture with mean 0 and standard deviation 1 about every place, but noise not lifted to it."""
    import cv2

    about = (max(grey.shape) // _PARTS,) * 2
    level = grey - cv2.blur(grey, about)
    return np.asarray(level / (np.sqrt(np.maximum(cv2.blur(level**2, about), 0)) + np.float32(0.02)))


def _places(shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Return y (h,) and x (w,) of pixels, from the centre, in half lengths of the longer side."""
    half = max(shape[:2]) / 2
    y, x = (np.linspace(1 - length, length - 1, length) / (2 * half) for length in shape[:2])
    return y, x


def _shifted(raw: Pixels, shape: tuple[int, ...], shifts: Array) -> Pixels:
    """Return a picture of that shape: of each place what the RAW picture has there and `shifts` away.

    Shifts (4, 4, 2), of y and x, are coefficients of y^i x^j. Without them both have the same centre, and the RAW
    picture just covers the other.
    """
    import cv2

    scale = max(shape[1] / raw.shape[1], shape[0] / raw.shape[0])
    v, u = _places(shape)
    y, x = np.polynomial.polynomial.polygrid2d(v, u, shifts)
    unit = max(shape[:2]) / (2 * scale)
    rows = ((y + v[:, None]) * unit + (raw.shape[0] - 1) / 2).astype(np.float32)
    columns = ((x + u) * unit + (raw.shape[1] - 1) / 2).astype(np.float32)
    nothing = (np.nan,) * 3
    laid = cv2.remap(raw, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=nothing)
    return np.asarray(laid)


def _flat_blocks(image: Pixels, laid: Pixels) -> tuple[Array, Array]:
    """Return the means of the blocks that are flat and unclipped, of image and RAW, (m, 3) each."""
    b, light = _blocks(image), _blocks(laid)
    level, mean = b.mean(axis=1), light.mean(axis=1)
    flat = (b.std(axis=1) < _UNEVEN) & (light.std(axis=1) < _NOISY * mean + 0.002)
    low, high = b.min(axis=1), b.max(axis=1)
    whole = ((low > 0) & (high < SATURATED)) | (low >= SATURATED) | (high <= 0)
    used = (flat & whole & (light.max(axis=1) < RAW_FULL)).all(axis=1)
    return level[used].astype(np.float64), mean[used].astype(np.float64)


def _blocks(pixels: Pixels) -> Pixels:
    """Return the pixels of whole blocks, shape (blocks, 64, 3)."""
    rows, columns = (length // _SIDE for length in pixels.shape[:2])
    cut = pixels[: rows * _SIDE, : columns * _SIDE].reshape(rows, _SIDE, columns, _SIDE, 3)
    return cut.swapaxes(1, 2).reshape(-1, _SIDE**2, 3)


def _by_colour(brightness: Array, light: Array) -> tuple[Array, Array]:
    """Average blocks by cells of the cube of colours."""
    steps = len(_EDGES) + 1
    cell = np.searchsorted(_EDGES, brightness, side="right") @ np.array([steps**2, steps, 1])
    _, inverse, counts = np.unique(cell, return_inverse=True, return_counts=True)
    of = [np.bincount(inverse, channel) / counts for channel in (*brightness.T, *(light.T ** (1 / _GAMMA)))]
    return np.stack(of[:3], axis=1), np.stack(of[3:], axis=1) ** _GAMMA
