"""Curves against models: pick a curve, drag a model's parameters or fit them, and see how far it gets."""

from collections.abc import Sequence
from copy import copy
from typing import Any

import numpy as np
import traitlets
from numpy.typing import ArrayLike

from crfbench.checks import as_finite, check_choice, check_count
from crfbench.curves import Array, as_curves, axis_labels
from crfbench.errors import InputError
from crfbench.metrics import mse, nonmonotone, out_of_range, rmse
from crfbench.models import ModelKey, ResponseModel
from crfbench.widgets.assets import StoredWidget, SyncedTrait, bundle, join, picture

_REACH = 4.0  # standard deviations on either side of the mean
_LEAST_SD = 1e-2  # of a parameter that is the same for all curves, so that its slider still moves something


class ModelExplorer(StoredWidget):
    """Curves beside models whose parameters are sliders; every value can be read and set from Python too.

    Beside the plot stand the model's formula and a photograph through curve and model. A slider moves one unconstrained
    parameter over its mean and 4 standard deviations on either side, as fitted to `curves`, and shows the parameter
    itself. Python decodes; the page only draws. `index`, `model`, `params` and `show_valid` are traits, for ``observe``
    and ``link``; so is `best`, the least RMSE reached by hand, by curve and model.

    Parameters
    ----------
    names : sequence of str
        One a curve.
    curves : array_like, shape (n, 1024), n > 1
        Of the models' direction.
    models : sequence of ResponseModel
        One or more, all of one direction, no two with the same name and number of parameters.

    Examples
    --------
    >>> from crfbench.curves import GRID
    >>> from crfbench.models import Gamma
    >>> explorer = ModelExplorer(["dark", "bright"], [GRID**2.0, GRID**0.5], [Gamma()])
    >>> explorer.index = 1
    >>> explorer.fit()
    >>> explorer
    ModelExplorer(curve='bright', model='Gamma-1')
    >>> round(explorer.params[0], 6)
    0.5
    """

    _esm = bundle("model_explorer.js")
    _css = join("widgets.css")
    _choices = traitlets.Dict().tag(sync=True)
    #: All that is drawn, in one trait, so that the page never sees half of a change, nor does a saved notebook.
    _scene = traitlets.Dict().tag(sync=True)
    best = traitlets.Dict().tag(sync=True)

    @SyncedTrait
    def index(self, index: object) -> int:
        """Which curve is shown, from 0."""
        return check_count("index", index, least=0, most=len(self._curves) - 1)

    @SyncedTrait
    def model(self, model: object) -> str:
        """Name of the model that is shown, such as "GGCM-3"; a new one starts at its mean parameters."""
        return check_choice("model", model, self.models)

    @SyncedTrait
    def params(self, params: ArrayLike) -> tuple[float, ...]:
        """Parameters of the model; beyond their sliders' ends the sliders stay there."""
        model = self.models[self.model]
        values = as_finite("params", params)
        if values.shape != (model.n_params,):
            raise InputError(f"params have shape {values.shape}, wrong for {model!r}; use ({model.n_params},)")
        model.decode(values)  # refuses what lies outside the model's domain
        return tuple(values.tolist())

    @SyncedTrait
    def show_valid(self, show: object) -> bool:
        """Whether the nearest valid curve to the decoded one is drawn as well."""
        if not isinstance(show, bool):
            raise InputError(f"show_valid={show!r} is not a valid switch; use True or False")
        return show

    def __init__(self, names: Sequence[str], curves: ArrayLike, models: Sequence[ResponseModel]) -> None:
        # Before `super`, which checks the traits and draws the first scene.
        self._curves = as_curves(curves)
        self._names = _check_names(names, len(self._curves))
        self.models = _by_name(models)
        # The page's request that the next scene answers, and what it says besides.
        self._request, self._message = "", ""
        self._travels: dict[str, tuple[Array, Array]] = {}
        first = next(iter(self.models))
        x_label, y_label = axis_labels(models[0].direction)
        choices = {"names": self._names, "models": list(self.models), "xLabel": x_label, "yLabel": y_label}
        super().__init__(index=0, show_valid=False, model=first, params=self._mean(first), _choices=choices)
        self.on_msg(self._receive)

    def _still(self) -> dict[str, str]:
        from crfbench.plots import plot_comparison

        direction = self.models[self.model].direction
        return picture(plot_comparison(self._curves[self.index], {self.model: self.curve}, direction=direction))

    def __repr__(self) -> str:
        return f"ModelExplorer(curve={self._names[self.index]!r}, model={self.model!r})"

    @property
    def curve(self) -> Array:
        """The decoded curve, shape (1024,)."""
        return self.models[self.model].decode(self.params)

    def fit(self) -> None:
        """Set the parameters with the least MSE to the shown curve."""
        model, target = self.models[self.model], self._curves[self.index]
        params = model.fit(target)[0]
        error = rmse(model.decode(params), target)
        self._message = f"Fitted {self.model} to {self._names[self.index]}: RMSE {error:.4g}"
        self.params = params
        if self._message:  # the parameters were these already, so nothing has been drawn
            self._draw()

    def reset(self) -> None:
        """Set the mean parameters over all curves."""
        self.params = self._mean(self.model)

    @traitlets.observe("index", "model", "params", "show_valid")
    def _draw(self, change: Any = None) -> None:
        if change is not None and change["name"] == "model":
            self.reset()
        model, target, curve = self.models[self.model], self._curves[self.index], self.curve
        message, self._message = self._message, ""
        self._scene = {
            "answered": self._request,
            "index": self.index,
            "model": self.model,
            "equation": model.equation,
            "inverse": model.direction == "inverse",
            "sliders": self._sliders(),
            "message": message,
            "target": _samples(target),
            "decoded": _samples(curve),
            "valid": _samples(model.nearest_valid(np.array(self.params))) if self.show_valid else None,
            **_judge(curve, target),
        }

    def _receive(self, _widget: object, message: dict[str, Any], _buffers: object) -> None:
        """Do what the page asks; the scene that results carries the number of the request as its answer."""
        self._request = message["request"]
        match message["kind"]:
            case "fit":
                self.fit()
            case "reset":
                self.reset()
            case "positions":
                self.params = self._at(self.model, message["value"])
            case "index" | "model" | "show_valid" as name:
                setattr(self, name, message["value"])
        if self._scene["answered"] != self._request:  # nothing has changed
            self._draw()

    def _travel(self, name: str) -> tuple[Array, Array]:
        """Return the means and standard deviations of a model's unconstrained parameters over all curves.

        They are learned when the model is first shown, by a copy, since the caller's model may have a prior of its own.
        """
        if name not in self._travels:
            prior = copy(self.models[name]).learn_prior(self._curves).prior_
            assert prior is not None  # noqa: S101 - learn_prior has just set it
            self._travels[name] = prior.mean, np.maximum(np.sqrt(np.diag(prior.covariance)), _LEAST_SD)
        return self._travels[name]

    def _at(self, name: str, positions: ArrayLike) -> Array:
        """Return the parameters at these positions of the sliders, which are in standard deviations from the mean."""
        mean, sd = self._travel(name)
        return self.models[name].from_unconstrained(mean + sd * np.asarray(positions, dtype=np.float64))

    def _mean(self, name: str) -> Array:
        return self._at(name, np.zeros(self.models[name].n_params))

    def _positions(self, params: Array) -> Array:
        mean, sd = self._travel(self.model)
        return (self.models[self.model].to_unconstrained(params) - mean) / sd

    def _sliders(self) -> list[dict[str, float | str]]:
        model = self.models[self.model]
        # `from_unconstrained` may stop before the full reach.
        ends = [self._positions(self._at(self.model, side * np.ones(model.n_params))) for side in (-_REACH, _REACH)]
        columns = [*np.round(ends, 9), self._positions(np.array(self.params)), np.array(self.params)]
        notes = model.param_notes or ("",) * model.n_params
        rows = zip(model.param_names, notes, *(column.tolist() for column in columns), strict=True)
        return [dict(zip(("name", "note", "min", "max", "position", "param"), row, strict=True)) for row in rows]


def _check_names(names: Sequence[str], n: int) -> list[str]:
    if isinstance(names, str) or len(names) != n or n < 2:
        raise InputError(f"there are {len(names)} names for {n} curves; use two or more curves and one name a curve")
    return [str(name) for name in names]


def _by_name(models: Sequence[ResponseModel]) -> dict[str, ResponseModel]:
    named = {str(ModelKey.of(model)): model for model in models}
    if not models or len(named) < len(models) or len({model.direction for model in models}) > 1:
        raise InputError(f"models={list(models)!r} are not valid; use one or more different ones, all of one direction")
    return named


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
