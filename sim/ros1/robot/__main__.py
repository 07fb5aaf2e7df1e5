"""`python -m sim.ros1.robot`, and the console script `baxter-robot`."""

from typing import NoReturn

from baxter_kin.command_line import run_process as run
from sim.ros1.robot.command import main


def run_process() -> NoReturn:
    """Run the simulated Baxter as a program of its own."""
    run(main, "baxter-robot", failed=1)


if __name__ == "__main__":
    run_process()
