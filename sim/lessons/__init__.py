"""Checks of the exercises in `notebooks/`, one module for each notebook.

A check takes an answer and gives `Feedback`: right, or one sentence that says what to mend.
"""
