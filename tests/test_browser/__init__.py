"""A package, so that its browser and its JupyterLab end before the tests after it begin."""
