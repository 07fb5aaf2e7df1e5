"""What a page can draw over the scene: tip paths, frames, goals, a ghost, and the nearest pair.

Goals and the ghost are translucent copies of what is drawn anyway, and share its triangles.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner import Body
from sim.events import Event, EventKind
from sim.recording.recording import Recording
from sim.view.animation import frame_samples, key_samples
from sim.view.appearance import Appearance
from sim.view.meshcat_commands import (
    Command,
    Rgb,
    compact,
    delete,
    glowing,
    set_object,
    set_transform,
    translucent,
    triangles,
    tube,
)
from sim.view.panel import GripperPhase
from sim.view.scenegraph import RobotTree, body_commands, line_command, part_command

NEAREST_PATH = "/nearest"
"""Node of the line between the nearest pair."""

NEAREST_RGB: Rgb = (0.78, 0.10, 0.42)
"""Colour of that line."""

GHOST_PATH = "/ghost"
"""Node of the other recording."""

GHOST_RGB: Rgb = (0.24, 0.33, 0.78)
"""Colour of the other recording."""

GHOST_OPACITY = 0.34
"""Opacity of the other recording."""

MIN_DIFFERENCE = 1e-4
"""Joints that differ by no more than this, rad or m, are drawn once."""

GOALS_PATH = "/goals"
"""Node of the goals."""

GOAL_RGB: Rgb = (0.05, 0.60, 0.55)
"""Colour of goals."""

GOAL_OPACITY = 0.36
"""Opacity of goals."""

MAX_GOALS = 24
"""Maximum number of goals; the first ones are drawn."""

SAME_GOAL = 1e-3
"""Maximum difference of equal poses, m and parts of a quaternion."""

AXES_RGB: tuple[Rgb, Rgb, Rgb] = ((0.85, 0.12, 0.12), (0.10, 0.60, 0.16), (0.12, 0.32, 0.90))
"""Colours of the axes x, y and z of frames."""

AXIS_RADIUS = 0.02
"""Radius of axes as a share of their length."""

JOINT_AXES_M = 0.10
"""Length of axes at joints."""

END_AXES_M = 0.16
"""Length of axes at base and tips."""

PATH_RADIUS_M = 4.5e-3
EMPTY_RGB: Rgb = (0.09, 0.42, 0.80)
HOLDING_RGB: Rgb = (0.93, 0.53, 0.02)
AHEAD_RGB: Rgb = (0.42, 0.47, 0.52)
"""The colours of a line, the last where the tip has yet to go. The pages' style sheet has the first
two for the grippers' states."""

SEGMENT_M = 0.015
"""Maximum length of the segments by which a line grows."""

INK_RADIUS_M, INK_SEGMENT_M, INK_TOLERANCE_M = 2e-3, 0.004, 2e-4
INK_RGB: Rgb = (0.06, 0.10, 0.30)
"""Ink: half its width, the length of its segments, its maximum distance from the recorded line, and
its colour."""

INK_PATH = "/ink"
"""Node of the ink."""

MAX_STEP_M = 0.2
"""A tip that is farther away at the next sample was put there, and did not move there."""

_TOLERANCE_M = 1e-3
_MIN_MOVED_M = 5e-3
"""A tip that moves no farther than this gets no line."""

_MAX_SEGMENTS = 1000
"""Maximum number of segments for each tip; those of a longer path are longer."""

MAX_PIECE_POINTS = 32
"""Maximum number of points of a piece, which is sent again whenever it grows."""

MAX_PIECES = 24
"""Maximum number of pieces, of which the latest stay: some 10 m of line."""

_LAYERS = (
    ("robot", "Robot", True),
    ("body", "Collision body", False),
    ("paths", "Tip path", True),
    ("ink", "Ink", True),
    ("goals", "Goals", True),
    ("frames", "Frames", False),
    ("ghost", "Other recording", True),
    ("nearest", "Nearest pair", True),
)
"""Id, label, and whether it is shown at first."""


def layers(paths: Mapping[str, Iterable[str]]) -> list[Command]:
    """What a page can show or hide: id, label, nodes, and whether it is shown at first.

    Args:
        paths: the nodes of each layer, by its id; layers without nodes are left out.
    """
    return [
        {"id": name, "label": label, "paths": nodes, "shown": is_shown}
        for name, label, is_shown in _LAYERS
        if (nodes := list(paths.get(name, ())))
    ]


def nearest_command() -> Command:
    """The line between the nearest pair, as a cylinder of radius 1 and length 1 along y.

    The page places it between two points.
    """
    cylinder = {"type": "CylinderGeometry", "radialSegments": 8, "height": 1.0}
    size = {"radiusTop": 1.0, "radiusBottom": 1.0}
    return set_object(NEAREST_PATH, cylinder | size, glowing(NEAREST_RGB))


def frame_commands(robot: Baxter, tree: RobotTree) -> Iterator[Command]:
    """Axes at base, both tips and the joints of both arms, drawn in front of everything else.

    Their nodes are `frame_paths`.
    """
    model, ends, axes = robot.model, _ends(robot), _axes()
    for path, frame in zip(frame_paths(robot, tree), [*ends, *_arm_joints(robot)], strict=True):
        length_m = END_AXES_M if frame in ends else JOINT_AXES_M
        placement = pin.SE3.Identity()
        if frame in ends and frame:
            placement = model.frames[model.getFrameId(frame)].placement
        yield set_object(path, axes, _AXES_SURFACE, _scaled(length_m))
        yield set_transform(path, placement)


def frame_paths(robot: Baxter, tree: RobotTree) -> list[str]:
    """The nodes of the frames: base, the tips, the joints of both arms."""
    model = robot.model
    tips = [model.frames[model.getFrameId(arm.tip_frame)] for arm in robot.arms.values()]
    on_tips = [f"{tree.moving_node(model.names[tip.parentJoint])}/tip frame" for tip in tips]
    on_joints = [f"{tree.moving_node(name)}/frame" for name in _arm_joints(robot)]
    return [f"{tree.moving_node('universe')}/frame", *on_tips, *on_joints]


def goal_commands(recording: Recording, robot: Baxter, appearance: Appearance) -> Iterator[Command]:
    """A hand at the goal of every recorded move, the fingers as they were at its end.

    They are nodes `/goals/<number of the move>`; moves to the same pose share one.
    """
    drawn: list[FloatArray] = []
    for number, move in enumerate(sorted(recording.moves, key=lambda move: move.start_s)):
        row = int(np.searchsorted(recording.times_s, move.end_s, side="right")) - 1
        q, limb = recording.q[max(row, 0)].copy(), move.limb
        q[list(robot.indices(move.joint_names))] = move.trajectory.q_goal
        fingers = [i for i, n in enumerate(robot.joint_names) if n.startswith(f"{limb[0]}_gripper")]
        tip = robot.arm(limb).T_base_tip(q[list(robot.indices(robot.arm(limb).joint_names))])
        goal = np.array([limb == "left", *pin.SE3ToXYZQUAT(tip), *q[fingers]])
        if len(drawn) < MAX_GOALS and not any(_is_same(goal, other) for other in drawn):
            drawn.append(goal)
            yield from hand_commands(f"{GOALS_PATH}/{number}", robot, limb, q, appearance)


def hand_commands(
    path: str, robot: Baxter, side: str, q: FloatArray, appearance: Appearance
) -> Iterator[Command]:
    """A translucent hand where it is at a full configuration, shape (19,)."""
    model, data = robot.model, robot.model.createData()
    pin.forwardKinematics(model, data, q)
    last = model.getJointId(robot.arm(side).joint_names[-1])
    joints = {model.names[joint] for joint in model.subtrees[last]}
    parts = [part for part in appearance.parts if part.joint in joints]
    surface = translucent(GOAL_RGB, GOAL_OPACITY)
    for index, part in enumerate(parts):
        T_base_mesh = data.oMi[model.getJointId(part.joint)] * part.T_joint_mesh
        yield part_command(f"{path}/{index}", part, T_base_mesh, surface)


def ghost_of(other: Recording, recording: Recording) -> Recording:
    """Another recording without the bodies that stand at the same place in both."""
    kept = [
        name
        for name, poses in other.body_poses.items()
        if name not in recording.body_poses or _differ(poses, recording.body_poses[name])
    ]
    bodies = {name: body for name, body in other.bodies.items() if name in kept}
    return evolve(other, bodies=bodies, body_poses={n: other.body_poses[n] for n in kept})


def varying_parts(
    appearance: Appearance, robot: Baxter, one: Recording, other: Recording
) -> Appearance:
    """The parts of the robot that are not at one constant pose in both recordings."""
    q = np.concatenate([one.q, other.q])
    differing = {
        robot.model.getJointId(name)
        for name, spread in zip(robot.joint_names, np.ptp(q, axis=0), strict=True)
        if spread > MIN_DIFFERENCE
    }
    model, parts = robot.model, appearance.parts
    chains = {name: set(model.supports[joint]) for joint, name in enumerate(model.names)}
    kept = tuple(part for part in parts if not differing.isdisjoint(chains[part.joint]))
    return evolve(appearance, parts=kept)


def ghost_commands(other: Recording, tree: RobotTree) -> Iterator[Command]:
    """Translucent robot and bodies of another recording; its tree is below `GHOST_PATH`."""
    surface = translucent(GHOST_RGB, GHOST_OPACITY)
    yield from tree.commands(surface)
    for body in other.bodies.values():
        yield from body_commands(body, GHOST_PATH, surface)


def _ends(robot: Baxter) -> list[str]:
    """Base as "", and the tips' frames."""
    return ["", *(arm.tip_frame for arm in robot.arms.values())]


def _arm_joints(robot: Baxter) -> list[str]:
    return [name for arm in robot.arms.values() for name in arm.joint_names]


_AXES_SURFACE: Command = {
    "type": "MeshBasicMaterial",
    "vertexColors": True,
    "depthTest": False,
    "transparent": True,
}


def _axes() -> Command:
    """Three tubes of length 1 from the origin, each in its colour."""
    lines = [tube(np.array([np.zeros(3), axis]), AXIS_RADIUS) for axis in np.eye(3)]
    vertices = np.concatenate([points for points, _ in lines])
    starts = np.cumsum([0, *(len(points) for points, _ in lines[:-1])])
    faces = np.concatenate([own + start for (_, own), start in zip(lines, starts, strict=True)])
    colours = np.repeat([[*rgb, 1.0] for rgb in AXES_RGB], len(lines[0][0]), axis=0)
    return triangles(vertices, compact(faces), colours=colours.astype(np.float32), uuid="axes")


def _is_same(goal: FloatArray, other: FloatArray) -> bool:
    return goal.shape == other.shape and bool(np.abs(goal - other).max() < SAME_GOAL)


def _differ(poses: FloatArray, others: FloatArray) -> bool:
    """Whether two tracks, shape (n, 7), are not one and the same place whenever they are known."""
    known = np.concatenate([track[np.isfinite(track).all(axis=1)] for track in (poses, others)])
    return not len(known) or bool(np.ptp(known, axis=0).max() >= SAME_GOAL)


def _scaled(length_m: float) -> list[float]:
    scale: list[float] = np.diag([length_m, length_m, length_m, 1.0]).reshape(-1).tolist()
    return scale


@dataclass(frozen=True, slots=True, eq=False)
class PathPiece:
    """A piece of a tip's path, with the hand either empty or holding something all along.

    Attributes:
        side: of the arm.
        times_s: recorded time at each point, shape (n,).
        points_base: shape (n, 3), metres.
        is_holding: whether the hand holds something.
    """

    side: str
    times_s: FloatArray
    points_base: FloatArray
    is_holding: bool

    def commands(self, path: str) -> tuple[Command, Command]:
        """The line twice, below a node: as drawn ahead of the tip, and behind it."""
        rgb, points = line_rgb(self.is_holding), self.points_base
        return (
            line_command(f"{path}/ahead", points, PATH_RADIUS_M, AHEAD_RGB, uuid=path),
            line_command(f"{path}/behind", points, PATH_RADIUS_M, rgb, uuid=path),
        )


def line_rgb(is_holding: bool) -> Rgb:
    """The colour of a line."""
    return HOLDING_RGB if is_holding else EMPTY_RGB


def recorded_paths(
    recording: Recording,
    robot: Baxter,
    phases: Mapping[str, Sequence[tuple[float, GripperPhase]]],
) -> Iterator[PathPiece]:
    """The paths of all tips that move, except where they draw.

    Args:
        recording: what happened.
        robot: the robot of the recording.
        phases: those of the grippers with their start times, by side.
    """
    frames = frame_samples(recording.times_s)
    times = recording.times_s[frames]
    for side, arm in robot.arms.items():
        joints = list(robot.indices(arm.joint_names))
        points = arm.T_base_tips(recording.q[frames][:, joints])[:, :3, 3]
        if np.ptp(points, axis=0).max() > _MIN_MOVED_M:
            starts_s = [-np.inf, *(start_s for start_s, _ in phases[side][1:])]
            is_holding = np.array([phase.is_holding for _, phase in phases[side]] or [False])
            now = is_holding[np.searchsorted(starts_s, times, side="right") - 1]
            begin = 0
            for first, last in [
                *np.searchsorted(times, _drawn_s(recording, side)),
                [len(times)] * 2,
            ]:
                rows = slice(begin, first)
                if first > begin:
                    yield from _pieces(side, times[rows], points[rows], now[rows])
                begin = last


def _drawn_s(recording: Recording, side: str) -> FloatArray:
    """From when to when a hand draws, lifts included, shape (k, 2), s."""
    found: list[list[float]] = []
    is_going_on = False
    for event in recording.events:
        if event.side == side and event.kind is EventKind.PEN_DOWN and not is_going_on:
            found.append([event.time_s, event.time_s])
            is_going_on = True
        elif event.side == side and event.kind is EventKind.PEN_UP and found:
            found[-1][1] = event.time_s
        elif event.side == side and event.kind is EventKind.MOVE_STARTED:
            is_going_on = False
    return np.array(found).reshape(-1, 2)


def _pieces(
    side: str, times: FloatArray, points: FloatArray, holding: NDArray[np.bool_]
) -> Iterator[PathPiece]:
    """The path cut where the hand grasps or releases, and where the tip jumps."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    jumps = steps > MAX_STEP_M
    segment_m = max(SEGMENT_M, float(steps[~jumps].sum()) / _MAX_SEGMENTS)
    cuts = np.flatnonzero(jumps | (np.diff(holding.astype(int)) != 0)) + 1
    for start, end in zip([0, *cuts], [*cuts, len(points)], strict=True):
        reaches_on = end < len(points) and not jumps[end - 1]
        rows = slice(start, end + int(reaches_on))
        chosen = _key_points(points[rows], segment_m)
        if len(chosen) > 1:
            at, where = times[rows][chosen], points[rows][chosen]
            yield PathPiece(side, at, where, bool(holding[start]))


def _key_points(
    points: FloatArray, segment_m: float, tolerance_m: float = _TOLERANCE_M
) -> NDArray[np.intp]:
    """Indices of the points of a line, without rests and points straight between two others."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    moved = np.flatnonzero(np.concatenate([[True], steps > 0.0]))
    if len(moved) < 2:
        return moved
    travelled = np.concatenate([[0.0], np.cumsum(steps)])[moved]
    shape = key_samples(travelled, points[moved], tolerance_m)
    regular = np.flatnonzero(np.diff(np.floor(travelled / segment_m), prepend=-1.0) > 0)
    return moved[np.union1d(shape, regular)]


@dataclass(frozen=True, slots=True, eq=False)
class InkLine:
    """A stroke of a pen.

    Attributes:
        times_s: recorded time at each point, shape (n,).
        points_base: on the body that was drawn on, shape (n, 3), m.
    """

    times_s: FloatArray
    points_base: FloatArray

    def command(self, path: str) -> Command:
        """The stroke at a node."""
        return line_command(path, self.points_base, INK_RADIUS_M, INK_RGB)


def recorded_ink(recording: Recording, robot: Baxter) -> Iterator[InkLine]:
    """The strokes of pens: below the tip, from where a pen touches a body until it leaves it."""
    times, down = recording.times_s, dict[str, Event]()
    for event in recording.events:
        if event.side is None:
            continue
        if event.kind is EventKind.PEN_DOWN:
            down[event.side] = event
        elif event.kind is EventKind.PEN_UP and event.side in down:
            begin = down.pop(event.side)
            first, end = np.searchsorted(times, [begin.time_s, event.time_s])
            rows = slice(max(first - 1, 0), end + 1)
            joints = list(robot.indices(robot.arm(event.side).joint_names))
            points = robot.arm(event.side).T_base_tips(recording.q[rows][:, joints])[:, :3, 3]
            points = on_paper(points, begin.body)
            chosen = _key_points(points, INK_SEGMENT_M, INK_TOLERANCE_M)
            if len(chosen) > 1:
                yield InkLine(times[rows][chosen], points[chosen])


def on_paper(points_base: FloatArray, body: Body | None) -> FloatArray:
    """Points of a tip, shape (n, 3), moved down to the top of the body that it draws on."""
    found = points_base.copy()
    if body is not None:
        found[:, 2] = body.extent_m((0.0, 0.0, 1.0))[1]
    return found


class TipPath:
    """The line of one tip in a live view."""

    def __init__(self, side: str) -> None:
        """Begin without a line; its pieces are nodes under `/path/<side>`."""
        self._root = f"/path/{side}"
        self._points: list[FloatArray] = []
        self._is_holding = False
        self._number = 0
        self._kept: deque[str] = deque()

    def advance(self, point_base: FloatArray, *, is_holding: bool) -> list[Command]:
        """The commands after a motion of the tip, mostly none.

        Args:
            point_base: its new position, shape (3,), m.
            is_holding: whether the hand holds something, which sets the colour.
        """
        last = self._points[-1] if self._points else np.full(3, np.inf)
        step_m = float(np.linalg.norm(point_base - last))
        if step_m > MAX_STEP_M:
            self._begin([point_base], is_holding)
            return []
        if is_holding != self._is_holding or len(self._points) >= MAX_PIECE_POINTS:
            self._begin(self._points[-1:], is_holding)
        if step_m < SEGMENT_M:
            return []
        self._points.append(point_base)
        return self._drawn()

    def _begin(self, points: list[FloatArray], is_holding: bool) -> None:
        self._points = points
        self._is_holding = is_holding
        self._number += 1

    def _drawn(self) -> list[Command]:
        path = f"{self._root}/{self._number}"
        removed = []
        if path not in self._kept:
            self._kept.append(path)
            if len(self._kept) > MAX_PIECES:
                removed.append(delete(self._kept.popleft()))
        line = line_command(path, np.array(self._points), PATH_RADIUS_M, line_rgb(self._is_holding))
        return [*removed, line]


class Ink:
    """The strokes of pens in a live view.

    Attributes:
        strokes: number of strokes so far.
    """

    def __init__(self) -> None:
        """Begin without ink; strokes are nodes under `INK_PATH`."""
        self.strokes = 0
        self._pens: dict[str, tuple[Body | None, list[FloatArray]]] = {}
        self._pieces = 0

    def touch(self, side: str, body: Body | None) -> None:
        """Begin a stroke of a hand on a body."""
        self.strokes += 1
        self._pens[side] = body, []

    def leave(self, side: str) -> None:
        """End the stroke of a hand."""
        self._pens.pop(side, None)

    def advance(self, side: str, point_base: FloatArray) -> list[Command]:
        """The commands after a motion of a tip to a position, shape (3,), m; mostly none."""
        if side not in self._pens:
            return []
        body, points = self._pens[side]
        point = on_paper(point_base[None], body)[0]
        if points and np.linalg.norm(point - points[-1]) < INK_SEGMENT_M:
            return []
        if not points or len(points) >= MAX_PIECE_POINTS:
            del points[:-1]
            self._pieces += 1
        points.append(point)
        path = f"{INK_PATH}/{self._pieces}"
        return [InkLine(np.zeros(0), np.array(points)).command(path)] if len(points) > 1 else []
