"""Sub-commands of `python -m planner.atlas`, one module each.

Each module has `HELP` (one line), `EXAMPLES` (the end of its help text), `add_arguments(parser)`
and `run(arguments)`, which returns the exit status.
"""
