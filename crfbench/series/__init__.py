"""Calibration without a chart, from photographs of one static scene at several exposures, and their linear merge."""

from crfbench.series.calibrating import calibrate_series
from crfbench.series.merging import Merged, merge_series
from crfbench.series.reading import Series, read_series
from crfbench.series.sampling import sample_series
from crfbench.series.writing import write_hdr

__all__ = ["Merged", "Series", "calibrate_series", "merge_series", "read_series", "sample_series", "write_hdr"]
