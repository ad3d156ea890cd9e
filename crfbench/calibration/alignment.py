"""The paper's loss: reference irradiance against decoded irradiance, aligned photograph by photograph.

    MSE_e = min over a_e, b_e of mean_p (r_p - a_e g(b_ep) - b_e)^2,    loss = sqrt(sum_e MSE_e^2)

in squared units of the reference. The minimum over a and b is taken in closed form, so that the loss and its
derivatives speak of the parameters alone. With `offset` False, b_e = 0: dark is zero.
"""

import numpy as np

from crfbench.calibration.looked_up import looked_up
from crfbench.calibration.observations import Observations
from crfbench.calibration.table import Table, in_parts
from crfbench.curves import Array
from crfbench.errors import InputError
from crfbench.models import ResponseModel
from crfbench.numerics import Objective

_TINY = 1e-12  # variance of decoded irradiance below which a curve is flat


class AlignedLoss:
    """The loss of `n` sets of observations; clipped patches count as they do in the paper, like any other.

    Parameters
    ----------
    observations : Observations
        With a reference.
    offset : bool
        Whether each photograph is aligned by scale and offset, or by scale alone.

    Raises
    ------
    InputError
        When the observations have no reference.
    """

    def __init__(self, observations: Observations, offset: bool = True) -> None:
        if observations.reference is None:
            raise InputError("the aligned loss compares with a reference and the observations have none; use 'map'")
        self.brightness, self.offset = observations.brightness, offset
        total = observations.weights.sum(axis=2, keepdims=True)
        self.weights = observations.weights / np.where(total > 0, total, 1.0)
        reference = np.broadcast_to(observations.reference[:, None], self.brightness.shape)
        self.reference = self._centre(reference[..., None], self.weights[..., None])[..., 0]
        self.power = (self.weights * self.reference**2).sum(axis=2)

    def on_table(self, table: Table) -> Array:
        """Return the loss of every row of a table, shape (n, t), in single precision."""
        n, e, p = self.brightness.shape
        return np.concatenate([self._on_table(table, rows) for rows in in_parts(n, e * p * len(table.free))])

    def _on_table(self, table: Table, rows: slice) -> Array:
        g = table.at(self.brightness[rows])
        w = self.weights[rows].astype(np.float32)[:, :, None]
        if self.offset:
            g -= w @ g  # first, because single precision loses the difference of two mean squares
        reference, power = self.reference[rows], self.power[rows]
        unit = np.sqrt(power.max(axis=1))  # so that the reference's own unit never leaves single precision
        unit[unit == 0] = 1.0
        along = (w * (reference / unit[:, None, None]).astype(np.float32)[:, :, None]) @ g
        g *= g
        gained = (along**2 / np.maximum(w @ g, _TINY))[:, :, 0]
        mse = np.maximum((power / unit[:, None] ** 2).astype(np.float32)[..., None] - gained, 0.0)
        return unit[:, None] ** 2 * np.sqrt(np.einsum("net,net->nt", mse, mse))

    def evaluate(self, model: ResponseModel, free: Array, rows: np.ndarray) -> tuple[Array, Array, Array]:
        """Return the MSE of each photograph (m, e), its gradient (m, e, k), and half its Gauss-Newton Hessian."""
        w = self.weights[rows][..., None]
        g, slope = looked_up(model, free, self.brightness[rows])
        g, slope = self._centre(g[..., None], w), self._centre(slope, w)
        square = np.maximum((w * g * g).sum(axis=2), _TINY)
        scale = (w * g * self.reference[rows][..., None]).sum(axis=2) / square
        residual = self.reference[rows][..., None] - scale[:, :, None] * g
        gradient = -2.0 * scale * (w * residual * slope).sum(axis=2)
        across = slope - g * ((w * g * slope).sum(axis=2) / square)[:, :, None]
        hessian = scale[..., None] ** 2 * (np.swapaxes(w * across, 2, 3) @ across)
        return (w * residual**2).sum(axis=(2, 3)), gradient, hessian

    def objective(self, model: ResponseModel, owner: np.ndarray) -> Objective:
        """Return the squared loss for `levenberg_marquardt`; problem i belongs to observations `owner[i]`."""

        def squared(free: Array, problems: np.ndarray) -> tuple[Array, Array, Array]:
            mse, gradient, hessian = self.evaluate(model, free, owner[problems])
            curved = np.einsum("mei,mej->mij", gradient, gradient) + 2.0 * np.einsum("me,meij->mij", mse, hessian)
            return (mse**2).sum(axis=1), curved, np.einsum("me,mek->mk", mse, gradient)

        return squared

    def _centre(self, values: Array, weights: Array) -> Array:
        """Take the mean over the patches off values (m, e, p, k), where there is an offset to align."""
        return values - (weights * values).sum(axis=2, keepdims=True) if self.offset else values
