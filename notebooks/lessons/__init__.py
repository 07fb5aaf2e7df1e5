"""Checks of the exercises of the notebooks beside this folder, one module for each notebook."""
