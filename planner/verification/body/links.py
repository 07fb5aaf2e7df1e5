"""Which pairs of the robot's own links are checked.

Every pair is, with one shape on the arm that moves, but

- links that are rigid to each other: both before or both behind the same joints;
- links one joint apart, which are mounted on each other: most of them touch in their bearing, and
  the rest keep the same distance at every angle;
- links two joints apart, which never touch at any two angles of those joints. It was measured on
  the meshes over the whole range of both, and is tested (`test_verification_links.py`). One pair is
  an exception and is checked: the upper elbow meets the upper forearm when the elbow is bent to its
  end. As it keeps 36 mm elsewhere at any angle, its distance says nothing of a motion until then,
  so it has a check of its own.
"""

from __future__ import annotations

import pinocchio as pin

from planner.verification.body.solid import Solid

MEETING = ("upper_elbow", "upper_forearm")
"""Links two joints apart that can meet, without their side."""

MOUNTED = 2
"""Links so many joints apart, or fewer, are left out."""


def joints_between(model: pin.Model, first: int, second: int) -> int:
    """How many joints move one joint's links relative to another's."""
    return len(set(_chain(model, first)) ^ set(_chain(model, second)))


def is_checked(model: pin.Model, first: Solid, second: Solid) -> bool:
    """Whether two shapes of the robot could meet, the elbow's fold left to `is_fold`."""
    return joints_between(model, first.joint, second.joint) > MOUNTED


def is_fold(model: pin.Model, first: Solid, second: Solid) -> bool:
    """Whether two shapes are those that meet when an elbow is bent to its end."""
    names = sorted(solid.name.split("_", 1)[1] for solid in (first, second) if "_" in solid.name)
    is_pair = names == sorted(MEETING)
    return is_pair and joints_between(model, first.joint, second.joint) == MOUNTED


def _chain(model: pin.Model, joint: int) -> list[int]:
    """The joints from base to a joint."""
    return [int(parent) for parent in model.supports[joint]][1:]
