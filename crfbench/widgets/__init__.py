"""Interactive views for notebooks, an explorer a question; their JavaScript and styles lie in ``static``.

A module is loaded when its widget is first used, so that a slider does not wait for tables, searches or PyTorch.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from crfbench.widgets.calibration_explorer import CalibrationExplorer
    from crfbench.widgets.chart_labeller import ChartLabeller
    from crfbench.widgets.epoch_player import EpochPlayer
    from crfbench.widgets.latent_explorer import LatentExplorer
    from crfbench.widgets.model_explorer import ModelExplorer
    from crfbench.widgets.search_explorer import SearchExplorer
    from crfbench.widgets.sortable_table import SortableTable
    from crfbench.widgets.training_panel import TrainingPanel

__all__ = [
    "CalibrationExplorer",
    "ChartLabeller",
    "EpochPlayer",
    "LatentExplorer",
    "ModelExplorer",
    "SearchExplorer",
    "SortableTable",
    "TrainingPanel",
]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module 'crfbench.widgets' has no attribute {name!r}; it has {', '.join(__all__)}")
    module = "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name).removeprefix("_")
    return getattr(import_module(f"crfbench.widgets.{module}"), name)
