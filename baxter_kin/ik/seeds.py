"""Seeds: the configurations from which searches start.

Modes, types, their numbers and labels are those of the service that this one replaces
(SolvePositionIK of the Rethink SDK 1.2). The null-space map of the real robot was never published;
ours is the table in `setpoints.json`, which `scripts/build_setpoints.py` computes and explains.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import suppress
from enum import IntEnum
from functools import cache, cached_property, partial
from importlib.resources import files
from typing import TypeAlias

import numpy as np

from baxter_kin.errors import UnknownNameError
from baxter_kin.ik.reach.closed_form import ClosedForm
from baxter_kin.ik.tolerance import EXACT, Task, Tolerance
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, Indices

FEATURE_WEIGHT_M = 0.3
"""Weight of rotation in the comparison of poses: metres per unit of the matrices' difference."""

PERTURBATION_RAD = 0.5
"""Standard deviation of further starts around a seed: wide enough to leave its basin."""

SEED_STARTS = 32
"""Starts around a seed if it is the only one allowed. Otherwise it gets one start, since the
null-space map, which depends on the pose, gives better restarts."""

MAP_STARTS = 20
"""Number of setpoints tried, nearest first. They leave 3 of 1,000 uniform poses unsolved."""


class SeedMode(IntEnum):
    """The seeds that a request allows."""

    AUTO = 0
    """USER if given, then CURRENT if given, then NS_MAP, until one leads to a solution."""
    USER = 1
    CURRENT = 2
    NS_MAP = 3

    @classmethod
    def of(cls, mode: object) -> SeedMode:
        """The mode with a number; an `UnknownNameError` if there is none."""
        if not isinstance(mode, bool):
            with suppress(ValueError):
                return cls(mode)  # type: ignore[arg-type]  # any object may come from outside
        raise UnknownNameError("seed mode", mode, [f"SeedMode.{m.name}" for m in cls])

    @property
    def seed_types(self) -> tuple[SeedType, ...]:
        """The types that it tries, in order."""
        if self is SeedMode.AUTO:
            return (SeedType.USER, SeedType.CURRENT, SeedType.NS_MAP)
        return (SeedType(self.value),)


class SeedType(IntEnum):
    """The seed that led to a solution."""

    INVALID = 0
    USER = 1
    CURRENT = 2
    NS_MAP = 3

    @property
    def label(self) -> str:
        """The words that the original demo prints."""
        return _LABELS[self]


_LABELS = {
    SeedType.INVALID: "No Valid Solution",
    SeedType.USER: "User Provided Seed",
    SeedType.CURRENT: "Current Joint Angles",
    SeedType.NS_MAP: "Nullspace Setpoints",
}


def starts_around(arm: Arm, q_seeds: FloatArray, count: int) -> Iterator[FloatArray]:
    """Starts at seeds, then at points scattered around them; the same ones every time.

    Args:
        arm: the arm, whose limits the points keep.
        q_seeds: shape (m, 7), rad.
        count: number of starts for each seed.

    Yields:
        Arrays of shape (m, 7), rad.
    """
    yield q_seeds
    rng = np.random.default_rng(1)
    for _ in range(count - 1):
        scattered = q_seeds + PERTURBATION_RAD * rng.standard_normal(7)
        yield np.clip(scattered, arm.limits.q_min, arm.limits.q_max)


Starts: TypeAlias = Callable[[FloatArray, int], FloatArray]
"""Computes a number of starts for each pose, shape (m, 4, 4): shape (m, number, 7), rad, best
first."""


class NullSpaceMap:
    """The starts of an arm's searches without a seed: stored configurations and computed ones.

    Both depend on the pose of the gripper. With a tolerance, they are taken in turns from the
    starts for a sample of the allowed gripper poses.
    """

    def __init__(self, arm: Arm, tolerance: Tolerance = EXACT) -> None:
        self._arm, self._task = arm.at_gripper, Task.of(arm, tolerance)
        self._closed_form = cache(partial(ClosedForm, self._arm))

    @cached_property
    def setpoints(self) -> FloatArray:
        """The stored configurations, shape (n, 7), rad, clipped to the arm's limits."""
        limits = self._arm.limits
        return setpoint_table(self._arm.side)[1].clip(limits.q_min, limits.q_max)

    def nearest(self, Ts: FloatArray) -> Indices:
        """The setpoints whose regions are nearest to any of the allowed poses, nearest first.

        Args:
            Ts: requested poses of the tip, shape (m, 4, 4).

        Returns:
            Indices, shape (m, `MAP_STARTS`).
        """
        middles, poses = setpoint_table(self._arm.side)[0], self._task.gripper_poses(Ts)
        features = pose_features(poses.reshape(-1, 4, 4))
        distances = (middles**2).sum(axis=1) - 2 * (features @ middles.T)
        least = distances.reshape(*poses.shape[:2], -1).min(axis=1)
        order: Indices = least.argsort(axis=1)[:, :MAP_STARTS]
        return order

    def coarse(self, Ts: FloatArray, count: int) -> FloatArray:
        """Starts, as of `Starts`, that take a quarter of a millisecond to compute."""
        return self._in_turns(self._closed_form(turns=16, rolls=1), Ts, count)

    def fine(self, Ts: FloatArray, count: int) -> FloatArray:
        """Starts that take one or two milliseconds: 0.07 rad apart in s0, with all rolls."""
        return self._in_turns(self._closed_form(turns=48, rolls=4), Ts, count)

    def scattered(self, Ts: FloatArray, count: int) -> FloatArray:
        """Starts from all over the joint ranges, uniform, the same ones for every pose.

        The others are dense where most of a pose's self-motion is nearly inside the limits; these
        also find an isolated solution elsewhere, between several limits.
        """
        rng, limits = np.random.default_rng(2), self._arm.limits
        q = rng.uniform(limits.q_min, limits.q_max, (count, 7))
        return np.broadcast_to(q, (len(Ts), count, 7))

    def _in_turns(self, closed_form: ClosedForm, Ts: FloatArray, count: int) -> FloatArray:
        """Starts for all allowed gripper poses, taken in turns."""
        poses = self._task.gripper_poses(Ts)
        each = -(-count // poses.shape[1])
        starts = closed_form.starts(poses.reshape(-1, 4, 4), each)
        in_turns: FloatArray = starts.reshape(len(Ts), -1, each, 7).transpose(0, 2, 1, 3)
        return in_turns.reshape(len(Ts), -1, 7)[:, :count]


@cache
def setpoint_table(side: str) -> tuple[FloatArray, FloatArray]:
    """Stored regions of poses with a configuration for each.

    Args:
        side: "left" or "right".

    Returns:
        The regions' middles as `pose_features`, shape (n, 12), and setpoints, shape (n, 7), rad.
    """
    text = (files("baxter_kin.ik") / "setpoints.json").read_text("utf-8")
    rows = json.loads(text)[side]
    middles = np.zeros((len(rows), 4, 4))
    middles[:, :3, 3] = [row["p_base_tip_m"] for row in rows]
    middles[:, :3, :3] = np.reshape([row["R_base_tip"] for row in rows], (-1, 3, 3))
    return pose_features(middles), np.array([row["q_rad"] for row in rows])


def pose_features(Ts: FloatArray) -> FloatArray:
    """Poses as points whose Euclidean distances compare them, shape (m, 12), in metres.

    Args:
        Ts: matrices, shape (m, 4, 4).
    """
    rotations = FEATURE_WEIGHT_M * Ts[:, :3, :3].reshape(-1, 9)
    return np.concatenate([Ts[:, :3, 3], rotations], axis=1)
