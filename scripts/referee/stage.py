"""Where everything is at one moment, how fingers close, and how far bodies fall.

Closing is quasi-static: the pad that touches first pushes the body along the closing axis, y of the
tip, until the other one touches; the body does not turn. Pads are the finger tips, with all their
triangles. The rest of a finger does not push: where it meets the body before the pads do, it will
be found inside it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from referee.pairs import Track
from referee.robot import Robot, arm_joints
from referee.solids import Array, Solid, box_solid, distance_m, inverse, solid_of

FLOOR_Z_M = -0.93
"""Height of the ground, seen from base."""

DOWN_M, UP_M = 1e-3, 6e-4
"""What carries a body is in its way down, and no more once it is lifted by as much as a contact may
press."""

PAD = "_finger_tip"
"""Suffix of the links that are pads."""

FINGER_STEP_M = 5e-5
"""How far fingers move at most from one sample to the next."""

TOUCHED_M, MAX_STEPS = 1e-7, 20_000
"""Where a movement up to the first contact ends."""


@dataclass(frozen=True)
class Thing:
    """A body: its solids, each with its pose on the body, and the body's pose in base."""

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
        return replace(self, T=T)

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
        return _gap_m(self.tracks(), other.tracks())


@dataclass(frozen=True)
class Stage:
    """One moment.

    Attributes:
        robot: all links.
        limb: the arm that the plan moves.
        joints: every joint of the robot, by name.
        things: bodies by name, without the one in the hand of `limb`.
        held: the body in that hand, or None.
        T_tip_held: its pose seen from the tip.
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
        things = {body.name: Thing.of(body) for body in state.scene}
        stage = cls(robot, plan.limb, joints, things).moved(np.array(plan.q_start))
        for holding in state.attachments:
            T_tip_body = np.array(holding.T_link_body.homogeneous)
            T = stage.tip(holding.side) @ T_tip_body
            stage = stage.with_thing(stage.things[holding.body].at(T))
            if holding.side == plan.limb:
                stage = stage.holding(holding.body, T_tip_body)
        return stage

    def tip(self, side: str) -> Array:
        """The pose of an arm's tip in base, shape (4, 4)."""
        return self.robot.poses(self.joints)[f"{side}_gripper"]

    def tips(self, q: Array) -> Array:
        """Poses of the tip for positions of the arm, shape (n, 7): (n, 4, 4)."""
        return self.robot.poses({**self.joints, **self.arm(q)})[f"{self.limb}_gripper"]

    def arm(self, q: Array) -> dict[str, Any]:
        """Positions of the arm, shape (7,) or (n, 7), by joint."""
        return dict(zip(arm_joints(self.limb), q.T, strict=True))

    def fingers(self, opening_m: Any) -> dict[str, Any]:
        """Positions of both finger joints, the one that opens along +y first."""
        letter = self.limb[0]
        return {f"{letter}_gripper_{side}_finger_joint": sign * opening_m for side, sign in SIDES}

    @property
    def opening_m(self) -> float:
        """Finger position, 0 when closed."""
        return self.joints[next(iter(self.fingers(0.0)))]

    @property
    def stroke_m(self) -> float:
        """Finger position when fully open."""
        return self.robot.joint(next(iter(self.fingers(0.0)))).upper

    @cached_property
    def finger_links(self) -> set[str]:
        """Links of both fingers."""
        return self.robot.below(self.fingers(0.0))

    @cached_property
    def hand_links(self) -> set[str]:
        """Links of wrist, hand and gripper, the fingers among them."""
        return self.robot.rigid_to(f"{self.limb}_wrist") | self.finger_links

    @property
    def in_hand(self) -> Thing | None:
        """What is held, where it is now."""
        if self.held is None or self.T_tip_held is None:
            return None
        return self.held.at(self.tip(self.limb) @ self.T_tip_held)

    def moved(self, q: Array) -> Stage:
        """The arm elsewhere; what it holds comes along."""
        joints = {name: float(value) for name, value in self.arm(q).items()}
        return replace(self, joints={**self.joints, **joints})

    def opened(self, opening_m: float) -> Stage:
        """The fingers elsewhere."""
        return replace(self, joints={**self.joints, **self.fingers(opening_m)})

    def with_thing(self, thing: Thing) -> Stage:
        """A body put somewhere."""
        return replace(self, things={**self.things, thing.name: thing})

    def holding(self, name: str, T_tip_held: Array) -> Stage:
        """A body taken into the hand."""
        others = {key: thing for key, thing in self.things.items() if key != name}
        return replace(self, things=others, held=self.things[name], T_tip_held=T_tip_held)

    def closed(self, thing: Thing | None, found: Closing) -> Stage:
        """The hand after it has closed, with a body in it that both pads met."""
        stage = self.opened(float(found.openings_m[-1]))
        if thing is None or not found.holds:
            return stage
        T = found.T_things[-1]
        T_tip_thing = np.linalg.inv(stage.tip(stage.limb)) @ T
        return stage.with_thing(thing.at(T)).holding(thing.name, T_tip_thing)

    def goal_of(self, grip: Any) -> float:
        """Where an opening grip brings the fingers."""
        return self.stroke_m if grip.opening_m is None else float(grip.opening_m)

    def released(self) -> Stage:
        """What is held, left where it is."""
        thing = self.in_hand
        return self if thing is None else replace(self.with_thing(thing), held=None)

    def without(self, names: Iterable[str]) -> Stage:
        """The same without some bodies that are not held."""
        gone = set(names)
        things = {name: thing for name, thing in self.things.items() if name not in gone}
        return replace(self, things=things)

    def links(self, joints: Mapping[str, Array | float]) -> dict[str, list[Track]]:
        """The solids of each link where some joints, shape (n,) or (), put it."""
        T = self.robot.poses({**self.joints, **joints})
        return {
            link: [Track(solid, T[link]) for solid in solids]
            for link, solids in self.robot.solids.items()
            if solids
        }

    def others(self, thing: Thing | None) -> list[Thing]:
        """All bodies but one."""
        return [each for each in self.things.values() if thing is None or each.name != thing.name]

    def supports(self, thing: Thing, down_m: float = DOWN_M) -> set[str]:
        """Names of the bodies that carry another where it is, or would if it fell so far."""
        lower, higher = thing.raised(-down_m), thing.raised(UP_M)
        return {
            other.name
            for other in self.others(thing)
            if lower.gap_m(other) == 0.0 and higher.gap_m(other) > 0.0
        }

    def drop_m(self, thing: Thing, max_m: float) -> float:
        """How far a body falls straight until it meets another or the floor."""
        T = np.eye(4)
        T[2, 3] = FLOOR_Z_M - 0.5
        floor = Thing("floor", ((box_solid("floor", np.array([10.0, 10.0, 1.0])), np.eye(4)),), T)
        down = np.array([0.0, 0.0, -1.0])
        return min(
            _travel_m(thing.tracks(), other.tracks(), down, max_m)
            for other in (*self.others(thing), floor)
        )


SIDES = (("l", 1.0), ("r", -1.0))
"""Fingers of a hand, and the sign of their joints."""


@dataclass(frozen=True)
class Closing:
    """How a hand closes.

    Attributes:
        openings_m: finger positions on the way, shape (n,).
        T_things: poses of the body meanwhile, shape (n, 4, 4).
        holds: whether both pads meet the body.
    """

    openings_m: Array
    T_things: Array
    holds: bool


def closing(stage: Stage, thing: Thing | None) -> Closing:
    """The hand closes from where its fingers are, around a body or nothing."""
    begin_m, axis = stage.opening_m, stage.tip(stage.limb)[:3, 1]
    openings, T = openings_m(begin_m, 0.0), np.eye(4) if thing is None else thing.T
    first, second = (np.inf, np.inf) if thing is None else _ways_m(stage, thing, 2 * begin_m)
    closed_m = (first + second) / 2
    holds = closed_m <= begin_m and max(first, second) < 2 * begin_m
    if holds:
        openings = openings_m(begin_m, begin_m - closed_m)
    T_things = np.tile(T, (len(openings), 1, 1))
    if holds:
        closed = begin_m - openings
        pushed = np.maximum(closed - second, 0.0) - np.maximum(closed - first, 0.0)
        T_things[:, :3, 3] += pushed[:, None] * axis
    return Closing(openings, T_things, holds)


def openings_m(begin_m: float, end_m: float) -> Array:
    """From one finger position to another, shape (n,)."""
    count = 1 + int(np.ceil(abs(end_m - begin_m) / FINGER_STEP_M))
    return np.linspace(begin_m, end_m, max(count, 2))


def _ways_m(stage: Stage, thing: Thing, max_m: float) -> list[float]:
    """How far each pad moves until it touches a body."""
    links, axis = stage.links({}), stage.tip(stage.limb)[:3, 1]
    ways = []
    for joint, sign in stage.fingers(1.0).items():
        tips = [link for link in stage.robot.below({joint}) if link.endswith(PAD)]
        pad = [track for link in tips for track in links[link]]
        ways.append(_travel_m(pad, thing.tracks(), -sign * axis, max_m))
    return ways


def _travel_m(moving: list[Track], still: list[Track], along: Array, max_m: float) -> float:
    """How far solids move along a unit vector of base until they touch others.

    They may move by what separates them, again and again.
    """
    travelled, shift = 0.0, np.eye(4)
    for _ in range(MAX_STEPS):
        shift[:3, 3] = travelled * along
        gap = _gap_m([Track(track.solid, shift @ track.T) for track in moving], still)
        travelled += gap
        if travelled >= max_m:
            return max_m
        if gap < TOUCHED_M:
            break
    return travelled


def _gap_m(tracks: list[Track], others: list[Track]) -> float:
    """Smallest distance of standing solids."""
    return min(distance_m(a.solid, b.solid, inverse(b.T) @ a.T) for a in tracks for b in others)
