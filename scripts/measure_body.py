"""Compare clearances of the robot's body with those of Rethink's meshes in random configurations.

`python scripts/measure_body.py [--count N] [--seed N] [--jobs N]`

Both arms and their fingers are at random positions within their limits, among random boxes. For
each arm the planner's clearance is compared with distances of the original meshes, by independent
kinematics and FCL (`referee`). The exit status is 1 when a mesh is nearer than the planner's
clearance, when a clearance below 50 mm is smaller than that of the meshes by more than 2 mm, or
when the planner reports a contact although the meshes, also of links rigidly attached, are 3 mm
apart.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from referee.robot import load_robot
from referee.solids import Array, Solid, distance_m, holds, inverse, solid_of
from tqdm import tqdm

from baxter_kin import Arm, Baxter
from baxter_kin.command_line import OneSentenceParser, whole_number
from planner import Body, Box, Part, RobotBody, RobotShapes, Scene
from planner.collision import ClearanceChecker

NEAR_M, WITHIN_M, APART_M = 0.050, 0.002, 0.003
"""Clearances below the first are compared, with the second as tolerance; the third is the maximum
distance of meshes in contact."""

ROUNDING_M = 1e-5
"""Error of distances by coal and FCL."""

BOXES, EDGES_M = 4, (0.02, 0.25)
REACH_M = ((0.2, 1.2), (-1.0, 1.0), (-0.4, 0.9))
"""Number of boxes, and ranges of their edges and of their centres in base."""

FINGER_M = 0.0208

Pair = tuple[str, str]


class Look(NamedTuple):
    """An arm in one configuration.

    Attributes:
        number: of the configuration.
        said_m: the planner's clearance.
        pair: the nearest pair, by the planner.
        of_pair_m: distance of the meshes of that pair.
        least_m: smallest distance of the meshes of any checked pair, up to `said_m`.
        nearest: that pair.
    """

    number: int
    said_m: float
    pair: Pair
    of_pair_m: float
    least_m: float
    nearest: Pair

    @property
    def fault(self) -> str | None:
        """Description of a fault, or None."""
        said = f"{self.number}: {1e3 * self.said_m:.2f} mm said"
        named, apart = " and ".join(self.pair), f"{1e3 * self.of_pair_m:.2f} mm apart"
        if self.said_m > self.least_m + ROUNDING_M:
            return f"{said}, but {' and '.join(self.nearest)} are {1e3 * self.least_m:.2f} mm apart"
        if 0.0 < self.said_m < NEAR_M and self.of_pair_m > self.said_m + WITHIN_M:
            return f"{said} of {named}, whose meshes are {apart}"
        if self.said_m <= 0.0 and self.of_pair_m >= APART_M:
            return f"{self.number}: {named} are said to touch, {apart}"
        return None


def main(argv: Sequence[str] | None = None) -> int:
    """Compare all configurations and print a summary; returns the exit status."""
    parser = OneSentenceParser(description="The robot's body beside its meshes.")
    parser.add_argument("--count", type=whole_number(1), default=10_000, help="configurations")
    parser.add_argument("--seed", type=whole_number(0), default=0)
    parser.add_argument("--jobs", type=whole_number(1), default=os.cpu_count(), help="processes")
    options: argparse.Namespace = parser.parse_args(argv)
    began_s, seeds = time.perf_counter(), [(options.seed, i) for i in range(options.count)]
    with ProcessPoolExecutor(options.jobs) as pool:
        found = pool.map(looks, seeds, chunksize=20)
        all_looks = [look for both in tqdm(found, total=len(seeds), disable=None) for look in both]
    faults = [look.fault for look in all_looks if look.fault is not None]
    near = [each.of_pair_m - each.said_m for each in all_looks if 0.0 < each.said_m < NEAR_M]
    touching = [each.of_pair_m for each in all_looks if each.said_m <= 0.0]
    print(*faults, sep="\n", end="\n" if faults else "")
    print(
        f"{options.count} configurations of both arms, {time.perf_counter() - began_s:.0f} s\n"
        f"{len(near)} clearances below {1e3 * NEAR_M:.0f} mm: meshes farther by "
        f"{_millimetres(near)}\n{len(touching)} said to touch: meshes apart by "
        f"{_millimetres(touching)}\n{len(faults)} faults"
    )
    return 1 if faults else 0


def _millimetres(metres: Sequence[float]) -> str:
    if not metres:
        return "none"
    low, middle, high = 1e3 * np.quantile(metres, (0.0, 0.5, 1.0))
    return f"{low:.2f} .. {high:.2f} mm, median {middle:.2f} mm"


def looks(seed: Sequence[int]) -> list[Look]:
    """Both arms in one random configuration among random boxes."""
    rng, baxter = np.random.default_rng(seed), _baxter()
    joints = {}
    for arm in baxter.arms.values():
        joints |= arm.joints(arm.random_configuration(rng))
        opened, fingers = rng.uniform(0.0, FINGER_M), f"{arm.side[0]}_gripper_{{}}_finger_joint"
        joints |= {fingers.format("l"): opened, fingers.format("r"): -opened}
    scene, q = Scene.of(_box(rng, number) for number in range(BOXES)), baxter.configuration(joints)
    meshes = Meshes(joints, scene)
    return [_look(seed[-1], arm, scene, np.array(q), meshes) for arm in baxter.arms.values()]


def _box(rng: np.random.Generator, number: int) -> Body:
    size, place = rng.uniform(*EDGES_M, 3), np.array([rng.uniform(*each) for each in REACH_M])
    turn = pin.rpy.rpyToMatrix(*rng.uniform(-np.pi, np.pi, 3))
    part = Part(Box(tuple(size.tolist())), pin.SE3.Identity())
    return Body(f"box {number}", (part,), pin.SE3(turn, place))


def _look(number: int, arm: Arm, scene: Scene, q: Array, meshes: Meshes) -> Look:
    found = ClearanceChecker(_shapes(), arm, scene).clearance(q)
    said_m, pair = found.distance_m, (found.first, found.second)
    of_pair_m = meshes.distance_m(*pair, np.inf)
    if said_m <= 0.0 and of_pair_m >= APART_M and meshes.are_nested(*pair):
        of_pair_m = 0.0
    least_m, nearest = of_pair_m, pair
    for each in _pairs(arm.side, tuple(body.name for body in scene)) if said_m > 0.0 else ():
        distance = meshes.distance_m(*each, min(said_m, least_m))
        if distance < least_m:
            least_m, nearest = distance, each
    return Look(number, said_m, pair, of_pair_m, least_m, nearest)


class Meshes:
    """Distances of links and boxes, by their meshes."""

    def __init__(self, joints: dict[str, float], scene: Scene) -> None:
        robot = load_robot()
        at_rest = {joint.name: 0.0 for joint in robot.joints if not joint.is_fixed}
        T = robot.poses({**at_rest, **joints})
        self._poses = {link: inverse(T["base"]) @ T[link] for link in T}
        self._solids = dict(robot.solids)
        for body in scene:
            self._poses[body.name] = body.T_base_body.homogeneous
            self._solids[body.name] = (solid_of(body.name, body.parts[0].shape),)

    def distance_m(self, one: str, other: str, within_m: float) -> float:
        """The distance of a pair; infinite where the boxes around both are farther apart."""
        T = self._from(one, other)
        near = (
            distance_m(first, second, T)
            for first, second in product(self._solids[one], self._solids[other])
            if self._gap_m(one, first, other, second) <= within_m
        )
        return min(near, default=np.inf)

    def are_nested(self, one: str, other: str) -> bool:
        """Whether one is inside the other, or a link rigidly attached to one intersects the other.

        The second case covers openings, as where an arm is mounted: many rays leave there.
        """
        robot, T = load_robot(), self._from(one, other)
        if any(
            holds(second, first, T) or holds(first, second, inverse(T))
            for first, second in product(self._solids[one], self._solids[other])
        ):
            return True
        return any(
            self.distance_m(link, outer, 0.0) == 0.0
            for inner, outer in ((one, other), (other, one))
            if inner in robot.chains
            for link in robot.rigid_to(inner) & robot.solids.keys() - {outer}
        )

    def _from(self, one: str, other: str) -> Array:
        return inverse(self._poses[other]) @ self._poses[one]

    def _gap_m(self, one: str, first: Solid, other: str, second: Solid) -> float:
        """Distance of the axis-aligned bounding boxes in base."""
        spans = []
        for name, solid in ((one, first), (other, second)):
            T = self._poses[name]
            corners = solid.corners @ T[:3, :3].T + T[:3, 3]
            spans.append((corners.min(axis=0), corners.max(axis=0)))
        (low, high), (other_low, other_high) = spans
        away = np.maximum(np.maximum(other_low - high, low - other_high), 0.0)
        return float(np.linalg.norm(away))


@cache
def _pairs(side: str, boxes: tuple[str, ...]) -> list[Pair]:
    """Pairs that the planner checks: neither within the hand nor skipped by the body."""
    robot, skipped = load_robot(), RobotBody.load().skipped_pairs
    links = sorted(link for link, solids in robot.solids.items() if solids)
    arm, hand = robot.below({f"{side}_s0"}), robot.below({f"{side}_w2"})
    return [
        (one, other)
        for one, other in product((link for link in links if link in arm), [*links, *boxes])
        if one != other
        and frozenset((one, other)) not in skipped
        and not {one, other} <= hand
        and other not in robot.rigid_to(one)
    ]


@cache
def _baxter() -> Baxter:
    return Baxter.load()


@cache
def _shapes() -> RobotShapes:
    return RobotShapes(_baxter())


if __name__ == "__main__":
    sys.exit(main())
