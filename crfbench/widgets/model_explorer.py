"""Curves against models: pick a curve, drag a model's parameters or fit them, and see how far it gets."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import anywidget
import numpy as np
import traitlets
from numpy.typing import ArrayLike

from crfbench.checks import as_numbers
from crfbench.curves import Array, as_curves, axis_labels
from crfbench.errors import InputError
from crfbench.metrics import mse, nonmonotone, out_of_range, rmse
from crfbench.models import ResponseModel
from crfbench.widgets.assets import join

_REACH = 4.0  # standard deviations on either side of the mean
_LEAST_SD = 1e-2  # of a parameter that is the same for all curves, so that its slider still moves something


@dataclass(frozen=True)
class _Travel:
    """How the sliders of a model map to its parameters: position = (free - mean) / sd, all of shape (k,)."""

    model: ResponseModel
    mean: Array
    sd: Array

    @classmethod
    def over(cls, model: ResponseModel, curves: Array) -> "_Travel":
        """Take the travel from the model's prior over `curves`, leaving the caller's own prior alone."""
        prior = copy(model).learn_prior(curves).prior_
        assert prior is not None  # noqa: S101 - learn_prior has just set it
        return cls(model, prior.mean, np.maximum(np.sqrt(np.diag(prior.covariance)), _LEAST_SD))

    def params(self, positions: ArrayLike) -> Array:
        return self.model.from_free(self.mean + self.sd * np.asarray(positions, dtype=np.float64))

    def positions(self, params: Array) -> Array:
        return (self.model.to_free(params) - self.mean) / self.sd

    def ends(self) -> tuple[Array, Array]:
        """Return the lowest and highest positions; `from_free` may stop before the full reach."""
        reach = np.full(self.model.n_params, _REACH)
        return self.positions(self.params(-reach)).round(9), self.positions(self.params(reach)).round(9)


class ModelExplorer(anywidget.AnyWidget):
    """Curves beside models whose parameters are sliders; every value can be read and set from Python too.

    A slider moves one free parameter over its mean and 4 standard deviations on either side, as fitted to
    `curves`, and shows the parameter itself. Python decodes; the page only draws.

    Parameters
    ----------
    names : sequence of str
        One a curve.
    curves : array_like, shape (n, 1024), n > 1
        Of the models' direction.
    models : sequence of ResponseModel
        One or more, all of one direction, no two with the same name and number of parameters.

    Raises
    ------
    InputError
        For arguments that do not fit together, and for values set later that do not fit.

    Examples
    --------
    >>> from crfbench.curves import GRID
    >>> from crfbench.models import Gamma
    >>> explorer = ModelExplorer(["dark", "bright"], [GRID**2.0, GRID**0.5], [Gamma()])
    >>> explorer.index = 1
    >>> explorer.fit()
    >>> explorer
    ModelExplorer(curve='bright', model='Gamma(1)')
    >>> round(explorer.params[0], 6)
    0.5
    """

    _esm = join("controls.js", "plot.js", "wishes.js", "model_explorer.js")
    _css = join("widgets.css")
    #: What can be chosen and what the axes show; set once.
    _choices = traitlets.Dict().tag(sync=True)
    #: All that is drawn, in one trait, so that the page never sees half of a change, nor does a saved notebook.
    _scene = traitlets.Dict().tag(sync=True)

    def __init__(self, names: Sequence[str], curves: ArrayLike, models: Sequence[ResponseModel]) -> None:
        super().__init__()
        self._curves = as_curves(curves)
        self._names = _check_names(names, len(self._curves))
        self._models = _by_name(models)
        self._travels: dict[str, _Travel] = {}
        self._index, self._show_valid, self._request = 0, False, ""
        x_label, y_label = axis_labels(models[0].direction)
        self._choices = {"names": self._names, "models": list(self._models), "xLabel": x_label, "yLabel": y_label}
        self.on_msg(self._receive)
        self.model_name = next(iter(self._models))

    def __repr__(self) -> str:
        return f"ModelExplorer(curve={self._names[self._index]!r}, model={self._name!r})"

    @property
    def index(self) -> int:
        """Which curve is shown, from 0."""
        return self._index

    @index.setter
    def index(self, index: int) -> None:
        n = len(self._curves)
        if isinstance(index, bool) or not isinstance(index, int | np.integer) or not 0 <= index < n:
            raise InputError(f"index={index!r} is no curve; use a whole number from 0 to {n - 1}")
        self._index = int(index)
        self._draw()

    @property
    def model_name(self) -> str:
        """Which model is shown, for example "GGCM(3)"; setting it starts at the model's mean parameters."""
        return self._name

    @model_name.setter
    def model_name(self, name: str) -> None:
        if name not in list(self._models):
            raise InputError(f"model_name={name!r} is not here; use one of {', '.join(self._models)}")
        self._name = name
        self.reset()

    @property
    def params(self) -> tuple[float, ...]:
        """The model's parameters; setting them moves the sliders, to their ends if they lie beyond."""
        return tuple(self._params.tolist())

    @params.setter
    def params(self, params: ArrayLike) -> None:
        self._place(params)
        self._draw()

    @property
    def show_valid(self) -> bool:
        """Whether the nearest valid curve to the decoded one is drawn as well."""
        return self._show_valid

    @show_valid.setter
    def show_valid(self, show: bool) -> None:
        if not isinstance(show, bool):
            raise InputError(f"show_valid={show!r} is no switch; use True or False")
        self._show_valid = show
        self._draw()

    @property
    def curve(self) -> Array:
        """The decoded curve, shape (1024,)."""
        return self._decoded.copy()

    def fit(self) -> None:
        """Set the parameters with the least MSE to the shown curve."""
        self._place(self._models[self._name].fit(self._curves[self._index])[0])
        error = rmse(self._decoded, self._curves[self._index])
        self._draw(f"Fitted {self._name} to {self._names[self._index]}: RMSE {error:.4g}")

    def reset(self) -> None:
        """Set the mean parameters over all curves."""
        self.params = self._travel().params(np.zeros(self._models[self._name].n_params))

    def _travel(self) -> _Travel:
        """Return the travel of the model's sliders, learned when the model is first shown."""
        if self._name not in self._travels:
            self._travels[self._name] = _Travel.over(self._models[self._name], self._curves)
        return self._travels[self._name]

    def _receive(self, _widget: object, wish: dict[str, Any], _buffers: object) -> None:
        """Do what the page asks; the scene that results carries the number of the request as its answer."""
        self._request = wish["request"]
        match wish["kind"]:
            case "fit":
                self.fit()
            case "reset":
                self.reset()
            case "positions":
                self.params = self._travel().params(wish["value"])
            case "index" | "model_name" | "show_valid" as name:
                setattr(self, name, wish["value"])

    def _place(self, params: ArrayLike) -> None:
        self._params, self._decoded = _decode(self._models[self._name], params)

    def _draw(self, message: str = "") -> None:
        nearest = _samples(self._models[self._name].nearest_valid(self._params)) if self._show_valid else None
        self._scene = {
            "answered": self._request,
            "index": self._index,
            "model": self._name,
            "sliders": self._sliders(),
            "message": message,
            "target": _samples(self._curves[self._index]),
            "decoded": _samples(self._decoded),
            "valid": nearest,
            **_judge(self._decoded, self._curves[self._index]),
        }

    def _sliders(self) -> list[dict[str, float | str]]:
        travel = self._travel()
        columns = (*travel.ends(), travel.positions(self._params), self._params)
        rows = zip(travel.model.param_names, *(column.tolist() for column in columns), strict=True)
        return [dict(zip(("name", "min", "max", "position", "param"), row, strict=True)) for row in rows]


def _check_names(names: Sequence[str], n: int) -> list[str]:
    if isinstance(names, str) or len(names) != n or n < 2:
        raise InputError(f"{len(names)} names do not fit {n} curves; use two or more curves and one name a curve")
    return [str(name) for name in names]


def _by_name(models: Sequence[ResponseModel]) -> dict[str, ResponseModel]:
    named = {f"{model.name}({model.n_params})": model for model in models}
    if not models or len(named) < len(models) or len({model.direction for model in models}) > 1:
        raise InputError(f"models={list(models)!r} do not fit; use one or more different ones, all of one direction")
    return named


def _decode(model: ResponseModel, params: ArrayLike) -> tuple[Array, Array]:
    values = as_numbers("params", params).copy()
    if values.shape != (model.n_params,):
        raise InputError(f"params of shape {values.shape} do not fit {model!r}; use ({model.n_params},)")
    return values, as_curves(model.decode(values))[0]


def _samples(curve: Array) -> bytes:
    """Return what the page draws, float32; what leaves the picture need not be told exactly."""
    return np.clip(curve, -1e3, 1e3).astype("<f4").tobytes()


def _judge(curve: Array, target: Array) -> dict[str, float | bool]:
    steps = np.stack([curve[:-1], curve[1:]], axis=1)
    return {
        "rmse": float(rmse(curve, target)),
        "mse": float(mse(curve, target)),
        "falls": int(nonmonotone(steps).sum()),
        "inRange": not bool(out_of_range(curve)[0]),
    }
