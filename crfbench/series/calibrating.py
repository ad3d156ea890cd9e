"""From an exposure series to inverse responses."""

from collections.abc import Sequence

from numpy.typing import ArrayLike

from crfbench.calibration import Calibration, Noise, Observations, calibrate
from crfbench.models import ResponseModel, load_model
from crfbench.series.sampling import sample_series

# Of its many blocks, neighbours in brightness repeat how a model misses the curve.
_INDEPENDENT = 24.0


def calibrate_series(
    images: Sequence[ArrayLike],
    exposures: ArrayLike,
    model: ResponseModel | None = None,
    method: str = "posterior",
    *,
    n: int = 256,
    seed: int = 0,
    per_channel: bool = False,
    exposure_error: float = 0.02,
) -> Calibration:
    """Find the inverse response of the camera that took a series.

    Parameters
    ----------
    images, exposures
        As in `sample_series`.
    model : ResponseModel, optional
        Of direction "inverse", with a prior; by default PPISP: a series that fills the range tells more than one
        number, and of uncommon responses, as of film, a single latent number misses much.
    method : {"posterior", "map"}
        As in `crfbench.calibration.calibrate`.
    n, seed, per_channel
        As in `sample_series`.
    exposure_error : float
        Standard deviation of each exposure in stops. Times as a camera names them, 1/60 for 1/64, call for 0.05.

    Returns
    -------
    Calibration
        One curve, or with `per_channel` one for each channel. Exposures alone tell no scale: where the data do not
        reach, that the curve ends in (1, 1) is the model's word.

    Raises
    ------
    InputError
        As `sample_series` and `calibrate`.
    """
    observations = sample_series(images, exposures, n=n, seed=seed, per_channel=per_channel)
    noise = _noise(observations, exposure_error)
    return calibrate(model or load_model("PPISP", 4), observations, method, noise=noise, seed=seed)


def _noise(observations: Observations, exposure_error: float) -> Noise:
    """Return noise under which the observations of a set count as `_INDEPENDENT` ones, however many they are."""
    measured = observations.counts.sum(axis=(1, 2)).mean()
    return Noise(exposure=exposure_error, independent=min(1.0, _INDEPENDENT / float(measured)))
