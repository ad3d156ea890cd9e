"""Interactive views for notebooks; their JavaScript and styles lie in ``static``."""

from crfbench.widgets.model_explorer import ModelExplorer

__all__ = ["ModelExplorer"]
