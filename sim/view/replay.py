"""One self-contained HTML page that replays a recording: no network, no server, no installation.

Meshcat's viewer, the robot, the bodies and their motion are all inside. Motion is kept as keyframes
of joints and bodies, so a page of a minute weighs little more than the robot it shows. It goes to a
file with `write_replay`, or into a notebook with `Replay`.
"""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Iterable, Iterator

from baxter_kin import Baxter
from baxter_kin.errors import shown_path
from baxter_kin.files import PathLike, replace_file
from baxter_kin.validation import positive_scalar
from baxter_kin.value_objects import OneLine
from planner.collision.robot.hand_body import fitted
from planner.collision.robot.robot_body import RobotBody
from sim.errors import RecordingError
from sim.events import EventKind
from sim.files import explained
from sim.recording.recording import Recording
from sim.view.animation import animation_commands, recorded_tracks
from sim.view.appearance import Appearance
from sim.view.gripper_status import GripperPhase, gripper_timelines
from sim.view.meshcat_commands import Command, packed
from sim.view.scenegraph import RobotTree, body_commands, line_command, stage_commands
from sim.view.tip_path import AHEAD_RGB, PATH_RADIUS_M, PathPiece, line_rgb, recorded_paths
from sim.view.webpage import inside_script, page, viewer_bundle

TITLE = "Baxter: pick and place"

FRAME_HEIGHT_PX = 520
"""Height of a replay in a notebook."""

MARKS = {EventKind.GRASPED: "grasp", EventKind.RELEASED: "release", EventKind.MISSED: "miss"}
"""Events that are marked above the time slider, and how they are called there."""


class Replay(OneLine):
    """A replay that shows itself where a notebook prints it.

    The page is in the notebook, as the `srcdoc` of a frame: it needs no file and no server beside
    it, so it also plays in notebooks exported to HTML and with kernels on other machines.

    Attributes:
        html: the page, as `replay_html` gives it.
        height_px: how high the frame is; it is as wide as the cell.
    """

    def __init__(
        self,
        recording: Recording,
        robot: Baxter,
        *,
        height_px: int = FRAME_HEIGHT_PX,
        title: str = TITLE,
        body: RobotBody | None = None,
    ) -> None:
        """Make the page.

        Args:
            recording: what happened.
            robot: the robot it happened to.
            height_px: how high the frame shall be.
            title: shown on the page.
            body: what plans are made with, to be seen instead of the meshes, or with them.

        Raises:
            RecordingError: when there is nothing to replay, the recording is of another robot, or
                the height is not a positive number.
        """
        self.height_px = math.ceil(positive_scalar(height_px, "height_px", RecordingError))
        self.html = replay_html(recording, robot, title=title, body=body)

    def _facts(self) -> tuple[str, ...]:
        return f"page of {len(self.html) / 1e6:.1f} MB", f"{self.height_px} px high"

    def _repr_html_(self) -> str:
        """The page in a frame, where it runs scripts but reaches neither notebook nor server."""
        escaped = self.html.replace("&", "&amp;").replace('"', "&quot;")
        return (
            f'<iframe srcdoc="{escaped}" width="100%" height="{self.height_px}" '
            'style="border: 0" sandbox="allow-scripts" title="Replay"></iframe>'
        )


def write_replay(
    path: PathLike,
    recording: Recording,
    robot: Baxter,
    *,
    title: str = TITLE,
    body: RobotBody | None = None,
) -> None:
    """Write the replay to a file, all of it or nothing.

    Args:
        path: the HTML file; an older one is replaced.
        recording: what happened.
        robot: the robot it happened to.
        title: shown on the page, and its name in the browser.
        body: what plans are made with; the page then shows it or the meshes or both, as chosen
            there, and is 2 MB larger.

    Raises:
        RecordingError: when there is nothing to replay, the recording is of another robot, or the
            file cannot be written.
    """
    text = replay_html(recording, robot, title=title, body=body)
    with explained(f"cannot write the replay to {shown_path(path)}"):
        replace_file(path, text.encode())


def replay_html(
    recording: Recording, robot: Baxter, *, title: str = TITLE, body: RobotBody | None = None
) -> str:
    """The replay as the text of a page; arguments as of `write_replay`.

    Raises:
        RecordingError: when there is nothing to replay, or the recording is of another robot.
    """
    _check(recording, robot)
    if body is not None and not isinstance(body, RobotBody):
        raise RecordingError(f"a replay shows a RobotBody, got {type(body).__name__}")
    appearance = Appearance.of(robot)
    content = _content(recording, robot, RobotTree(robot.model, appearance), body)
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
    own = robot.description.identity
    difference = "" if recording.robot is None else own.difference(recording.robot)
    if difference:
        raise RecordingError(f"the recording is of another robot: {difference}")


def _content(
    recording: Recording, robot: Baxter, tree: RobotTree, body: RobotBody | None
) -> Command:
    """What the page decodes: commands in their order, the geometries they share, and the story."""
    phases = gripper_timelines(recording)
    pieces = {
        f"/path/{number}": piece
        for number, piece in enumerate(recorded_paths(recording, robot, phases))
    }
    body = None if body is None else fitted(body, robot.description)
    commands = [
        *stage_commands(),
        *tree.commands(),
        *(() if body is None else tree.body_commands(body)),
        *(command for body in recording.bodies.values() for command in body_commands(body)),
        *(line for path, piece in pieces.items() for line in _lines(path, piece)),
        *animation_commands(recorded_tracks(recording, tree), recording.duration_s),
    ]
    return {
        "geometries": _shared_geometries(commands),
        "commands": commands,
        "duration": recording.duration_s,
        "layers": {}
        if body is None
        else {"meshes": tree.mesh_paths, "body": tree.body_paths(body)},
        **_story(recording, phases, pieces),
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


def _lines(path: str, piece: PathPiece) -> tuple[Command, Command]:
    """A piece of a tip's way twice: as it is drawn ahead of the tip, and behind it."""
    rgb = line_rgb(piece.is_holding)
    return (
        line_command(f"{path}/ahead", piece.points_base, PATH_RADIUS_M, AHEAD_RGB, uuid=path),
        line_command(f"{path}/behind", piece.points_base, PATH_RADIUS_M, rgb, uuid=path),
    )


def _story(
    recording: Recording,
    phases: dict[str, list[tuple[float, GripperPhase]]],
    pieces: dict[str, PathPiece],
) -> Command:
    """What the page says and marks, and when, in seconds from its beginning."""
    start_s = float(recording.times_s[0])
    moved = {piece.side for piece in pieces.values()}
    active = [side for side in phases if side in moved or len(phases[side]) > 1]
    return {
        "captions": [[float(time) - start_s, text] for time, text in recording.captions],
        "seeds": [[time_s - start_s, seed] for time_s, seed in _seeds(recording)],
        "grippers": {
            side: [[time - start_s, *phase.for_page()] for time, phase in phases[side]]
            for side in active or phases
        },
        "marks": [
            [event.time_s - start_s, MARKS[event.kind], event.text]
            for event in recording.events
            if event.kind in MARKS and start_s <= event.time_s <= start_s + recording.duration_s
        ],
        "paths": [
            {"path": path, "times": (piece.times_s - start_s).tolist()}
            for path, piece in pieces.items()
        ],
        "sides": active,
    }


def _seeds(recording: Recording) -> Iterator[tuple[float, str]]:
    """When which seed of inverse kinematics led to where the arm moves; none between moves."""
    moves = sorted(recording.moves, key=lambda recorded: recorded.start_s)
    starts_s = [recorded.start_s for recorded in moves]
    yield min([float(recording.times_s[0]), *starts_s]), ""
    for recorded, next_s in zip(moves, [*starts_s, math.inf][1:], strict=True):
        yield recorded.start_s, "" if recorded.ik is None else recorded.move.seed_label
        yield min(recorded.end_s, next_s), ""  # another starts earlier where one was stopped
