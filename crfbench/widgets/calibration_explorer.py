"""Calibration by hand: choose patches of a colour chart, see the inverse response they give and how far off it is."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, TypeVar

import anywidget
import numpy as np
import traitlets

from crfbench.calibration import Calibration, Observations, Table, calibrate, decode_table
from crfbench.curves import Array
from crfbench.datasets.middlebury import ILLUMINATIONS, N_PATCHES, REFERENCE_IRRADIANCE, load_patches, patch_arrays
from crfbench.errors import InputError
from crfbench.models import ResponseModel
from crfbench.models.ready import load_model
from crfbench.tables.calibration import THREE_GREYS, held_out_rmse
from crfbench.tables.stability import ORDER
from crfbench.widgets.assets import join

#: What calibrates; each can be chosen.
MODELS = {
    f"{name}({n_params})": (name, n_params)
    for name, n_params in (
        ("SLR-ldl", 1),
        ("SLR-baseline", 1),
        ("SLR-monotone", 1),
        ("SLR-ldl", 3),
        ("SLR-monotone", 3),
        ("Polynomial", 3),
        ("GGCM", 3),
        ("EMoR", 3),
        ("Gamma", 1),
        ("PPISP", 4),
    )
}
_METHODS = {
    "posterior": "posterior (with bands)",
    "map": "map (most probable)",
    "grid": "grid (least loss)",
    "lm": "lm (least loss)",
    "paper": "paper (takes seconds)",
}
_SHORTCUTS = {
    "3 greys": THREE_GREYS,
    "6 greys": ORDER[:6],
    "12 patches": ORDER[:12],
    "all 24": ORDER,
}
_CHART = 2  # the photograph whose colours the chart has: the third, neither dim nor burnt
_STRIDE = 3  # 1023 = 3 * 341, so that every third sample includes both ends
_T = TypeVar("_T")
_FREE_NAMES = {"Gamma": "log gamma"}  # where the prior is not over the parameter itself


@dataclass(frozen=True)
class _State:
    """What is chosen."""

    camera: str
    illumination: int = 1
    method: str = "posterior"
    model: str = "SLR-ldl(1)"
    patches: tuple[int, ...] = THREE_GREYS


class CalibrationExplorer(anywidget.AnyWidget):
    """A colour chart whose patches calibrate a camera, and the truth beside what they give.

    The patches seen under one illumination give the inverse response; the RAW images under the *other* one judge it.
    Every choice can be read and set from Python too. Python calibrates; the page only draws.

    Examples
    --------
    >>> explorer = CalibrationExplorer()
    >>> explorer.camera = "NikonD70"
    >>> explorer.patches = (19, 22, 24)
    >>> explorer
    CalibrationExplorer('NikonD70', illumination=1, 'SLR-ldl(1)', 'posterior', patches=(19, 22, 24))
    >>> explorer.result.curves.shape
    (1, 1024)
    """

    _esm = join("controls.js", "plot.js", "wishes.js", "calibration_explorer.js")
    _css = join("widgets.css", "calibration_explorer.css")
    #: What can be chosen; set once.
    _choices = traitlets.Dict().tag(sync=True)
    #: All that is drawn, in one trait, so that the page never sees half of a change.
    _scene = traitlets.Dict().tag(sync=True)

    def __init__(self) -> None:
        super().__init__()
        self._chart = patch_arrays(load_patches())
        self._request = ""
        self._shown: dict[str, Any] = {}
        self._choices = _choices(self._chart.cameras)
        self.on_msg(self._receive)
        self._change(_State(self._chart.cameras[0]))

    def __repr__(self) -> str:
        state = self._state
        parts = f"{state.camera!r}, illumination={state.illumination}, {state.model!r}, {state.method!r}"
        return f"CalibrationExplorer({parts}, patches={state.patches})"

    @property
    def camera(self) -> str:
        """Which of the 14 cameras is calibrated."""
        return self._state.camera

    @camera.setter
    def camera(self, camera: str) -> None:
        self._change(replace(self._state, camera=_one_of("camera", camera, self._chart.cameras)))

    @property
    def illumination(self) -> int:
        """Which illumination calibrates, 1 or 2; the other judges."""
        return self._state.illumination

    @illumination.setter
    def illumination(self, illumination: int) -> None:
        self._change(replace(self._state, illumination=_one_of("illumination", illumination, ILLUMINATIONS)))

    @property
    def method(self) -> str:
        """How: "posterior", "map", "paper", and "grid" for one parameter or "lm" for more; see `calibrate`."""
        return self._state.method

    @method.setter
    def method(self, method: str) -> None:
        self._change(replace(self._state, method=_one_of("method", method, _methods(self.model))))

    @property
    def model(self) -> str:
        """Which of `MODELS`, for example "GGCM(3)"; "grid" gives way to "lm" and back where the new one needs it."""
        return self._state.model

    @model.setter
    def model(self, model: str) -> None:
        methods = _methods(_one_of("model", model, MODELS))
        # Both lists have the least loss at the same place.
        method = methods[_methods(self.model).index(self.method)]
        self._change(replace(self._state, model=model, method=method))

    @property
    def patches(self) -> tuple[int, ...]:
        """Which patches calibrate, from 1 to 24 row by row; fewer than the calibrator needs leave `error`."""
        return self._state.patches

    @patches.setter
    def patches(self, patches: Iterable[int]) -> None:
        self._change(replace(self._state, patches=_check_patches(patches)))

    @property
    def result(self) -> Calibration:
        """The calibration that is shown.

        Raises
        ------
        InputError
            When the present choice gives none.
        """
        if self.error:
            raise InputError(self.error)
        return self._result

    @property
    def rmse(self) -> float:
        """RMSE of the curve at the held-out JPEG intensities against the RAW ones, not aligned; see `result`."""
        return self._judge(self.result)

    @property
    def error(self) -> str:
        """Why the present choice gives no calibration, or nothing."""
        return self._error

    def _receive(self, _widget: object, wish: dict[str, Any], _buffers: object) -> None:
        """Do what the page asks; the scene that results carries the number of the request as its answer."""
        self._request = wish["request"]
        if wish["kind"] in ("camera", "illumination", "method", "model", "patches"):
            setattr(self, wish["kind"], wish["value"])

    def _change(self, state: _State) -> None:
        self._state, self._error = state, ""
        try:
            self._result = self._calibrate()
            self._shown = self._describe()
        except InputError as error:
            self._error = str(error)
        self._draw()

    def _describe(self) -> dict[str, Any]:
        """Return what the page draws of the calibration."""
        label = f"{self.model}, {self.method}"
        return {"label": label, "rmse": self._judge(self._result), **_show(self._result, _table(self.model))}

    def _calibrate(self) -> Calibration:
        at, chosen = self._at(), self.patches
        if not chosen:
            raise InputError("no patch is chosen; choose 2 or more")
        seen = Observations.from_rgb(self._chart.jpeg[at], REFERENCE_IRRADIANCE, clipped=self._chart.clipped[at])
        kept = seen.take([patch - 1 for patch in chosen])
        return calibrate(_model(self.model), kept, self.method, table=_table(self.model))

    def _at(self, held_out: bool = False) -> tuple[int, int]:
        """Return where the arrays hold the photographs that calibrate, or those that judge."""
        illumination = ILLUMINATIONS.index(self.illumination)
        return self._chart.cameras.index(self.camera), 1 - illumination if held_out else illumination

    def _held_out(self) -> Array:
        """Return brightness and irradiance of all patches under the other illumination, shape (2, 96)."""
        at = self._at(held_out=True)
        return np.stack([kind[at].mean(axis=-1).ravel() for kind in (self._chart.jpeg, self._chart.raw)])

    def _judge(self, result: Calibration) -> float:
        jpeg, raw = self._held_out()
        return float(held_out_rmse(result.curves, jpeg[None], raw[None])[0])

    def _draw(self) -> None:
        self._scene = {
            "answered": self._request,
            **vars(self._state),
            "error": self._error,
            "colours": np.round(255 * self._chart.jpeg[self._at()][_CHART]).astype(np.uint8).tobytes(),
            "truth": _float32(self._held_out()),
            "shown": self._shown,
        }


@cache
def _model(name: str) -> ResponseModel:
    return load_model(*MODELS[name])


@cache
def _table(name: str) -> Table:
    return decode_table(_model(name))


def _methods(model: str) -> list[str]:
    """Return the methods that fit a model."""
    return ["posterior", "map", "grid" if MODELS[model][1] == 1 else "lm", "paper"]


def _choices(cameras: tuple[str, ...]) -> dict[str, object]:
    return {
        "cameras": cameras,
        "illuminations": list(ILLUMINATIONS),
        "models": [{"name": name, "methods": _methods(name)} for name in MODELS],
        "methods": _METHODS,
        "shortcuts": [{"label": label, "patches": patches} for label, patches in _SHORTCUTS.items()],
        "reference": REFERENCE_IRRADIANCE.tolist(),
    }


def _one_of(name: str, value: _T, known: Iterable[_T]) -> _T:
    values = list(known)
    if isinstance(value, bool) or value not in values:
        raise InputError(f"{name}={value!r} is not here; use one of {', '.join(map(str, values))}")
    return value


def _check_patches(patches: Iterable[int]) -> tuple[int, ...]:
    try:
        numbers = list(patches)
        whole = all(int(patch) == patch and not isinstance(patch, bool) for patch in numbers)
    except (TypeError, ValueError, OverflowError):
        whole = False
    if not whole or not {int(patch) for patch in numbers} <= set(range(1, N_PATCHES + 1)):
        raise InputError(f"patches={patches!r} do not fit; use whole numbers from 1 to {N_PATCHES}")
    return tuple(sorted({int(patch) for patch in numbers}))


def _show(result: Calibration, table: Table) -> dict[str, Any]:
    """Return what the page draws of a calibration."""
    return {
        "curve": _float32(result.curves[0, ::_STRIDE]),
        "bands": {str(level): _float32(np.stack(ends)[:, 0, ::_STRIDE]) for level, ends in result.bands.items()},
        "dots": _float32(np.stack(result.dots(0))),
        "range": result.brightness_range[0].tolist(),
        "belief": _belief(result, table) if result.model.n_params == 1 else None,
        "params": dict(zip(result.model.param_names, result.params[0].tolist(), strict=True)),
        "warnings": list(result.warnings[0]),
        "milliseconds": 1e3 * result.seconds,
    }


def _belief(result: Calibration, table: Table) -> dict[str, Any]:
    """Return densities over the one free parameter, where either counts: prior, and posterior if there is one."""
    free, model = table.free[:, 0], result.model
    rows = [np.exp(table.log_prior)] + ([result.belief.weights[0]] if result.belief else [])
    densities = np.stack(rows) / (free[1] - free[0])
    seen = np.flatnonzero((densities > 1e-3 * densities.max(axis=1, keepdims=True)).any(axis=0))
    part = slice(seen[0], seen[-1] + 1)
    return {
        "name": _FREE_NAMES.get(model.name, model.param_names[0]),
        "ends": free[part][[0, -1]].tolist(),
        "best": float(model.to_free(result.params)[0, 0]),
        "densities": [_float32(row) for row in densities[:, part]],
    }


def _float32(values: Array) -> bytes:
    return np.asarray(values).astype("<f4").tobytes()
