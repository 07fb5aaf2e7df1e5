"""The scene of a live view: robot, bodies and tip paths, and the commands that change them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.display import quoted
from baxter_kin.validation import FloatArray
from planner import Body, Scene
from sim.errors import ViewerError
from sim.events import Event, EventKind
from sim.recording.recorded_motion import RecordedMove
from sim.view.appearance import Appearance
from sim.view.meshcat_commands import Command, delete, set_property
from sim.view.overlays import (
    GOALS_PATH,
    INK_PATH,
    NEAREST_PATH,
    Ink,
    TipPath,
    frame_commands,
    frame_paths,
    hand_commands,
    layers,
    nearest_command,
)
from sim.view.scenegraph import (
    RobotTree,
    body_commands,
    body_path,
    pose_commands,
    stage_commands,
)

JOINT_STEP = 1e-5
"""Motion of a joint that is sent, rad or m: a hundredth of a millimetre at the tip."""

POSE_STEP = 1e-6
"""Motion of a body that is sent: metres, and parts of a unit quaternion."""

MAX_GOALS = 6
"""Number of moves, the latest, whose goals are drawn: those of a pick and place."""


class DrawnScene:
    """What is drawn now. Not for several threads at once.

    Attributes:
        q: the full configuration, shape (19,), rad and m.
        bodies: the bodies by name, at the poses at which they were added.
    """

    def __init__(self, robot: Baxter) -> None:
        self._robot, self._appearance = robot, Appearance.of(robot)
        self._tree = RobotTree(robot.model, self._appearance)
        self._goals = 0
        self._joints = {s: list(robot.indices(arm.joint_names)) for s, arm in robot.arms.items()}
        self._tip_paths = {side: TipPath(side) for side in robot.arms}
        self._ink = Ink()
        self._poses: dict[str, FloatArray] = {}
        self.q = np.full(len(self._tree.paths), np.nan)
        self.bodies: dict[str, Body] = {}

    def commands(self) -> list[Command]:
        """Commands that draw stage and robot for the first time."""
        frames = frame_paths(self._robot, self._tree)
        return [
            *stage_commands(),
            *self._tree.commands(),
            *frame_commands(self._robot, self._tree),
            nearest_command(),
            # the page shows them when they are chosen, and the line between two points
            *(set_property(path, "visible", False) for path in (*frames, GOALS_PATH, NEAREST_PATH)),
        ]

    def layers(self) -> list[Command]:
        """The layers that a page can show or hide, named as in a replay."""
        return layers(
            {
                "robot": self._tree.mesh_paths,
                "paths": ["/path"],
                "ink": [INK_PATH] if self._ink.strokes else [],
                "goals": [GOALS_PATH],
                "frames": frame_paths(self._robot, self._tree),
                "nearest": [NEAREST_PATH],
            }
        )

    def add_goal(self, move: RecordedMove) -> list[Command]:
        """Draw the hand at the goal of a move, in place of the oldest goal."""
        q = self.q.copy()
        q[list(self._robot.indices(move.joint_names))] = move.trajectory.q_goal
        path = f"{GOALS_PATH}/{self._goals % MAX_GOALS}"
        self._goals += 1
        hand = hand_commands(path, self._robot, move.limb, q, self._appearance)
        return [delete(path), *hand]

    def on_pen(self, event: Event) -> None:
        """Begin or end a stroke."""
        if event.kind is EventKind.PEN_DOWN and event.side is not None:
            self._ink.touch(event.side, event.body)
        elif event.kind is EventKind.PEN_UP and event.side is not None:
            self._ink.leave(event.side)

    def add_body(self, body: Body) -> list[Command]:
        """Draw a body at its pose, in place of one of the same name."""
        path = body_path(body.name)
        self.bodies[body.name] = body
        self._poses[body.name] = pin.SE3ToXYZQUAT(body.T_base_body)
        return [delete(path), *body_commands(body), *pose_commands(path, body.T_base_body)]

    def remove_body(self, name: str) -> list[Command]:
        """Remove a body."""
        self._known(name)
        del self._poses[name], self.bodies[name]
        return [delete(body_path(name))]

    def bodies_except(self, names: Collection[str]) -> dict[str, Body]:
        """The bodies with other names, at the poses at which they are drawn now."""
        return {
            name: body.at(pin.XYZQUATToSE3(self._poses[name]))
            for name, body in self.bodies.items()
            if name not in names
        }

    def replace_bodies(self, old: Iterable[str], new: Scene) -> list[Command]:
        """Draw bodies in place of others, some of which may be gone; all further ones stay."""
        gone = [name for name in old if name in self.bodies and name not in new.bodies]
        removed = [command for name in gone for command in self.remove_body(name)]
        return removed + [command for body in new for command in self.add_body(body)]

    def clear_run(self) -> list[Command]:
        """Remove the lines that the tips have drawn, the ink and the goals."""
        self._tip_paths = {side: TipPath(side) for side in self._robot.arms}
        self._ink = Ink()
        self._goals = 0
        goals = [delete(f"{GOALS_PATH}/{number}") for number in range(MAX_GOALS)]
        return [*goals, delete(INK_PATH), *(delete(f"/path/{side}") for side in self._robot.arms)]

    def move(
        self, q: FloatArray, T_base_bodies: Mapping[str, pin.SE3], holding: Mapping[str, bool]
    ) -> list[Command]:
        """Move the joints and bodies that are elsewhere now, and extend the tips' lines and ink.

        Args:
            q: full configuration, shape (19,), rad and m.
            T_base_bodies: by name, poses of bodies seen from base.
            holding: by side, whether the hand holds something, which sets the line's colour.
        """
        commands = [*self._joint_commands(q), *self._moved(T_base_bodies)]
        for side, arm in self._robot.arms.items():
            point, is_holding = arm.T_base_tip(q[self._joints[side]]).translation, holding.get(side)
            commands += self._tip_paths[side].advance(point.copy(), is_holding=bool(is_holding))
            commands += self._ink.advance(side, point)
        return commands

    def _joint_commands(self, q: FloatArray) -> Iterator[Command]:
        moved = ~(np.abs(q - self.q) < JOINT_STEP)
        for joint in np.flatnonzero(moved).tolist():
            key, value = self._tree.motion(joint, float(q[joint]))
            yield set_property(self._tree.paths[joint], key, value)
        self.q[moved] = q[moved]

    def _moved(self, T_base_bodies: Mapping[str, pin.SE3]) -> Iterator[Command]:
        for name, T_base_body in T_base_bodies.items():
            pose = pin.SE3ToXYZQUAT(T_base_body)
            if np.abs(pose - self._known(name)).max() > POSE_STEP:
                yield from pose_commands(body_path(name), T_base_body)
                self._poses[name] = pose

    def _known(self, name: str) -> FloatArray:
        if name not in self._poses:
            shown = ", ".join(self._poses) or "none"
            raise ViewerError(f"the view has no body {quoted(name)}; it shows: {shown}")
        return self._poses[name]
