"""Seeds: where a search begins, and which of them led to a solution.

Modes, types, their numbers and labels are those of the service that this replaces (SolvePositionIK
of the Rethink SDK 1.2). The null-space map of the real robot was never published; ours is the table
in `setpoints.json`, which `scripts/build_setpoints.py` computes and explains.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from importlib.resources import files

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Vector
from baxter_kin.errors import UnknownNameError
from baxter_kin.frames import angle_between
from baxter_kin.model import Arm

ROTATION_WEIGHT_M_PER_RAD = 0.3
"""What one radian counts against metres when poses are compared: about a forearm's length."""

PERTURBATION_RAD = 0.5
"""Spread (sigma) of the further starts around a seed: wide enough to leave its basin."""

STARTS_PER_TYPE = 8
"""Starts of each seed type. From the null-space map alone, 8 starts solved 1,000 of 1,000 poses
within 5 cm of the demo's block poses and 599 of 600 anywhere; one start solved 492 of those 600."""


class SeedMode(IntEnum):
    """Which seeds a request allows."""

    AUTO = 0
    """USER when given, then CURRENT when given, then NS_MAP, until one is valid."""
    USER = 1
    CURRENT = 2
    NS_MAP = 3

    @classmethod
    def of(cls, mode: object) -> SeedMode:
        """The mode of that number.

        Raises:
            UnknownNameError: when there is none.
        """
        try:
            return cls(mode)  # type: ignore[arg-type]  # any object may come from outside
        except ValueError:
            raise UnknownNameError("seed mode", mode, [f"SeedMode.{m.name}" for m in cls]) from None


class SeedType(IntEnum):
    """Which seed led to a solution."""

    INVALID = 0
    USER = 1
    CURRENT = 2
    NS_MAP = 3

    @property
    def label(self) -> str:
        """The words the original demo prints."""
        return _LABELS[self]


_LABELS = {
    SeedType.INVALID: "No Valid Solution",
    SeedType.USER: "User Provided Seed",
    SeedType.CURRENT: "Current Joint Angles",
    SeedType.NS_MAP: "Nullspace Setpoints",
}


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Where one search begins.

    Attributes:
        seed_type: the type it counts for.
        q_seed: the configuration to stay close to, shape (7,), rad.
        q_start: the first iterate, shape (7,), rad; the seed itself or a point around it.
    """

    seed_type: SeedType
    q_seed: Vector
    q_start: Vector


def starts_around(arm: Arm, seed_type: SeedType, q_seed: Vector) -> Iterator[Start]:
    """The seed itself, then points scattered around it, the same ones every time."""
    yield Start(seed_type, q_seed, q_seed)
    rng = np.random.default_rng(seed_type)
    for _ in range(STARTS_PER_TYPE - 1):
        scattered = q_seed + PERTURBATION_RAD * rng.standard_normal(q_seed.size)
        q_start = np.clip(scattered, arm.limits.q_min, arm.limits.q_max)
        yield Start(seed_type, q_seed, q_start)


class NullSpaceMap:
    """Stored configurations of an arm, chosen by the requested pose."""

    def __init__(self, arm: Arm) -> None:
        """Read nothing yet: the table is loaded when first asked."""
        self._arm = arm

    @cached_property
    def setpoints(self) -> Vector:
        """The stored configurations, shape (n, 7), rad."""
        table = json.loads((files("baxter_kin.ik") / "setpoints.json").read_text("utf-8"))
        return np.array(table[self._arm.side])

    @cached_property
    def _poses(self) -> tuple[pin.SE3, ...]:
        return tuple(self._arm.T_base_tip(q) for q in self.setpoints)

    def starts(self, T_base_tip: pin.SE3) -> Iterator[Start]:
        """The setpoints whose tip poses are nearest to the requested one, nearest first."""
        distances = [_pose_distance_m(pose, T_base_tip) for pose in self._poses]
        for index in np.argsort(distances, kind="stable")[:STARTS_PER_TYPE]:
            q = self.setpoints[index]
            yield Start(SeedType.NS_MAP, q, q)


def _pose_distance_m(T_base_a: pin.SE3, T_base_b: pin.SE3) -> float:
    offset = float(np.linalg.norm(T_base_a.translation - T_base_b.translation))
    angle = angle_between(T_base_a.rotation, T_base_b.rotation)
    return offset + ROTATION_WEIGHT_M_PER_RAD * angle
