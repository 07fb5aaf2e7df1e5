"""Sub-commands of `python -m planner.atlas`, one module each."""
