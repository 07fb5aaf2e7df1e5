"""The live view: robot, bodies, tip paths and a caption in the browser, while the program runs.

Meshcat's viewer draws, fed by a small server of our own in this process
(`sim.view.live.live_server`). Showing a frame only notes what changed; sending is the server's
business, so a slow browser, or none, never holds the program up.
"""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import Baxter
from baxter_kin.errors import expect, quoted
from baxter_kin.validation import FloatArray, finite_array, finite_scalar
from baxter_kin.value_objects import NotCopied, OneLine
from planner import Body
from sim.errors import ViewerError
from sim.view.appearance import Appearance
from sim.view.gripper_status import GripperPhase
from sim.view.live.clients import Clients, Message
from sim.view.live.live_server import ADDRESS, LiveServer
from sim.view.meshcat_commands import Command, delete, set_property
from sim.view.scenegraph import RobotTree, body_commands, body_path, pose_commands, stage_commands
from sim.view.tip_path import TipPath, TipTracker
from sim.view.webpage import page, viewer_bundle

JOINT_STEP = 1e-5
"""Joints that moved less, rad or m, are not sent again: a hundredth of a millimetre at the tip."""

LONGEST_WAIT_S = 86_400.0

POSE_STEP = 1e-6
"""The same for bodies: metres, and parts of a unit quaternion."""

TITLE = "Baxter, live"

FRAME_HEIGHT_PX = 520
"""Height of the view in a notebook."""


class Viewer(NotCopied, OneLine):
    """A live view, served from its creation until `close`; use it as a context manager.

    As the last value of a notebook's cell it shows itself there. That needs a browser on the
    machine where the program runs, or the port forwarded to the same number; a
    `sim.view.replay.Replay`
    does not.

    Attributes:
        url: where to look.
    """

    def __init__(self, robot: Baxter, *, port: int | None = None) -> None:
        """Start serving; nothing waits for a browser.

        Args:
            robot: shown in its neutral configuration at first.
            port: where to listen on this machine; None takes 7000 or the next one free.

        Raises:
            ViewerError: when that port is taken or not allowed, or Meshcat is missing.
        """
        self._tree = RobotTree(robot.model, Appearance.of(robot))
        self._clients = Clients()
        self._q = np.full(len(self._tree.paths), np.nan)
        self._poses: dict[str, FloatArray] = {}
        self._told: dict[str, object] = {}
        self._grippers: dict[str, GripperPhase] = {}
        self._tracker = TipTracker(robot)
        self._tip_paths = {side: TipPath(side) for side in robot.arms}
        script = ("text/javascript; charset=utf-8", viewer_bundle())
        files = {
            "/": ("text/html; charset=utf-8", page("live.html", title=TITLE)),
            "/main.min.js": script,
        }
        self._server = LiveServer(self._clients, files, port)
        self.url = f"http://{ADDRESS}:{self._server.port}/"
        self._publish([*stage_commands(), *self._tree.commands()])
        self.show(robot.configuration(), {}, "")

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _facts(self) -> tuple[str, ...]:
        return (self.url,)

    def _repr_html_(self) -> str:
        """The view as a frame of a notebook."""
        return (
            f'<iframe src="{html.escape(self.url)}" width="100%" height="{FRAME_HEIGHT_PX}" '
            'style="border: 0" title="Baxter, live"></iframe>'
        )

    @property
    def q(self) -> FloatArray:
        """The full configuration shown, shape (19,), rad and m; a copy."""
        return self._q.copy()

    @property
    def has_client(self) -> bool:
        """Whether a browser is watching."""
        return len(self._clients) > 0

    def wait_for_client(self, timeout_s: float) -> bool:
        """Wait until a browser watches, at most so long. Returns whether one does.

        Raises:
            ViewerError: when the time is not a number from 0 to `LONGEST_WAIT_S`.
        """
        seconds = finite_scalar(timeout_s, "timeout_s", ViewerError)
        if not 0.0 <= seconds <= LONGEST_WAIT_S:
            raise ViewerError(f"timeout_s must be from 0 to {LONGEST_WAIT_S:g} s, got {seconds:g}")
        return self._clients.wait(seconds)

    def add_body(self, body: Body) -> None:
        """Show a body at its pose. One of the same name is replaced.

        Raises:
            ViewerError: when the view is closed.
        """
        path = body_path(expect(body, Body, "body", ViewerError).name)
        placed = pose_commands(path, body.T_base_body)
        self._publish([delete(path), *body_commands(body), *placed])
        self._poses[body.name] = pin.SE3ToXYZQUAT(body.T_base_body)

    def remove_body(self, name: str) -> None:
        """Show a body no more.

        Raises:
            ViewerError: when there is none of that name, or the view is closed.
        """
        self._known(name)
        self._publish([delete(body_path(name))])
        del self._poses[name]

    def show(
        self,
        q: ArrayLike,
        T_base_bodies: Mapping[str, pin.SE3],
        caption: str = "",
        *,
        seed: str = "",
        grippers: Mapping[str, GripperPhase] | None = None,
    ) -> None:
        """Show one frame: only what changed is sent, and nothing is waited for.

        Args:
            q: full configuration, shape (19,), rad and m.
            T_base_bodies: by name, the poses of bodies seen from base; others stay where they are.
            caption: what is going on.
            seed: which seed of inverse kinematics led there, such as "Current Joint Angles".
            grippers: by side, what each gripper does; None for no change.

        Raises:
            ViewerError: when `q` has another shape or is not finite, a body is not in the view, a
                gripper does not exist, or the view is closed.
        """
        configuration = finite_array(q, self._q.shape, "q", ViewerError)
        expect(T_base_bodies, Mapping, "T_base_bodies", ViewerError)  # type: ignore[type-abstract]
        commands = [*self._joint_commands(configuration), *self._moved(T_base_bodies)]
        self._note_grippers({} if grippers is None else grippers)
        commands += self._trail_commands(configuration)
        shown = {side: phase.for_page() for side, phase in self._grippers.items()}
        self._publish(commands, caption=caption, seed=seed, grippers=shown)

    def close(self) -> None:
        """Stop serving and free the port. A second call does nothing."""
        self._server.close()

    def _joint_commands(self, q: FloatArray) -> Iterator[Command]:
        moved = ~(np.abs(q - self._q) < JOINT_STEP)
        for joint in np.flatnonzero(moved).tolist():
            key, value = self._tree.motion(joint, float(q[joint]))
            yield set_property(self._tree.paths[joint], key, value)
        self._q[moved] = q[moved]

    def _note_grippers(self, phases: Mapping[str, GripperPhase]) -> None:
        for side, phase in phases.items():
            if side not in self._tip_paths:
                raise ViewerError(
                    f"no gripper {quoted(side)}; there are: {', '.join(self._tip_paths)}"
                )
            self._grippers[side] = expect(phase, GripperPhase, f"{side} gripper", ViewerError)

    def _trail_commands(self, q: FloatArray) -> Iterator[Command]:
        for side, point in self._tracker.points(q).items():
            phase = self._grippers.get(side)
            is_holding = phase is not None and phase.is_holding
            yield from self._tip_paths[side].advance(point, is_holding=is_holding)

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

    def _publish(self, commands: list[Command], **news: object) -> None:
        """Send commands, and to the page itself what is new of each topic."""
        if self._server.is_closed:
            raise ViewerError("the viewer is closed")
        messages = [Message.with_command(command) for command in commands]
        for topic, value in news.items():
            if value != self._told.get(topic):
                messages.append(Message.for_page(topic, value))
                self._told[topic] = value
        if messages:
            self._clients.publish(messages)
            self._server.notify()
