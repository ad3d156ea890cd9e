"""The latent slider: drag one number, or three, and watch the response that an SLR decodes from it."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import anywidget
import numpy as np
import traitlets
from numpy.typing import ArrayLike

from crfbench.checks import as_numbers
from crfbench.curves import GRID, Array, axis_labels
from crfbench.datasets import Responses
from crfbench.errors import InputError
from crfbench.files import write_new
from crfbench.models.slr import SLR
from crfbench.models.weights import shipped_weights
from crfbench.widgets.assets import join
from crfbench.widgets.page import frame, page

_STRIDE = 11  # 1023 = 3 * 11 * 31, so that every eleventh sample, 94 in all, includes both ends
_TITLE = "The latent slider"
_SPELLING = {"ldl": "LDL", "auc": "AUC", "aae": "AAE", "vae": "VAE", "dorf": "DoRF", "opencrf": "OpenCRF"}


class LatentExplorer(anywidget.AnyWidget):
    """A slider for each latent of an SLR, the decoded response, and the latents of its training curves.

    The page decodes, from weights that it gets once, so the curve follows the hand at once and also where no Python
    runs: in a page that `to_html` wrote, and, with the shown model alone, in a notebook converted to HTML.

    Besides the curve, the page says which power x^gamma is nearest in least squares (the best of a table of
    exponents, polished by golden section) and which of the measured curves, by RMSE; both look at every eleventh
    sample, 94 of the 1024.

    Parameters
    ----------
    models : mapping of str to SLR, or sequence of SLR
        One or more; the first is shown first. Those of a sequence are named by their cards.
    responses : Responses, optional
        Measured curves, of which the nearest is named and drawn. Exported pages hold only those whose licence is known.

    Raises
    ------
    InputError
        For arguments that do not fit, and for values set later that do not fit.

    Examples
    --------
    >>> from crfbench.models import SLR
    >>> explorer = LatentExplorer({"untrained": SLR(seed=1)})
    >>> explorer.latent = 1.5
    >>> explorer
    LatentExplorer(model='untrained', latent=(1.5,))
    >>> explorer.curve.shape
    (1024,)
    """

    _esm = join("controls.js", "plot.js", "latent_explorer.js")
    _css = join("widgets.css")
    #: The models and the measured curves; set once.
    _choices = traitlets.Dict().tag(sync=True)
    #: What is shown, in one trait, so that neither side sees half of a change: model, latent, and how often Python
    #: has set them. The page repeats that number, which tells what it sent before it knew of Python's last change.
    _shown = traitlets.Dict().tag(sync=True)

    def __init__(self, models: Mapping[str, SLR] | Sequence[SLR], responses: Responses | None = None) -> None:
        super().__init__()
        self._models = _by_name(models)
        self._responses = responses
        self._said: dict[str, Any] = {}
        self._choices = _choices(self._models, responses)
        self.model_name = next(iter(self._models))

    @classmethod
    def shipped(cls, responses: Responses | None = None) -> "LatentExplorer":
        """Show all shipped models, the one-latent inverse LDL model first."""
        names = sorted(shipped_weights(), key=lambda name: name != "ldl-1-inverse")
        return cls({name: _load(name) for name in names}, responses)

    def __repr__(self) -> str:
        return f"LatentExplorer(model={self.model_name!r}, latent={self.latent})"

    @property
    def model_name(self) -> str:
        """Which model is shown; a new one keeps the latent if it has as many, and starts at 0 otherwise."""
        return str(self._shown["model"])

    @model_name.setter
    def model_name(self, name: str) -> None:
        if name not in list(self._models):
            raise InputError(f"model_name={name!r} is not here; use one of {', '.join(self._models)}")
        latent, k = self._shown.get("latent", []), self._models[name].n_params
        self._show(name, latent if len(latent) == k else [0.0] * k)

    @property
    def model(self) -> SLR:
        """The model that is shown; it can be set to another of those given."""
        return self._models[self.model_name]

    @model.setter
    def model(self, model: SLR) -> None:
        names = [name for name, known in self._models.items() if known is model]
        if not names:
            raise InputError(f"model={model!r} is not among those given; use one of {', '.join(self._models)}")
        self.model_name = names[0]

    @property
    def latent(self) -> tuple[float, ...]:
        """The latent; setting it moves the sliders, to their ends if it lies beyond -4 or 4."""
        return tuple(float(z) for z in self._shown["latent"])

    @latent.setter
    def latent(self, latent: ArrayLike) -> None:
        self._show(self.model_name, _check_latent(latent, self.model.n_params))

    @property
    def curve(self) -> Array:
        """The decoded curve, shape (1024,), of the model's direction."""
        return self.model.decode(self.latent)

    def to_csv(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the curve as two columns, irradiance and brightness.

        Raises
        ------
        InputError
            Where there is a file already and `overwrite` is false.
        """
        columns = (GRID, self.curve) if self.model.direction == "forward" else (self.curve, GRID)
        text = io.StringIO()
        np.savetxt(
            text, np.stack(columns, axis=1), fmt="%.9g", delimiter=",", header="irradiance,brightness", comments=""
        )
        write_new(path, text.getvalue().encode(), overwrite)

    def to_html(self, path: str | Path, title: str = _TITLE, overwrite: bool = False) -> None:
        """Write one HTML page with all models, which works from a file and asks the network for nothing.

        Measured curves without a known licence stay out of it, since pages are made to be passed on.

        Raises
        ------
        InputError
            Where there is a file already and `overwrite` is false.
        """
        write_new(path, page(self, title, self._public(self._models)).encode(), overwrite)

    def _show(self, name: str, latent: list[float]) -> None:
        self._said = {"model": name, "latent": latent, "revision": self._said.get("revision", 0) + 1}
        self._shown = self._said

    @traitlets.validate("_shown")
    def _refuse_the_outdated(self, proposal: Mapping[str, Any]) -> dict[str, Any]:
        """Keep what Python has said last from what the page sent before it heard of it."""
        shown: dict[str, Any] = proposal["value"]
        return shown if shown["revision"] >= self._said["revision"] else self._said

    def _repr_mimebundle_(self, **kwargs: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """Add a page of the shown model, which is what HTML made from a saved notebook can still show."""
        data, metadata = super()._repr_mimebundle_(**kwargs) or ({}, {})
        alone = page(self, _TITLE, self._public({self.model_name: self.model}))
        return {**data, "text/html": frame(alone, f"{self!r}: run this cell to see it.")}, metadata

    def _public(self, models: Mapping[str, SLR]) -> dict[str, object]:
        """Return the state of a page that may be passed on."""
        return {"_choices": _choices(models, _with_licence(self._responses))}


def _by_name(models: Mapping[str, SLR] | Sequence[SLR]) -> dict[str, SLR]:
    named = dict(models) if isinstance(models, Mapping) else {_name(model): model for model in models}
    if not named or len(named) < len(models):
        raise InputError(f"models={models!r} do not fit; use one or more, and a mapping where their cards agree")
    return {str(name): model for name, model in named.items()}


def _name(model: SLR) -> str:
    """Return a name like that of shipped weights."""
    kind = "-monotone" if model.monotone else ""
    return f"{model.card_.get('constraint', 'untrained')}{kind}-{model.n_params}-{model.direction}"


def _load(name: str) -> SLR:
    constraint, n_latent, direction = name.rsplit("-", 2)
    return SLR.load(constraint, int(n_latent), "forward" if direction == "forward" else "inverse")


def _check_latent(latent: ArrayLike, k: int) -> list[float]:
    values = np.atleast_1d(as_numbers("latent", latent))
    if values.shape != (k,) or not np.isfinite(values).all():
        raise InputError(f"latent={latent!r} does not fit; use {k} finite numbers")
    return values.tolist()


def _choices(models: Mapping[str, SLR], responses: Responses | None) -> dict[str, object]:
    """Return all that the page needs to know, with numbers as little-endian bytes."""
    directions = {model.direction for model in models.values()}
    curves = {direction: _thinned(responses, direction) for direction in directions} if responses else None
    packed = [_pack(name, model) for name, model in models.items()]
    return {"facets": _facets(models), "models": packed, "curves": curves, "stride": _STRIDE}


def _pack(name: str, model: SLR) -> dict[str, object]:
    layers = range(len(model.hidden) + 1)
    parts = [model.weights_[f"decoder.{i}.{kind}"] for i in layers for kind in ("weight", "bias")]
    x_label, y_label = axis_labels(model.direction)
    return {
        "name": name,
        "labels": list(model.param_names),
        "direction": model.direction,
        "monotone": model.monotone,
        "sizes": [model.n_params, *(len(bias) for bias in parts[1::2])],
        "weights": np.concatenate([part.ravel() for part in parts]).astype("<f4").tobytes(),
        "latents": model.weights_["latents"].astype("<f4").tobytes(),
        "xLabel": x_label,
        "yLabel": y_label,
    }


def _facets(models: Mapping[str, SLR]) -> list[dict[str, object]]:
    """Return what tells the models apart, most important first; their names too, if nothing else does."""
    rows = [_traits(name, model) for name, model in models.items()]
    if len({tuple(row.values()) for row in rows}) < len(rows):
        rows = [{**row, "Name": name} for row, name in zip(rows, models, strict=True)]
    return [{"title": title, "values": [row[title] for row in rows]} for title in rows[0]]


def _traits(name: str, model: SLR) -> dict[str, str]:
    constraint, data = (str(model.card_.get(key, "")) for key in ("constraint", "data"))
    return {
        "Constraint": _SPELLING.get(constraint, constraint) or name,
        "Latents": str(model.n_params),
        "Decoder": "monotone" if model.monotone else "plain",
        "Direction": model.direction,
        "Trained on": _SPELLING.get(data, data) or "unknown",
    }


def _thinned(responses: Responses, direction: str) -> dict[str, object]:
    """Return names and every eleventh sample, as shares of 65535."""
    samples = np.clip(responses.in_direction(direction)[:, ::_STRIDE], 0.0, 1.0)
    return {"names": list(responses.names), "samples": np.round(samples * 65535).astype("<u2").tobytes()}


def _with_licence(responses: Responses | None) -> Responses | None:
    known = [i for i, licence in enumerate(responses.licences) if licence != "unknown"] if responses else []
    return responses.select(known) if responses and known else None
