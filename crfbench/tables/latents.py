"""How near the latents of the training curves come to N(0, 1), constraint by constraint."""

import numpy as np
import pandas as pd
from scipy.stats import kstest

from crfbench.models.slr import SLR
from crfbench.models.weights import shipped_weights

COLUMNS = (
    "model",
    "n_latent",
    "direction",
    "constraint",
    "mean",
    "sd",
    "kl",
    "ks",
    "best_mse",
    "best_rmse",
    "encoder_mse",
)


def latent_table() -> pd.DataFrame:
    """Describe the latents of every shipped SLR.

    Returns
    -------
    DataFrame
        One row a model. Of several latents, the one farthest from N(0, 1) in each figure: ``mean`` and ``sd`` over the
        training curves, ``kl`` the KL divergence of N(mean, sd) to N(0, 1), ``ks`` the Kolmogorov-Smirnov distance of
        the latents themselves to N(0, 1), which sees their shape too. The last three columns are figures of the
        model's card: mean MSE and RMSE with the best latent of each training curve, and MSE with the encoder's.
    """
    return pd.DataFrame([_row(name) for name in shipped_weights()], columns=list(COLUMNS))


def _row(name: str) -> dict[str, object]:
    stem, k, direction = name.rsplit("-", 2)
    model = SLR.load(stem, int(k), "inverse" if direction == "inverse" else "forward")
    latents = model.weights_["latents"].astype(float)
    figures = latent_figures(latents)
    return {
        "model": f"SLR-{stem}",
        "n_latent": model.n_params,
        "direction": direction,
        "constraint": model.card_["constraint"],
        **figures,
        **{key: model.card_["figures"][key] for key in COLUMNS[-3:]},
    }


def latent_figures(latents: np.ndarray) -> dict[str, float]:
    """Return mean, sd, KL and Kolmogorov-Smirnov distance to N(0, 1) of latents (n, k), each the worst over the k."""
    mean, sd = latents.mean(axis=0), latents.std(axis=0)
    kl = 0.5 * (mean**2 + sd**2 - 2 * np.log(sd) - 1)
    ks = max(float(kstest(column, "norm").statistic) for column in latents.T)
    farthest_mean, farthest_sd = mean[np.argmax(np.abs(mean))], sd[np.argmax(np.abs(sd - 1))]
    return {"mean": float(farthest_mean), "sd": float(farthest_sd), "kl": float(kl.max()), "ks": ks}
