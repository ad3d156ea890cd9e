"""Every number that the paper reports, to compare with.

Zhao, Ferguson, Zhou and Rafferty, "Representing Camera Response Function by a Single Latent Variable and Fully
Connected Neural Network" (2022). Figures only; what they mean is said beside each table.
"""

from decimal import Decimal
from typing import NamedTuple

#: Table 1, "DoRF curves fitting": mean RMSE as the paper calls it, by model and number of parameters. Kept as
#: text, for the digits printed are part of the figure. The SLR figure is 5.61E-4 in the paper's running text.
FITTING: dict[tuple[str, int], str] = {
    ("SLR", 1): "5.57E-4",
    ("Gamma", 1): "7.34E-3",
    ("Polynomial", 1): "8.79E-3",
    ("Polynomial", 2): "2.36E-2",
    ("Polynomial", 3): "2.50E-2",
    ("Polynomial", 4): "2.90E-2",
    ("GGCM", 1): "6.65E-3",
    ("GGCM", 2): "7.55E-3",
    ("GGCM", 3): "7.06E-3",
    ("GGCM", 4): "6.76E-3",
    ("EMoR", 1): "3.60E-2",
    ("EMoR", 2): "1.24E-2",
    ("EMoR", 3): "5.71E-3",
    ("EMoR", 4): "3.21E-3",
}

#: Table 2, "Stability": total variance between inverse responses from 3, 6, 12 and 24 patches (Canon PowerShot G9).
STABILITY: dict[str, float] = {"SLR": 0.66, "Polynomial": 1.63, "GGCM": 8.11, "EMoR": 3.87}

#: Columns of Table 3: statistics of the RMSE over 14 cameras, and seconds for all of them.
CALIBRATION_COLUMNS = ("mean", "median", "sd", "max", "p95", "seconds")

#: Table 3, "Camera radiometric calibration", by model, constraint and number of parameters.
CALIBRATION: dict[tuple[str, str, int], tuple[float, ...]] = {
    ("SLR", "ldl", 1): (0.062, 0.056, 0.056, 0.106, 0.101, 57.4),
    ("SLR", "auc", 1): (0.105, 0.092, 0.064, 0.252, 0.213, 43.1),
    ("SLR", "aae", 1): (0.064, 0.057, 0.027, 0.131, 0.107, 56.4),
    ("SLR", "vae", 1): (0.063, 0.054, 0.025, 0.108, 0.107, 57.0),
    ("SLR", "baseline", 1): (0.075, 0.067, 0.039, 0.193, 0.138, 58.5),
    ("SLR", "ldl", 3): (0.097, 0.097, 0.050, 0.184, 0.181, 61.1),
    ("SLR", "aae", 3): (0.063, 0.051, 0.038, 0.178, 0.122, 60.6),
    ("SLR", "vae", 3): (0.091, 0.091, 0.038, 0.145, 0.139, 62.1),
    ("SLR", "baseline", 3): (0.120, 0.120, 0.051, 0.251, 0.195, 59.72),
    ("Gamma", "", 1): (0.092, 0.080, 0.040, 0.164, 0.162, 112.6),
    ("Polynomial", "", 3): (0.074, 0.070, 0.027, 0.156, 0.118, 129.6),
    ("GGCM", "", 3): (0.124, 0.125, 0.055, 0.222, 0.210, 143.3),
    ("EMoR", "", 3): (0.154, 0.105, 0.121, 0.474, 0.408, 138.1),
}

#: The difference in RMSE that the paper calls significant in calibration.
SIGNIFICANT_RMSE = 0.005


class Statement(NamedTuple):
    """Something the running text says: in our words, in which section, and the figure as printed, if there is one.

    Parameters
    ----------
    claim : str
    where : str
    figure : str
        Empty for claims in words.
    """

    claim: str
    where: str
    figure: str


#: What the paper states outside the cells of its tables. Settings of its experiments are no claims and are left out.
STATEMENTS: dict[str, Statement] = {
    "responses": Statement("DoRF holds so many responses", "2 and 4.1", "201"),
    "cameras_of_dorf": Statement("each of these is another real-world camera", "4.1, figure", "201"),
    "samples": Statement("each is sampled at so many points", "2", "1024"),
    "energy": Statement("share of DoRF's energy in three principal components", "2", "99.5"),
    "classical_models": Statement("polynomial and gamma fit slightly worse than EMoR", "2", ""),
    "camera_count": Statement("cameras taken from Middlebury", "4.1", "14"),
    "photographs": Statement("photographs in the modified Middlebury set", "4.1", "112"),
    "photographs_each": Statement("photographs of each camera", "4.1", "8"),
    "illuminations": Statement("uniform illuminations", "4.1", "2"),
    "exposures": Statement("fixed exposures", "4.1", "4"),
    "patches": Statement("colour patches labelled in each photograph", "4.1", "24"),
    "uniform_channels": Statement("these cameras have the more uniform channels", "4.1", ""),
    "candidates": Statement("valid candidate architectures", "3.2", "156"),
    "candidate_time": Statement("seconds in which each is judged, at most", "3.2", "60"),
    "architecture": Statement("the architecture that the search finds", "3.2; released program", "(50, 20)"),
    "smoothness": Statement("the norm of the first derivative tells smooth curves from rough ones", "3.1", ""),
    "variance": Statement("the sum of squared deviations estimates the latents' variance", "3.3", ""),
    "ldl_accurate": Statement("LDL leads to an accurate latent distribution", "4.3", ""),
    "ldl_rapid": Statement("LDL converges rapidly, VAE and no constraint slowly", "4.3", ""),
    "aae_unstable": Statement("AAE's latent distribution is unstable compared to the others", "4.3", ""),
    "auc_sharp": Statement("AUC gives a narrow, sharp latent distribution", "4.3", ""),
    "ldl_best": Statement("LDL performs best of the constraints", "4.3", ""),
    "one_figure": Statement("mean RMSE of SLR, in the text as in Table 1", "4.4", "5.61E-4"),
    "ten_folds": Statement("SLR is more than ten-folds better than most of the others", "4.4", ""),
    "ten_folds_unseen": Statement("ten-folds better in cross-validation", "5", ""),
    "optimal": Statement("every curve is fitted with the optimal parameters of each model", "4.4", ""),
    "gamma_within_ggcm": Statement("Gamma, and GGCM with one parameter, fit as Table 1 says", "4.4", ""),
    "most_stable": Statement("SLR is the most stable with varied numbers of patches", "4.5", ""),
    "nearest_to_truth": Statement("SLR comes nearest to the measured values of the Canon PowerShot G9", "4.5", ""),
    "most_accurate": Statement("SLR with LDL and one latent calibrates most accurately of all", "4.5", ""),
    "ldl_helps": Statement("LDL improves calibration over the baseline", "4.5", ""),
    "significant": Statement("a difference in RMSE above this is significant", "4.2", "0.005"),
    "auc_trades": Statement("AUC calibrates faster than LDL but less accurately", "4.5", ""),
    "impossible_spread": Statement(
        "14 cameras can have the printed mean, s.d. and maximum of RMSE", "4.5, Table 3", ""
    ),
    "metrics": Statement("number of metrics in the second experiment, in the text as in Table 3", "4.2", "5"),
    "calibration_images": Statement("photographs that a camera is calibrated with", "4.5, caption of Table 3", "8"),
    "almost_twice": Statement("calibration is almost twice as fast as with the best other models", "abstract", ""),
    "half_the_time": Statement("calibration takes less than half the time of the best other models", "1", ""),
    "faster_than_gamma": Statement("Gamma takes so many times as long as SLR with LDL", "4.5", "1.96"),
    "around_twice": Statement("calibration is around twice as fast as with the best other models", "5", ""),
}


def scientific(value: float, digits: int = 2) -> str:
    """Write a number as the paper does, for example 3.60E-2."""
    mantissa, exponent = f"{value:.{digits}E}".split("E")
    return f"{mantissa}E{int(exponent)}"


def verdict(ours: float, printed: str | None) -> str:
    """Judge a figure by the digits the paper printed.

    Parameters
    ----------
    ours : float
    printed : str or None
        The paper's figure as printed, or None where it gives none for this case.

    Returns
    -------
    str
        "reproduced" when ours, rounded to as many digits, is within one unit of the last printed digit;
        "differs" when it is not; "not comparable" without a figure.
    """
    if printed is None:
        return "not comparable"
    figure = Decimal(printed)
    unit = Decimal(1).scaleb(int(figure.as_tuple().exponent))
    rounded = Decimal(repr(float(ours))).quantize(unit)
    return "reproduced" if abs(rounded - figure) <= unit else "differs"
