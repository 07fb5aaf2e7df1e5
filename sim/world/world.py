"""World: the one place where things move. Robot, fingers, bodies, what supports and holds what.

Kinematic: bodies have no mass. What stands on a body goes where that goes, however fast. How bodies
fall is on `sim.world.falling`, how closing fingers push them on `sim.world.finger_closing`; nothing
else pushes them.
"""

from __future__ import annotations

from collections.abc import Mapping

import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import Baxter
from baxter_kin.errors import expect, quoted
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.value_objects import listing
from planner import Body, Scene
from planner.collision.robot.robot_body import RobotBody
from planner.errors import SceneError
from planner.scene.contact import PRESSING_TOLERANCE_M
from planner.scene.held import Held
from sim.errors import SimulationError
from sim.world.falling import Rest, come_to_rest
from sim.world.robot_state import RobotState


class World(RobotState):
    """Robot and bodies at one moment.

    Attributes:
        robot: the robot.
        shapes: its shapes.
        hands: left and right hand by side; a side without fingers has none.
        supports: name of each body at rest -> what it stands on.
    """

    def __init__(self, robot: Baxter, body: RobotBody | None = None) -> None:
        """An empty world with the robot in neutral, its hands open.

        Args:
            robot: the robot.
            body: what it is taken to be; `RobotBody.load()` when not given.
        """
        super().__init__(robot, body)
        self.supports: dict[str, str] = {}
        self._bodies: dict[str, Body] = {}  # as they were spawned
        self._poses: dict[str, pin.SE3] = {}  # where they are now
        self._held: dict[str, Held] = {}

    @property
    def scene(self) -> Scene:
        """All bodies where they are now."""
        return Scene.of(body.at(self._poses[name]) for name, body in self._bodies.items())

    def body(self, name: str) -> Body:
        """One body where it is now.

        Raises:
            SceneError: when it is not there.
        """
        known = self._known(name)
        return self._bodies[known].at(self._poses[known])

    @property
    def held(self) -> tuple[Held, ...]:
        """What the hands hold."""
        return tuple(self._held.values())

    def holding(self, side: str) -> Held | None:
        """What a hand holds, or None."""
        return self._held.get(self._side(side))

    def move_arm(self, side: str, q: ArrayLike) -> None:
        """Put an arm somewhere; what its hand holds comes along.

        Args:
            side: "left" or "right".
            q: shape (7,), rad, inside the limits.

        Raises:
            ConfigurationError: when `q` is malformed or outside the limits.
        """
        super().move_arm(side, q)
        self._carry(side)

    def spawn(self, body: Body) -> str:
        """Add a body; a movable one falls on what is below it.

        Returns:
            The name of its support; of a body that is not movable, its own name.

        Raises:
            SceneError: when the name is taken.
        """
        _ = self.scene.with_body(expect(body, Body, "body", SceneError))
        self._bodies[body.name] = body
        self._poses[body.name] = body.T_base_body
        if not body.is_movable:
            return body.name
        return self.settle(body.name).support

    def delete(self, name: str) -> None:
        """Remove a body, out of a hand if need be; what stands on it falls.

        Raises:
            SceneError: when it is not there.
        """
        loose = self.riders(name)
        del self._bodies[name], self._poses[name]
        self.supports.pop(name, None)
        self._held = {side: held for side, held in self._held.items() if held.body != name}
        for rider in loose:
            self.supports.pop(rider)
        for rider in loose:
            self.settle(rider)

    def place_body(self, name: str, T_base_body: PoseLike) -> None:
        """Put a body somewhere, as it is; what stands on it goes along.

        It stands on what it touches below it then, and hangs in the air when that is nothing.

        Raises:
            SceneError: when it is not there.
            PoseError: when the pose is not a valid one.
            SimulationError: when a hand holds it.
        """
        self.carry(name, T_base_body)
        self.supports.pop(name, None)
        rest = self.rest(name)
        if rest.fall_m <= PRESSING_TOLERANCE_M:
            self.supports[name] = rest.support

    def carry(self, name: str, T_base_body: PoseLike) -> None:
        """Put a body somewhere on its way, what stands on it with it; nobody asks what is below.

        Raises:
            SceneError: when it is not there.
            PoseError: when the pose is not a valid one.
            SimulationError: when a hand holds it.
        """
        self._refuse_held(self._known(name))
        self._put(name, checked_pose(T_base_body))

    def slide(self, name: str, T_base_body: PoseLike) -> None:
        """Put one body somewhere on its way, and nothing else.

        Raises:
            SceneError: when it is not there.
            PoseError: when the pose is not a valid one.
            SimulationError: when a hand holds it.
        """
        self._refuse_held(self._known(name))
        self._poses[name] = checked_pose(T_base_body)

    def riders(self, name: str) -> tuple[str, ...]:
        """Names of the bodies that stand on a body, and on these, from below up.

        Raises:
            SceneError: when it is not there.
        """
        found = [self._known(name)]
        for below in found:  # grows: what stands on a rider rides too
            found += [n for n, s in self.supports.items() if s == below and n not in found]
        return tuple(found[1:])

    def rest(self, name: str) -> Rest:
        """Where a body would come to rest if let go where it is.

        Raises:
            SceneError: when it is not there.
        """
        along = {self._known(name), *self.riders(name)}
        return come_to_rest(self.body(name), [b for b in self.scene if b.name not in along])

    def settle(self, name: str) -> Rest:
        """Let a body come to rest, at once; what stands on it goes along and settles after it.

        Raises:
            SceneError: when it is not there.
            SimulationError: when a hand holds it.
        """
        rest = self.rest(name)
        self.put_to_rest(name, rest)
        return rest

    def put_to_rest(self, name: str, rest: Rest) -> None:
        """Put a body where it comes to rest, as `rest` said; what stands on it settles after it.

        Raises:
            SceneError: when it is not there.
            SimulationError: when a hand holds it, or `rest` is of another class.
        """
        expect(rest, Rest, "rest", SimulationError)
        self.carry(name, rest.T_base_body)
        self.supports[name] = rest.support
        for rider in [n for n, below in self.supports.items() if below == name]:
            self.settle(rider)

    def attach(self, side: str, name: str, T_tip_body: PoseLike) -> None:
        """From now on a body moves with a hand.

        Raises:
            SceneError: when the body is not there.
            PoseError: when the pose is not a valid one.
            SimulationError: when it is not movable, is in a hand already, or the hand is full.
        """
        if not self.body(name).is_movable:
            raise SimulationError(f"{quoted(name)} is not movable")
        if self.holding(side) is not None:
            raise SimulationError(f"the {side} hand already holds {self._held[side].body!r}")
        self._refuse_held(name)
        self._held[side] = Held(self._side(side), name, checked_pose(T_tip_body))
        self.supports.pop(name, None)  # what stands on it still does, and is carried along
        self._carry(side)

    def detach(self, side: str) -> str | None:
        """Let go of what a hand holds: its name, or None. It hangs in the air until settled."""
        held = self._held.pop(self._side(side), None)
        return None if held is None else held.body

    def body_poses(self) -> Mapping[str, pin.SE3]:
        """Every body's pose seen from base."""
        return {name: pin.SE3(pose) for name, pose in self._poses.items()}

    def _facts(self) -> tuple[str, ...]:
        return listing(self.scene.bodies, "body"), *(f"{each.side} hand full" for each in self.held)

    def _known(self, name: str) -> str:
        if not isinstance(name, str) or name not in self._bodies:
            _ = self.scene[name]  # says what there is
        return name

    def _refuse_held(self, name: str) -> None:
        for side, held in self._held.items():
            if held.body == name:
                raise SimulationError(f"{quoted(name)} is in the {side} hand; open it first")

    def _carry(self, side: str) -> None:
        held = self._held.get(side)
        if held is not None:
            self._put(held.body, self.T_base_tip(side) * held.T_tip_body)

    def _put(self, name: str, T_base_body: pin.SE3) -> None:
        riders = self.riders(name)
        if riders:
            motion = T_base_body * self._poses[name].inverse()
            for rider in riders:
                self._poses[rider] = motion * self._poses[rider]
        self._poses[name] = T_base_body
