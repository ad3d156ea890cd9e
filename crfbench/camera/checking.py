"""How straight a linearised photograph is: its patches against their RAW values."""

from typing import TYPE_CHECKING

import numpy as np

from crfbench.camera.files import CameraCalibration
from crfbench.charts import measure_chart, read_image
from crfbench.errors import InputError
from crfbench.passport import linearise

if TYPE_CHECKING:
    from pandas import DataFrame


def linearised_patches(result: CameraCalibration, name: str) -> "DataFrame":
    """Measure the chart in one photograph before and after it was linearised.

    Parameters
    ----------
    result : CameraCalibration
        Of photographs of a chart.
    name : str
        Of the photograph.

    Returns
    -------
    DataFrame
        One row a patch and channel, without the clipped ones. raw: share of full scale, NaN without a RAW file; jpeg:
        brightness; linear: irradiance by the calibration, each channel times the factor that brings it nearest to raw
        (white balance and exposure are no part of a response).

    Raises
    ------
    InputError
        For a photograph without a chart.
    """
    import pandas as pd

    if name not in result.measured:
        raise InputError(f"name={name!r} is no photograph with a chart; use one of {', '.join(result.measured)}")
    photograph = result.measured[name]
    pixels = linearise(read_image(result.photographs[name]).pixels, result.passport)
    linear = measure_chart(pixels, photograph.corners).means
    raw = np.full_like(linear, np.nan) if photograph.raw is None else photograph.raw.means
    kept = photograph.jpeg.clipped == 0
    if photograph.raw is not None:
        kept &= photograph.raw.clipped == 0
        linear = linear * (raw * linear)[kept].sum(axis=0) / (linear**2)[kept].sum(axis=0)
    patch, channel = np.indices(linear.shape)[:, kept].reshape(2, -1)
    columns = {"raw": raw[kept].ravel(), "jpeg": photograph.jpeg.means[kept].ravel(), "linear": linear[kept].ravel()}
    return pd.DataFrame({"patch": patch + 1, "channel": np.array(list("rgb"))[channel], **columns})
