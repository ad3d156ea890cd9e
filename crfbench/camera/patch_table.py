"""From photographs of a chart to the patch table, in the Middlebury table's columns, and from it to observations."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from crfbench.calibration import Observations
from crfbench.calibration.observations import colour_error
from crfbench.camera.measuring import PatchValues, find_chart, measure_chart, orient
from crfbench.camera.photographs import Pair, Problem, check_sizes, exposure_steps
from crfbench.camera.reading import Exif, read_exif, read_image, read_raw
from crfbench.camera.worker import WORKER
from crfbench.curves import Array
from crfbench.datasets.chart import chart_colours
from crfbench.datasets.middlebury import CLIPPED_SHARE, N_PATCHES
from crfbench.errors import FormatError, InputError

if TYPE_CHECKING:
    from pandas import DataFrame

_COLUMNS = (
    *("photograph", "camera", "exposure_step", "confidence", "patch"),
    *(f"{kind}_{value}" for kind in ("jpeg", "raw") for value in ("r", "g", "b", "clipped", "spread")),
)
_RAW_ERROR, _CHART_ERROR = 0.01, 0.05  # relative standard deviation of a patch's irradiance: measured, published
_DARKEST_RAW = 0.002  # of full scale; below, noise and the black level say more than the light
_ROUNDS = 20


class MeasuredChart(NamedTuple):
    """One photograph of a chart: where the chart lies, how surely, and its patches in the JPEG and in the RAW file."""

    corners: Array  # shape (4, 2); in chart order, x and y as fractions of the image
    confidence: float  # from 0 to 1
    jpeg: PatchValues
    raw: PatchValues | None
    exif: Exif


def measure_photograph(jpeg: Path, raw: Path | None = None, corners: ArrayLike | None = None) -> MeasuredChart:
    """Measure the chart in one photograph, decoding its files in this process.

    The chart lies at the same place in both files. Corners marked by hand, shape (4, 2), are clockwise from any corner
    on; without them the chart is sought in the JPEG.
    """
    pixels, exif = read_image(jpeg), read_exif(jpeg)
    found, confidence = find_chart(pixels) if corners is None else orient(pixels, corners)
    values = measure_chart(pixels, found)
    if raw is None:
        return MeasuredChart(found, confidence, values, None, exif)
    linear = read_raw(raw)
    (height, width), (raw_height, raw_width) = pixels.shape[:2], linear.shape[:2]
    check_sizes(Path(jpeg), (width, height), Path(raw), (raw_width, raw_height))
    return MeasuredChart(found, confidence, values, measure_chart(linear, found), exif)


def chart_table(
    pairs: Sequence[Pair], labels: Mapping[str, ArrayLike] | None = None
) -> tuple["DataFrame", dict[str, MeasuredChart], list[Problem]]:
    """Measure the chart in every photograph; one that cannot be measured is reported, the rest goes on.

    Parameters
    ----------
    pairs : sequence of Pair
        See `pair_photographs`; without a RAW file, its columns are NaN.
    labels : mapping of str to array_like, shape (4, 2), optional
        Corners by the name of the photograph (`load_labels`); in the other photographs the chart is sought.

    Returns
    -------
    patches : DataFrame
        One row a photograph and patch (1 to 24). ``{jpeg,raw}_{r,g,b,clipped,spread}`` are the `PatchValues`,
        ``exposure_step`` is in stops relative to the first photograph that tells its exposure (`exposure_steps`),
        ``camera`` the model by EXIF.
    measured : dict of str to MeasuredChart
        By the name of the photograph.
    problems : list of Problem
    """
    import pandas as pd

    measured: dict[str, MeasuredChart] = {}
    problems = []
    for pair in pairs:
        corners = (labels or {}).get(pair.name)
        try:
            measured[pair.name] = WORKER.run(measure_photograph, pair.jpeg, pair.raw, corners)
        except (FormatError, InputError) as error:
            problems.append(Problem(pair.jpeg, str(error)))
    steps = exposure_steps([photograph.exif for photograph in measured.values()])
    rows = [
        (name, photograph.exif.model, step, photograph.confidence, patch + 1, *values)
        for (name, photograph), step in zip(measured.items(), steps, strict=True)
        for patch, values in enumerate(np.column_stack([_values(photograph.jpeg), _values(photograph.raw)]).tolist())
    ]
    return pd.DataFrame(rows, columns=list(_COLUMNS)), measured, problems


def _values(values: PatchValues | None) -> Array:
    if values is None:
        return np.full((N_PATCHES, 5), np.nan)
    return np.column_stack([values.means, values.clipped, values.spread])


def observe_chart(patches: "DataFrame", exposures: ArrayLike | None = None) -> Observations:
    """Make observations of a measured patch table.

    Where every photograph has its RAW file, they tell the irradiance of the patches and the exposures; else the
    published colours of the chart do, and `exposures`, shape (e,), in stops; by default those of the table, if all are
    known.
    """
    rgb, raw = (_cube(patches, kind) for kind in ("jpeg", "raw"))
    clipped = _by_photograph(patches, "jpeg_clipped") >= CLIPPED_SHARE
    brightness, colour = rgb.mean(axis=-1), colour_error(rgb)
    if np.isfinite(raw).all():
        bad = _by_photograph(patches, "raw_clipped") >= CLIPPED_SHARE
        reference, steps = separate(raw.mean(axis=-1), bad)
        known = reference > 0  # a patch that no RAW file measured says nothing
        error = np.hypot(_RAW_ERROR, colour)
        reference, weights = np.where(known, reference, 1.0), known.astype(float)
        return Observations(
            brightness, reference, steps, clipped, weights=weights, reference_error=error, absolute=True
        )
    steps = np.asarray(_by_photograph(patches, "exposure_step")[:, 0] if exposures is None else exposures)
    if np.shape(steps) != (len(rgb),):
        raise InputError(f"there are {np.size(steps)} exposures for {len(rgb)} photographs with a chart; give one each")
    reference = np.maximum(chart_colours(), 0.0).mean(axis=1)
    known_steps = steps if np.isfinite(steps).all() else None
    return Observations(brightness, reference, known_steps, clipped, reference_error=np.hypot(_CHART_ERROR, colour))


def separate(raw: Array, clipped: np.ndarray) -> tuple[Array, Array]:
    """Split RAW intensities (e, p) into irradiance of patches times exposure of photographs: least squares of logs.

    The irradiance (p,) is in units of the first photograph that measures any, and 0 where no photograph does. The
    exposures (e,) are in stops, and 0 where a photograph measures nothing.
    """
    weight = np.where(clipped, 0.0, np.maximum(raw - _DARKEST_RAW, 0.0))
    logs = np.log(np.maximum(raw, _DARKEST_RAW))
    exposure = np.zeros(len(raw))
    # The best irradiances at given exposures are weighted means, and the other way round; in turn, both converge.
    for _ in range(_ROUNDS):
        irradiance = _mean(logs - exposure[:, None], weight, 0)
        exposure = _mean(logs - irradiance, weight, 1)
    first = exposure[np.argmax(weight.any(axis=1))]
    measured = weight.any(axis=0)
    return np.where(measured, np.exp(irradiance + first), 0.0), (exposure - first * weight.any(axis=1)) / np.log(2.0)


def _mean(values: Array, weight: Array, axis: int) -> Array:
    return np.asarray((weight * values).sum(axis=axis) / np.maximum(weight.sum(axis=axis), 1e-300))


def _by_photograph(patches: "DataFrame", column: str) -> Array:
    return np.asarray(patches[column].to_numpy().reshape(-1, N_PATCHES))


def _cube(patches: "DataFrame", kind: str) -> Array:
    """Return red, green and blue as (photographs, 24, 3)."""
    return patches[[f"{kind}_{channel}" for channel in "rgb"]].to_numpy(float).reshape(-1, N_PATCHES, 3)
