"""Interactive views for notebooks; their JavaScript and styles lie in ``static``."""

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
