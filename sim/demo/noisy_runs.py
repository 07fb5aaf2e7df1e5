"""The demo's first cycle with noisy poses, once for each seed: the runs of a Monte-Carlo study."""

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
"""Greatest distance of the block from its place; the pads do not correct errors along them."""


@dataclass(frozen=True, slots=True)
class NoisyRun:
    """One run of the study.

    Attributes:
        seed: of the noise.
        noise: of the perceived poses.
        retries: greatest number of attempts after the first.
    """

    seed: int
    noise: Noise
    retries: int


@dataclass(frozen=True, slots=True)
class NoisyResult:
    """The result of one run.

    Attributes:
        attempts: their number.
        is_placed: whether the block truly ends at its place.
        off_m: its true distance from there.
        failure: why the loop ended early, or None.
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
    """Run one cycle, with a block that is perceived off its true place."""
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
    perceived = NoisyPoses(truth, run.noise, np.random.default_rng(run.seed))
    loop = ClosedLoop(simulation, manipulator, perceived, retries=run.retries)
    result = loop.pick_and_place(transfer)
    off = world.body(BLOCK).centre_base - block.at(goal).centre_base
    off_m = float(np.linalg.norm(off))
    is_placed = result.is_success and off_m <= PLACED_WITHIN_M
    return NoisyResult(len(result.attempts), is_placed, off_m, result.failure)


@lru_cache(maxsize=1)
def _manipulator() -> Manipulator:
    """Loaded once in each process."""
    return Manipulator.of(Baxter.load(), "left")
