"""The demo's first cycle with noisy eyes, once for each seed: the runs of a Monte-Carlo study."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from baxter_kin import Baxter
from planner import Manipulator
from sim.demo.options import DEFAULT_POSES_M
from sim.demo.scene import BLOCK, centred_below, demo_bodies, overhead
from sim.perception.closed_loop import ClosedLoop
from sim.perception.noisy_poses import Noise, NoisyPoses
from sim.perception.pose_source import TruePoses
from sim.perception.transfer import Transfer
from sim.simulation import Simulation
from sim.world.world import World

PLACED_WITHIN_M = 0.010
"""How far from its place the block may end; errors along the pads, which push nothing, remain."""


@dataclass(frozen=True, slots=True)
class NoisyRun:
    """What is run.

    Attributes:
        seed: of the noise.
        noise: of the seen poses.
        retries: attempts after the first, at most.
    """

    seed: int
    noise: Noise
    retries: int


@dataclass(frozen=True, slots=True)
class NoisyResult:
    """What came of one run.

    Attributes:
        attempts: how many there were.
        is_placed: whether the block really ends where it should.
        off_m: how far from there it really ends.
        failure: why the loop gave up, or None.
    """

    attempts: int
    is_placed: bool
    off_m: float
    failure: str | None

    @property
    def is_open_success(self) -> bool:
        """Whether the first attempt was enough."""
        return self.is_placed and self.attempts == 1


def result_of(run: NoisyRun) -> NoisyResult:
    """Run it: a true block on the table, and eyes that see it displaced."""
    manipulator = _manipulator()
    world = World(manipulator.robot)
    world.move_arm("left", manipulator.arm.start)
    truth = TruePoses(world)
    simulation = Simulation(world, [truth])
    for body in demo_bodies("left"):
        simulation.spawn(body)
    block, (pick, place) = world.body(BLOCK), map(overhead, DEFAULT_POSES_M)
    goal = centred_below(block, place)
    transfer = Transfer(BLOCK, centred_below(block, pick).inverse() * pick, goal)
    eyes = NoisyPoses(truth, run.noise, np.random.default_rng(run.seed))
    loop = ClosedLoop(simulation, manipulator, eyes, retries=run.retries)
    result = loop.pick_and_place(transfer)
    off = world.body(BLOCK).centre_base - block.at(goal).centre_base
    off_m = float(np.linalg.norm(off))
    is_placed = result.is_success and off_m <= PLACED_WITHIN_M
    return NoisyResult(len(result.attempts), is_placed, off_m, result.failure)


@lru_cache(maxsize=1)
def _manipulator() -> Manipulator:
    """Loaded once in each process."""
    return Manipulator.of(Baxter.load(), "left")
