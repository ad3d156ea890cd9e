"""Photographs of a colour chart, as RAW files and JPEGs, to measurements of its 24 patches."""

from crfbench.charts.exif import Exif, exposure_steps, read_exif
from crfbench.charts.finding import find_chart
from crfbench.charts.labels import load_labels, save_labels
from crfbench.charts.measuring import Orientation, PatchValues, chart_confidence, measure_chart, orient
from crfbench.charts.pairs import Pair, Pairing, Problem, pair_photographs
from crfbench.charts.reading import Picture, read_image, read_raw, read_size
from crfbench.charts.safely import SafeReader
from crfbench.charts.table import ChartTable, Measured, chart_table, measure_photograph

__all__ = [
    "ChartTable",
    "Exif",
    "Measured",
    "Orientation",
    "Pair",
    "Pairing",
    "PatchValues",
    "Picture",
    "Problem",
    "SafeReader",
    "chart_confidence",
    "chart_table",
    "exposure_steps",
    "find_chart",
    "load_labels",
    "measure_chart",
    "measure_photograph",
    "orient",
    "pair_photographs",
    "read_exif",
    "read_image",
    "read_raw",
    "read_size",
    "save_labels",
]
