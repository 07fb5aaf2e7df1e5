"""What a replay's page decodes: the scene, its animation, the story, and the telemetry.

The page of a file has it embedded; a live page gets it when the program ends, and goes on as the
replay of what it showed.
"""

from __future__ import annotations

import base64
import math
import zlib
from collections.abc import Collection, Iterable, Iterator

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import expect, expect_all
from planner import Plan
from planner.collision.robot.robot_body import RobotBody, fitted
from sim.errors import RecordingError
from sim.events import EventKind
from sim.recording.recording import Recording
from sim.view.animation import animation_commands, recorded_tracks
from sim.view.appearance import Appearance
from sim.view.delta_coding import delta_coded
from sim.view.drawn_bodies import body_commands
from sim.view.gripper_status import GripperPhase, gripper_timelines
from sim.view.meshcat_commands import Command, packed, shared_geometries
from sim.view.overlays import (
    GHOST_PATH,
    GOALS_PATH,
    NEAREST_PATH,
    frame_commands,
    frame_paths,
    ghost_commands,
    ghost_of,
    goal_commands,
    layers,
    moving_parts,
    nearest_command,
)
from sim.view.scenegraph import RobotTree, line_command, stage_commands
from sim.view.telemetry.arms import recorded_arms
from sim.view.telemetry.clearance import recorded_clearance, why_unmeasured
from sim.view.telemetry.waypoints import recorded_waypoints
from sim.view.tip_path import AHEAD_RGB, PATH_RADIUS_M, PathPiece, line_rgb, recorded_paths

MARKS = {EventKind.GRASPED: "grasp", EventKind.RELEASED: "release", EventKind.MISSED: "miss"}
"""Events that are marked above the time slider, and how they are called there."""


def encoded_content(
    recording: Recording,
    robot: Baxter,
    *,
    body: RobotBody | None = None,
    compare: Recording | None = None,
    uncounted: Collection[str] = (),
) -> str:
    """All that a page needs to replay a recording, as ASCII.

    Its arrays as differences, then msgpack, then zlib, then base64.

    A compressed page is no larger than a gzipped one of plain msgpack, whose bytes base64 takes out
    of step. It needs a browser of 2023 or later (`DecompressionStream`).

    Args:
        recording: what happened.
        robot: the robot it happened to.
        body: what plans are made with, to be shown, too.
        compare: another recording of the same robot, shown as a ghost from its own start on.
        uncounted: names of bodies that are drawn only, and are no part of the clearance.
    """
    check_replayed(recording, robot)
    if compare is not None:
        check_replayed(compare, robot)
    if body is not None:
        expect(body, RobotBody, "the body", RecordingError)
    names = expect_all(uncounted, str, "uncounted", RecordingError)
    measured = _measured(_without(recording, names), robot, body)
    content = _content(recording, robot, body, compare, measured)
    return base64.b64encode(zlib.compress(packed(delta_coded(content)), level=9)).decode("ascii")


def check_replayed(shown: Recording | Plan, robot: Baxter, hint: str = "") -> None:
    """Refuse what is no recording or plan of a robot.

    Args:
        shown: what is to be replayed.
        robot: the robot.
        hint: what to do when it is another one.
    """
    if not isinstance(shown, Recording | Plan):
        raise RecordingError(f"a replay needs a Recording or a Plan, got {type(shown).__name__}")
    if not isinstance(robot, Baxter):
        raise RecordingError(f"a replay needs the robot as a Baxter, got {type(robot).__name__}")
    what = "recording is of" if isinstance(shown, Recording) else "plan is for"
    if isinstance(shown, Recording) and tuple(shown.joint_names) != robot.joint_names:
        raise RecordingError(f"the recording's joints are not those of this robot{hint}")
    own = robot.description.identity
    difference = "" if shown.robot is None else own.difference(shown.robot)
    if difference:
        raise RecordingError(f"the {what} another robot: {difference}{hint}")


def _content(
    recording: Recording,
    robot: Baxter,
    body: RobotBody | None,
    compare: Recording | None,
    measured: Command,
) -> Command:
    """What the page decodes: commands in their order, the geometries they share, and the story."""
    phases = gripper_timelines(recording)
    pieces = {
        f"/path/{number}": piece
        for number, piece in enumerate(recorded_paths(recording, robot, phases))
    }
    shown = None if body is None else fitted(body, robot.description)
    ghost = None if compare is None else ghost_of(compare, recording)
    scene = _Scene(recording, robot, shown, ghost, has_nearest=measured["clearance"] is not None)
    lines = [line for path, piece in pieces.items() for line in _lines(path, piece)]
    commands = scene.commands(lines)
    return {
        "geometries": shared_geometries(commands),
        "commands": commands,
        "duration": scene.duration_s,
        **_story(recording, phases, pieces),
        "arms": recorded_arms(recording, robot),
        **measured,
        "waypoints": recorded_waypoints(recording, robot),
        "layers": scene.layers(),
    }


def _without(recording: Recording, names: Collection[str]) -> Recording:
    """A recording less some of its bodies."""
    if not names:
        return recording
    kept = [name for name in recording.bodies if name not in names]
    return evolve(
        recording,
        bodies={name: recording.bodies[name] for name in kept},
        body_poses={name: recording.body_poses[name] for name in kept},
    )


def _measured(recording: Recording, robot: Baxter, body: RobotBody | None) -> Command:
    """The clearance, or why there is none."""
    clearance = recorded_clearance(recording, robot, body)
    reason = "" if clearance is not None else why_unmeasured(recording, robot, body)
    return {"clearance": clearance, "unmeasured": reason}


class _Scene:
    """What is drawn: the recording, what lies over it, and another one as a ghost.

    Attributes:
        duration_s: of the longer of the two.
    """

    def __init__(
        self,
        recording: Recording,
        robot: Baxter,
        body: RobotBody | None,
        ghost: Recording | None,
        *,
        has_nearest: bool,
    ) -> None:
        self._recording, self._robot, self._body, self._ghost = recording, robot, body, ghost
        self._appearance, self._has_nearest = Appearance.of(robot), has_nearest
        self._tree = RobotTree(robot.model, self._appearance)
        self._ghost_tree = self._tree_of_ghost()
        both = [recording] if ghost is None else [recording, ghost]
        self.duration_s = max(each.duration_s for each in both)
        self._goals = list(goal_commands(recording, robot, self._appearance))

    def commands(self, lines: Iterable[Command]) -> list[Command]:
        """All of them, the animation last; `lines` are those of the tips."""
        tree, ghost = self._tree, self._ghost
        tracks = list(recorded_tracks(self._recording, tree))
        if ghost is not None:
            tracks += recorded_tracks(ghost, self._ghost_tree, GHOST_PATH)
        return [
            *stage_commands(),
            *tree.commands(),
            *(() if self._body is None else tree.body_commands(self._body)),
            *(part for body in self._recording.bodies.values() for part in body_commands(body)),
            *lines,
            *self._goals,
            *frame_commands(self._robot, tree),
            *(() if ghost is None else ghost_commands(ghost, self._ghost_tree)),
            *([nearest_command()] if self._has_nearest else ()),
            *animation_commands(tracks, self.duration_s),
        ]

    def _tree_of_ghost(self) -> RobotTree:
        appearance, ghost = self._appearance, self._ghost
        if ghost is not None:
            appearance = moving_parts(appearance, self._robot, self._recording, ghost)
        return RobotTree(self._robot.model, appearance, GHOST_PATH)

    def layers(self) -> list[Command]:
        """What the page can show or hide: id, label, nodes, and whether it is shown at first."""
        body = () if self._body is None else self._tree.body_paths(self._body)
        ghost = () if self._ghost is None else (GHOST_PATH,)
        return layers(
            {
                "robot": self._tree.mesh_paths,
                "body": body,
                "paths": ("/path",),
                "goals": (GOALS_PATH,) if self._goals else (),
                "frames": frame_paths(self._robot, self._tree),
                "ghost": ghost,
                "nearest": (NEAREST_PATH,) if self._has_nearest else (),
            }
        )


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
            side: [[time - start_s, *phase.for_page()] for time, phase in timeline]
            for side, timeline in phases.items()
            if timeline
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
