"""Interactive views for notebooks, an explorer a question; their JavaScript and styles lie in ``static``.

A module is loaded when its widget is first used, so that a slider does not wait for tables, searches or PyTorch.
"""

from typing import TYPE_CHECKING

from crfbench.lazy import found_when_used

if TYPE_CHECKING:
    from crfbench.widgets.before_after import BeforeAfter
    from crfbench.widgets.calibration_explorer import CalibrationExplorer
    from crfbench.widgets.chart_labeller import ChartLabeller
    from crfbench.widgets.dot_plot import DotPlot
    from crfbench.widgets.epoch_player import EpochPlayer
    from crfbench.widgets.latent_explorer import LatentExplorer
    from crfbench.widgets.model_explorer import ModelExplorer
    from crfbench.widgets.search_explorer import SearchExplorer
    from crfbench.widgets.sortable_table import SortableTable
    from crfbench.widgets.training_panel import TrainingPanel

__all__ = [
    "BeforeAfter",
    "CalibrationExplorer",
    "ChartLabeller",
    "DotPlot",
    "EpochPlayer",
    "LatentExplorer",
    "ModelExplorer",
    "SearchExplorer",
    "SortableTable",
    "TrainingPanel",
]

_MODULES = ("".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name)[1:] for name in __all__)
__getattr__ = found_when_used(
    __name__, {f"widgets.{module}": name for module, name in zip(_MODULES, __all__, strict=True)}
)
