"""Stretch: samples of the robot in motion, and what stands or is held meanwhile.

A stretch is a run of moves of the arm, with the fingers still, or one travel of the fingers, with
the arm still and perhaps a body that they push. Nine coordinates say how far things went: the seven
joints, a finger, and the pushed body.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from baxter_kin.validation import FloatArray
from planner.plan import Grip, Move
from planner.verification.body.solid import Solid
from planner.verification.urdf_robot import UrdfRobot

FINGER, PUSH = 7, 8
"""Coordinates after those of the joints."""

IN_HAND = -1
"""The joint of what is held: the tip of the arm that moves, shifted by a push."""


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """One step of a plan within a stretch.

    Attributes:
        step: the move or gripper action.
        first: number of its first sample.
        last: of its last one.
        touched: names of the bodies that the fingers may touch meanwhile.
        is_taken: whether what is held may still touch what it stood on at the first sample.
        is_put_down: whether it may already touch what it stands on at the last sample.
    """

    step: Move | Grip
    first: int
    last: int
    touched: frozenset[str] = frozenset()
    is_taken: bool = False
    is_put_down: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Samples, and the shapes around.

    Attributes:
        q: configurations of all joints, shape (k, nq).
        gone: how far each coordinate went since the first sample, back and forth, shape (k, 9).
        pushed_m: how far what is in the hand was pushed along y of the tip, shape (k,).
        at: time within the step, s, or how far each finger is open, m; shape (k,).
        sections: in order.
        still: shapes of the scene, and of what the other hand holds.
        held: shapes in this hand, or between its fingers.
    """

    q: FloatArray
    gone: FloatArray
    pushed_m: FloatArray
    at: FloatArray
    sections: tuple[Section, ...]
    still: tuple[Solid, ...] = ()
    held: tuple[Solid, ...] = ()

    def where(self, section: Section, sample: int) -> str:
        """Step, and time or opening."""
        if isinstance(section.step, Move):
            return f"{section.step.label}, {self.at[sample]:.4f} s"
        return f"{section.step.label}, each finger {1e3 * self.at[sample]:.3f} mm open"


def lever_arms(robot: UrdfRobot, solid: Solid) -> FloatArray:
    """How far any point of a shape goes at most with each coordinate, shape (9,)."""
    arms = np.zeros(PUSH + 1)
    level = arm_level(robot, solid.joint)
    if not level:
        return arms
    beyond = solid.farthest_m()
    if solid.joint == IN_HAND:
        arms[PUSH] = 1.0
        beyond += float(np.linalg.norm(robot.T_wrist_tip().translation)) + 2 * robot.stroke_m
    elif solid.joint in robot.fingers:
        arms[FINGER] = 1.0
        beyond += _length(robot, solid.joint) + robot.stroke_m
    for number in reversed(range(level)):
        arms[number] = beyond
        beyond += _length(robot, robot.arm_joints[number])
    return arms


def relative_arms(robot: UrdfRobot, first: Solid, second: Solid) -> FloatArray:
    """How far any point of one shape goes at most relative to another's, shape (9,).

    Joints that move both do not count: seen from the inner one, the outer one alone moves.
    """
    inner, outer = sorted((first, second), key=lambda solid: arm_level(robot, solid.joint))
    arms = lever_arms(robot, outer)
    arms[: arm_level(robot, inner.joint)] = 0.0
    if arm_level(robot, inner.joint) == FINGER:
        arms[FINGER:] += lever_arms(robot, inner)[FINGER:]
    return arms


def arm_level(robot: UrdfRobot, joint: int) -> int:
    """How many joints of the arm move what a joint carries."""
    if joint == IN_HAND or joint in robot.fingers:
        return len(robot.arm_joints)
    return robot.arm_joints.index(joint) + 1 if joint in robot.arm_joints else 0


def _length(robot: UrdfRobot, joint: int) -> float:
    return math.dist(robot.model.jointPlacements[joint].translation, (0.0, 0.0, 0.0))
