"""From a measured patch table to observations: what the RAW files, or else the chart itself, say of the irradiance."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from crfbench.calibration import Observations
from crfbench.calibration.observations import colour_error
from crfbench.curves import Array
from crfbench.datasets.colour_chart import chart_colours
from crfbench.datasets.middlebury import CLIPPED_SHARE, N_PATCHES
from crfbench.errors import InputError

if TYPE_CHECKING:
    from pandas import DataFrame

_RAW_ERROR, _CHART_ERROR = 0.01, 0.05  # relative standard deviation of a patch's irradiance: measured, published
_DARKEST_RAW = 0.002  # of full scale; below, noise and the black level say more than the light
_ROUNDS = 20


def observe_chart(patches: "DataFrame", exposures: ArrayLike | None = None) -> Observations:
    """Make observations of a measured patch table.

    Where every photograph has its RAW file, they tell the irradiance of the patches and the exposures; else the
    published colours of the chart do, and `exposures`.

    Parameters
    ----------
    patches : DataFrame
        From `crfbench.charts.chart_table`: rows are photographs x 24 patches.
    exposures : array_like, shape (e,), optional
        Of the photographs, in stops; used without RAW files. Default: those of the table, if all are known.

    Returns
    -------
    Observations
        One set of intensities.

    Raises
    ------
    InputError
        For an empty table or exposures of another number.
    """
    if patches.empty:
        raise InputError("no photograph with a chart is left; mark the corners with ChartLabeller, or use other files")
    rgb, raw = (_cube(patches, kind) for kind in ("jpeg", "raw"))
    clipped = patches["jpeg_clipped"].to_numpy().reshape(-1, N_PATCHES) >= CLIPPED_SHARE
    colour = colour_error(rgb)
    if np.isfinite(raw).all():
        bad = patches["raw_clipped"].to_numpy().reshape(-1, N_PATCHES) >= CLIPPED_SHARE
        reference, steps = separate(raw.mean(axis=-1), bad)
        known = reference > 0  # a patch that no RAW file measured says nothing
        return Observations(
            rgb.mean(axis=-1),
            np.where(known, reference, 1.0),
            steps,
            clipped,
            weights=known.astype(float),
            reference_error=np.hypot(_RAW_ERROR, colour),
            absolute=True,
        )
    steps = np.asarray(
        patches["exposure_step"].to_numpy().reshape(-1, N_PATCHES)[:, 0] if exposures is None else exposures
    )
    if np.shape(steps) != (len(rgb),):
        raise InputError(f"there are {np.size(steps)} exposures for {len(rgb)} photographs with a chart; give one each")
    return Observations(
        rgb.mean(axis=-1),
        np.maximum(chart_colours(), 0.0).mean(axis=1),
        steps if np.isfinite(steps).all() else None,
        clipped,
        reference_error=np.hypot(_CHART_ERROR, colour),
    )


def separate(raw: Array, clipped: np.ndarray) -> tuple[Array, Array]:
    """Split RAW intensities into irradiance of patches times exposure of photographs, by least squares of logarithms.

    Parameters
    ----------
    raw : ndarray, shape (e, p)
        In [0, 1] of full scale.
    clipped : ndarray of bool, shape (e, p)

    Returns
    -------
    irradiance : ndarray, shape (p,)
        In units of the first photograph that measures any; 0 where no photograph does.
    exposures : ndarray, shape (e,)
        In stops; 0 where a photograph measures nothing.
    """
    weight = np.where(clipped, 0.0, np.maximum(raw - _DARKEST_RAW, 0.0))
    logs = np.log(np.maximum(raw, _DARKEST_RAW))
    exposure = np.zeros(len(raw))
    for _ in range(_ROUNDS):
        irradiance = _mean(logs - exposure[:, None], weight, 0)
        exposure = _mean(logs - irradiance, weight, 1)
    first = exposure[np.argmax(weight.any(axis=1))]
    measured = weight.any(axis=0)
    return np.where(measured, np.exp(irradiance + first), 0.0), (exposure - first * weight.any(axis=1)) / np.log(2.0)


def _mean(values: Array, weight: Array, axis: int) -> Array:
    return np.asarray((weight * values).sum(axis=axis) / np.maximum(weight.sum(axis=axis), 1e-300))


def _cube(patches: "DataFrame", kind: str) -> Array:
    """Return red, green and blue as (photographs, 24, 3)."""
    return patches[[f"{kind}_{channel}" for channel in "rgb"]].to_numpy(float).reshape(-1, N_PATCHES, 3)
