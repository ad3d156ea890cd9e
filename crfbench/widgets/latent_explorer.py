"""The latent slider: drag one number, or three, and watch the response that an SLR decodes from it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import traitlets
from numpy.typing import ArrayLike

from crfbench.checks import as_numbers, check_choice
from crfbench.curves import GRID, Array, axis_labels
from crfbench.datasets import Responses
from crfbench.errors import InputError
from crfbench.files import write_new
from crfbench.models.registry import ModelKey, load_model, pretrained_models
from crfbench.models.slr import SLR
from crfbench.widgets.assets import SyncedTrait, bundle, join
from crfbench.widgets.page import LivingWidget, page

_STRIDE = 11  # 1023 = 3 * 11 * 31, so that every eleventh sample, 94 in all, includes both ends
_ROUNDING = 1e-9  # of a latent
_TITLE = "The latent slider"
_SPELLING = {"ldl": "LDL", "auc": "AUC", "aae": "AAE", "vae": "VAE", "dorf": "DoRF", "opencrf": "OpenCRF"}

Shown = str | ModelKey | SLR


class LatentExplorer(LivingWidget):
    """A slider for each latent of an SLR, the decoded response, and the latents of its training curves.

    The page decodes, from weights that it gets once, so the curve follows the hand at once and also where no Python
    runs: in a page that `to_html` wrote, and, with the shown model alone, in a notebook converted to HTML.

    Besides the curve, the page says which power x^gamma is nearest in least squares (the best of a table of
    exponents, polished by golden section) and which of the measured curves, by RMSE; both look at every eleventh
    sample, 94 of the 1024.

    `latent` and `model` are traits that Python and the page share. The latent of a one-latent model is a plain number,
    so that ``observe`` and ``link``, ``jslink`` with an ipywidgets slider work as with any widget; of several latents
    it is a tuple.

    Parameters
    ----------
    models : str, ModelKey or SLR, or a sequence of them, or a mapping of str to SLR
        One or more; the first is shown first. Names are those of `crfbench.load_model`.
    responses : Responses, optional
        Measured curves, of which the nearest is named and drawn. Exported pages hold only those whose licence is known.

    Examples
    --------
    >>> explorer = LatentExplorer("SLR-ldl-1")
    >>> seen = []
    >>> explorer.observe(lambda change: seen.append(change["new"]), "latent")
    >>> explorer.latent = 1.5
    >>> explorer, seen
    (LatentExplorer(model='SLR-ldl-1', latent=1.5), [1.5])
    >>> explorer.curve.shape
    (1024,)

    Linked with a slider, and with no Python in between:

    >>> from ipywidgets import FloatSlider, jslink
    >>> slider = FloatSlider(min=-4, max=4)
    >>> _ = jslink((slider, "value"), (explorer, "latent"))
    """

    _esm = bundle("latent_explorer.js")
    _css = join("widgets.css")
    _choices = traitlets.Dict().tag(sync=True)
    _moved_by_both = frozenset({"model", "latent"})

    @SyncedTrait
    def model(self, model: object) -> str:
        """Name of the model that is shown; a new one keeps the latent if it has as many, and starts at 0 otherwise."""
        return check_choice("model", model, self.models)

    @SyncedTrait
    def latent(self, latent: ArrayLike) -> float | tuple[float, ...]:
        """Latent of the shown model: a number, or a tuple of several; beyond -4 or 4 the sliders stay at their ends."""
        k = self.models[self.model].n_params
        values = np.atleast_1d(as_numbers("latent", latent))
        if values.shape != (k,) or not np.isfinite(values).all():
            raise InputError(f"latent={latent!r} is not valid for {self.model}; use {k} finite number{'s' * (k > 1)}")
        # An ipywidgets slider answers what a link tells it with the same number, rounded otherwise. That is no move.
        shown = self.latent if self.trait_has_value("latent") else np.nan
        if shown is not None and np.size(shown) == k and np.allclose(values, shown, rtol=0, atol=_ROUNDING):
            return shown
        return float(values[0]) if k == 1 else tuple(values.tolist())

    def __init__(self, models: Shown | Sequence[Shown] | Mapping[str, SLR], responses: Responses | None = None) -> None:
        # Before `super`, which checks the traits and sends them to the page.
        self.models = _by_name(models)
        self._responses = responses
        first = next(iter(self.models))
        start = np.zeros(self.models[first].n_params)
        super().__init__(model=first, latent=start, _choices=_choices(self.models, responses))

    @classmethod
    def pretrained(cls, responses: Responses | None = None) -> "LatentExplorer":
        """Show all pretrained models, the one-latent inverse LDL model first."""
        return cls(sorted(map(str, pretrained_models()), key=lambda name: name != "SLR-ldl-1"), responses)

    def __repr__(self) -> str:
        return f"LatentExplorer(model={self.model!r}, latent={self.latent})"

    @traitlets.observe("model")
    def _fit_latent(self, _change: object) -> None:
        k = self.models[self.model].n_params
        if np.size(self.latent) != k:
            self.latent = np.zeros(k)

    @property
    def curve(self) -> Array:
        """The decoded curve, shape (1024,), of the model's direction."""
        return self.models[self.model].decode(np.atleast_1d(self.latent))

    def to_csv(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the curve as two columns, irradiance and brightness."""
        forward = self.models[self.model].direction == "forward"
        columns = (GRID, self.curve) if forward else (self.curve, GRID)
        rows = [f"{irradiance:.9g},{brightness:.9g}" for irradiance, brightness in zip(*columns, strict=True)]
        write_new(path, "\n".join(["irradiance,brightness", *rows, ""]).encode(), overwrite)

    def to_html(self, path: str | Path, title: str = _TITLE, overwrite: bool = False) -> None:
        """Write one HTML page with all models, which works from a file and asks the network for nothing.

        Measured curves without a known licence stay out of it, since pages are made to be passed on.
        """
        write_new(path, page(self, title, self._public(self.models)).encode(), overwrite)

    def _alone(self) -> str:
        return page(self, _TITLE, self._public({self.model: self.models[self.model]}))

    def _public(self, models: Mapping[str, SLR]) -> dict[str, object]:
        """Return the state of a page that may be passed on."""
        return {"_choices": _choices(models, _with_licence(self._responses))}


def _by_name(models: Shown | Sequence[Shown] | Mapping[str, SLR]) -> dict[str, SLR]:
    if isinstance(models, Mapping):
        pairs = [(str(name), model) for name, model in models.items()]
    else:
        loaded = [_load(model) for model in ([models] if isinstance(models, Shown) else models)]
        pairs = [(str(ModelKey.of(model)), model) for model in loaded]
    if not pairs or len(dict(pairs)) < len(pairs):
        raise InputError(f"models={models!r} are none or have equal names; use one or more, and a mapping to name them")
    return dict(pairs)


def _load(model: Shown) -> SLR:
    loaded = model if isinstance(model, SLR) else load_model(model)
    if not isinstance(loaded, SLR):
        raise InputError(f"model {model!r} has no latent; use one such as 'SLR-ldl-1'")
    return loaded


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
    constraint, data = (str(model.metadata_.get(key, "")) for key in ("constraint", "data"))
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
