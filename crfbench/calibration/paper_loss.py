"""The paper's loss, reference irradiance against decoded irradiance, and the search by which the paper minimises it.

    MSE_e = min over a_e, b_e of mean_p (r_p - a_e g(b_ep) - b_e)^2,    loss = sqrt(sum_e MSE_e^2)

in squared units of the reference, for patch p in photograph e. The minimum over a and b is taken in closed form, so
that the loss and its derivatives depend on the parameters alone.
"""

import numpy as np

from crfbench.calibration.observations import Observations
from crfbench.calibration.table import Table, chunks, evaluate_with_gradient
from crfbench.curves import N_SAMPLES, Array
from crfbench.errors import InputError
from crfbench.models import ResponseModel
from crfbench.numerics import Objective

_TINY = 1e-12  # variance of decoded irradiance below which a curve is flat


class AlignedLoss:
    """The loss of `n` sets of observations with a reference; clipped patches count as in the paper, like any other."""

    def __init__(self, observations: Observations) -> None:
        if observations.reference is None:
            raise InputError("the aligned loss compares with a reference and the observations have none; use 'map'")
        self.brightness = observations.brightness
        total = observations.weights.sum(axis=2, keepdims=True)
        self.weights = observations.weights / np.where(total > 0, total, 1.0)
        reference = np.broadcast_to(observations.reference[:, None], self.brightness.shape)
        self.reference = _centred(reference[..., None], self.weights[..., None])[..., 0]
        self.power = (self.weights * self.reference**2).sum(axis=2)

    def on_table(self, table: Table) -> Array:
        """Return the loss of every row of a table, shape (n, t), in single precision."""
        n, e, p = self.brightness.shape
        return np.concatenate([self._on_table(table, sets) for sets in chunks(n, e * p * len(table.params))])

    def _on_table(self, table: Table, sets: slice) -> Array:
        g = table.at(self.brightness[sets])
        w = self.weights[sets].astype(np.float32)[:, :, None]
        g -= w @ g  # first, because single precision loses the difference of two mean squares
        reference, power = self.reference[sets], self.power[sets]
        unit = np.sqrt(power.max(axis=1))  # so that the reference's own unit never leaves single precision
        unit[unit == 0] = 1.0
        along = (w * (reference / unit[:, None, None]).astype(np.float32)[:, :, None]) @ g
        g *= g
        # What the best scale explains of the reference's power; the rest is the MSE.
        gained = (along**2 / np.maximum(w @ g, _TINY))[:, :, 0]
        mse = np.maximum((power / unit[:, None] ** 2).astype(np.float32)[..., None] - gained, 0.0)
        return unit[:, None] ** 2 * np.sqrt(np.einsum("net,net->nt", mse, mse))

    def evaluate(self, model: ResponseModel, z: Array, sets: np.ndarray) -> tuple[Array, Array, Array]:
        """Return the MSE of each photograph (m, e), its gradient (m, e, k), and half its Gauss-Newton Hessian."""
        w = self.weights[sets][..., None]
        g, slope = evaluate_with_gradient(model, z, self.brightness[sets])
        g, slope = _centred(g[..., None], w), _centred(slope, w)
        square = np.maximum((w * g * g).sum(axis=2), _TINY)
        scale = (w * g * self.reference[sets][..., None]).sum(axis=2) / square
        residual = self.reference[sets][..., None] - scale[:, :, None] * g
        # At the best scale and offset the loss does not change with them, so the gradient needs the slope of g alone.
        gradient = -2.0 * scale * (w * residual * slope).sum(axis=2)
        # The Hessian does: a change of g that a change of scale undoes costs nothing, and is projected out.
        across = slope - g * ((w * g * slope).sum(axis=2) / square)[:, :, None]
        hessian = scale[..., None] ** 2 * (np.swapaxes(w * across, 2, 3) @ across)
        return (w * residual**2).sum(axis=(2, 3)), gradient, hessian

    def objective(self, model: ResponseModel) -> Objective:
        """Return the squared loss, for `levenberg_marquardt`."""

        def squared(z: Array, sets: np.ndarray) -> tuple[Array, Array, Array]:
            mse, gradient, hessian = self.evaluate(model, z, sets)
            curved = np.einsum("mei,mej->mij", gradient, gradient) + 2.0 * np.einsum("me,meij->mij", mse, hessian)
            return (mse**2).sum(axis=1), curved, np.einsum("me,mek->mk", mse, gradient)

        return squared

    def value_and_gradient(self, model: ResponseModel, z: Array, sets: np.ndarray) -> tuple[Array, Array]:
        """Return the loss (m,) and its gradient (m, k)."""
        mse, gradient, _ = self.evaluate(model, z, sets)
        value = np.sqrt((mse**2).sum(axis=1))
        return value, np.einsum("me,mek->mk", mse, gradient) / np.maximum(value, 1e-300)[:, None]


def _centred(values: Array, weights: Array) -> Array:
    """Subtract the mean over the patches from values (m, e, p, k), which aligns the offset."""
    return values - (weights * values).sum(axis=2, keepdims=True)


def descend(
    loss: AlignedLoss, model: ResponseModel, starts: int, seed: int, steps: int = 600, rate: float = 1e-3
) -> Array:
    """Search as the paper does: Adam from N(0, 1) starts, the best end kept; return unconstrained parameters (n, k).

    All starts of all observations run side by side. A start is done when its loss moves by less than 1e-6, in
    squared units of the reference. Kingma and Ba 2015, arXiv:1412.6980.
    """
    n = len(loss.brightness)
    drawn = np.random.default_rng(seed).normal(size=(n, starts, model.n_params))
    parts = chunks(n, 4 * starts * N_SAMPLES)
    return np.concatenate([_adam(loss, model, drawn[part], np.arange(n)[part], steps, rate) for part in parts])


def _adam(loss: AlignedLoss, model: ResponseModel, drawn: Array, sets: np.ndarray, steps: int, rate: float) -> Array:
    """Run all starts (m, s, k) of some sets of observations and return the best ends (m, k)."""
    m, starts, k = drawn.shape
    z, owner = drawn.reshape(-1, k).copy(), np.repeat(sets, starts)
    first, second = np.zeros_like(z), np.zeros_like(z)
    value = np.full(len(z), np.inf)
    active = np.arange(len(z))  # starts that still move; the others are not evaluated again
    for step in range(1, steps + 1):
        now, gradient = loss.value_and_gradient(model, z[active], owner[active])
        moved = np.abs(now - value[active]) >= 1e-6
        value[active] = now
        active, gradient = active[moved], gradient[moved]
        if not active.size:
            break
        first[active] = 0.9 * first[active] + 0.1 * gradient
        second[active] = 0.999 * second[active] + 0.001 * gradient**2
        unbiased = first[active] / (1 - 0.9**step), second[active] / (1 - 0.999**step)
        z[active] -= rate * unbiased[0] / (np.sqrt(unbiased[1]) + 1e-8)
    best = np.argmin(loss.value_and_gradient(model, z, owner)[0].reshape(m, starts), axis=1)
    return z.reshape(m, starts, k)[np.arange(m), best]
