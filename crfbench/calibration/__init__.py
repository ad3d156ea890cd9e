"""Calibration: from the brightness of patches to an inverse response, for any model."""

from crfbench.calibration.calibrate import METHODS, Calibration, calibrate
from crfbench.calibration.learning import learn_discrepancy
from crfbench.calibration.observations import Observations
from crfbench.calibration.posterior import Noise
from crfbench.calibration.table import Table, decode_table

__all__ = ["METHODS", "Calibration", "Noise", "Observations", "Table", "calibrate", "decode_table", "learn_discrepancy"]
