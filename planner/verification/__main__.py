"""`python -m planner.verification`."""

from baxter_kin.command_line import EXIT_USAGE, run_process
from planner.verification.command_line import main

if __name__ == "__main__":
    run_process(main, "planner.verification", failed=EXIT_USAGE)
