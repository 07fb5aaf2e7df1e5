"""Poses to solve: reachable by construction, drawn from a seeded generator.

Every pose is the tip pose of a configuration within the limits, so a solver that finds no joint
angles for it has failed. A scenario defines how configurations and seeds are drawn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np
import pinocchio as pin

from baxter_kin.kinematics.arm import LIMBS, Arm
from baxter_kin.validation import FloatArray

NEAR_RAD = 0.1
"""A near seed differs from the solution by at most this much in every joint."""

SINGULAR = 1e-9
"""The Jacobian's smallest singular value below which a configuration counts as singular. Of uniform
configurations the median is 0.1, the least of 2,000 is 2e-4."""

STRETCHED_E1_RAD = math.atan(0.069 / 0.36442) - math.atan(0.010 / 0.37429)
"""Elbow angle at which shoulder, elbow and wrist lie on a line. It is not zero, for the elbow is
offset from the upper arm by 69 mm and the wrist from the forearm by 10 mm (URDF)."""

WINDOW_RAD = 0.1
"""Tolerance of the elbow angle about `STRETCHED_E1_RAD`, and of the wrist about straight. The
offsets of the links make it 0.055 and 0.027 at most; other singularities lie farther away."""

E0, E1, W0, W1 = 2, 3, 4, 5


class Scenario(Enum):
    """How goal configurations and seeds are drawn."""

    MID_RANGE = "mid-range"
    NEAR = "near"
    AT_LIMITS = "at-limits"
    ELBOW_STRAIGHT = "elbow-straight"
    WRIST_SINGULAR = "wrist-singular"

    @property
    def caption(self) -> str:
        """The scenario in words."""
        return _CAPTIONS[self]


@dataclass(frozen=True, slots=True, eq=False)
class PoseSet:
    """Poses of one scenario for one arm; n of them.

    Attributes:
        side: of the arm whose tip is to be placed.
        scenario: how they were drawn.
        q_goals: configurations that reach the poses, shape (n, 7), rad.
        q_seeds: where solvers start, shape (n, 7), rad, inside the limits.
        T_base_tips: the poses, seen from base.
    """

    side: str
    scenario: Scenario
    q_goals: FloatArray
    q_seeds: FloatArray
    T_base_tips: tuple[pin.SE3, ...]

    def __len__(self) -> int:
        return len(self.T_base_tips)

    def blocks(self, size: int) -> Iterator[PoseSet]:
        """Split into consecutive sets of at most `size` poses."""
        for first in range(0, len(self), size):
            part = slice(first, first + size)
            arrays = self.q_goals[part], self.q_seeds[part], self.T_base_tips[part]
            yield PoseSet(self.side, self.scenario, *arrays)


def draw_poses(arm: Arm, scenario: Scenario, *, count: int, seed: int) -> PoseSet:
    """Draw the poses of a scenario.

    The same seed gives the same poses, whichever other scenarios are drawn. `MID_RANGE` and `NEAR`
    share their poses and differ in the seeds only.
    """
    drawn_as = Scenario.MID_RANGE if scenario is Scenario.NEAR else scenario
    key = [seed, LIMBS.index(arm.side), _STREAMS[drawn_as]]
    goals_rng, seeds_rng = np.random.default_rng(key).spawn(2)
    q_goals = np.array([_DRAW[drawn_as](arm, goals_rng) for _ in range(count)])
    q_seeds = _near(arm, q_goals, seeds_rng) if scenario is Scenario.NEAR else _mid(arm, count)
    poses = tuple(arm.T_base_tip(q) for q in q_goals)
    return PoseSet(arm.side, scenario, q_goals, q_seeds, poses)


def smallest_singular_value(arm: Arm, q: FloatArray) -> float:
    """Smallest singular value of the tip's Jacobian (mixed units, m and rad)."""
    return float(np.linalg.svd(arm.jacobian(q), compute_uv=False)[-1])


def _mid(arm: Arm, count: int) -> FloatArray:
    return np.tile((arm.limits.q_min + arm.limits.q_max) / 2.0, (count, 1))


def _near(arm: Arm, q_goals: FloatArray, rng: np.random.Generator) -> FloatArray:
    offsets = rng.uniform(-NEAR_RAD, NEAR_RAD, q_goals.shape)
    return np.clip(q_goals + offsets, arm.limits.q_min, arm.limits.q_max)


def _uniform(arm: Arm, rng: np.random.Generator) -> FloatArray:
    return arm.random_configuration(rng)


def _at_limits(arm: Arm, rng: np.random.Generator) -> FloatArray:
    """One to three joints exactly on a limit, the others uniform."""
    q = arm.random_configuration(rng)
    for joint in rng.choice(len(q), size=rng.integers(1, 4), replace=False):
        q[joint] = rng.choice([arm.limits.q_min[joint], arm.limits.q_max[joint]])
    return q


def _elbow_straight(arm: Arm, rng: np.random.Generator) -> FloatArray:
    """Arm stretched so that the tip cannot move away from the shoulder; the rest uniform."""

    def start() -> FloatArray:
        q = arm.random_configuration(rng)
        q[E1] = STRETCHED_E1_RAD
        return q

    def is_stretched(q: FloatArray) -> bool:
        return bool(abs(q[E1] - STRETCHED_E1_RAD) <= WINDOW_RAD)

    return _singular(arm, start, (E0, E1), is_stretched)


def _wrist_singular(arm: Arm, rng: np.random.Generator) -> FloatArray:
    """Wrist straight and turned so that one rotation is lost (w1 near 0); the rest uniform.

    A straight wrist alone is no singularity of a 7-joint arm. It is one for some angle of w0, about
    a quarter turn, where no other joint makes up for the lost rotation.
    """

    def start() -> FloatArray:
        q = arm.random_configuration(rng)
        q[W0], q[W1] = rng.choice([-1.0, 1.0]) * np.pi / 2.0, 0.0
        return q

    def is_straight(q: FloatArray) -> bool:
        return bool(abs(q[W1]) <= WINDOW_RAD)

    return _singular(arm, start, (W0, W1), is_straight)


def _singular(
    arm: Arm,
    start: Callable[[], FloatArray],
    joints: tuple[int, int],
    is_wanted: Callable[[FloatArray], bool],
) -> FloatArray:
    """A singular configuration within the limits, by moving two joints of random starts."""
    while True:
        q = _moved_to_singularity(arm, start(), joints)
        is_inside = bool(np.all(arm.limits.q_min <= q) and np.all(q <= arm.limits.q_max))
        if is_inside and is_wanted(q) and smallest_singular_value(arm, q) <= SINGULAR:
            return q


def _moved_to_singularity(arm: Arm, q: FloatArray, joints: tuple[int, int]) -> FloatArray:
    """Gauss-Newton on J(q)^T u = 0 over two joint angles and the unit wrench u.

    A 6 x 7 matrix loses rank on a set of codimension 2, so two joints suffice. It may not converge,
    which the caller checks.
    """
    q = q.copy()
    for _ in range(8):
        U, _, _ = np.linalg.svd(arm.jacobian(q))
        J_T, u, other_directions = arm.jacobian(q).T, U[:, -1], U[:, :-1]
        slopes = [_jacobian_derivative(arm, q, joint).T @ u for joint in joints]
        step = np.linalg.lstsq(
            np.column_stack([J_T @ other_directions, *slopes]), -J_T @ u, rcond=None
        )[0]
        q[list(joints)] += step[-2:]
    return q


def _jacobian_derivative(arm: Arm, q: FloatArray, joint: int) -> FloatArray:
    """Derivative of the Jacobian by one joint, by central differences, shape (6, 7)."""
    step = np.zeros(len(q))
    step[joint] = 1e-6
    return (arm.jacobian(q + step) - arm.jacobian(q - step)) / 2e-6


_DRAW: dict[Scenario, Callable[[Arm, np.random.Generator], FloatArray]] = {
    Scenario.MID_RANGE: _uniform,
    Scenario.AT_LIMITS: _at_limits,
    Scenario.ELBOW_STRAIGHT: _elbow_straight,
    Scenario.WRIST_SINGULAR: _wrist_singular,
}

_STREAMS = {
    Scenario.MID_RANGE: 0,
    Scenario.AT_LIMITS: 2,
    Scenario.ELBOW_STRAIGHT: 3,
    Scenario.WRIST_SINGULAR: 4,
}
"""Part of the random key of each scenario; another number means other poses."""

_CAPTIONS = {
    Scenario.MID_RANGE: "uniform poses, mid-range seed",
    Scenario.NEAR: f"the same poses, seed within {NEAR_RAD:g} rad of the solution",
    Scenario.AT_LIMITS: "1-3 joints exactly on a limit, mid-range seed",
    Scenario.ELBOW_STRAIGHT: "elbow straight (singular), mid-range seed",
    Scenario.WRIST_SINGULAR: "wrist singular, mid-range seed",
}
