"""World: the state of robot, fingers and bodies, and of what supports and holds what.

It is kinematic: bodies have no mass. What stands on a body moves with it, however fast. Bodies fall
as `sim.world.falling` says, and closing fingers push them as `sim.world.gripper` says; nothing else
pushes them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import Baxter
from baxter_kin.display import OneLine, listing, quoted
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, expect, finite_scalar
from planner import Body, Hand, Part, Scene, State
from planner.collision.robot.robot_body import RobotBody
from planner.collision.robot.robot_shapes import RobotShapes
from planner.errors import SceneError
from planner.scene.bodies import Attachment
from planner.scene.contact import PRESSING_TOLERANCE_M, depth_m
from planner.scene.support import MAX_TILT_RAD, lifted_out
from sim.errors import SimulationError
from sim.world.falling import Rest, come_to_rest

ROUNDING_RAD = 1e-9
"""Maximum distance of a trajectory from the joint limits by rounding."""

MIN_MOTION = 1e-6
"""A body that moves by less, m, and of rotation matrices, stays on all that it stands on."""


class World(OneLine):
    """Robot and bodies at one moment.

    Attributes:
        robot: the robot.
        shapes: its shapes.
        hands: left and right hand by side; a side without fingers has none.
        supports: name of each body at rest -> names of all that it stands on.
    """

    def __init__(self, robot: Baxter, body: RobotBody | None = None) -> None:
        """An empty world with the robot in neutral, its hands open.

        Args:
            robot: the robot.
            body: what it is taken to be; `RobotBody.load()` when not given.
        """
        self.robot = expect(robot, Baxter, "robot", SimulationError)
        self.shapes = RobotShapes(robot, body)
        self.hands = {
            side: Hand.of(robot, arm, self.shapes)
            for side, arm in robot.arms.items()
            if Hand.is_on(robot, side)
        }
        self._limits = {side: arm.limits for side, arm in robot.arms.items()}
        self._arm_indices = {
            s: np.array(robot.indices(a.joint_names)) for s, a in robot.arms.items()
        }
        self._head = robot.indices(("head_pan",))[0]
        self._finger_indices = {
            s: list(robot.indices(h.joint_names)) for s, h in self.hands.items()
        }
        self._q = np.array(robot.configuration())
        for side, hand in self.hands.items():
            self.set_fingers(side, hand.stroke_m)
        self.supports: dict[str, tuple[str, ...]] = {}
        self._bodies: dict[str, Body] = {}  # as they were spawned
        self._poses: dict[str, pin.SE3] = {}  # where they are now
        self._held: dict[str, Attachment] = {}

    @classmethod
    def from_state(cls, state: State, robot: Baxter, body: RobotBody | None = None) -> World:
        """World exactly as in a state; no body falls or moves.

        Args:
            state: the state; joints that it does not name stand in neutral, fingers open.
            robot: the robot.
            body: as of `World`.
        """
        world = cls(robot, body)
        expect(state, State, "state", SimulationError)
        names = tuple(name for name in robot.joint_names if name in state.joints)
        world._q[list(robot.indices(names))] = state.q(names)
        world._bodies = dict(state.scene.bodies)
        world._poses = {each.name: each.T_base_body for each in state.scene}
        held_names = {held.body for held in state.attachments}
        for each in state.scene:
            if each.is_movable and each.name not in held_names:
                rest = world.rest(each.name)
                if rest.fall_m <= PRESSING_TOLERANCE_M:
                    world.supports[each.name] = rest.supports
        for held in state.attachments:
            world.attach(held.side, held.body, held.T_link_body)
        return world

    @property
    def q(self) -> FloatArray:
        """The full configuration, shape (19,), rad and m; a copy."""
        return self._q.copy()

    def arm_q(self, side: str) -> FloatArray:
        """Configuration of an arm, shape (7,), rad."""
        q: FloatArray = self._q[self._arm_indices[self._side(side)]]
        return q

    def T_base_tip(self, side: str) -> pin.SE3:
        """Pose in base of the tip of an arm."""
        return self.robot.arm(side).T_base_tip(self.arm_q(side))

    def finger_m(self, side: str) -> float:
        """Finger position of a hand, 0 closed .. stroke; 0 where there are no fingers."""
        where = self._finger_indices.get(self._side(side))
        return 0.0 if where is None else float(self._q[where[0]])

    def hand(self, side: str) -> Hand:
        """The hand of a side.

        Raises:
            UnknownNameError: when there is no such side.
            SimulationError: when it has no fingers.
        """
        hand = self.hands.get(self._side(side))
        if hand is None:
            raise SimulationError(f"the {side} hand of this robot has no fingers")
        return hand

    def turn_head(self, pan_rad: float) -> None:
        """Turn the head, rad, positive to the robot's left."""
        self._q[self._head] = finite_scalar(pan_rad, "pan_rad", SimulationError)

    def set_fingers(self, side: str, finger_m: float) -> None:
        """Put the fingers of a hand at a position; they do not push.

        Raises:
            SimulationError: when the position is outside 0 .. stroke, or there are no fingers.
        """
        hand = self.hand(side)
        x = finite_scalar(finger_m, "finger position", SimulationError)
        if not -1e-12 <= x <= hand.stroke_m + 1e-12:
            raise SimulationError(
                f"finger position {1e3 * x:.3f} mm is outside 0 .. {1e3 * hand.stroke_m:.3f} mm"
            )
        self._q[self._finger_indices[side]] = list(hand.finger_joints(x).values())

    @property
    def scene(self) -> Scene:
        """All bodies where they are now."""
        return Scene.of(body.at(self._poses[name]) for name, body in self._bodies.items())

    @property
    def state(self) -> State:
        """Robot and bodies as they are now."""
        joints = dict(zip(self.robot.joint_names, self.q.tolist(), strict=True))
        return State(self.scene, joints, self.held)

    def body(self, name: str) -> Body:
        """A body where it is now."""
        known = self._known(name)
        return self._bodies[known].at(self._poses[known])

    def parts(self, name: str) -> tuple[Part, ...]:
        """The parts of a body."""
        return self._bodies[self._known(name)].parts

    @property
    def held(self) -> tuple[Attachment, ...]:
        """What the hands hold."""
        return tuple(self._held.values())

    def holding(self, side: str) -> Attachment | None:
        """What a hand holds, or None."""
        return self._held.get(self._side(side))

    def is_held(self, name: str) -> bool:
        """Whether a hand holds a body."""
        return any(held.body == name for held in self._held.values())

    def move_arm(self, side: str, q: ArrayLike) -> None:
        """Put an arm at a configuration; what its hand holds moves along.

        Args:
            side: "left" or "right".
            q: shape (7,), rad, inside the limits.

        Raises:
            ConfigurationError: when `q` is malformed or outside the limits.
        """
        limits = self._limits[self._side(side)]
        self._q[self._arm_indices[side]] = limits.check(q, "q", tolerance=ROUNDING_RAD)
        self._carry(side)

    def spawn(self, body: Body) -> str:
        """Add a body; a movable one falls on what is below it.

        A movable body below the floor is raised to it.

        Returns:
            The name of its support, of several the first; of a body that is not movable, its own.

        Raises:
            SceneError: when the name is taken; of a movable body also when it would be more than
                `PRESSING_TOLERANCE_M` inside another, or what is below it is too steep.
        """
        _ = self.scene.with_body(expect(body, Body, "body", SceneError))
        rest = self._checked_rest(body) if body.is_movable else None
        self._bodies[body.name] = body
        self._poses[body.name] = body.T_base_body
        if rest is None:
            return body.name
        self.put_to_rest(body.name, rest)
        return rest.support

    def delete(self, name: str) -> None:
        """Remove a body, also a held one; what stands on it falls."""
        loose = self.riders(name)
        del self._bodies[name], self._poses[name]
        self.supports.pop(name, None)
        self._held = {side: held for side, held in self._held.items() if held.body != name}
        for rider in loose:
            self.supports.pop(rider)
        for rider in loose:
            self.settle(rider)

    def place_body(self, name: str, T_base_body: PoseLike) -> None:
        """Put a body at a pose; what stands on it moves along.

        It stands on what it touches below it then, and hangs in the air when that is nothing.
        """
        self.carry(name, T_base_body)
        self.supports.pop(name, None)
        rest = self.rest(name)
        if rest.fall_m <= PRESSING_TOLERANCE_M:
            self.supports[name] = rest.supports

    def carry(self, name: str, T_base_body: PoseLike) -> None:
        """Move a body during a motion, with what stands on it.

        Its supports are stale until `put_to_rest` or `settle`.
        """
        self._refuse_held(self._known(name))
        self._put(name, checked_pose(T_base_body))

    def slide(self, name: str, T_base_body: PoseLike) -> None:
        """Move a body during a motion; nothing else moves.

        Its supports are stale until `put_to_rest` or `settle`.
        """
        self._refuse_held(self._known(name))
        self._poses[name] = checked_pose(T_base_body)

    def riders(self, name: str) -> tuple[str, ...]:
        """Names of the bodies that stand on a body, and on these, from below up."""
        found = [self._known(name)]
        for below in found:  # grows: what stands on a rider rides too
            found += [n for n, s in self.supports.items() if below in s and n not in found]
        loose, ordered = found[1:], list[str]()
        while loose:
            ready = [n for n in loose if not set(loose).intersection(self.supports[n])] or loose
            ordered += ready
            loose = [n for n in loose if n not in ready]
        return tuple(ordered)

    def rest(self, name: str) -> Rest:
        """Where a body would come to rest if released where it is."""
        along = {self._known(name), *self.riders(name)}
        return come_to_rest(self.body(name), [b for b in self.scene if b.name not in along])

    def settle(self, name: str) -> Rest:
        """Let a body come to rest at once; what stands on it moves along and settles after it."""
        rest = self.rest(name)
        self.put_to_rest(name, rest)
        return rest

    def put_to_rest(self, name: str, rest: Rest) -> None:
        """Put a body where `rest` says; what stands on it settles after it."""
        expect(rest, Rest, "rest", SimulationError)
        self.carry(name, rest.T_base_body)
        self.supports[name] = rest.supports
        for rider in [n for n, below in self.supports.items() if name in below]:
            self.settle(rider)

    def attach(self, side: str, name: str, T_tip_body: PoseLike) -> None:
        """Let a body move with a hand from now on.

        A body that both hands hold moves with the left one.

        Raises:
            SceneError: when the body is not there.
            PoseError: when the pose is not a valid one.
            SimulationError: when it is not movable, the hand is full, or the other hand holds the
                body elsewhere.
        """
        if not self.body(name).is_movable:
            raise SimulationError(f"{quoted(name)} is not movable")
        if self.holding(side) is not None:
            raise SimulationError(f"the {side} hand already holds {self._held[side].body!r}")
        T = checked_pose(T_tip_body)
        if self.is_held(name) and not np.allclose(
            (self.T_base_tip(side) * T).homogeneous,
            self._poses[name].homogeneous,
            atol=PRESSING_TOLERANCE_M,
        ):
            self._refuse_held(name)
        self._held[side] = Attachment(name, self.robot.arm(side).tip_frame, T)
        self.supports.pop(name, None)  # what stands on it still does, and is carried along
        self._carry(side)

    def detach(self, side: str) -> str | None:
        """Release what a hand holds, which hangs in the air until settled; returns its name."""
        held = self._held.pop(self._side(side), None)
        return None if held is None else held.body

    def body_poses(self) -> Mapping[str, pin.SE3]:
        """Poses of all bodies in base."""
        return {name: pin.SE3(pose) for name, pose in self._poses.items()}

    def _facts(self) -> tuple[str, ...]:
        return listing(self.scene.bodies, "body"), *(f"{each.side} hand full" for each in self.held)

    def _side(self, side: str) -> str:
        """The side, if it is one."""
        is_known = type(side) is str and side in self._arm_indices
        return side if is_known else self.robot.arm(side).side

    def _known(self, name: str) -> str:
        if not isinstance(name, str) or name not in self._bodies:
            _ = self.scene[name]  # says what there is
        return name

    def _refuse_held(self, name: str) -> None:
        for side, held in self._held.items():
            if held.body == name:
                raise SimulationError(f"{quoted(name)} is in the {side} hand; open it first")

    def _checked_rest(self, body: Body) -> Rest:
        """Where a movable body to be added comes to rest; raises when it must not be added."""
        others = list(self.scene)
        for other in others:
            inside_m = depth_m(body, other)
            if inside_m <= PRESSING_TOLERANCE_M:
                continue
            lifted = lifted_out(body, others).T_base_body
            rise_m = float(lifted.translation[2] - body.T_base_body.translation[2])
            raise SceneError(
                f"{quoted(body.name)} would be {1e3 * inside_m:.1f} mm inside "
                f"{quoted(other.name)}; at most {1e3 * PRESSING_TOLERANCE_M:g} mm is allowed: put "
                f"it {1e3 * rise_m:.1f} mm higher, or elsewhere"
            )
        rest = come_to_rest(body, others)
        if rest.slope_rad > 0.0:
            met = (*rest.fell_off, *rest.supports)[0]
            raise SceneError(
                f"{quoted(body.name)} would not stand: {quoted(met)} slopes by "
                f"{math.degrees(rest.slope_rad):.1f} deg there, and at most "
                f"{math.degrees(MAX_TILT_RAD):g} deg is taken for level; level it, or put the body "
                "elsewhere"
            )
        return rest

    def _carry(self, side: str) -> None:
        held = self._held.get(side)
        if held is None:
            return
        hands = [each for each in self._held if self._held[each].body == held.body]
        if side == min(hands, key=LIMBS.index):  # the other one follows
            self._put(held.body, self.T_base_tip(side) * held.T_link_body)

    def _put(self, name: str, T_base_body: pin.SE3) -> None:
        riders = self.riders(name)
        if riders:
            motion = T_base_body * self._poses[name].inverse()
            along = {name, *riders}
            for rider in riders:
                self._poses[rider] = motion * self._poses[rider]
                if not motion.isIdentity(MIN_MOTION):  # it leaves what else it stood on
                    left = tuple(below for below in self.supports[rider] if below in along)
                    self.supports[rider] = left
        self._poses[name] = T_base_body
