"""A model at the observed brightnesses, with its derivatives."""

import numpy as np

from crfbench.curves import Array, evaluate
from crfbench.models import ResponseModel


def looked_up(model: ResponseModel, free: Array, brightness: Array) -> tuple[Array, Array]:
    """Look the curves of free parameters up.

    Parameters
    ----------
    model : ResponseModel
    free : ndarray, shape (m, k)
    brightness : ndarray, shape (m, e, p)

    Returns
    -------
    irradiance : ndarray, shape (m, e, p)
    slope : ndarray, shape (m, e, p, k)
        Its derivatives by the free parameters.
    """
    params, at = model.from_free(free), brightness.reshape(len(free), -1)
    curves, jacobian = model.decode_with_jacobian(params)
    slope = evaluate(np.swapaxes(jacobian, 1, 2), at[:, None]) * model.free_slope(params)[:, :, None]
    shape = brightness.shape
    return evaluate(curves, at).reshape(shape), np.moveaxis(slope, 1, 2).reshape(*shape, model.n_params)
