"""Your own camera: from RAW and JPEG files to a response that other programs read."""

from crfbench.camera.checking import linearised_patches
from crfbench.camera.files import CHOICES, CameraCalibration, calibrate_chart, calibrate_exposures
from crfbench.camera.outputs import linearise_file, write_outputs

__all__ = [
    "CHOICES",
    "CameraCalibration",
    "calibrate_chart",
    "calibrate_exposures",
    "linearise_file",
    "linearised_patches",
    "write_outputs",
]
