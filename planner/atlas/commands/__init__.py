"""Sub-commands of `python -m planner.atlas`, one module each.

Each is a class of options with `run()`, which returns the exit status.
"""
