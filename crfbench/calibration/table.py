"""A dense table of decoded curves: for one parameter it holds every curve that the model can make."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from crfbench.checks import check_count, check_seed
from crfbench.curves import N_SAMPLES, Array
from crfbench.errors import InputError
from crfbench.models import ResponseModel
from crfbench.models.base import Prior

ONE_PARAMETER, MORE_PARAMETERS = 512, 1024
_REACH = 5.0  # standard deviations of the prior, and the least reach of a free parameter
_FEWEST = 16  # rows
_BAND_STEP = 8  # bands are computed at every eighth sample
_CELLS = 2**19  # numbers in one array over the table; memory then grows with the results alone


@dataclass(frozen=True)
class Table:
    """Free parameters and their curves.

    Parameters
    ----------
    free : ndarray, shape (t, k)
        For one parameter in even steps, for more drawn from the prior.
    params : ndarray, shape (t, k)
    curves : ndarray of float32, shape (t, 1024)
    log_prior : ndarray, shape (t,)
        Log weight that each row has before any data; they sum to 1 as weights.
    """

    free: Array
    params: Array
    curves: NDArray[np.float32]
    log_prior: Array

    @cached_property
    def by_sample(self) -> NDArray[np.float32]:
        """The curves, sample by sample: (1024, t), so that a look-up reads neighbouring numbers."""
        return np.ascontiguousarray(self.curves.T)

    @cached_property
    def order(self) -> np.ndarray:
        """Rows in rising order of irradiance at every eighth sample, shape (129, t)."""
        return np.argsort(self.by_sample[band_samples()], axis=1, kind="stable")

    def at(self, brightness: Array) -> NDArray[np.float32]:
        """Look all curves up at brightnesses (...), linear between samples: (..., t)."""
        position = brightness * (N_SAMPLES - 1)
        left = np.minimum(position.astype(np.intp), N_SAMPLES - 2)
        share = (position - left).astype(np.float32)[..., None]
        low = self.by_sample[left]
        low += share * (self.by_sample[left + 1] - low)
        return low


def in_parts(n: int, cells: int) -> Iterator[slice]:
    """Split `n` sets of observations that need `cells` numbers each into parts that stay in the processor's cache."""
    size = max(1, _CELLS // max(cells, 1))
    return (slice(first, min(first + size, n)) for first in range(0, n, size))


def band_samples() -> np.ndarray:
    """Return the indices of the samples at which bands are computed: every eighth and the last."""
    return np.append(np.arange(0, N_SAMPLES, _BAND_STEP), N_SAMPLES - 1)


def learned_prior(model: ResponseModel) -> Prior:
    """Return the prior of a model.

    Raises
    ------
    InputError
        When it has none.
    """
    if not isinstance(model, ResponseModel):
        raise InputError(f"model is a {type(model).__name__}; use what load_model(name) gives")
    if model.prior_ is None:
        raise InputError(f"{model!r} has no prior; give it one with learn_prior(curves)")
    return model.prior_


def decode_table(model: ResponseModel, rows: int | None = None, seed: int = 0) -> Table:
    """Decode a table of the model's curves; calibrating many times, decode it once.

    Parameters
    ----------
    model : ResponseModel
        With a prior.
    rows : int, optional
        Default 512 for one parameter, 1024 draws for more.
    seed : int
        Of the draws.

    Raises
    ------
    InputError
        When the model has no prior, or for too few rows.
    """
    prior = learned_prior(model)
    if rows is not None:
        check_count("rows", rows, _FEWEST)
    check_seed(seed)
    if model.n_params == 1:
        mean, sd = prior.mean[0], np.sqrt(prior.covariance[0, 0])
        reach = max(_REACH * sd, _REACH)
        free = mean + np.linspace(-reach, reach, rows or ONE_PARAMETER)[:, None]
        log_prior = -0.5 * ((free[:, 0] - mean) / sd) ** 2
    else:
        free = np.concatenate([prior.mean[None], prior.sample((rows or MORE_PARAMETERS) - 1, seed)])
        log_prior = np.zeros(len(free))
    params = model.from_free(free)
    log_prior -= np.log(np.exp(log_prior - log_prior.max()).sum()) + log_prior.max()
    return Table(free, params, model.decode_float32(params), log_prior)
