"""Calibration by hand: choose patches of a colour chart, see the inverse response they give and its RMSE."""

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
import traitlets

from crfbench.calibration import Calibration, Observations, Table, calibrate, decode_table
from crfbench.checks import check_choice, check_count
from crfbench.curves import Array, evaluate
from crfbench.datasets import middlebury
from crfbench.datasets.chart import N_PATCHES
from crfbench.errors import InputError
from crfbench.metrics import rmse
from crfbench.models import ModelKey, ResponseModel, load_model
from crfbench.widgets.assets import StoredWidget, SyncedTrait, bundle, join, picture

MODELS = (
    "SLR-ldl-1", "SLR-baseline-1", "SLR-monotone-1", "SLR-ldl-3", "SLR-monotone-3", "Polynomial-3", "GGCM-3",
    "EMoR-3", "Gamma-1", "PPISP-4", "Kernel-8",
)  # fmt: skip
_CHOICES = ("camera", "illumination", "model", "method", "patches")
_METHODS = {
    "posterior": "posterior (with bands)",
    "family": "posterior, no discrepancy",
    "map": "map (most probable)",
    "grid": "grid (least loss)",
    "lm": "lm (least loss)",
    "paper": "paper (takes seconds)",
}
_SHORTCUTS = {"3 greys": 3, "6 greys": 6, "12 patches": 12, "all 24": 24}  # so many, the most useful first
_CHART = 2  # the photograph whose colours the chart has: the third, neither dim nor burnt
_STRIDE = 3  # 1023 = 3 * 341, so that every third sample includes both ends
_UNCONSTRAINED_NAMES = {"Gamma": "log gamma"}  # where the prior is not over the parameter itself


class CalibrationExplorer(StoredWidget):
    """A colour chart whose patches calibrate a camera, and the truth beside the curve that they give.

    The patches seen under one illumination give the inverse response; the RAW images under the *other* one judge it.
    Python calibrates; the page only draws. `camera`, `illumination`, `model`, `method` and `patches` are traits: read
    them, set them, `observe` them, or `link` them to another widget.

    Examples
    --------
    >>> explorer = CalibrationExplorer()
    >>> explorer.camera = "NikonD70"
    >>> explorer.patches = (19, 22, 24)
    >>> explorer
    CalibrationExplorer('NikonD70', illumination=1, 'SLR-ldl-1', 'posterior', patches=(19, 22, 24))
    >>> explorer.result.curves.shape
    (1, 1024)
    """

    _esm = bundle("calibration_explorer.js")
    _css = join("widgets.css", "calibration_explorer.css")
    _options = traitlets.Dict().tag(sync=True)
    #: All that is drawn, in one trait, so that the page never sees half of a change. Its "choice" says what it is of:
    #: while that differs from the traits, an answer is on its way.
    _scene = traitlets.Dict().tag(sync=True)

    def __init__(self) -> None:
        self._chart = middlebury.patch_arrays(middlebury.load_patches())
        # The model comes before the method, which is checked against it.
        super().__init__(
            _options=_options(self._chart.cameras),
            camera=self._chart.cameras[0],
            illumination=1,
            model="SLR-ldl-1",
            method="posterior",
            patches=middlebury.THREE_GREYS,
        )

    def _still(self) -> dict[str, str]:
        from crfbench.plots import plot_calibration

        axes = plot_calibration(self._result, patches=self._shown["patches"])
        brightness, irradiance = self._held_out()
        axes.scatter(brightness, irradiance, s=4, color="0.5", label="truth: RAW, the other illumination")
        axes.legend(loc="upper left", fontsize="small")
        return picture(axes)

    def __repr__(self) -> str:
        parts = f"{self.camera!r}, illumination={self.illumination}, {self.model!r}, {self.method!r}"
        return f"CalibrationExplorer({parts}, patches={self.patches})"

    @SyncedTrait
    def camera(self, camera: object) -> str:
        """Which of the 14 cameras is calibrated."""
        return check_choice("camera", camera, self._chart.cameras)

    @SyncedTrait
    def illumination(self, illumination: object) -> int:
        """Which illumination calibrates, 1 or 2; the other judges."""
        return check_count("illumination", illumination, most=len(middlebury.ILLUMINATIONS))

    @SyncedTrait
    def model(self, model: object) -> str:
        """Which of `MODELS`, for example "GGCM-3"; "grid" gives way to "lm" and back where the new one needs it."""
        return check_choice("model", model, MODELS)

    @SyncedTrait
    def method(self, method: object) -> str:
        """How, as in `calibrate`; "family" is "posterior" without discrepancy, "lm" for several parameters."""
        return check_choice("method", method, _methods(self.model))

    @SyncedTrait
    def patches(self, patches: object) -> tuple[int, ...]:
        """Which patches calibrate, from 1 to 24 row by row; where they are too few, `error` says so."""
        if not isinstance(patches, Iterable):
            raise InputError(f"patches={patches!r} is not a list; use whole numbers from 1 to {N_PATCHES}")
        return tuple(sorted({check_count("patches", patch, most=N_PATCHES) for patch in patches}))

    @property
    def result(self) -> Calibration:
        """The calibration that is shown; `InputError` where the present choice gives none."""
        if self.error:
            raise InputError(self.error)
        return self._result

    @property
    def rmse(self) -> float:
        """RMSE of the curve at the held-out JPEG intensities against the RAW ones, not aligned; see `result`."""
        jpeg, raw = self._held_out()
        return float(rmse(evaluate(self.result.curves, jpeg[None]), raw[None])[0])

    @property
    def error(self) -> str:
        """Why the present choice gives no calibration, or nothing."""
        return self._error

    @traitlets.observe(*_CHOICES)
    def _update(self, _change: object) -> None:
        if self.method not in _methods(self.model):
            # Only "grid" and "lm" depend on the model; both look for the least loss.
            self.method = "lm" if self.method == "grid" else "grid"
        choice = {name: getattr(self, name) for name in _CHOICES}
        # Traits that change together are heard of one after the other: the first time says it all.
        if choice != self._scene.get("choice"):
            self._scene = {"choice": choice, **self._describe()}

    def _describe(self) -> dict[str, Any]:
        """Return all that is drawn; where the choice gives no calibration, the last one stays."""
        self._error = ""
        try:
            self._result = self._calibrate()
            label = f"{self.model}, {self.method}"
            of = {"patches": list(self.patches), "label": label, "rmse": self.rmse}
            self._shown = {**of, **_show(self._result, _decoded(self.model)[1])}
        except InputError as error:
            self._error = str(error)
        return {
            "error": self._error,
            "colours": np.round(255 * self._chart.jpeg[self._at()][_CHART]).astype(np.uint8).tobytes(),
            "truth": _float32(self._held_out()),
            "shown": self._shown,
        }

    def _calibrate(self) -> Calibration:
        if not self.patches:
            raise InputError("no patch is chosen; choose 2 or more")
        at = self._at()
        jpeg, clipped = self._chart.jpeg[at], self._chart.clipped[at]
        seen = Observations.from_rgb(jpeg, middlebury.REFERENCE_IRRADIANCE, clipped=clipped)
        model, table = _decoded(self.model)
        chosen, alone = seen.take([patch - 1 for patch in self.patches]), self.method == "family"
        return calibrate(model, chosen, "posterior" if alone else self.method, discrepancy=not alone, table=table)

    def _at(self, held_out: bool = False) -> tuple[int, int]:
        """Return where the arrays hold the photographs that calibrate, or those that judge."""
        illumination = middlebury.ILLUMINATIONS.index(self.illumination)
        return self._chart.cameras.index(self.camera), 1 - illumination if held_out else illumination

    def _held_out(self) -> Array:
        """Return brightness and irradiance of all patches under the other illumination, shape (2, 96)."""
        at = self._at(held_out=True)
        return np.stack([kind[at].mean(axis=-1).ravel() for kind in (self._chart.jpeg, self._chart.raw)])


@cache
def _decoded(name: str) -> tuple[ResponseModel, Table]:
    """Return a model and the table of its curves, which is decoded once for all calibrations."""
    model = load_model(name)
    return model, decode_table(model)


def _methods(model: str) -> list[str]:
    return ["posterior", "family", "map", "grid" if ModelKey.parse(model).n_params == 1 else "lm", "paper"]


def _options(cameras: tuple[str, ...]) -> dict[str, object]:
    return {
        "cameras": cameras,
        "illuminations": list(middlebury.ILLUMINATIONS),
        "models": [{"name": name, "methods": _methods(name)} for name in MODELS],
        "methods": _METHODS,
        "shortcuts": [
            {"label": label, "patches": sorted(middlebury.PATCH_ORDER[:n])} for label, n in _SHORTCUTS.items()
        ],
        "reference": middlebury.REFERENCE_IRRADIANCE.tolist(),
    }


def _show(result: Calibration, table: Table) -> dict[str, Any]:
    return {
        "curve": _float32(result.curves[0, ::_STRIDE]),
        "bands": {str(level): _float32(np.stack(ends)[:, 0, ::_STRIDE]) for level, ends in result.bands.items()},
        "dots": _float32(np.stack(result.dots(0))),
        "dotPatches": np.nonzero(result.observations.counts[0])[1].tolist(),
        "range": result.brightness_range[0].tolist(),
        "density": _density(result, table) if result.model.n_params == 1 else None,
        "params": dict(zip(result.model.param_names, result.params[0].tolist(), strict=True)),
        "warnings": list(result.warnings[0]),
        "milliseconds": 1e3 * result.seconds,
    }


def _density(result: Calibration, table: Table) -> dict[str, Any]:
    """Return densities over the one unconstrained parameter: the prior; posterior and likelihood where there are."""
    from scipy.stats import norm

    z, model = table.unconstrained[:, 0], result.model
    rows = [np.exp(table.log_prior) / (z[1] - z[0])]
    if result.samples is not None:
        drawn, weights = result.samples.unconstrained[0, :, 0], result.samples.weights[0]
        if len(drawn) == len(z):  # samples are the rows of the table themselves
            likelihood = weights / rows[0]
            rows += [weights / (z[1] - z[0]), likelihood / likelihood.sum() / (z[1] - z[0])]
        else:  # or draws, equally likely
            width = max(float(np.std(drawn)) * len(drawn) ** -0.2, z[1] - z[0])  # Scott's rule
            rows.append(norm.pdf(z[:, None], drawn, width).mean(axis=1))
    densities = np.stack(rows)
    # Where each is less than a thousandth of its peak, nothing would be seen of it.
    seen = np.flatnonzero((densities > 1e-3 * densities.max(axis=1, keepdims=True)).any(axis=0))
    part = slice(seen[0], seen[-1] + 1)
    return {
        "name": _UNCONSTRAINED_NAMES.get(model.name, model.param_names[0]),
        "ends": z[part][[0, -1]].tolist(),
        "best": float(model.to_unconstrained(result.params)[0, 0]),
        "densities": [_float32(row) for row in densities[:, part]],
    }


def _float32(values: Array) -> bytes:
    return np.asarray(values).astype("<f4").tobytes()
