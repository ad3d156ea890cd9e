"""The numbers of the paper's three tables, to compare with. What its text says stands in `crfbench.paper.claims`.

Zhao, Ferguson, Zhou and Rafferty, "Representing Camera Response Function by a Single Latent Variable and Fully
Connected Neural Network" (2022).
"""

#: Table 1, "DoRF curves fitting": mean RMSE as the paper calls it, of responses. Kept as text, for the digits printed
#: are part of the figure. SLR's constraint is not stated; LDL is the one that the paper recommends.
FITTING: dict[str, str] = {
    "SLR-ldl-1-forward": "5.57E-4",
    "Gamma-1-forward": "7.34E-3",
    "Polynomial-1-forward": "8.79E-3",
    "Polynomial-2-forward": "2.36E-2",
    "Polynomial-3-forward": "2.50E-2",
    "Polynomial-4-forward": "2.90E-2",
    "GGCM-1-forward": "6.65E-3",
    "GGCM-2-forward": "7.55E-3",
    "GGCM-3-forward": "7.06E-3",
    "GGCM-4-forward": "6.76E-3",
    "EMoR-published-1-forward": "3.60E-2",
    "EMoR-published-2-forward": "1.24E-2",
    "EMoR-published-3-forward": "5.71E-3",
    "EMoR-published-4-forward": "3.21E-3",
}

#: Table 2, "Stability": total variance between inverse responses from 3, 6, 12 and 24 patches (Canon PowerShot G9).
STABILITY: dict[str, float] = {"SLR-ldl-1": 0.66, "Polynomial-3": 1.63, "GGCM-3": 8.11, "EMoR-3": 3.87}

CALIBRATION_COLUMNS = ("mean", "median", "sd", "max", "p95", "seconds")

#: Table 3, "Camera radiometric calibration", of inverse responses.
CALIBRATION: dict[str, tuple[float, ...]] = {
    "SLR-ldl-1": (0.062, 0.056, 0.056, 0.106, 0.101, 57.4),
    "SLR-auc-1": (0.105, 0.092, 0.064, 0.252, 0.213, 43.1),
    "SLR-aae-1": (0.064, 0.057, 0.027, 0.131, 0.107, 56.4),
    "SLR-vae-1": (0.063, 0.054, 0.025, 0.108, 0.107, 57.0),
    "SLR-baseline-1": (0.075, 0.067, 0.039, 0.193, 0.138, 58.5),
    "SLR-ldl-3": (0.097, 0.097, 0.050, 0.184, 0.181, 61.1),
    "SLR-aae-3": (0.063, 0.051, 0.038, 0.178, 0.122, 60.6),
    "SLR-vae-3": (0.091, 0.091, 0.038, 0.145, 0.139, 62.1),
    "SLR-baseline-3": (0.120, 0.120, 0.051, 0.251, 0.195, 59.72),
    "Gamma-1": (0.092, 0.080, 0.040, 0.164, 0.162, 112.6),
    "Polynomial-3": (0.074, 0.070, 0.027, 0.156, 0.118, 129.6),
    "GGCM-3": (0.124, 0.125, 0.055, 0.222, 0.210, 143.3),
    "EMoR-3": (0.154, 0.105, 0.121, 0.474, 0.408, 138.1),
}

SIGNIFICANT_RMSE = 0.005
