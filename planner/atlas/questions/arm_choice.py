"""Which arm: exact answers for poses and each arm of a map, and the better arm for all of them.

A map has answers at its cells only. Here each pose is solved as it is: of all solutions found along
its self-motion, the one farthest from the joint limits is its witness.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from baxter_kin import IKService
from baxter_kin.display import position, quoted
from baxter_kin.errors import PoseError
from baxter_kin.fields import frozen, mapping
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.kinematics.arm import Arm
from baxter_kin.kinematics.limits import JointLimits
from baxter_kin.validation import FloatArray, expect
from planner.atlas.reach_map import ReachMap
from planner.errors import AtlasError

EQUAL_RAD = 1e-3
"""Margins that differ by less count as equal."""


@frozen(error=AtlasError)
class PoseAnswer:
    """Whether one arm reaches a pose.

    Attributes:
        label: name of the pose, such as "red: pick".
        side: of the arm.
        T_base_tip: the pose.
        q: the witness, shape (7,), rad; None without one.
        margin_rad: distance of the witness to the nearest joint limit; None without one.
        nearest_limit: name of that joint.
        is_proven_unreachable: whether it is proven that there is no witness.
        reason: why there is none, a clause; empty with one.
    """

    label: str
    side: str
    T_base_tip: pin.SE3
    q: FloatArray | None = None
    margin_rad: float | None = None
    nearest_limit: str = ""
    is_proven_unreachable: bool = False
    reason: str = ""

    @property
    def is_reachable(self) -> bool:
        """Whether there is a witness."""
        return self.q is not None

    @property
    def status(self) -> str:
        """As of cells of a map: "reachable", "unreachable" (proven) or "undecided"."""
        if self.is_reachable:
            return "reachable"
        return "unreachable" if self.is_proven_unreachable else "undecided"

    def __str__(self) -> str:
        if self.margin_rad is None:
            return f"the {self.side} arm does not reach it: {self.reason}"
        return (
            f"the {self.side} arm reaches it, {self.margin_rad:.3f} rad from the limit of "
            f"{self.nearest_limit}"
        )

    def _facts(self) -> tuple[str, ...]:
        margin = "" if self.margin_rad is None else f"margin {self.margin_rad:.3f} rad"
        return self.label, self.side, position(self.T_base_tip), self.status, margin


@frozen(error=AtlasError)
class ArmChoice:
    """What each arm reaches.

    Attributes:
        answers: side of the arm -> its exact answer for each pose, in their order.
    """

    answers: Mapping[str, tuple[PoseAnswer, ...]] = mapping()

    @property
    def margins_rad(self) -> dict[str, float]:
        """The smallest margin of each arm; -inf when it does not reach a pose."""
        return {side: least_margin(answers) for side, answers in self.answers.items()}

    @property
    def best(self) -> str | None:
        """The arm that reaches all poses and has the greatest smallest margin; None without one.

        Of arms that are equal within `EQUAL_RAD` it is the first one of the map.
        """
        margins = self.margins_rad
        widest = max(margins.values())
        if widest == -math.inf:
            return None
        return next(side for side, margin in margins.items() if margin >= widest - EQUAL_RAD)

    @property
    def arms_by_pose(self) -> tuple[tuple[str, ...], ...]:
        """The arms that reach each pose."""
        by_pose = zip(*self.answers.values(), strict=True)
        return tuple(tuple(a.side for a in answers if a.is_reachable) for answers in by_pose)

    @property
    def reason(self) -> str:
        """Why this arm is the best, or none is, in a sentence."""
        best = self.best
        others = [side for side in self.answers if side != best]
        first = "no arm does it all" if best is None else f"the {best} arm: it {self._reach(best)}"
        return "; ".join([first, *(f"the {side} arm {self._reach(side)}" for side in others)])

    def _reach(self, side: str) -> str:
        answers = self.answers[side]
        missed = [answer for answer in answers if not answer.is_reachable]
        if missed:
            reached = f"{len(answers) - len(missed)} of {len(answers)}"
            return f"reaches {reached}, not {missed[0].label!r}: {missed[0].reason}"
        worst = min(answers, key=_margin)
        several = len(answers) > 1
        poses, at = (
            (f"all {len(answers)} poses", f" at {worst.label!r}") if several else ("the pose", "")
        )
        return f"reaches {poses}, {worst.margin_rad:.3f} rad from {worst.nearest_limit}'s limit{at}"

    def _facts(self) -> tuple[str, ...]:
        return (self.reason,)


def which_arm(
    atlas: ReachMap, poses: Sequence[PoseLike] | Mapping[str, PoseLike] | PoseLike
) -> ArmChoice:
    """Which arms of a map reach poses, each solved exactly, and which is better for all of them.

    Args:
        atlas: a map of the robot, for its arms; its cells are not used, so poses need not be on
            its grid.
        poses: of the tip seen from base: one, several, or several by name.

    Raises:
        PoseError: when one is invalid, or there is none.
    """
    expect(atlas, ReachMap, "atlas", AtlasError)
    named = _named(poses)
    iks = {side: IKService(atlas.robot.arm(side)) for side in atlas.arms}
    return ArmChoice(
        {
            side: tuple(answer_pose(ik, T, name) for name, T in named.items())
            for side, ik in iks.items()
        }
    )


def answer_pose(ik: IKService, T_base_tip: pin.SE3, label: str = "") -> PoseAnswer:
    """Solve a pose for one arm; it takes tens of milliseconds.

    Args:
        ik: inverse kinematics of the arm.
        T_base_tip: a valid pose.
        label: its name.
    """
    arm = ik.arm
    result = ik.solve(T_base_tip, objective=_WidestMargin())
    if result.failure is None:
        margins = limit_margins(arm.limits, result.q)
        nearest = int(margins.argmin())
        joint = arm.limits.names[nearest]
        return PoseAnswer(label, arm.side, T_base_tip, result.q, float(margins[nearest]), joint)
    return PoseAnswer(
        label,
        arm.side,
        T_base_tip,
        is_proven_unreachable=result.failure.beyond_reach_m > 0.0,
        reason=result.failure.reason,
    )


def least_margin(answers: Sequence[PoseAnswer]) -> float:
    """The smallest margin of answers, rad; -inf when a pose is not reached, or there is none."""
    return min(map(_margin, answers), default=-math.inf)


def limit_margins(limits: JointLimits, q: FloatArray) -> FloatArray:
    """Distance of each joint to its nearest limit, negative outside, shape as `q`, rad."""
    return np.minimum(q - limits.q_min, limits.q_max - q)


@dataclass(frozen=True, slots=True)
class _WidestMargin:
    """An objective of inverse kinematics: maximise the smallest margin, as maps store it."""

    def costs(self, arm: Arm, q: FloatArray) -> FloatArray:
        """Minus the smallest margin of each configuration, shape (n,), rad."""
        return np.array(-limit_margins(arm.limits, q).min(axis=1))


def _margin(answer: PoseAnswer) -> float:
    return -math.inf if answer.margin_rad is None else answer.margin_rad


def _named(poses: Any) -> dict[str, pin.SE3]:
    if isinstance(poses, Mapping):
        named = {str(name): checked_pose(pose) for name, pose in poses.items()}
    elif isinstance(poses, (list, tuple)) and not _is_matrix(poses):
        named = {f"pose {i}": checked_pose(pose) for i, pose in enumerate(poses, start=1)}
    else:
        named = {"pose 1": checked_pose(poses)}
    if not named:
        raise PoseError(f"there must be a pose, one or more, got {quoted(poses)}")
    return named


def _is_matrix(rows: Sequence[object]) -> bool:
    """Whether it is one 4 x 4 matrix written as lists of numbers."""
    return len(rows) == 4 and all(isinstance(r, (list, tuple)) and len(r) == 4 for r in rows)
