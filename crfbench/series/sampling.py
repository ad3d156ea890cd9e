"""Choose what an exposure series is calibrated from: small flat blocks that cover the brightness range."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crfbench.calibration import Observations
from crfbench.calibration.observations import SATURATED
from crfbench.checks import check_count, check_seed
from crfbench.curves import Array
from crfbench.errors import InputError
from crfbench.series.checks import LEVELS, Image, as_series, as_stops

_SIDE = 5  # pixels of a block along each side
_STRATA = 32  # of equal width in brightness
_FLATTEST = 0.25  # share of a stratum that is drawn from
_CHANGE = 2 / 255  # of brightness from the least to the greatest exposure; less is noise


class _Blocks(NamedTuple):
    """Brightness, its range inside the block, and whether all its pixels are measured; each of shape (e, blocks)."""

    mean: Array
    span: Array
    measured: NDArray[np.bool_]

    def at(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> "_Blocks":
        return _Blocks(self.mean[:, chosen], self.span[:, chosen], self.measured[:, chosen])


def sample_series(
    images: Sequence[ArrayLike], exposures: ArrayLike, *, n: int = 256, seed: int = 0, per_channel: bool = False
) -> Observations:
    """Choose blocks of a series and return their brightness, ready to calibrate from.

    A block is 5 x 5 pixels of one channel: its mean beats noise. It must be neither black nor saturated anywhere in two
    exposures or more. By their brightness, averaged over all exposures, the blocks are divided into 32 strata of equal
    width; from each stratum equally many are drawn at random, among the flattest quarter, where photographs that are
    misaligned by a pixel still show the same.

    Parameters
    ----------
    images : sequence of array_like, each of shape (h, w) or (h, w, 3)
        Of one static scene, 8 or 16 bits.
    exposures : array_like, shape (e,)
        In stops.
    n : int
        How many blocks, at most, for each set of observations.
    seed : int
        Of the draw.
    per_channel : bool
        Whether each channel makes a set of its own, or all of them together one, as of a camera with one response for
        all. Means over channels are not taken: the mean of bent values is not the bent mean.

    Returns
    -------
    Observations
        One set, or with `per_channel` one for each channel, without a reference. Blocks that are partly clipped count
        for nothing in that exposure.

    Raises
    ------
    InputError
        For images or exposures that do not fit each other, no unclipped blocks, or a scene that does not get brighter
        with the exposure.
    """
    arrays = as_series(images)
    stops = as_stops(exposures, len(arrays))
    check_count("n", n, _STRATA)
    channels = range(arrays[0].shape[2])
    groups = [[c] for c in channels] if per_channel else [list(channels)]
    sets = [_blocks([array[..., c] for array in arrays for c in group], len(arrays)) for group in groups]
    rng = np.random.default_rng(check_seed(seed))
    brightness, measured = _stacked([_chosen(blocks, stops, n, rng) for blocks in sets])
    return Observations(brightness, exposures=stops, clipped=~measured, weights=measured)


def _blocks(planes: Sequence[Image], e: int) -> _Blocks:
    """Reduce the channels (h, w) of the first exposure, of the second, and so on up to `e`, to blocks."""
    parts = [_reduced(plane) for plane in planes]
    mean, low, high = (np.stack(part).reshape(e, -1) for part in zip(*parts, strict=True))
    return _Blocks(mean, high - low, (low > 0.0) & (high < SATURATED))


def _reduced(plane: Image) -> tuple[Array, Array, Array]:
    """Return mean, least and greatest brightness of the blocks of one plane."""
    import cv2

    side = min(_SIDE, *plane.shape)
    rows, columns = (length // side for length in plane.shape)
    cut = np.ascontiguousarray(plane[: rows * side, : columns * side])
    kernel, first = np.ones((side, side), np.uint8), side // 2
    white = LEVELS[plane.dtype] - 1
    mean = cv2.resize(cut.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
    extremes = (of(cut, kernel)[first::side, first::side] for of in (cv2.erode, cv2.dilate))
    low, high = (extreme.astype(np.float64) / white for extreme in extremes)
    return np.clip(mean.astype(np.float64) / white, low, high), low, high


def _chosen(blocks: _Blocks, stops: Array, n: int, rng: np.random.Generator) -> _Blocks:
    """Draw from the strata of one set."""
    usable = blocks.measured.sum(axis=0) >= 2
    if not usable.any():
        raise InputError(
            f"none of {usable.size} blocks is unclipped in two exposures; use exposures nearer to the scene"
        )
    candidates = blocks.at(usable)
    _check_change(candidates, stops)
    return candidates.at(_stratified(candidates, n, rng))


def _check_change(blocks: _Blocks, stops: Array) -> None:
    """Refuse a scene that does not get brighter from the least to the greatest exposure that measured it."""
    order = np.argsort(stops, kind="stable")
    mean, measured = blocks.mean[order], blocks.measured[order]
    least, greatest = np.argmax(measured, axis=0), len(order) - 1 - np.argmax(measured[::-1], axis=0)
    each = np.arange(mean.shape[1])
    change = float(np.median(mean[greatest, each] - mean[least, each]))
    if change < _CHANGE:
        raise InputError(
            f"brightness changes by {change:.3g} where exposure rises; use exposures in the order of the images, "
            "of a still scene, from a camera that does not brighten them by itself"
        )


def _stratified(blocks: _Blocks, n: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return the indices of at most `n` blocks, equally many of each stratum where there are so many."""
    level = blocks.mean.mean(axis=0)  # rises with radiance even where single exposures are clipped
    span = np.where(blocks.measured, blocks.span, 0.0).sum(axis=0) / blocks.measured.sum(axis=0)
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


def _stacked(sets: Sequence[_Blocks]) -> tuple[Array, NDArray[np.bool_]]:
    """Return brightness and what is measured, shape (sets, e, p); shorter sets are filled with what is not."""
    longest = max(blocks.mean.shape[1] for blocks in sets)
    mean = np.zeros((len(sets), len(sets[0].mean), longest))
    measured = np.zeros(mean.shape, dtype=bool)
    for i, blocks in enumerate(sets):
        filled = np.s_[i, :, : blocks.mean.shape[1]]
        mean[filled], measured[filled] = blocks.mean, blocks.measured
    return mean, measured
