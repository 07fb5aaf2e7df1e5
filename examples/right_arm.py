"""The right arm with a hand that opens less, and two blocks.

Half-round tips are mounted on its right fingers, as the URDF of example-robot-data has them: so the
hand opens 52.7 mm, with paddles 57.0 mm. It carries a block of 4 cm across the table and back. A
block of 5.4 cm, grasped as the demo does, measures 55.3 mm between the pads; it is refused before
anything moves.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from baxter_kin import ElectricGripper
from examples.workbench import play
from planner import PickAndPlace, Plan, plan_pick_and_place
from sim import Workbench
from sim.demo.scene import overhead

HALF_ROUND = ElectricGripper(tips="half_round")
EDGE_M, TOO_WIDE_M = 0.04, 0.054
HERE_M, THERE_M, BESIDE_M = (0.70, -0.15), (0.75, 0.10), (0.60, -0.25)
"""x and y in base."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run it; returns the exit status."""
    return play(argv, __doc__, carry, hands={"right": HALF_ROUND})


def carry(bench: Workbench, _rng: np.random.Generator) -> None:
    """Carry one block there and back, and ask for the other."""
    bench.add_block("block", *HERE_M, edge_m=EDGE_M, colour="blue")
    bench.add_block("wide", *BESIDE_M, edge_m=TOO_WIDE_M, colour="red")
    print(f"the wide block is refused: {as_in_the_demo(bench, 'wide').failure}")
    for goal_m in (THERE_M, HERE_M):
        bench.carry("block", to=goal_m, arm="right")
    bench.withdraw("right")


def as_in_the_demo(bench: Workbench, block: str) -> Plan:
    """How the arm would pick a block up as the demo does, the hand tilted by 1 degree."""
    arm = bench.arm("right")
    pick = overhead(tuple(bench.world.body(block).centre_base.tolist()))
    task = PickAndPlace(block, pick, pick)
    return plan_pick_and_place(task, arm, bench.world.scene, bench.world.arm_q("right"))


if __name__ == "__main__":
    sys.exit(main())
