"""Contacts on purpose: what touches because that is the task, followed while it goes on.

A clearance that counted them would be zero whenever something is grasped. Left out are

- a hand against a movable body that is between its pads now, or where the move under way began or
  will end: it is about to grasp it, or has just let it go;
- a held body against the hand that holds it, against what it touched when it was grasped and where
  the move under way began or will end, as its support, and against what stands on it.

What bodies in no hand do to each other is not measured at all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin import Arm, Baxter
from baxter_kin.validation import FloatArray
from planner import Body, Scene
from planner.collision.robot.robot_shapes import RobotShapes
from planner.grasping.hand import Hand
from planner.scene.bodies import Box, Part
from planner.scene.contact import touching
from sim.events import Event, EventKind
from sim.view.telemetry.nearest import Contacts

_BETWEEN = "what is between the pads"


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """Robot and bodies at one time.

    Attributes:
        q: a full configuration, shape (19,), rad and m.
        T_base_bodies: of the bodies that are there, by name, shape (4, 4).
    """

    q: FloatArray
    T_base_bodies: Mapping[str, FloatArray]


class ContactsOnPurpose:
    """Knows them at any time, when told of moves and events in their order.

    Attributes:
        bodies: those it was told of, by name; only these count.
    """

    def __init__(self, shapes: RobotShapes) -> None:
        """Nothing is held.

        Args:
            shapes: the robot's.
        """
        robot = self._robot = shapes.robot
        self._arms = {side: list(robot.indices(arm.joint_names)) for side, arm in _arms(robot)}
        self._between = {
            side: _space_between_pads(Hand.of(robot, arm, shapes))
            for side, arm in _arms(robot)
            if Hand.is_on(robot, side)
        }
        self.bodies: dict[str, Body] = {}
        self._held: dict[str, str] = {}
        self._by_hand: dict[str, frozenset[str]] = {}
        self._by_body: dict[str, frozenset[str]] = {}
        self._riders: dict[str, frozenset[str]] = {}

    def hold(self, side: str, name: str, moment: Moment) -> None:
        """From now on a hand holds a body."""
        self._held[side] = name
        around = self._touched(name, None, moment)
        height_m = _height_m(name, moment)
        self._riders[side] = frozenset(
            other
            for other in around
            if self.bodies[other].is_movable and _height_m(other, moment) > height_m
        )
        self._by_body[side] = around
        self._by_hand.pop(side, None)

    def hear(self, event: Event, moment: Moment) -> None:
        """Take note of something that happened; moves are told by `begin`."""
        if event.side is None or event.body is None:
            return
        if event.kind is EventKind.GRASPED:
            self.hold(event.side, event.body.name, moment)
        elif event.kind is EventKind.RELEASED and event.side in self._held:
            self._by_hand[event.side] = frozenset([self._held.pop(event.side)])
            self._by_body.pop(event.side, None)
            self._riders.pop(event.side, None)

    def begin(self, side: str, q_goal: FloatArray, moment: Moment) -> None:
        """An arm begins a move from where it is to a goal, shape (7,), rad."""
        T_start, T_goal = self._T_base_tip(side, moment), self._robot.arm(side).T_base_tip(q_goal)
        name = self._held.get(side)
        if name is None:
            self._by_hand[side] = self._between_pads(side, T_start, moment) | self._between_pads(
                side, T_goal, moment
            )
        elif name in moment.T_base_bodies and name in self.bodies:
            T_goal_body = T_goal * T_start.inverse() * pin.SE3(moment.T_base_bodies[name])
            now, then = (self._touched(name, T, moment) for T in (None, T_goal_body))
            self._by_body[side] = now | then

    def at(self, moment: Moment) -> Contacts:
        """What holds what and may touch at a moment."""
        by_hand = {(side, name) for side, names in self._by_hand.items() for name in names}
        for side in self._between.keys() - self._held.keys():
            T_base_tip = self._T_base_tip(side, moment)
            by_hand |= {(side, name) for name in self._between_pads(side, T_base_tip, moment)}
        held = {side: name for side, name in self._held.items() if name in self.bodies}
        by_body = {
            (held[side], other)
            for touched in (self._by_body, self._riders)
            for side, others in touched.items()
            if side in held
            for other in others
        }
        return Contacts(held, frozenset(by_hand), frozenset(by_body))

    def _touched(self, name: str, T_base_body: pin.SE3 | None, moment: Moment) -> frozenset[str]:
        """What a body touches, where it is or elsewhere."""
        if name not in self.bodies or name not in moment.T_base_bodies:
            return frozenset()
        T = pin.SE3(moment.T_base_bodies[name]) if T_base_body is None else T_base_body
        return touching(self.bodies[name].at(T), self._scene(moment))

    def _between_pads(self, side: str, T_base_tip: pin.SE3, moment: Moment) -> frozenset[str]:
        """The movable bodies that reach between the pads of a hand."""
        space = self._between.get(side)
        movable = self._scene(moment, only_movable=True)
        if space is None or not movable.bodies:
            return frozenset()
        return touching(Body(_BETWEEN, (space,), T_base_tip), movable)

    def _scene(self, moment: Moment, *, only_movable: bool = False) -> Scene:
        return Scene(
            {
                name: body.at(pin.SE3(moment.T_base_bodies[name]))
                for name, body in self.bodies.items()
                if name in moment.T_base_bodies and (body.is_movable or not only_movable)
            }
        )

    def _T_base_tip(self, side: str, moment: Moment) -> pin.SE3:
        return self._robot.arm(side).T_base_tip(moment.q[self._arms[side]])


def _arms(robot: Baxter) -> list[tuple[str, Arm]]:
    return list(robot.arms.items())


def _space_between_pads(hand: Hand) -> Part:
    """A box from pad to pad of the open hand, seen from the tip."""
    corners = []
    for pad in hand.pads_at(pin.SE3.Identity(), hand.stroke_m):
        middle, turned = pad.T_body_part.translation, pad.T_body_part.rotation.T
        reach = np.array(
            [[pad.shape.support_m(sign * turned[:, axis]) for axis in range(3)] for sign in (-1, 1)]
        )
        corners += [middle - reach[0], middle + reach[1]]
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    x, y, z = (high - low).tolist()
    return Part(Box((x, y, z)), pin.SE3(np.eye(3), (low + high) / 2))


def _height_m(name: str, moment: Moment) -> float:
    pose = moment.T_base_bodies.get(name)
    return -np.inf if pose is None else float(pose[2, 3])
