"""Which two links need no check against each other, and why.

Nothing is taken from the SRDF, whose list was made for other shapes. Four reasons count:

- no joint moves one against the other;
- one joint joins them and their covers overlap by design, in every configuration looked at;
- they overlap in every configuration looked at though more than one joint is between them;
- they cannot meet: for boxes of joint angles, the distance of their convex pieces, or triangles, at
  the box's middle exceeds what half the box can move them; boxes where it does not are halved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from itertools import combinations, product

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.description import StockFiles
from planner.collision.robot.robot_body import LinkBody
from planner.scene.coal_shapes import coal_pose, convex, surface

F = NDArray[np.float64]

RIGID = "no joint moves one against the other"
JOINED = "joined by one joint, their covers overlap by design"
NESTED = "their covers overlap in every configuration"
APART = "cannot meet: proven for all joint angles, at least {:.1f} mm apart"

MOST_JOINTS = 2
"""Between two links for which the proof is tried; what is farther apart is always checked, so that
a clearance that is stated counts it."""

MOST_BOXES = 60_000
"""Of joint angles before a proof is given up."""


NEAR_M = 1e-3
"""Beyond the margins, so that what rubs in a bearing counts as touching."""

SAMPLES = 10_000
"""Configurations within the limits by which overlaps are counted."""


class Poses:
    """Where links are: forward kinematics of the full robot with both arms, head and fingers."""

    def __init__(self, links: Mapping[str, LinkBody]) -> None:
        self.model = pin.buildModelFromUrdf(str(StockFiles.installed().urdf))
        self.data = self.model.createData()
        self.frame = {name: self.model.getFrameId(name) for name in links}
        self.low = np.array(self.model.lowerPositionLimit)
        self.high = np.array(self.model.upperPositionLimit)

    def joint(self, link: str) -> int:
        """The joint that carries a link; 0 is the base."""
        return int(self.model.frames[self.frame[link]].parentJoint)

    def between(self, a: str, b: str) -> list[int]:
        """The joints that move one link against the other."""
        up, down = self._chain(self.joint(a)), self._chain(self.joint(b))
        return sorted(set(up) ^ set(down))

    def _chain(self, joint: int) -> list[int]:
        chain = []
        while joint:
            chain.append(joint)
            joint = int(self.model.parents[joint])
        return chain

    def set(self, q: F) -> None:
        """Move all links."""
        pin.framesForwardKinematics(self.model, self.data, q)

    def of(self, link: str) -> pin.SE3:
        """The pose of a link's frame in base."""
        return self.data.oMf[self.frame[link]]


def reasons(links: Mapping[str, LinkBody], seed: int = 0) -> dict[frozenset[str], str]:
    """Why pairs of links are skipped, for those that are."""
    poses = Poses(links)
    found: dict[frozenset[str], str] = {}
    open_pairs: list[tuple[str, str]] = []
    for a, b in combinations(links, 2):
        joints = poses.between(a, b)
        if not joints:
            found[frozenset((a, b))] = RIGID
        elif len(joints) <= MOST_JOINTS:
            both = links[a], links[b]
            least = least_distance(poses, *both, joints=joints, level=pieces_of)
            if least is None:
                least = least_distance(poses, *both, joints=joints, level=finest)
            if least is None:
                open_pairs.append((a, b))
            else:
                found[frozenset((a, b))] = APART.format(1e3 * least)
    shares = overlaps(poses, links, open_pairs, seed=seed)
    for (a, b), share in shares.items():
        if share == 1.0:
            joined = len(poses.between(a, b)) == 1
            found[frozenset((a, b))] = JOINED if joined else NESTED
        elif len(poses.between(a, b)) == 1:
            print(f"{a} and {b}, one joint apart, touch in {100.0 * share:g} % of configurations")
    return found


@cache
def pieces_of(body: LinkBody) -> list[coal.CollisionGeometry]:
    """The pieces of a link as Coal's convex shapes."""
    return [convex(*piece) for piece in body.pieces]


@cache
def finest(body: LinkBody) -> list[coal.CollisionGeometry]:
    """The triangles of a link, or its pieces where there are none."""
    return [surface(*body.surface)] if body.has_surface else pieces_of(body)


def least_distance(
    poses: Poses,
    a: LinkBody,
    b: LinkBody,
    *,
    joints: list[int],
    level: Callable[[LinkBody], list[coal.CollisionGeometry]],
) -> float | None:
    """A lower bound of the distance of two links over all angles of the joints between; or None.

    Measured on one of their levels, `pieces_of` or `finest`, less the margins.
    """
    pieces, margin_m = list(product(level(a), level(b))), a.margin_m + b.margin_m
    index = [int(poses.model.idx_qs[joint]) for joint in joints]
    q = pin.neutral(poses.model)
    levers = np.array([_lever(poses, a, b, joints, joint) for joint in joints])
    stack = [(poses.low[index], poses.high[index])]
    least = np.inf
    for _ in range(MOST_BOXES):
        if not stack:
            return least
        low, high = stack.pop()
        q[index] = (low + high) / 2.0
        poses.set(q)
        reach = levers * (high - low) / 2.0
        distance = _distance(pieces, poses.of(a.name), poses.of(b.name)) - margin_m
        if distance <= 0.0:
            return None
        if distance - reach.sum() > 0.2 * distance:
            least = min(least, distance - float(reach.sum()))
            continue
        k = int(reach.argmax())
        middle_high, middle_low = high.copy(), low.copy()
        middle_high[k] = middle_low[k] = q[index[k]]
        stack += [(low, middle_high), (middle_low, high)]
    return None


def _lever(poses: Poses, a: LinkBody, b: LinkBody, joints: list[int], joint: int) -> float:
    """How far a joint moves any point of the link it carries, per radian (or metre)."""
    if poses.model.joints[joint].shortname().startswith("JointModelP"):
        return 1.0
    moved = a if joint in poses._chain(poses.joint(a.name)) else b
    chain = [j for j in reversed(poses._chain(poses.joint(moved.name))) if j in joints]
    after = chain[chain.index(joint) + 1 :]
    travel = sum(_size(poses, j) for j in after)
    frame = poses.model.frames[poses.frame[moved.name]].placement
    corners = np.concatenate([vertices for vertices, _ in moved.pieces])
    local = corners @ frame.rotation.T + frame.translation
    if not after:
        # the joint turns about one axis: the distance from it, not from a point on it
        name = poses.model.joints[joint].shortname()
        axis = {"JointModelRX": 0, "JointModelRY": 1, "JointModelRZ": 2}.get(name)
        if axis is not None:
            local = np.delete(local, axis, axis=1)
    return travel + float(np.linalg.norm(local, axis=1).max())


def _size(poses: Poses, joint: int) -> float:
    """How far a joint's frame is from its parent's, at most."""
    size = float(np.linalg.norm(poses.model.jointPlacements[joint].translation))
    if poses.model.joints[joint].shortname().startswith("JointModelP"):
        index = int(poses.model.idx_qs[joint])
        size += max(abs(poses.low[index]), abs(poses.high[index]))
    return size


def _distance(
    pieces: list[tuple[coal.CollisionGeometry, coal.CollisionGeometry]], T_a: pin.SE3, T_b: pin.SE3
) -> float:
    request = coal.DistanceRequest()
    A, B = coal_pose(T_a), coal_pose(T_b)
    least = np.inf
    for p, r in pieces:
        result = coal.DistanceResult()
        least = min(least, float(coal.distance(p, A, r, B, request, result)))
    return least


def configurations(poses: Poses, count: int, seed: int) -> Iterator[F]:
    """Uniform within the joint limits."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield rng.uniform(poses.low, poses.high)


def overlaps(
    poses: Poses,
    links: Mapping[str, LinkBody],
    pairs: list[tuple[str, str]],
    *,
    seed: int,
    count: int = SAMPLES,
) -> dict[tuple[str, str], float]:
    """In which share of configurations the bodies of each pair overlap."""
    hits = dict.fromkeys(pairs, 0)
    for q in configurations(poses, count, seed):
        poses.set(q)
        for a, b in pairs:
            hits[a, b] += touches(links[a], links[b], poses.of(a), poses.of(b))
    return {pair: number / count for pair, number in hits.items()}


def touches(a: LinkBody, b: LinkBody, T_a: pin.SE3, T_b: pin.SE3) -> bool:
    """Whether two links are nearer than their margins."""
    A, B = coal_pose(T_a), coal_pose(T_b)
    near_m = a.margin_m + b.margin_m + NEAR_M
    if not any(_collide(p, A, r, B, near_m) for p, r in product(pieces_of(a), pieces_of(b))):
        return False
    return any(_collide(p, A, r, B, near_m) for p, r in product(finest(a), finest(b)))


def _collide(a: object, A: object, b: object, B: object, near_m: float) -> bool:
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    request.security_margin = near_m
    return bool(coal.collide(a, A, b, B, request, result))
