"""Photographs of a colour chart that no camera took: everything about them is known, so that methods can be checked."""

from crfbench.synthetic.photographs import write_pair
from crfbench.synthetic.scenes import Scene, render_chart

__all__ = ["Scene", "render_chart", "write_pair"]
