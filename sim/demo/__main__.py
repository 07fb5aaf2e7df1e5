"""`python -m baxter_kin.demo`, and the console script `baxter-demo`."""

from typing import NoReturn

from baxter_kin.command_line import run_process as run
from sim.demo import main


def run_process() -> NoReturn:
    """Run the demo as a program of its own."""
    run(main, "baxter-demo", failed=1)


if __name__ == "__main__":
    run_process()
