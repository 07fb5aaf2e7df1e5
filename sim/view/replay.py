"""One self-contained HTML page that replays a recording: no network, no server, no installation.

Meshcat's viewer, the robot, the bodies and their motion are all inside. Motion is stored as
keyframes of joints and bodies, so a page of a minute is little larger than the robot that it shows.
It goes to a file with `write_replay`, or into a notebook with `Replay`. A live page receives the
content when the program ends, and continues as the replay of what it showed.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TypeAlias

from baxter_kin import Baxter
from baxter_kin.display import OneLine, shown_path
from baxter_kin.fields import evolve
from baxter_kin.files import PathLike, replace_file
from baxter_kin.kinematics.robot import given_or_stock
from baxter_kin.validation import expect, expect_all, positive_scalar
from planner import Plan, TwoArmPlan
from planner.collision.robot.robot_body import RobotBody, fitted
from sim.errors import RecordingError
from sim.events import EventKind
from sim.files import explained
from sim.recording.recorder import difference_of, planned_recording
from sim.recording.recording import Recording
from sim.view.animation import animation_commands, recorded_tracks
from sim.view.appearance import Appearance
from sim.view.clearance import recorded_clearance
from sim.view.meshcat_commands import Command, shared_geometries
from sim.view.overlays import (
    GHOST_PATH,
    GOALS_PATH,
    INK_PATH,
    NEAREST_PATH,
    InkLine,
    PathPiece,
    frame_commands,
    frame_paths,
    ghost_commands,
    ghost_of,
    goal_commands,
    layers,
    nearest_command,
    recorded_ink,
    recorded_paths,
    varying_parts,
)
from sim.view.panel import (
    GripperPhase,
    gripper_timelines,
    recorded_arms,
    recorded_bounds,
    waypoints,
)
from sim.view.scenegraph import RobotTree, body_commands, stage_commands
from sim.view.webpage import encoded, page

TITLE = "Baxter: pick and place"

FRAME_HEIGHT_PX = 520
"""Height of a replay in a notebook."""

MARKS = {EventKind.GRASPED: "grasp", EventKind.RELEASED: "release", EventKind.MISSED: "miss"}
"""Events that are marked above the time slider, and their names there."""


Shown: TypeAlias = Recording | Plan | TwoArmPlan
"""What a replay shows: what happened, or a valid plan, shown as if it had happened."""


class Replay(OneLine):
    """A replay that displays itself in a notebook.

    The page is in the notebook, as the `srcdoc` of a frame: it needs no file and no server, so it
    also plays in notebooks exported to HTML and with kernels on other machines.

    Attributes:
        html: the page, as `replay_html` gives it.
        height_px: height of the frame, which is as wide as the cell.
    """

    def __init__(
        self,
        recording: Shown,
        robot: Baxter | None = None,
        *,
        height_px: int = FRAME_HEIGHT_PX,
        title: str = TITLE,
        body: RobotBody | None = None,
        compare: Shown | None = None,
        uncounted: Collection[str] = (),
    ) -> None:
        """Make the page.

        Args:
            recording: what happened; or a valid plan, shown as if it had happened in the world that
                it was made for.
            robot: the robot of the recording or plan; the stock robot when not given.
            height_px: height of the frame.
            title: shown on the page.
            body: the collision body, shown instead of the meshes or with them.
            compare: a recording or plan of the same robot, shown as a ghost; both begin at once.
            uncounted: names of bodies that are only drawn, and do not count for the clearance.

        Raises:
            RecordingError: when there is nothing to replay, it is of another robot, a plan is not
                valid, or the height is not a positive number.
        """
        self.height_px = math.ceil(positive_scalar(height_px, "height_px", RecordingError))
        self.html = replay_html(
            recording, robot, title=title, body=body, compare=compare, uncounted=uncounted
        )

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
    recording: Shown,
    robot: Baxter | None = None,
    *,
    title: str = TITLE,
    body: RobotBody | None = None,
    compare: Shown | None = None,
) -> None:
    """Write the replay to a file, completely or not at all.

    Args:
        path: the HTML file; an older one is replaced.
        recording: what happened; or a valid plan, shown as if it had happened.
        robot: the robot of the recording or plan; the stock robot when not given.
        title: shown on the page, and its name in the browser.
        body: the collision body; the page then shows it, the meshes or both, as chosen there, and
            is 2 MB larger.
        compare: a recording or plan of the same robot, shown as a ghost; both begin at once.

    Raises:
        RecordingError: as of `Replay`, or when the file cannot be written.
    """
    text = replay_html(recording, robot, title=title, body=body, compare=compare)
    with explained(f"cannot write the replay to {shown_path(path)}"):
        replace_file(path, text.encode())


def replay_html(
    recording: Shown,
    robot: Baxter | None = None,
    *,
    title: str = TITLE,
    body: RobotBody | None = None,
    compare: Shown | None = None,
    uncounted: Collection[str] = (),
) -> str:
    """The replay as the text of a page; arguments as of `Replay`."""
    known = given_or_stock(robot, RecordingError)
    hint = "; give that robot as robot=..." if robot is None else ""
    happened = _recording(recording, known, body, hint)
    other = None if compare is None else _recording(compare, known, body, hint)
    content = replay_content(happened, known, body=body, compare=other, uncounted=uncounted)
    return page(
        "replay.html",
        title=title,
        notice=Appearance.of(known).notice,
        data=encoded(content),
    )


def _recording(shown: Shown, robot: Baxter, body: RobotBody | None, hint: str) -> Recording:
    """The recording, or the one that executing the plan would give, if it is of the robot."""
    if not isinstance(shown, Recording | Plan | TwoArmPlan):
        raise RecordingError(f"a replay needs a Recording or a Plan, got {type(shown).__name__}")
    if not isinstance(shown, Recording):
        difference = difference_of(shown, robot)
        if difference:
            raise RecordingError(f"the plan is for another robot: {difference}{hint}")
        return planned_recording(shown, robot, body=body)
    if tuple(shown.joint_names) != robot.joint_names:
        raise RecordingError(f"the recording's joints are not those of this robot{hint}")
    own = robot.description.identity
    difference = "" if shown.robot is None else own.difference(shown.robot)
    if difference:
        raise RecordingError(f"the recording is of another robot: {difference}{hint}")
    return shown


def replay_content(
    recording: Recording,
    robot: Baxter,
    *,
    body: RobotBody | None = None,
    compare: Recording | None = None,
    uncounted: Collection[str] = (),
) -> Command:
    """What the page decodes: commands, their geometries, the timeline and the panel's data.

    Args:
        recording: what happened.
        robot: the robot of the recording.
        body: the collision body, to be shown, too.
        compare: another recording of the same robot, shown as a ghost from its own start on.
        uncounted: names of bodies that are only drawn, and do not count for the clearance.
    """
    if body is not None:
        expect(body, RobotBody, "the body", RecordingError)
    names = expect_all(uncounted, str, "uncounted", RecordingError)
    clearance, reason = recorded_clearance(_without(recording, names), robot, body)
    phases = gripper_timelines(recording)
    pieces = {
        f"/path/{number}": piece
        for number, piece in enumerate(recorded_paths(recording, robot, phases))
    }
    ink = {
        f"{INK_PATH}/{number}": line for number, line in enumerate(recorded_ink(recording, robot))
    }
    appearance = Appearance.of(robot)
    tree = RobotTree(robot.model, appearance)
    tracks = list(recorded_tracks(recording, tree))
    drawn = None if body is None else fitted(body, robot.description)
    ghost: list[Command] = []
    duration_s = recording.duration_s
    if compare is not None:
        duration_s = max(duration_s, compare.duration_s)
        other = ghost_of(compare, recording)
        parts = varying_parts(appearance, robot, recording, other)
        ghost_tree = RobotTree(robot.model, parts, GHOST_PATH)
        ghost += ghost_commands(other, ghost_tree)
        tracks += recorded_tracks(other, ghost_tree, GHOST_PATH)
    goals = list(goal_commands(recording, robot, appearance))
    commands = [
        *stage_commands(),
        *tree.commands(),
        *(() if drawn is None else tree.body_commands(drawn)),
        *(part for each in recording.bodies.values() for part in body_commands(each)),
        *(line for path, piece in pieces.items() for line in piece.commands(path)),
        *(line.command(path) for path, line in ink.items()),
        *goals,
        *frame_commands(robot, tree),
        *ghost,
        *([] if clearance is None else [nearest_command()]),
        *animation_commands(tracks, duration_s),
    ]
    geometries, commands = shared_geometries(commands)
    return {
        "geometries": geometries,
        "commands": commands,
        "duration": duration_s,
        **_timeline(recording, phases, pieces, ink),
        "arms": recorded_arms(recording, robot),
        "bounds": recorded_bounds(recording, robot),
        "clearance": clearance,
        "unmeasured": reason,
        "waypoints": waypoints(recording.moves, *recording.times_s[[0, -1]].tolist()),
        "layers": layers(
            {
                "robot": tree.mesh_paths,
                "body": () if drawn is None else tree.body_paths(drawn),
                "paths": ("/path",),
                "ink": (INK_PATH,) if ink else (),
                "goals": (GOALS_PATH,) if goals else (),
                "frames": frame_paths(robot, tree),
                "ghost": (GHOST_PATH,) if ghost else (),
                "nearest": () if clearance is None else (NEAREST_PATH,),
            }
        ),
    }


def _without(recording: Recording, names: Collection[str]) -> Recording:
    """A recording without some of its bodies."""
    kept = [name for name in recording.bodies if name not in names]
    return evolve(
        recording,
        bodies={name: recording.bodies[name] for name in kept},
        body_poses={name: recording.body_poses[name] for name in kept},
    )


def _timeline(
    recording: Recording,
    phases: Mapping[str, Sequence[tuple[float, GripperPhase]]],
    pieces: Mapping[str, PathPiece],
    ink: Mapping[str, InkLine],
) -> Command:
    """Captions, seeds, gripper phases, marks, paths, ink; times in seconds from the start."""
    start_s = float(recording.times_s[0])
    moved = {piece.side for piece in pieces.values()}
    return {
        "captions": [[float(time) - start_s, text] for time, text in recording.captions],
        "seeds": [[time_s - start_s, seed] for time_s, seed in _seeds(recording)],
        "grippers": {
            side: [[time - start_s, *phase.for_page()] for time, phase in timeline]
            for side, timeline in phases.items()
            if timeline
        },
        "marks": [
            [event.time_s - start_s, MARKS[event.kind], event.text, event.side]
            for event in recording.events
            if event.kind in MARKS and start_s <= event.time_s <= start_s + recording.duration_s
        ],
        "paths": [
            {"path": path, "times": (piece.times_s - start_s).tolist()}
            for path, piece in pieces.items()
        ],
        "ink": [
            {"path": path, "times": (line.times_s - start_s).tolist()} for path, line in ink.items()
        ],
        "sides": [side for side in phases if side in moved or len(phases[side]) > 1],
    }


def _seeds(recording: Recording) -> Iterator[tuple[float, str]]:
    """The times from which each seed of inverse kinematics is shown; "" between moves."""
    moves = sorted(recording.moves, key=lambda recorded: recorded.start_s)
    starts_s = [recorded.start_s for recorded in moves]
    yield min([float(recording.times_s[0]), *starts_s]), ""
    for recorded, next_s in zip(moves, [*starts_s, math.inf][1:], strict=True):
        yield recorded.start_s, "" if recorded.ik is None else recorded.move.seed_label
        yield min(recorded.end_s, next_s), ""  # another starts earlier where one was stopped
