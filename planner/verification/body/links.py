"""Which pairs of the robot's own links are checked.

Every pair is, with one shape on the arm that moves, but

- links that are rigid to each other: both before or both behind the same joints;
- links one joint apart, which are mounted on each other: most of them touch in their bearing, and
  the rest keep the same distance at every angle;
- links two joints apart, which never touch at any two angles of those joints. It was measured on
  the meshes over the whole range of both, and is tested (`test_verification_links.py`): the upper
  elbow comes nearest, to 1.7 mm from the upper forearm when the elbow is bent to its end.
"""

from __future__ import annotations

import pinocchio as pin

from planner.verification.body.solid import Solid

MOUNTED = 2
"""Links so many joints apart, or fewer, are left out."""


def joints_between(model: pin.Model, first: int, second: int) -> int:
    """How many joints move one joint's links relative to another's."""
    return len(set(_chain(model, first)) ^ set(_chain(model, second)))


def is_checked(model: pin.Model, first: Solid, second: Solid) -> bool:
    """Whether two shapes of the robot could meet."""
    return joints_between(model, first.joint, second.joint) > MOUNTED


def _chain(model: pin.Model, joint: int) -> list[int]:
    """The joints from base to a joint."""
    return [int(parent) for parent in model.supports[joint]][1:]
