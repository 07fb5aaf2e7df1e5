"""Who stands where: bodies as solids, the robot's links, and what the hands hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from baxter_kin.fields import evolve
from referee.clearance import Track, distance_m, inverse
from referee.motion import arm_joints
from referee.solids import Array, Solid, box_solid, solid_of
from referee.urdf import Robot

FLOOR_Z_M = -0.93
"""Of the ground, seen from base."""

DOWN_M, UP_M = 1e-3, 6e-4
"""What carries a body is in its way down, and no more once it is lifted by what a contact may
press."""


@dataclass(frozen=True)
class Thing:
    """A body: its solids, each with its pose on the body, and where it is seen from base."""

    name: str
    parts: tuple[tuple[Solid, Array], ...]
    T: Array

    @classmethod
    def of(cls, body: Any) -> Thing:
        """From the data of a body."""
        parts = tuple(
            (solid_of(body.name, part.shape), np.array(part.T_body_part.homogeneous))
            for part in body.parts
        )
        return cls(body.name, parts, np.array(body.T_base_body.homogeneous))

    def at(self, T: Array) -> Thing:
        """The same body elsewhere."""
        return evolve(self, T=T)

    def raised(self, height_m: float) -> Thing:
        """The same body higher up."""
        T = self.T.copy()
        T[2, 3] += height_m
        return self.at(T)

    def tracks(self, T: Array | None = None) -> list[Track]:
        """Its solids where it is, or at other poses, shape (n, 4, 4)."""
        return [Track(solid, (self.T if T is None else T) @ T_part) for solid, T_part in self.parts]

    def gap_m(self, other: Thing) -> float:
        """Distance of surfaces."""
        return min(
            distance_m(a.solid, b.solid, inverse(b.T) @ a.T)
            for a in self.tracks()
            for b in other.tracks()
        )


@dataclass(frozen=True)
class Stage:
    """One moment.

    Attributes:
        robot: all links.
        limb: the arm that the plan moves.
        joints: every joint of the robot, by name.
        things: bodies by name; the one in the hand of `limb` not among them.
        held: the body in that hand, or None.
        T_tip_held: where it is seen from the tip.
    """

    robot: Robot
    limb: str
    joints: Mapping[str, float]
    things: Mapping[str, Thing]
    held: Thing | None = None
    T_tip_held: Array | None = None

    @classmethod
    def of(cls, plan: Any, state: Any, robot: Robot) -> Stage:
        """The moment before the first step."""
        joints = {name: float(value) for name, value in state.joints.items()}
        joints |= dict(zip(arm_joints(plan.limb), np.array(plan.q_start).tolist(), strict=True))
        things = {body.name: Thing.of(body) for body in state.scene}
        stage = cls(robot, plan.limb, joints, things)
        for holding in state.attachments:
            T_tip_body = np.array(holding.T_link_body.homogeneous)
            T = stage.tip(holding.side) @ T_tip_body
            stage = stage.with_thing(stage.things[holding.body].at(T))
            if holding.side == plan.limb:
                stage = stage.holding(holding.body, T_tip_body)
        return stage

    def tip(self, side: str) -> Array:
        """Where the tip of an arm is, shape (4, 4)."""
        return self.robot.poses(self.joints)[f"{side}_gripper"]

    @property
    def finger_names(self) -> tuple[str, str]:
        """Both finger joints of the hand, the one that opens along +y first."""
        letter = self.limb[0]
        return f"{letter}_gripper_l_finger_joint", f"{letter}_gripper_r_finger_joint"

    @property
    def opening_m(self) -> float:
        """Finger position, 0 when closed."""
        return self.joints[self.finger_names[0]]

    @property
    def stroke_m(self) -> float:
        """Finger position when fully open."""
        return self.robot.joint(self.finger_names[0]).upper

    @property
    def fingers(self) -> set[str]:
        """Links of both fingers."""
        return self.robot.below(set(self.finger_names))

    @property
    def hand(self) -> set[str]:
        """Links of wrist, hand and gripper, the fingers among them."""
        wrist = self.robot.group[f"{self.limb}_wrist"]
        palm = {link for link, group in self.robot.group.items() if group == wrist}
        return palm | self.fingers

    @property
    def in_hand(self) -> Thing | None:
        """What is held, where it is now."""
        if self.held is None or self.T_tip_held is None:
            return None
        return self.held.at(self.tip(self.limb) @ self.T_tip_held)

    def moved(self, q: Array) -> Stage:
        """The arm elsewhere; what it holds comes along."""
        return evolve(
            self,
            joints={
                **self.joints,
                **dict(zip(arm_joints(self.limb), q.tolist(), strict=True)),
            },
        )

    def opened(self, opening_m: float) -> Stage:
        """The fingers elsewhere."""
        first, second = self.finger_names
        return evolve(self, joints={**self.joints, first: opening_m, second: -opening_m})

    def with_thing(self, thing: Thing) -> Stage:
        """A body put somewhere."""
        return evolve(self, things={**self.things, thing.name: thing})

    def holding(self, name: str, T_tip_held: Array) -> Stage:
        """A body taken into the hand."""
        others = {key: thing for key, thing in self.things.items() if key != name}
        return evolve(self, things=others, held=self.things[name], T_tip_held=np.array(T_tip_held))

    def released(self) -> Stage:
        """What is held, left where it is."""
        thing = self.in_hand
        assert thing is not None
        return evolve(self.with_thing(thing), held=None, T_tip_held=None)

    def links(self, joints: Mapping[str, Array | float]) -> dict[str, list[Track]]:
        """Every solid of every link where some joints, shape (n,) or (), put it."""
        T = self.robot.poses({**self.joints, **joints})
        return {
            link: [Track(solid, T[link]) for solid in solids]
            for link, solids in self.robot.solids.items()
            if solids
        }

    def supports(self, thing: Thing, down_m: float = DOWN_M) -> set[str]:
        """Names of the bodies that carry another where it is, or would if it fell so far."""
        lower, higher = thing.raised(-down_m), thing.raised(UP_M)
        return {
            name
            for name, other in self.things.items()
            if name != thing.name and lower.gap_m(other) == 0.0 and higher.gap_m(other) > 0.0
        }

    def fallen(self, thing: Thing, room_m: float) -> float:
        """How far a body falls straight until it meets another or the floor; at most some room."""
        ground = box_solid("floor", np.array([10.0, 10.0, 1.0]))
        T = np.eye(4)
        T[2, 3] = FLOOR_Z_M - 0.5
        others = [other for name, other in self.things.items() if name != thing.name]
        others.append(Thing("floor", ((ground, np.eye(4)),), T))
        return min(travel_m(thing.tracks(), o.tracks(), (0, 0, -1), room_m) for o in others)


NEAR_M = 1e-7
MOST_STEPS = 20_000


def travel_m(
    moving: list[Track], still: list[Track], along: tuple[float, float, float], room_m: float
) -> float:
    """How far solids move along a unit vector of base until they touch others; at most some room.

    They may move by what separates them, again and again.
    """
    travelled = 0.0
    for _ in range(MOST_STEPS):
        shift = np.eye(4)
        shift[:3, 3] = travelled * np.array(along)
        gap = min(
            distance_m(a.solid, b.solid, inverse(b.T) @ shift @ a.T) for a in moving for b in still
        )
        travelled += gap
        if travelled >= room_m:
            return room_m
        if gap < NEAR_M:
            return travelled
    return travelled
