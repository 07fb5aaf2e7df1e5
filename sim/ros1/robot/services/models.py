"""Models: bodies that come and go by Gazebo's services.

Names are those of the world's bodies. Positions in "world" are on the floor, 0.93 m below base. A
quaternion of zeros, as the original demo sends it, is no rotation.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent import futures
from concurrent.futures import Future

import pinocchio as pin

from baxter_kin.display import OneLine, listing, numbers, position, quoted
from baxter_kin.errors import BaxterError
from baxter_kin.frames import T_world_base, quaternion_xyzw
from sim.ros1.definitions import service_type
from sim.ros1.robot.baxter import SimulatedBaxter
from sim.ros1.robot.services.frame_tree import T_base_frame, pose_of
from sim.ros1.robot.services.model_text import body_of_text
from sim.ros1_messages import Message

SPAWN, DELETE = "gazebo_msgs/SpawnModel", "gazebo_msgs/DeleteModel"

WORLD_FRAMES = ("", "world", "map", "/map")
"""As Gazebo has them."""

ROBOT = "baxter"
"""What Gazebo calls the robot, whose links are "baxter::left_gripper" and so on."""

ANSWER_S = 10.0
"""A world that does not tick for so long answers no more."""

Between = Callable[[Callable[[], None]], "Future[None]"]
"""Does something between two ticks."""


class Models(OneLine):
    """Spawns and deletes; any thread may ask it."""

    def __init__(
        self, baxter: SimulatedBaxter, between: Between, say: Callable[[str], object]
    ) -> None:
        """Serve a world.

        Args:
            baxter: whose world.
            between: does something between two ticks, in the thread that owns the world.
            say: told what happens.
        """
        self._baxter, self._between, self._say = baxter, between, say

    def spawn(self, request: Message) -> Message:
        """The response to a `gazebo_msgs/SpawnModel`, for SDF and URDF alike."""
        name = str(request.model_name)

        def add() -> None:
            T_base_model = self._T_base_frame(request.reference_frame) * _initial(request)
            body = body_of_text(request.model_xml, name, T_base_model)
            self._baxter.spawn(body)
            self._say(f"spawned {self._where(body.name)}")

        return self._done(SPAWN, f"spawned {name}", f"spawning {quoted(name)}", add)

    def delete(self, request: Message) -> Message:
        """The response to a `gazebo_msgs/DeleteModel`; it is said where movable bodies are."""
        name = str(request.model_name)

        def remove() -> None:
            for body in self._baxter.world.scene:
                if body.is_movable:
                    self._say(f"before {name} is deleted: {self._where(body.name)}")
            self._baxter.delete(name)

        return self._done(DELETE, f"deleted {name}", f"deleting {quoted(name)}", remove)

    def _done(self, kind: str, done: str, what: str, act: Callable[[], None]) -> Message:
        response = service_type(kind).response
        doing = self._between(act)
        try:
            doing.result(ANSWER_S)
        except BaxterError as cause:
            self._say(f"{what}: {cause}")
            return response.make(success=False, status_message=f"{what}: {cause}")
        except futures.TimeoutError:
            doing.cancel()
            text = f"{what}: the robot is shutting down"
            return response.make(success=False, status_message=text)
        return response.make(success=True, status_message=done)

    def _where(self, name: str) -> str:
        """A body, where it is and on what."""
        world = self._baxter.world
        body = world.body(name)
        holder = next((held.side for held in world.held if held.body == name), None)
        stands_on = " and ".join(world.supports.get(name, ())) or "nothing"
        on = f"in the {holder} hand" if holder else f"on {stands_on}"
        T_base_body: pin.SE3 = body.T_base_body
        turned = f"xyzw {numbers(quaternion_xyzw(T_base_body))}"
        centre = numbers(body.centre_base.round(4))
        fixed = f"{name} at {position(T_base_body)} in base, {turned}"
        return f"{fixed}, its centre at {centre} m, {on}" if body.is_movable else fixed

    def _T_base_frame(self, frame: str) -> pin.SE3:
        if frame in WORLD_FRAMES:
            return T_world_base().inverse()
        model, _, link = frame.partition("::")
        if model in self._baxter.world.scene.bodies:
            return self._baxter.world.body(model).T_base_body
        name = link if model == ROBOT else frame
        return T_base_frame(self._baxter.world.robot, self._baxter.world.q, name)

    def _facts(self) -> tuple[str, ...]:
        return (listing(self._baxter.world.scene.bodies, "body"),)


def _initial(request: Message) -> pin.SE3:
    """The pose that a model shall have; no rotation where the quaternion is zero."""
    orientation = request.initial_pose.orientation
    if (orientation.x, orientation.y, orientation.z, orientation.w) == (0.0, 0.0, 0.0, 0.0):
        orientation.w = 1.0
    return pose_of(request.initial_pose)
