"""Calibration: from the brightness of patches to an inverse response, for any model."""

from crfbench.calibration.calibrate import METHODS, calibrate
from crfbench.calibration.likelihood import Noise
from crfbench.calibration.observations import Observations
from crfbench.calibration.result import Calibration
from crfbench.calibration.table import Table, decode_table

__all__ = ["METHODS", "Calibration", "Noise", "Observations", "Table", "calibrate", "decode_table"]
