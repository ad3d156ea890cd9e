"""From an exposure series of any static scene, without a chart, to inverse responses.

What a series is calibrated from are small flat blocks of the photographs that cover the brightness range.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.calibration import Calibration, Noise, Observations, calibrate, decode_table
from crfbench.calibration.observations import SATURATED
from crfbench.camera.reading import read_levels, reduced
from crfbench.checks import as_numbers, check_seed, refuse_masked
from crfbench.curves import GRID, Array, evaluate
from crfbench.errors import InputError
from crfbench.models import DEFAULT_MODEL, ResponseModel, load_model

Image = NDArray[Any]
Kind = tuple[np.dtype[Any], tuple[int, ...]]

_STOPS = 60.0  # between least and greatest exposure; more cannot be one camera's
_SIDE = 5  # pixels of a block along each side
_MOST_BLOCKS = 2**16  # of a channel that are looked at, evenly over the photograph
_BLOCKS = 256  # of a set
_MOST_CELLS = 2**15  # blocks times photographs of a set; a calibration needs memory for 60 numbers each
_STRATA = 32  # of equal width in brightness
_FLATTEST = 0.25  # share of a stratum that is drawn from
# How much a series tells: of each photograph at least so many values; the lags that are looked at, the autocorrelation
# that is near 0, and the residuals, in medians, that are cut down for it.
_VALUES, _LAGS, _ALIKE, _OUTLIER = 32.0, 64, 0.05, 6.0
# Blocks are means of many pixels; in the dark, whole levels and stray light count for more than noise.
_READING, _FINE = 0.005, 0.1
# Of black floor and white: pixels that are looked at, and stops to the next longer exposure.
_PIXELS, _LONGER = 20_000, 0.9
# Of white: share of a photograph's values that end there, how far below lossy files leave some, and how many.
_ENDS, _UNEVEN, _FEW_UNEVEN = 0.005, 4, 0.05
_LOW_WHITE = 0.96  # below, it is more than lossy files do
_FAR_FROM_WHITE = 0.9  # below, how much light makes white is far from what was seen
# Of the black floor: levels of 255 that may be floor and that have risen so far that they say nothing, and the share of
# the pixels that three levels need.
_DARK, _RISEN, _FLOOR_SHARE = 60, 200, 0.0007
# Of what moved: rounds of leaving out; off by at least this much of log irradiance, more below a brightness, and so
# many times what is usual; above the darkest, which may be a floor; the share of the blocks that is not worth a round,
# and that which stays: where fewer would, it is not the scene that moves.
_ROUNDS, _OFF, _BRIGHT, _FAR, _ABOVE, _FEW, _LEFT = 5, 0.35, 0.3, 6.0, 0.03, 0.01, 0.25
EXACT = 0.02  # stops that exposures err by which somebody gave
# Stops that exposures may err by which nobody told, and that they span at most to begin with; irradiance.
_FREE, _SPAN, _LEAST = 50.0, 6.0, 1e-6
_CONTRADICTS = 0.5  # stops, between two photographs
# Of aligning: the longer side of the pictures that are compared, in pixels; and the peak of phase correlation, which
# is 1 for the same picture and near 0 for another, from which on it counts.
_WIDEST, _SURE = 1024, 0.3
# Of brightness from the least to the greatest exposure: less is noise; and in powers of 2 a stop, more no camera gives.
_CHANGE, _MOST_CHANGE = 2 / 255, 5.0


class Reduced(NamedTuple):
    """The part of a photograph that a series is calibrated from; so little that photographs are read one by one."""

    shape: tuple[int, ...]  # of the photograph
    dtype: np.dtype[Any]
    mean: float
    blocks: Array  # shape (3, c, m); mean, least and greatest brightness
    pixels: NDArray[np.uint8]  # shape (m, c); the high byte of values of 16 bits
    picture: NDArray[np.uint8]
    name: str


def reduce_photograph(path: Path, white_level: int | None = None, shift: tuple[int, int] = (0, 0)) -> Reduced:
    """Read a photograph as `read_levels` does, shift it and reduce it, or raise `FormatError`."""
    return reduce_image(shifted(read_levels(path, white_level), *shift), path.name)


def reduce_image(image: ArrayLike, name: str = "") -> Reduced:
    """Reduce an image (h, w) or (h, w, c) to what `calibrate_series` needs."""
    (array,) = as_images([image])
    pixels = array.reshape(-1, array.shape[2])[:: max(1, array[..., 0].size // _PIXELS)]
    high = pixels >> 8 if pixels.dtype == np.uint16 else pixels
    blocks = np.stack([_blocks(array[..., c]) for c in range(array.shape[2])], axis=1)
    picture = equalised(array)
    return Reduced(np.shape(image), array.dtype, float(array.mean()), blocks, high.astype(np.uint8), picture, name)


def equalised(array: NDArray[Any]) -> NDArray[np.uint8]:
    """Reduce the green channel of an image (h, w, c) of 8 or 16 bits to what no response and no exposure changes."""
    import cv2

    plane = array[..., array.shape[2] // 2]
    levels = np.ascontiguousarray(plane >> 8 if plane.dtype == np.uint16 else plane).astype(np.uint8)
    return np.asarray(cv2.equalizeHist(reduced(levels, _WIDEST)), dtype=np.uint8)


def find_shifts(pictures: Sequence[NDArray[np.uint8]], stops: Array, shape: tuple[int, ...]) -> NDArray[np.intp]:
    """Say by how many whole columns and rows to shift each photograph to where they all show the same.

    Each is compared with that of the next exposure, by phase correlation (Kuglin and Hines 1975). Where two do not
    correlate, they count as aligned. Takes the `pictures` from `equalised`, exposures (e,), of which the photograph of
    the middle one stays where it is, and the shape of the photographs; returns shape (e, 2).
    """
    order = np.argsort(stops, kind="stable")
    scale = max(shape[:2]) / max(pictures[0].shape)
    steps = [scale * _shift(pictures[early], pictures[late]) for early, late in pairwise(order)]
    along = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    shifts, middle = np.empty(along.shape, dtype=np.intp), order[len(order) // 2]
    shifts[order] = np.rint(along[len(order) // 2] - along)
    for shift, picture in zip(shifts, pictures, strict=True):
        if shift.any() and not _nearer(pictures[middle], picture, shift / scale):
            shift[:] = 0  # small errors of the steps have added up, or something large has moved
    return shifts


def _nearer(still: NDArray[np.uint8], picture: NDArray[np.uint8], shift: Array) -> bool:
    """Say whether a shifted picture is more like the one that stays than it is without."""
    import cv2

    edge = int(np.ceil(np.abs(shift).max()))
    inside = (slice(edge, -edge),) * 2
    moved = cv2.warpAffine(picture, np.column_stack([np.eye(2), shift]), picture.shape[::-1])
    off = [np.abs(np.subtract(still[inside], each[inside], dtype=np.int16)).sum() for each in (picture, moved)]
    return bool(off[1] < off[0])


def shifted(array: NDArray[Any], columns: int, rows: int) -> NDArray[Any]:
    """Shift the content of an image (h, w) or (h, w, c) right and down; what comes in from outside is 0."""
    import cv2

    return np.asarray(cv2.createAlignMTB().shiftMat(array, (int(columns), int(rows)))).reshape(array.shape)


def _shift(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> Array:
    """Return by how many columns and rows the second picture is off the first, 0 where that is not sure."""
    import cv2

    window = cv2.createHanningWindow(first.shape[::-1], cv2.CV_32F)
    # Of a transform of odd length OpenCV takes the middle half a pixel off.
    more = [2 * cv2.getOptimalDFTSize((length + 1) // 2) - length for length in first.shape]
    seen = [np.pad(picture * window, [(0, n) for n in more]) for picture in (first, second)]
    found, sure = cv2.phaseCorrelate(*seen)
    return np.array(found if sure > _SURE else (0.0, 0.0))


def calibrate_series(
    images: Iterable[ArrayLike | Reduced],
    exposures: ArrayLike | None,
    model: ResponseModel | None = None,
    method: str = "posterior",
    *,
    seed: int = 0,
    per_channel: bool = True,
    exposure_error: float = EXACT,
) -> Calibration:
    """Find the inverse response of the camera that took a series.

    It is a curve for each channel, coupled, or without `per_channel` one for all. Exposures alone tell no scale: where
    the data do not reach, that the curve ends in (1, 1) is the model's word, for which the bands do not allow (those of
    `crfbench.camera.calibrate` do).

    Parameters
    ----------
    images, exposures
        As in `sample_series`. Exposures that are None are estimated too: then a power of the curve explains the
        photographs as well, it is the one most usual in curves of the model, and the band holds the others.
    model, method
        As in `crfbench.calibrate`, with "posterior" or "map"; by default `crfbench.models.DEFAULT_MODEL`.
    seed, per_channel
        As in `sample_series`.
    exposure_error : float
        Standard deviation of each exposure in stops. Times as a camera names them, 1/60 for 1/64, call for 0.05.
    """
    images, model = _as_reduced(images), model or load_model(DEFAULT_MODEL)
    fit = partial(_from_exposures, images, model, method, seed, per_channel)
    if exposures is None:
        found = _estimated(images, model, seed, fit)
    else:
        found = with_contradictions(fit(exposures, exposure_error), _names(images))
    white = find_white(images, np.asarray(found.observations.exposures)[0])
    said = f"the photographs end at brightness {white:.3f}: what reaches it is saturated" if white < _LOW_WHITE else ""
    brightest = found.brightness_range[:, 1].max()
    if brightest < _FAR_FROM_WHITE and not said:
        seen = f"nothing that two exposures show is brighter than {brightest:.2f}"
        said = f"{seen}: beyond, and for the scale, the model speaks alone"
    return _told(found, [said] * len(found))


def _from_exposures(
    images: Sequence[Reduced],
    model: ResponseModel,
    method: str,
    seed: int,
    per_channel: bool,
    exposures: ArrayLike,
    error: float,
) -> Calibration:
    """Calibrate a series of exposures that are given and err by so many stops, as `calibrate_series` does."""
    observations = sample_series(images, exposures, seed=seed, per_channel=per_channel)
    noise = Noise(_READING, error, fine=_FINE, repeats=1.0)
    channels = len(observations) == 3
    # How much the blocks tell, channels by themselves say as well, and sooner.
    alone = partial(calibrate, model, noise=noise, seed=seed, table=decode_table(model, seed=seed))
    fit = partial(alone, channels=channels)
    weighted = partial(_weighted, observations, _independent(alone(observations, "map")))
    found, still = fit(weighted(), method), np.ones(observations.brightness.shape, dtype=bool)
    moved = ~still
    for _ in range(_ROUNDS):
        moved = moved | _moved(found)
        rest = still & ~moved.any(axis=1, keepdims=True)
        left = rest[:, 0].mean(axis=1)
        if (still[:, 0].mean() - left.mean()) < _FEW or left.min() < _LEFT:
            break
        still = rest
        found = fit(weighted(still), method)
    floor = black_floor(images, exposures, found.curves)
    if floor.any():
        light = still & (observations.brightness > floor[:, None, None])
        # What lies below the floor has irradiance 0, up to what its band says.
        found, below = fit(weighted(light), method), floor[:, None] > GRID
        bands = {level: (np.where(below, 0.0, low), high) for level, (low, high) in found.bands.items()}
        found = replace(found, curves=np.where(below, 0.0, found.curves), bands=bands)
        text = "below brightness {:.3f} nothing follows the exposure, by noise or a floor: it counts as irradiance 0"
        found = _told(found, [text.format(edge) if edge > 0 else "" for edge in floor])
    share = 1.0 - still[:, 0].mean(axis=1, where=observations.counts.any(axis=1))
    text = "{:.0%} of the blocks do not follow the exposures, as where something moves, most in {}; they are left out"
    names = [_names(images)[k] for k in moved.sum(axis=2).argmax(axis=1)]
    return _told(found, [text.format(*each) if each[0] > _FEW else "" for each in zip(share, names, strict=True)])


def _moved(found: Calibration) -> NDArray[np.bool_]:
    """Say where blocks are far off what the others say, as in a photograph where something moved, shape (n, e, p)."""
    residuals = np.ma.array(found.residuals, mask=~found.observations.counts)
    off = np.abs(residuals - np.ma.median(residuals, axis=2)[..., None])
    usual = np.ma.median(off.reshape(len(off), -1), axis=1)[:, None, None]
    seen = np.ma.array(found.observations.brightness, mask=residuals.mask)
    far = (off > np.maximum(_OFF * np.maximum(1.0, _BRIGHT / seen), _FAR * usual)) & (seen > _ABOVE + seen.min())
    return np.asarray(far.filled(False))


def _estimated(
    images: Sequence[Reduced], model: ResponseModel, seed: int, fit: Callable[[Array, float], Calibration]
) -> Calibration:
    """Calibrate a series whose exposures nobody told: curve and exposures come from the photographs, up to a power.

    `fit` takes exposures, and by how many stops they err.
    """
    rank = np.argsort(np.argsort([image.mean for image in images], kind="stable"))
    order = min(1.0, _SPAN / max(len(images) - 1, 1)) * rank.astype(np.float64)
    free = fit(order, _FREE)
    middle = (GRID > 0.1) & (GRID < 0.9)
    both = (model.decode(model.sample(256, seed)), free.curves)
    usual, ours = (np.log(np.maximum(curves[:, middle], _LEAST)).mean(axis=1) for curves in both)
    stops = usual.mean() / ours.mean() * (order + np.median(free.exposure_errors, axis=0))
    found = fit(stops, EXACT)
    power = usual.std() / abs(usual.mean())
    logs, bands = np.log(np.maximum(found.curves, _LEAST)), {}
    for level, band in found.bands.items():  # an uncertain power widens them in log irradiance
        wide = NormalDist().inv_cdf(0.5 + level / 2) * power * np.abs(logs)
        low, high = (np.hypot(np.log(np.maximum(edge, _LEAST)) - logs, wide) for edge in band)
        bands[level] = found.curves * np.exp(-low), found.curves * np.exp(high)
    said = "the exposures are estimated from the photographs: any power of the curve fits as well, as its band says"
    return _told(replace(found, bands=bands), [said] * len(found))


def black_floor(images: Sequence[ArrayLike | Reduced], exposures: ArrayLike, curves: Array) -> Array:
    """Return the brightness of each curve (c, 1024) from which on brightness follows the exposure, (c,); 0 is usual.

    Scans, lifted blacks and stray light have a floor that does not. The pixels of a level rise, in the next longer
    exposure, to where the curve says; where they rise by less than half as much, their level is no light.
    """
    stops = as_stops(exposures, len(images))
    levels, stops, pairs = _longer(_as_reduced(images), stops)
    if len(curves) == 1:
        levels = levels.reshape(len(levels), -1, 1)
    told = evaluate(curves, np.arange(256) / 255)
    edges = [_floor(levels[..., c], stops, g, pairs) for c, g in enumerate(told)]
    return np.array(edges) / 255.0


def find_white(images: Sequence[Reduced], exposures: ArrayLike) -> float:
    """Return the brightness from which on a series counts as saturated: 254/255, or less where the photographs tell.

    Video levels end at 235 of 255, some sensors fill below their greatest number, and lossy files leave white areas
    uneven. White is where photographs end alike although one was exposed longer; what was white in the shorter one
    tells how uneven it is in the longer one.
    """
    levels, _, pairs = _longer(images, as_stops(exposures, len(images)))
    counts = np.stack([np.bincount(each.ravel(), minlength=256) for each in levels])
    reach = counts[:, ::-1].cumsum(axis=1)[:, ::-1]  # how many reach each level
    ends = (reach > _ENDS * reach[:, :1]).sum(axis=1) - 1
    top = int(ends.max())
    near, far = max(top - _UNEVEN, 0), max(top - 3 * _UNEVEN, 0)
    full = (ends >= top - 1) & (2 * reach[:, near] > reach[:, far])
    # Where no more reach it in the longer exposure, both are the same photograph.
    grown = [(k, j) for k, j in pairs if full[k] and full[j] and reach[k, near] < reach[j, near]]
    still = [levels[j][levels[k] >= top - 1] for k, j in grown]
    white = np.concatenate([np.empty(0), *still])
    white = white[white > far]  # what is darker has moved
    if not white.size:
        return SATURATED
    level = min(top, int(np.quantile(white, _FEW_UNEVEN, method="lower")))
    return min(SATURATED, (level - 1) / 255)


def _longer(images: Sequence[Reduced], stops: Array) -> tuple[NDArray[np.int16], Array, list[tuple[int, int]]]:
    """Return levels (e, m, c) and stops in the order of exposure, and the pairs of each with the next longer one."""
    order = np.argsort(stops, kind="stable")
    following = np.searchsorted(stops[order], stops[order] + _LONGER)
    pairs = [(k, later) for k, later in enumerate(following) if later < len(stops)]
    return np.stack([image.pixels for image in images])[order].astype(np.int16), stops[order], pairs


def _floor(levels: NDArray[np.int16], stops: Array, curve: Array, pairs: list[tuple[int, int]]) -> int:
    """Return the first of 256 levels, of photographs (e, pixels), that follows the exposure."""
    every = np.arange(256)
    # Strictly rising, so that it can be inverted.
    light = np.log2(np.maximum(np.maximum.accumulate(curve), 1e-12)) + 1e-9 * every
    sums = np.zeros((3, 256))
    for early, late in pairs:
        use = levels[late] < _RISEN
        now, rise = levels[early][use], (levels[late] - levels[early])[use]
        many = np.bincount(now, minlength=256)
        expected = np.interp(light + stops[late] - stops[early], light, every) - every
        sums += np.bincount(now, rise, 256), many * expected, many
    risen, rises, count = (np.convolve(row, np.ones(3), "same") for row in sums)
    slow, seen = risen < 0.5 * rises, count > _FLOOR_SHARE * max(count.sum(), 1)
    still, following = (np.flatnonzero(each[:_DARK]) for each in (slow & seen, ~slow & seen))
    # A floor is one range of levels: what stands still above levels that follow again is no black, but moves, say.
    above = following[following > still.min(initial=_DARK)].min(initial=_DARK)
    return int(still[still < above].max(initial=-1)) + 1


def _told(found: Calibration, sentences: Sequence[str]) -> Calibration:
    """Add a warning to each set; an empty one is none."""
    pairs = zip(found.warnings, sentences, strict=True)
    return replace(found, warnings=tuple((*old, text) if text else old for old, text in pairs))


def with_contradictions(found: Calibration, names: Sequence[str]) -> Calibration:
    """Warn of photographs, of those names, that are not as far from the one before as their exposures say."""
    given = found.observations.exposures
    if given is None:
        return found
    order = np.argsort(given[0], kind="stable")
    steps, off = np.diff(given[0, order]), np.diff(np.median(found.exposure_errors, axis=0)[order])
    said = [
        f"{names[late]} is {_apart(step + more)} {names[early]}; its exposure says {_apart(step)} it"
        for early, late, step, more in zip(order[:-1], order[1:], steps, off, strict=True)
        if abs(more) > _CONTRADICTS
    ]
    if said:
        said.append("where exposures are wrong, --exposures estimate takes the photographs' word")
    return replace(found, warnings=tuple((*texts, *said) for texts in found.warnings))


def _apart(stops: float) -> str:
    return f"{abs(stops):.1f} stops {'above' if stops >= 0 else 'below'}"


def _names(images: Sequence[Reduced]) -> list[str]:
    return [image.name or f"photograph {i + 1}" for i, image in enumerate(images)]


def _independent(found: Calibration) -> Array:
    """Return the share of the blocks that tell something of their own, (n,), by the autocorrelation of their residuals.

    It is 1 over the integrated autocorrelation time along brightness, 1 + 2 (rho_1 + rho_2 + ...), where the sum ends
    before the first lag at which rho is near 0; as in Geyer 1992, "Practical Markov chain Monte Carlo",
    doi:10.1214/ss/1177011137.
    """
    counts = found.observations.counts
    order = np.argsort(np.where(counts, found.observations.brightness, np.inf), axis=2, kind="stable")
    counts, off = (np.take_along_axis(each, order, axis=2) for each in (counts, np.where(counts, found.residuals, 0.0)))
    far = _OUTLIER * np.ma.median(np.ma.array(np.abs(off), mask=~counts).reshape(len(off), -1), axis=1).filled(0.0)
    off = np.clip(off, -far[:, None, None], far[:, None, None])
    lags = range(min(_LAGS, off.shape[2]))
    products = [(off[..., : off.shape[2] - lag] * off[..., lag:]).sum(axis=(1, 2)) for lag in lags]
    pairs = [(counts[..., : off.shape[2] - lag] & counts[..., lag:]).sum(axis=(1, 2)) for lag in lags]
    alike = np.array(products) / np.maximum(np.array(pairs), 1)
    alike /= np.maximum(alike[0], 1e-30)
    return 1.0 / np.maximum(1.0, 2.0 * np.sum(alike * np.logical_and.accumulate(alike > _ALIKE), axis=0) - 1.0)


def _weighted(observations: Observations, share: Array, light: NDArray[np.bool_] | bool = True) -> Observations:
    """Leave out what is no light, and let a share of each set (n,) count, but `_VALUES` of each photograph at least."""
    counts = observations.counts
    free = counts.sum(axis=(1, 2)) - counts.any(axis=1).sum(axis=1)
    least = _VALUES * (counts.shape[1] - 1) / np.maximum(free, 1)
    return observations.weighed(light * np.minimum(1.0, np.maximum(share, least))[:, None, None])


def sample_series(
    images: Sequence[ArrayLike | Reduced], exposures: ArrayLike, *, seed: int = 0, per_channel: bool = False
) -> Observations:
    """Choose blocks of a series and return their brightness, ready to calibrate from.

    A block is 5 x 5 pixels of one channel: its mean beats noise. It must be neither black nor saturated anywhere in two
    exposures or more. By their brightness, averaged over all exposures, the blocks are divided into 32 strata of equal
    width; from each stratum equally many are drawn at random, among the flattest quarter, where photographs that are
    misaligned by a pixel still show the same. Where a block is partly clipped, it counts for nothing in that exposure.

    `images`, (h, w) or (h, w, 3), of 8 or 16 bits, show one static scene; or they are what `reduce_image` gives of
    them. `exposures` (e,) are in stops. A set has 256 blocks, or fewer of more than 128 photographs.

    With `per_channel` each channel makes a set of its own, else all of them together one, as of a camera with one
    response for all. Means over channels are not taken: a response is nonlinear, so the mean of its values is not its
    value at the mean.
    """
    photographs = _as_reduced(images)
    stops = as_stops(exposures, len(photographs))
    white = find_white(photographs, stops)
    every = [image.blocks.copy() for image in photographs]
    for blocks in every:
        blocks[2][blocks[2] >= white] = 1.0
    n = min(_BLOCKS, max(_STRATA, _MOST_CELLS // len(every)))
    channels = range(every[0].shape[1])
    groups = [[c] for c in channels] if per_channel else [list(channels)]
    rng = np.random.default_rng(check_seed(seed))
    drawn = [
        _drawn(np.stack([blocks[:, group].reshape(3, -1) for blocks in every], axis=1), stops, n, rng)
        for group in groups
    ]
    # Shorter sets are filled with blocks of brightness 0, which are not measured.
    longest = max(blocks.shape[2] for blocks in drawn)
    filled = np.stack([np.pad(blocks, ((0, 0), (0, 0), (0, longest - blocks.shape[2]))) for blocks in drawn])
    measured = _measured(np.moveaxis(filled, 1, 0))
    return Observations(filled[:, 0], exposures=stops, clipped=~measured, weights=measured)


def _as_reduced(images: Iterable[ArrayLike | Reduced]) -> list[Reduced]:
    """Reduce two or more images one by one, but for those that are reduced already."""
    reduced = [image if isinstance(image, Reduced) else reduce_image(image) for image in images]
    if len(reduced) < 2:
        raise InputError(f"the series has {len(reduced)} images; use two or more of one scene at different exposures")
    for i, image in enumerate(reduced):
        _check_alike(i, (image.dtype, image.shape), (reduced[0].dtype, reduced[0].shape))
    return reduced


def as_images(images: Iterable[Any]) -> Iterator[Image]:
    """Yield images as arrays (h, w, c) with c = 1 or 3, all alike; none is kept."""
    first: Kind | None = None
    for i, image in enumerate(images):
        refuse_masked("images", image)
        array = np.atleast_3d(np.asarray(image))
        dtype, shape = kind = array.dtype, array.shape
        if dtype not in (np.uint8, np.uint16) or len(shape) != 3 or shape[2] not in (1, 3) or not array.size:
            raise InputError(f"image {i} is {dtype} of shape {shape}; use uint8 or uint16, (h, w) or (h, w, 3)")
        first = first or kind
        _check_alike(i, kind, first)
        yield array


def _check_alike(i: int, kind: Kind, first: Kind) -> None:
    if kind != first:
        kinds = "image 0 is {} {}, image {} {} {}".format(*first, i, *kind)
        raise InputError(f"{kinds}; use images of one size and depth, aligned with each other")


def as_stops(exposures: ArrayLike, n: int) -> Array:
    """Return the exposures of `n` images in stops: finite, not all equal, and not too far apart."""
    stops = as_numbers("exposures", exposures)
    if stops.shape != (n,) or not np.isfinite(stops).all():
        raise InputError(f"exposures={stops.tolist()} do not match {n} images; use one finite number of stops an image")
    if not 0 < np.ptp(stops) <= _STOPS:
        use = f"use unequal ones, {_STOPS:g} stops apart or less, or estimate"
        raise InputError(f"the exposures of {n} images span {np.ptp(stops):g} stops; {use}")
    return stops


def _blocks(plane: Image) -> Array:
    """Return mean, least and greatest brightness of the blocks of one plane, shape (3, m)."""
    import cv2

    side = min(_SIDE, *plane.shape)
    rows, columns = (length // side for length in plane.shape)
    # Of large photographs some rows of blocks; of those, then, some blocks.
    every = int(np.sqrt(max(1, rows * columns // _MOST_BLOCKS)))
    chosen = (np.arange(0, rows, every)[:, None] * side + np.arange(side)).ravel()
    cut, rows = np.ascontiguousarray(plane[chosen, : columns * side]), len(chosen) // side
    kernel, first = np.ones((side, side), np.uint8), side // 2
    white = np.iinfo(plane.dtype).max
    mean = cv2.resize(cut.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
    # Erosion and dilation give the extremes around every pixel; those around the centres are the blocks'.
    extremes = (of(cut, kernel)[first::side, first::side] for of in (cv2.erode, cv2.dilate))
    step = max(1, mean.size // _MOST_BLOCKS)
    mean, low, high = (each.ravel()[::step].astype(np.float64) / white for each in (mean, *extremes))
    return np.stack([np.clip(mean, low, high), low, high])


def _measured(blocks: Array) -> NDArray[np.bool_]:
    """Say which blocks are neither black nor saturated anywhere; mean, least and greatest come first."""
    _, low, high = blocks
    return np.asarray((low > 0.0) & (high < SATURATED))


def _drawn(blocks: Array, stops: Array, n: int, rng: np.random.Generator) -> Array:
    """Draw at most `n` blocks (3, e, n) of one set (3, e, blocks) from its strata."""
    usable = _measured(blocks).sum(axis=0) >= 2
    if not usable.any():
        raise InputError(f"none of {usable.size} blocks is unclipped in two exposures; use less extreme exposures")
    candidates = blocks[..., usable]
    chosen = candidates[..., _stratified(candidates, n, rng)]
    _check_change(chosen, stops)  # of these, as most blocks of a dark scene stay dark
    return chosen


def _check_change(blocks: Array, stops: Array) -> None:
    """Refuse a scene that does not get brighter from the least to the greatest exposure that measured it."""
    order = np.argsort(stops, kind="stable")
    mean, measured = blocks[0, order], _measured(blocks)[order]
    least, greatest = np.argmax(measured, axis=0), len(order) - 1 - np.argmax(measured[::-1], axis=0)
    each = np.arange(mean.shape[1])
    change = float(np.median(mean[greatest, each] - mean[least, each]))
    if change < _CHANGE:
        raise InputError(
            f"brightness changes by {change:.3g} where exposure rises; use exposures in the order of the images, "
            "of a still scene, from a camera that does not brighten them by itself"
        )
    doublings = np.log2(mean[greatest, each] / mean[least, each])
    told = stops[order][greatest] - stops[order][least]
    if np.median(doublings - _MOST_CHANGE * told) > 0:
        seen = f"brightness doubles {np.median(doublings):.2g} times where exposures say {np.median(told):.2g} stops"
        raise InputError(f"{seen}, as no camera does; give exposures in stops, log2 of times")


def _stratified(blocks: Array, n: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return the indices of at most `n` blocks, equally many of each stratum where there are so many."""
    (mean, low, high), measured = blocks, _measured(blocks)
    level = mean.mean(axis=0)  # rises with radiance even where single exposures are clipped
    span = np.where(measured, high - low, 0.0).sum(axis=0) / measured.sum(axis=0)
    edges = np.linspace(level.min(), level.max(), _STRATA + 1)[1:-1]
    stratum = np.searchsorted(edges, level, side="right")
    quota, draw = n // _STRATA, rng.random(level.size)
    rough = _ranks(stratum, span, draw)
    flat = np.flatnonzero(rough < np.maximum(quota, _FLATTEST * np.bincount(stratum)[stratum]))
    return flat[_ranks(stratum[flat], draw[flat]) < quota]


def _ranks(group: NDArray[np.intp], *keys: Array) -> NDArray[np.intp]:
    """Return the rank of each entry inside its group, from 0, by the first key and where that ties the next."""
    order = np.lexsort((*keys[::-1], group))
    first = np.searchsorted(group[order], group[order])
    ranks = np.empty(len(group), dtype=np.intp)
    ranks[order] = np.arange(len(group)) - first
    return ranks
