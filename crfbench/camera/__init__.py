"""Your own camera: from RAW and JPEG files to a response that other programs read, and from images back to light.

>>> from crfbench import camera
>>> result = camera.calibrate("my-photographs")  # doctest: +SKIP
>>> paths = list(camera.write_outputs(result, "calibrated"))  # doctest: +SKIP
"""

from crfbench.camera.calibrate import CameraCalibration, calibrate
from crfbench.camera.formats import FORMATS, read_response, write_response
from crfbench.camera.measuring import chart_table
from crfbench.camera.merging import merge_series, write_hdr
from crfbench.camera.outputs import calibrate_cameras, linearise_file, linearised_patches, matrix_text, write_outputs
from crfbench.camera.passport import Passport, linearise
from crfbench.camera.photographs import pair_photographs
from crfbench.camera.reading import read_image
from crfbench.camera.series import calibrate_series
from crfbench.camera.synthetic import EXAMPLE_FOLDER, render_series
from crfbench.datasets.chart import load_labels, save_labels

__all__ = [
    "EXAMPLE_FOLDER",
    "FORMATS",
    "CameraCalibration",
    "Passport",
    "calibrate",
    "calibrate_cameras",
    "calibrate_series",
    "chart_table",
    "linearise",
    "linearise_file",
    "linearised_patches",
    "load_labels",
    "matrix_text",
    "merge_series",
    "pair_photographs",
    "read_image",
    "read_response",
    "render_series",
    "save_labels",
    "write_hdr",
    "write_outputs",
    "write_response",
]
