"""Learn the priors of the models with a formula, and EMoR's components, from DoRF; write data/dorf_priors.npz.

Run: python scripts/build_priors.py (with CRFBENCH_DATA set, or after `crfbench fetch dorf`).
"""

import io
from pathlib import Path
from typing import cast, get_args

import numpy as np
import pandas as pd

from crfbench.curves import Array, Direction
from crfbench.datasets import load_dorf, load_opencrf
from crfbench.datasets.responses import near_copies
from crfbench.files import write_atomically
from crfbench.models import MODELS, ClosedForm, EMoR, Kernel, ModelKey, Prior

_FILM = 0.1
TARGET = Path(__file__).parents[1] / "data" / "dorf_priors.npz"


def main() -> None:
    learned: dict[str, np.ndarray] = {}
    responses = load_dorf()
    for direction in get_args(Direction):
        curves = responses.in_direction(direction)
        for kind, counts in MODELS.items():
            for k in counts:
                model = kind.from_curves(curves, k, direction)
                prior = learn_prior(model, curves)
                key = ModelKey(kind.name, "", k, direction)
                if isinstance(model, Kernel) and prior.centres is not None and prior.weights is not None:
                    learned[f"{key}.centres"], learned[f"{key}.weights"] = prior.centres, prior.weights
                    learned[f"{key}.basis"] = np.vstack([model.mean_, model.components_])
                else:
                    learned[f"{key}.mean"], learned[f"{key}.covariance"] = prior.mean, prior.covariance
        basis = EMoR.from_curves(curves, max(MODELS[EMoR]), direction)
        learned[f"basis-{direction}"] = np.vstack([basis.mean_, basis.components_]).astype(np.float32)
    content = io.BytesIO()
    np.savez_compressed(content, allow_pickle=False, **learned)
    write_atomically(TARGET, content.getvalue())
    print(f"{TARGET.name}: {len(learned)} arrays, {len(content.getvalue())} bytes")


def learn_prior(model: ClosedForm, curves: Array) -> Prior:
    if not isinstance(model, Kernel):
        return cast(Prior, model.learn_prior(curves).prior_)
    # Every curve is a centre; a group of near copies weighs like its square root, and films, which OpenCRF holds, for
    # a tenth: most of what is calibrated are digital cameras.
    more = load_opencrf()
    every = np.concatenate([curves, more.in_direction(model.direction)])
    labels = near_copies(curves), pd.factorize(np.array(more.units))[0]
    own, film = (1.0 / np.sqrt(np.bincount(each)[each]) for each in labels)
    weights = np.concatenate([own, _FILM * film])
    return cast(Prior, model.learn_prior(every, weights).prior_)


if __name__ == "__main__":
    main()
