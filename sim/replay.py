"""One self-contained HTML file that replays a recording: no network, no server, no installation.

Meshcat's viewer, the robot, the bodies and their motion are all inside. Motion is kept as keyframes
of joints and bodies, so a page of a minute weighs little more than the robot it shows.
"""

from __future__ import annotations

import base64
import html
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.arrays import Vector
from sim.animation import animation_commands, recorded_tracks
from sim.appearance import Appearance
from sim.errors import RecordingError
from sim.keyframes import frame_samples, telling_samples
from sim.meshcat_commands import Command, Rgb, packed
from sim.recording import Recording
from sim.scenegraph import RobotTree, body_commands, line_command, stage_commands
from sim.webpage import inside_script, page, viewer_bundle

TITLE = "Baxter: pick and place"

PATH_TOLERANCE_M = 1e-3
PATH_RADIUS_M = 3e-3
PATH_RGB: Rgb = (0.10, 0.48, 0.74)

STILL_M = 5e-3
"""A tip that moves no farther than this gets no line."""


def write_replay(
    path: str | os.PathLike[str], recording: Recording, robot: Baxter, *, title: str = TITLE
) -> None:
    """Write the replay to a file, all of it or nothing.

    Args:
        path: the HTML file; an older one is replaced.
        recording: what happened.
        robot: the robot it happened to.
        title: shown on the page, and its name in the browser.

    Raises:
        RecordingError: when there is nothing to replay, the recording is of another robot, or the
            file cannot be written.
    """
    text = replay_html(recording, robot, title=title)
    try:
        _replace_file(Path(path), text)
    except (OSError, TypeError, ValueError) as cause:
        reason = getattr(cause, "strerror", None) or cause
        raise RecordingError(f"cannot write the replay to {path!s}: {reason}") from cause


def replay_html(recording: Recording, robot: Baxter, *, title: str = TITLE) -> str:
    """The replay as the text of a page.

    Raises:
        RecordingError: when there is nothing to replay, or the recording is of another robot.
    """
    _check(recording, robot)
    appearance = Appearance.load()
    content = _content(recording, robot, RobotTree(robot.model, appearance))
    return page(
        "replay.html",
        title=html.escape(str(title)),
        notice=html.escape(appearance.notice),
        bundle=inside_script(viewer_bundle()),
        data=base64.b64encode(packed(content)).decode("ascii"),
    )


def _check(recording: Recording, robot: Baxter) -> None:
    if not isinstance(recording, Recording):
        raise RecordingError(f"a replay needs a Recording, got {type(recording).__name__}")
    if not isinstance(robot, Baxter):
        raise RecordingError(f"a replay needs the robot as a Baxter, got {type(robot).__name__}")
    if tuple(recording.joint_names) != robot.joint_names:
        raise RecordingError("the recording's joints are not those of this robot")


def _content(recording: Recording, robot: Baxter, tree: RobotTree) -> Command:
    """What the page decodes: commands in their order, the geometries they share, captions."""
    start_s = float(recording.times_s[0])
    commands = [
        *stage_commands(),
        *tree.commands(),
        *(command for body in recording.bodies.values() for command in body_commands(body)),
        *_tip_paths(recording, robot),
        *animation_commands(recorded_tracks(recording, tree), recording.duration_s),
    ]
    return {
        "geometries": _shared_geometries(commands),
        "commands": commands,
        "captions": [[float(time) - start_s, text] for time, text in recording.captions],
        "duration": recording.duration_s,
    }


def _shared_geometries(commands: Iterable[Command]) -> dict[str, Command]:
    """The geometries by name, each once; the commands keep the names only."""
    shared: dict[str, Command] = {}
    for command in commands:
        if command["type"] == "set_object":
            drawn = command["object"]
            shared.update((geometry["uuid"], geometry) for geometry in drawn["geometries"])
            drawn["geometries"] = [{"uuid": geometry["uuid"]} for geometry in drawn["geometries"]]
    return shared


def _tip_paths(recording: Recording, robot: Baxter) -> Iterator[Command]:
    """A line for each arm's tip that moves."""
    frames = frame_samples(recording.times_s)
    for side, arm in robot.arms.items():
        points = _tip_points(robot, arm.tip_frame, recording.q[frames])
        if np.ptp(points, axis=0).max() > STILL_M:
            yield line_command(f"/path/{side}", _thinned(points), PATH_RADIUS_M, PATH_RGB)


def _tip_points(robot: Baxter, frame: str, q: Vector) -> Vector:
    """Where a frame is at configurations (n, 19): points in base, shape (n, 3), metres."""
    model, data = robot.model, robot.model.createData()
    frame_id = model.getFrameId(frame)
    points = np.empty((len(q), 3))
    for row, configuration in enumerate(q):
        pin.forwardKinematics(model, data, configuration)
        points[row] = pin.updateFramePlacement(model, data, frame_id).translation
    return points


def _thinned(points: Vector) -> Vector:
    """The points (n, 3) without those on the line between their neighbours, and without rests."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    moved = np.concatenate([[True], steps > 0.0])
    points, travelled = points[moved], travelled[moved]
    return points[telling_samples(travelled, points, PATH_TOLERANCE_M)]


def _replace_file(link: Path, text: str) -> None:
    """Write a file beside the target and rename it, so that nobody sees half a file.

    A link stays one. What is no file, such as a device, is never replaced.
    """
    target = link.resolve()
    if target.exists() and not target.is_file():
        raise ValueError("it exists and is no ordinary file")
    beside = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        beside.write_text(text, encoding="utf-8")
        os.replace(beside, target)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise
