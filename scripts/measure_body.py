"""The robot's body beside Rethink's meshes: how near what it says is, in random configurations.

`python scripts/measure_body.py [--count N] [--seed N] [--jobs N]`

Both arms stand anywhere within their limits, fingers too, among boxes at random places. For each
arm the planner's clearance is compared with distances of the original meshes, by other kinematics
and FCL (`referee`). It prints the greatest differences. The exit status is 1 when a mesh is
nearer than the planner says, when a clearance below 50 mm is over 2 mm less than that of the
meshes, or when something counts as touching whose meshes are 3 mm apart, as are those of what is
rigid to it.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
import pinocchio as pin
from referee.robot import Robot, load_robot
from referee.solids import Array, Solid, box_solid, distance_m, inverse
from tqdm import tqdm

from baxter_kin import Arm, Baxter
from baxter_kin.command_line import OneSentenceParser, whole_number
from planner import Body, Box, Part, RobotBody, RobotShapes, Scene
from planner.collision import ClearanceChecker

NEAR_M, WITHIN_M, APART_M = 0.050, 0.002, 0.003
"""Below which a clearance is compared, what it may be too small by, and how far apart meshes must
not be where something counts as touching."""

ROUNDING_M = 1e-5
"""What coal's distances, and FCL's, may be wrong by."""

BOXES, LEAST_M, MOST_M = 4, 0.02, 0.25
REACH_M = ((0.2, 1.2), (-1.0, 1.0), (-0.4, 0.9))
"""Edges of the boxes, and where their centres are in base."""


@dataclass(frozen=True)
class Look:
    """An arm in one configuration.

    Attributes:
        number: of the configuration.
        said_m: the planner's clearance.
        pair: of what.
        of_pair_m: the distance of the meshes of that pair.
        least_m: the least distance of the meshes of any pair that is checked, up to `said_m`.
        nearest: of which pair that is.
    """

    number: int
    said_m: float
    pair: tuple[str, str]
    of_pair_m: float
    least_m: float
    nearest: tuple[str, str]

    @property
    def fault(self) -> str | None:
        """What is wrong with it, in a sentence."""
        said = f"{self.number}: {1e3 * self.said_m:.2f} mm said"
        named = " and ".join(self.pair)
        if self.said_m > self.least_m + ROUNDING_M:
            return f"{said}, but {' and '.join(self.nearest)} are {1e3 * self.least_m:.2f} mm apart"
        if 0.0 < self.said_m < NEAR_M and self.of_pair_m > self.said_m + WITHIN_M:
            return f"{said} of {named}, whose meshes are {1e3 * self.of_pair_m:.2f} mm apart"
        if self.said_m <= 0.0 and self.of_pair_m >= APART_M:
            apart = f"{1e3 * self.of_pair_m:.2f} mm apart"
            return f"{self.number}: {named} are said to touch, {apart}"
        return None


def main(argv: Sequence[str] | None = None) -> int:
    """Look at all configurations, print what was found."""
    options = _parser().parse_args(argv)
    started, seeds = time.perf_counter(), [(options.seed, i) for i in range(options.count)]
    with ProcessPoolExecutor(options.jobs) as pool:
        found = pool.map(looks, seeds, chunksize=20)
        all_looks = [look for both in tqdm(found, total=len(seeds), disable=None) for look in both]
    faults = [look.fault for look in all_looks if look.fault is not None]
    for fault in faults:
        print(fault)
    near = [look for look in all_looks if 0.0 < look.said_m < NEAR_M]
    touching = [look for look in all_looks if look.said_m <= 0.0]
    print(
        f"{options.count} configurations of both arms, {time.perf_counter() - started:.0f} s\n"
        f"{len(near)} clearances below {1e3 * NEAR_M:.0f} mm: meshes farther by "
        f"{_millimetres([look.of_pair_m - look.said_m for look in near])}\n"
        f"{len(touching)} said to touch: meshes apart by "
        f"{_millimetres([look.of_pair_m for look in touching])}\n"
        f"{len(faults)} faults"
    )
    return 1 if faults else 0


def looks(seed: Sequence[int]) -> list[Look]:
    """Both arms in one random configuration among random boxes."""
    rng, baxter = np.random.default_rng(seed), _baxter()
    joints = {}
    for arm in baxter.arms.values():
        joints |= arm.joints(arm.random_configuration(rng))
        opened = rng.uniform(0.0, 0.0208)
        letter = arm.side[0]
        joints |= {f"{letter}_gripper_l_finger_joint": opened}
        joints |= {f"{letter}_gripper_r_finger_joint": -opened}
    scene = Scene.of(_boxes(rng))
    q, poses = baxter.configuration(joints), _poses(joints)
    solids = {**load_robot().solids, **{body.name: (_solid(body),) for body in scene}}
    poses |= {body.name: body.T_base_body.homogeneous for body in scene}
    distances = _Distances(solids, poses)
    arms = baxter.arms.values()
    return [_look(seed[-1], arm, scene, np.array(q), distances) for arm in arms]


def _look(number: int, arm: Arm, scene: Scene, q: Array, meshes: _Distances) -> Look:
    found = ClearanceChecker(_shapes(), arm, scene).clearance(q)
    pair = found.first, found.second
    of_pair = meshes.of(*pair, np.inf)
    if found.distance_m <= 0.0 and of_pair >= APART_M and _is_in(meshes, pair):
        of_pair = 0.0
    least, nearest = of_pair, pair
    if found.distance_m > 0.0:
        for one, other in _pairs(arm.side, tuple(body.name for body in scene)):
            distance = meshes.of(one, other, min(found.distance_m, least))
            if distance < least:
                least, nearest = distance, (one, other)
    return Look(number, found.distance_m, pair, of_pair, least, nearest)


def _is_in(meshes: _Distances, pair: tuple[str, str]) -> bool:
    """Whether one is inside the other, or what is rigid to it passes through the other's surface.

    Rays tell what is inside; near an opening, as where an arm is mounted, many of them are free.
    """
    if meshes.are_nested(*pair):
        return True
    robot = load_robot()
    return any(
        meshes.of(link, other, 0.0) == 0.0
        for inner, other in (pair, pair[::-1])
        if inner in robot.chains
        for link in robot.rigid_to(inner) & robot.solids.keys() - {other}
    )


class _Distances:
    """Of links and boxes, by their meshes."""

    def __init__(self, solids: Mapping[str, tuple[Solid, ...]], poses: Mapping[str, Array]) -> None:
        self._solids, self._poses = solids, poses

    def of(self, one: str, other: str, within_m: float) -> float:
        """The distance of a pair; infinite where the boxes around both are farther apart."""
        return min(
            (
                distance_m(first, second, inverse(self._poses[other]) @ self._poses[one])
                for first, second in product(self._solids[one], self._solids[other])
                if self._gap_m(one, first, other, second) <= within_m
            ),
            default=np.inf,
        )

    def are_nested(self, one: str, other: str) -> bool:
        """Whether one is inside the other, all of it."""
        T = inverse(self._poses[other]) @ self._poses[one]
        return any(
            _holds(second, first, T) or _holds(first, second, inverse(T))
            for first, second in product(self._solids[one], self._solids[other])
        )

    def _gap_m(self, one: str, first: Solid, other: str, second: Solid) -> float:
        """Of axis-aligned boxes in base around the boxes around both."""
        spans = []
        for name, solid in ((one, first), (other, second)):
            T = self._poses[name]
            corners = solid.corners @ T[:3, :3].T + T[:3, 3]
            spans.append((corners.min(axis=0), corners.max(axis=0)))
        (low, high), (other_low, other_high) = spans
        away = np.maximum(np.maximum(other_low - high, low - other_high), 0.0)
        return float(np.linalg.norm(away))


def _holds(outer: Solid, inner: Solid, T_outer_inner: Array) -> bool:
    middle = T_outer_inner[:3, :3] @ inner.vertices.mean(axis=0) + T_outer_inner[:3, 3]
    return bool(outer.contains(middle[None])[0])


def _boxes(rng: np.random.Generator) -> Iterator[Body]:
    for number in range(BOXES):
        size = rng.uniform(LEAST_M, MOST_M, 3)
        place = np.array([rng.uniform(low, high) for low, high in REACH_M])
        turn = pin.rpy.rpyToMatrix(*rng.uniform(-np.pi, np.pi, 3))
        part = Part(Box(tuple(size.tolist())), pin.SE3.Identity())
        yield Body(f"box {number}", (part,), pin.SE3(turn, place))


def _solid(body: Body) -> Solid:
    return box_solid(body.name, np.array(body.parts[0].shape.size_m))  # type: ignore[union-attr]


@cache
def _pairs(side: str, boxes: tuple[str, ...]) -> list[tuple[str, str]]:
    """What the planner checks of an arm: not its hand by itself, not what its body leaves out."""
    robot, skipped = load_robot(), RobotBody.load().skipped_pairs
    arm = _with_solids(robot, robot.below({f"{side}_s0"}))
    hand = robot.below({f"{side}_w2"})
    links = _with_solids(robot, set(robot.solids))
    return [
        (one, other)
        for one, other in product(arm, [*links, *boxes])
        if one != other
        and frozenset((one, other)) not in skipped
        and not {one, other} <= hand
        and other not in robot.rigid_to(one)
    ]


def _with_solids(robot: Robot, links: set[str]) -> list[str]:
    return sorted(link for link in links if robot.solids.get(link))


def _poses(joints: Mapping[str, float]) -> dict[str, Array]:
    robot = load_robot()
    at_rest = {joint.name: 0.0 for joint in robot.joints if not joint.is_fixed}
    found = robot.poses({**at_rest, **joints})
    T_base = inverse(found["base"])
    return {link: T_base @ T for link, T in found.items()}


@cache
def _baxter() -> Baxter:
    return Baxter.load()


@cache
def _shapes() -> RobotShapes:
    return RobotShapes(_baxter())


def _millimetres(metres: Sequence[float]) -> str:
    if not metres:
        return "none"
    low, median, high = 1e3 * np.quantile(metres, (0.0, 0.5, 1.0))
    return f"{low:.2f} .. {high:.2f} mm, median {median:.2f} mm"


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(description="The robot's body beside its meshes.")
    parser.add_argument("--count", type=whole_number(1), default=10_000, help="configurations")
    parser.add_argument("--seed", type=whole_number(0), default=0)
    parser.add_argument("--jobs", type=whole_number(1), default=os.cpu_count(), help="processes")
    return parser


if __name__ == "__main__":
    sys.exit(main())
