"""What a calibration gives."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from crfbench.calibration.likelihood import Likelihood, Noise
from crfbench.calibration.observations import Observations
from crfbench.calibration.posterior import PosteriorSamples
from crfbench.checks import check_count
from crfbench.curves import GRID, Array, evaluate, invert, repair
from crfbench.models import ResponseModel

if TYPE_CHECKING:
    from pandas import DataFrame

LEVELS = (0.5, 0.9)


@dataclass(frozen=True)
class Calibration:
    """Inverse responses from observations, one for each of the `n` sets.

    Parameters
    ----------
    model : ResponseModel
    method : str
    observations : Observations
    noise : Noise
        What `residuals` are weighed with.
    params : ndarray, shape (n, k)
        The best by the method's own measure.
    curves : ndarray, shape (n, 1024)
        Inverse responses (brightness to irradiance): of `params`, or with method "posterior" the posterior mean.
    warnings : tuple of tuples of str
        One tuple for each set.
    seconds : float
        For all of them.
    noise_scale : ndarray, shape (n,), optional
        By which factor the data scale the stated noise ("map", "posterior").
    samples : PosteriorSamples, optional
        The posterior itself ("posterior").
    bands : dict
        From level (0.5, 0.9) to the low and high curves, each (n, 1024), between which that share of the posterior
        lies at every brightness ("posterior").
    """

    model: ResponseModel
    method: str
    observations: Observations
    noise: Noise
    params: Array
    curves: Array
    warnings: tuple[tuple[str, ...], ...]
    seconds: float
    noise_scale: Array | None = None
    samples: PosteriorSamples | None = None
    bands: dict[float, tuple[Array, Array]] = field(default_factory=dict)

    def __repr__(self) -> str:
        model, warned = f"{self.model.name}({self.model.n_params})", sum(map(bool, self.warnings))
        return f"Calibration({model}, {self.method}, {len(self)} sets, {warned} with warnings)"

    def __len__(self) -> int:
        return len(self.params)

    @cached_property
    def brightness_range(self) -> Array:
        """Least and greatest brightness measured, (n, 2); beyond, model and prior speak alone."""
        measured = np.where(self.observations.counts, self.observations.brightness, np.nan)
        return np.stack([np.nanmin(measured, axis=(1, 2)), np.nanmax(measured, axis=(1, 2))], axis=1)

    @cached_property
    def residuals(self) -> Array:
        """Log irradiance of each patch less what reference and exposure tell, (n, e, p); 0.05 is 5 % too bright.

        At the exposures that fit best, and without a reference at the irradiances that do.
        """
        likelihood, every = Likelihood(self.observations, self.noise), slice(None)
        brightness = self.observations.brightness
        g = evaluate(self.curves, brightness.reshape(len(self), -1)).reshape(*brightness.shape, 1)
        d = likelihood.residual(g, every)
        d = (d - likelihood.squares(d, every)[1][:, :, None])[..., 0]
        if self.observations.reference is None:
            counted = likelihood.precision
            d = d - ((counted * d).sum(axis=1) / np.maximum(counted.sum(axis=1), 1e-300))[:, None]
        return np.asarray(d)

    @property
    def responses(self) -> Array:
        """Responses (irradiance to brightness), shape (n, 1024): the nearest valid curves, inverted."""
        return invert(repair(self.curves))

    def to_frame(self) -> "DataFrame":
        """Return one row for each set: parameters, brightness range, RMS residual, noise scale and warnings."""
        import pandas as pd

        frame = pd.DataFrame(self.params, columns=list(self.model.param_names))
        frame["darkest"], frame["brightest"] = self.brightness_range.T
        counts = self.observations.counts
        squares = np.where(counts, self.residuals**2, 0.0).sum(axis=(1, 2))
        frame["rms_residual"] = np.sqrt(squares / counts.sum(axis=(1, 2)))
        if self.noise_scale is not None:
            frame["noise_scale"] = self.noise_scale
        if self.samples is not None:
            frame["log_evidence"] = self.samples.log_evidence
        return frame.assign(warnings=["; ".join(each) for each in self.warnings])

    def dots(self, index: int = 0) -> tuple[Array, Array]:
        """Return brightness and aligned irradiance of the measured patches of one set, each of shape (m,)."""
        check_count("index", index, least=-len(self), most=len(self) - 1)
        counts = self.observations.counts[index]
        brightness = self.observations.brightness[index][counts]
        irradiance = np.interp(brightness, GRID, self.curves[index])
        # On the curve up to its residual: where the patch would lie if exposure and reference were exact.
        return brightness, irradiance * np.exp(-self.residuals[index][counts])
