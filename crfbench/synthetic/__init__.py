"""Photographs that no camera took: everything about them is known, so that methods can be checked."""

from crfbench.synthetic.exposures import ExposureSeries, render_series
from crfbench.synthetic.photographs import write_pair
from crfbench.synthetic.scenes import Scene, render_chart

__all__ = ["ExposureSeries", "Scene", "render_chart", "render_series", "write_pair"]
