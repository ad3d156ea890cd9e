"""Learn the priors of the models with a formula, and EMoR's components, from DoRF; write data/dorf_priors.npz.

Run: python scripts/build_priors.py (with CRFBENCH_DATA set, or after `crfbench fetch dorf`).
"""

import io
from pathlib import Path
from typing import get_args

import numpy as np

from crfbench.curves import Direction
from crfbench.datasets import load_dorf
from crfbench.files import write_atomically
from crfbench.models import MODELS, EMoR, ModelKey, Prior

TARGET = Path(__file__).parents[1] / "data" / "dorf_priors.npz"


def main() -> None:
    learned: dict[str, np.ndarray] = {}
    responses = load_dorf()
    for direction in get_args(Direction):
        curves = responses.in_direction(direction)
        for kind, counts in MODELS.items():
            for k in counts:
                model = kind.from_curves(curves, k, direction)
                prior = Prior.from_samples(model.to_unconstrained(model.fit(curves)))
                key = ModelKey(kind.name, "", k, direction)
                learned[f"{key}.mean"], learned[f"{key}.covariance"] = prior.mean, prior.covariance
        basis = EMoR.from_curves(curves, max(MODELS[EMoR]), direction)
        learned[f"basis-{direction}"] = np.vstack([basis.mean_, basis.components_]).astype(np.float32)
    content = io.BytesIO()
    np.savez_compressed(content, allow_pickle=False, **learned)
    write_atomically(TARGET, content.getvalue())
    print(f"{TARGET.name}: {len(learned)} arrays, {len(content.getvalue())} bytes")


if __name__ == "__main__":
    main()
