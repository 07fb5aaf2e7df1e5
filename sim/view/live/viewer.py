"""The live view: robot, bodies, tip paths and a caption in the browser, while the program runs.

```python
viewer = Viewer()  # the last value of a notebook's cell shows itself; else open viewer.url
simulation = Simulation(world, [viewer])
simulation.execute(plan, certificate=verify(plan))  # in real time, on the page
```

Meshcat's viewer draws, fed by a small server in this process (`sim.view.live.server`). Showing a
frame only stores what has changed, and the server sends it, so a slow browser, or none, never
delays the program. Real time does, and Pause on the page.
"""

from __future__ import annotations

import atexit
import html
import os
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from urllib.parse import urlsplit

import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import Baxter
from baxter_kin.display import quoted
from baxter_kin.fields import NotCopied
from baxter_kin.kinematics.robot import given_or_stock
from baxter_kin.validation import FloatArray, expect, finite_array, finite_scalar, float_array
from planner import Body, Scene, State
from sim.errors import ViewerError
from sim.events import Event, EventKind, Observer, Snapshot
from sim.recording.recorded_motion import recorded_move
from sim.view.live.drawn_scene import DrawnScene
from sim.view.live.pacing import Pacing
from sim.view.live.server import LiveServer
from sim.view.live.shown_run import ShownRun
from sim.view.panel import GripperPhase
from sim.view.replay import FRAME_HEIGHT_PX, Replay, replay_content
from sim.view.webpage import encoded

MAX_WAIT_S = 86_400.0
_EMPTY = State(Scene({}), {})


class Viewer(NotCopied, Observer):
    """A live view, served from its creation until `close`; use it as a context manager.

    It observes simulations, one after the other: each waits for real time, and can be paused and
    slowed down from the page. When the view is closed, or the program ends, the page becomes a
    replay of what it showed last.

    As the last value of a notebook's cell it is displayed there. That needs a browser on the
    machine where the program runs, or the port forwarded to the same number; a
    `sim.view.replay.Replay` does not.

    Attributes:
        url: address of the page.
    """

    def __init__(
        self, robot: Baxter | None = None, *, port: int | None = None, keeps_time: bool = True
    ) -> None:
        """Start serving; nothing waits for a browser.

        Args:
            robot: shown in its neutral configuration at first; `Baxter.load()` when not given.
            port: where to listen on this machine; by default 7000 or the next free one.
            keeps_time: whether simulations that it observes wait for real time; one that runs in
                real time by itself cannot be paused.

        Raises:
            ViewerError: when that port is taken or not allowed, Meshcat is missing, or an argument
                has the wrong type.
        """
        self._pacing = Pacing(keeps_time=expect(keeps_time, bool, "keeps_time", ViewerError))
        self._robot = given_or_stock(robot, ViewerError)
        self._scene = DrawnScene(self._robot)
        self._grippers: dict[str, GripperPhase] = {}
        self._run = ShownRun(self._robot, _EMPTY)
        self._is_simulated = False
        self._server = LiveServer(port, self._pacing)
        self.url = self._server.url
        self._server.publish(self._scene.commands(), layers=self._scene.layers())
        self.show(self._robot.configuration(), {}, "")
        atexit.register(self.close)

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, _: object) -> None:
        if kind is None:
            self.close()
        else:
            self.close("stopped" if kind is KeyboardInterrupt else str(error) or kind.__name__)

    def _facts(self) -> tuple[str, ...]:
        return (self.url, "closed" if self._server.is_closed else "")

    def _repr_html_(self) -> str:
        """The view as a frame of a notebook."""
        return (
            f'<iframe src="{html.escape(self.url)}" width="100%" height="{FRAME_HEIGHT_PX}" '
            'style="border: 0" title="Baxter, live"></iframe>'
        )

    @property
    def q(self) -> FloatArray:
        """The full configuration shown, shape (19,), rad and m; a copy."""
        return self._scene.q.copy()

    @property
    def has_client(self) -> bool:
        """Whether a browser shows the page."""
        return self._server.has_client

    def wait_for_client(self, timeout_s: float) -> bool:
        """Wait until a browser shows the page; returns whether one does.

        Args:
            timeout_s: maximum waiting time, at most `MAX_WAIT_S`.
        """
        seconds = finite_scalar(timeout_s, "timeout_s", ViewerError)
        if not 0.0 <= seconds <= MAX_WAIT_S:
            raise ViewerError(f"timeout_s must be from 0 to {MAX_WAIT_S:g} s, got {seconds:g}")
        return self._server.wait(seconds)

    def on_start(self, state: State) -> None:
        """Show the state at the beginning of a simulation; a closed view shows nothing."""
        expect(state, State, "state", ViewerError)
        if self._server.is_closed:
            return
        joints = [state.joints.get(name) for name in self._robot.joint_names]
        q = self._checked_q([x for x in joints if x is not None])
        bodies = self._scene.replace_bodies(self._run.bodies, state.scene)
        self._server.publish([*bodies, *self._scene.clear_run(), *self._scene.move(q, {}, {})])
        self._begin_run(state)

    def on_event(self, event: Event) -> None:
        """Show a body that appears or disappears, or a new goal; a closed view shows nothing."""
        expect(event, Event, "event", ViewerError)
        if self._server.is_closed:
            return
        self._begin_run_if_over(event.time_s)
        self._pacing.stand_still()
        self._run.on_event(event)
        if event.body is not None and event.kind is EventKind.SPAWNED:
            self._server.publish(self._scene.add_body(event.body))
        elif event.body is not None and event.kind is EventKind.DELETED:
            self._server.publish(self._scene.replace_bodies([event.body.name], Scene({})))
        elif event.kind in (EventKind.PEN_DOWN, EventKind.PEN_UP):
            self._scene.on_pen(event)
            self._server.publish([], layers=self._scene.layers())
        elif (move := recorded_move(event)) is not None:
            self._server.publish(self._scene.add_goal(move))

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Wait until a snapshot is due, then show it, without bodies that no event reported.

        A closed view shows nothing, and does not wait.

        Raises:
            ViewerError: when it is a snapshot of another robot.
        """
        expect(snapshot, Snapshot, "snapshot", ViewerError)
        if self._server.is_closed:
            return
        q = self._checked_q(snapshot.q)
        self._begin_run_if_over(snapshot.time_s)
        self._pacing.wait_for(snapshot.time_s)
        self._run.on_snapshot(snapshot, self._scene.bodies_except(self._run.bodies))
        if self._run.is_frame_due(snapshot.time_s, self._pacing.speed):
            known = self._scene.bodies
            poses = {name: T for name, T in snapshot.T_base_bodies.items() if name in known}
            self._grippers |= self._run.phases
            self._is_simulated = True
            self._draw(q, poses, **self._run.topics(snapshot))

    def show(
        self,
        q: ArrayLike,
        T_base_bodies: Mapping[str, pin.SE3],
        caption: str = "",
        *,
        seed: str = "",
        grippers: Mapping[str, GripperPhase] | None = None,
    ) -> None:
        """Show one frame, without waiting for browsers.

        Args:
            q: full configuration, shape (19,), rad and m.
            T_base_bodies: by name, the poses of bodies seen from base; others stay where they are.
            caption: what is going on.
            seed: the seed of inverse kinematics that led there, such as "Current Joint Angles".
            grippers: what each gripper does, by side; None for no change.

        Raises:
            ViewerError: when `q` has another shape or is not finite, a body is not in the view, a
                gripper does not exist, or the view is closed.
        """
        configuration = finite_array(q, self._scene.q.shape, "q", ViewerError)
        expect(T_base_bodies, Mapping, "T_base_bodies", ViewerError)  # type: ignore[type-abstract]
        for side, phase in ({} if grippers is None else grippers).items():
            if side not in self._robot.arms:
                known = ", ".join(self._robot.arms)
                raise ViewerError(f"no gripper {quoted(side)}; there are: {known}")
            self._grippers[side] = expect(phase, GripperPhase, f"{side} gripper", ViewerError)
        self._is_simulated = False
        self._draw(configuration, T_base_bodies, caption=caption, seed=seed)

    def add_body(self, body: Body) -> None:
        """Show a body at its pose, in place of one of its name; replays do not measure it."""
        self._server.publish(self._scene.add_body(expect(body, Body, "body", ViewerError)))

    def remove_body(self, name: str) -> None:
        """Remove a body from the view.

        Raises:
            ViewerError: when there is no body of that name, or the view is closed.
        """
        self._server.publish(self._scene.remove_body(expect(name, str, "name", ViewerError)))

    def replay(self) -> Replay:
        """A replay of what was shown of the last simulation, its last two minutes at most.

        Raises:
            RecordingError: when no simulation was shown.
        """
        return Replay(self._run.recording(), self._robot, uncounted=self._run.drawn_only)

    def close(self, note: str = "") -> None:
        """Turn pages into replays of what they showed, stop serving, and free the port.

        Args:
            note: the last caption, such as the reason why the program failed.
        """
        if self._server.is_closed:
            return
        atexit.unregister(self.close)
        try:
            self._finish(expect(note, str, "note", ViewerError))
        finally:
            self._server.close()

    def present(
        self, say: Callable[[str], None], *, may_open: bool = True, wait_s: float = 0.0
    ) -> None:
        """Report the address of the page, open it where the user would see it, and wait for it.

        Args:
            say: prints a line.
            may_open: whether to open the user's browser at all.
            wait_s: how long to wait for a page.
        """
        is_opened = may_open and can_open(os.environ, sys.platform)
        for line in address_lines(self.url, os.environ, is_opened, wait_s):
            say(line)
        if is_opened:
            open_page(self.url)
        self.wait_for_client(wait_s)

    def _finish(self, note: str) -> None:
        """Send the last caption and, if a simulation is shown, the replay."""
        topics: dict[str, object] = {"caption": note} if note else {}
        if self._is_simulated and self.has_client:
            recording, uncounted = self._run.recording(note), self._run.drawn_only
            content = replay_content(recording, self._robot, uncounted=uncounted)
            topics["replay"] = encoded(content)
        self._server.publish([], **topics)

    def _begin_run_if_over(self, time_s: float) -> None:
        if self._run.is_over(time_s):
            self._begin_run(State(Scene(self._run.bodies), {}))

    def _begin_run(self, state: State) -> None:
        self._run = ShownRun(self._robot, state)
        self._pacing.begin()

    def _checked_q(self, q: ArrayLike) -> FloatArray:
        """The configuration, if it is of the robot in the view."""
        joints = float_array(q, "q", ViewerError)
        if joints.shape != self._scene.q.shape:
            raise ViewerError(
                f"the simulation moves a robot of {joints.size} joints, the view shows one of "
                f"{self._scene.q.size}; show the same one: Viewer(world.robot)"
            )
        return joints

    def _draw(self, q: FloatArray, T_base_bodies: Mapping[str, pin.SE3], **topics: object) -> None:
        holding = {side: phase.is_holding for side, phase in self._grippers.items()}
        commands = self._scene.move(q, T_base_bodies, holding)
        shown = {side: phase.for_page() for side, phase in self._grippers.items()}
        self._server.publish(commands, grippers=shown, **topics)


def can_open(environ: Mapping[str, str], platform: str) -> bool:
    """Whether a page that this program opens would be visible to the user.

    It is not over SSH, where the browser would run on the wrong machine, without a display, and in
    CI.

    Args:
        environ: environment variables.
        platform: as `sys.platform`.
    """
    if any(environ.get(name) for name in ("CI", "SSH_CONNECTION")):
        return False
    has_windows = platform in ("darwin", "win32")
    return has_windows or any(environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def address_lines(
    url: str, environ: Mapping[str, str], is_opened: bool, wait_s: float
) -> Iterator[str]:
    """Lines that name the address of a page.

    Args:
        url: the address.
        environ: environment variables.
        is_opened: whether a browser opens it.
        wait_s: how long the program waits for the page.
    """
    if is_opened:
        yield f"watch it at {url}, which opens in your browser"
    else:
        yield f"open {url} in a browser to watch"
    if environ.get("SSH_CONNECTION"):
        port = urlsplit(url).port
        yield (
            "(over SSH, forward that port first, on your own machine: "
            f"ssh -L {port}:127.0.0.1:{port} user@host)"
        )
    if wait_s > 0.0:
        yield f"(starts when the page is open, or in {wait_s:g} s)"


def open_page(url: str) -> None:
    """Open a page in the user's browser, without waiting until the browser is closed."""

    def attempt() -> None:
        with suppress(webbrowser.Error, OSError):
            webbrowser.open(url)

    threading.Thread(target=attempt, name="browser", daemon=True).start()
