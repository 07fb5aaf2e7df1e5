"""The clearance of a recording over time: how near what moves comes to anything else.

What counts is on `nearest`, and what may touch on `stated_contacts`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.validation import FloatArray, Indices
from planner.collision.robot.robot_body import RobotBody
from planner.collision.robot.robot_shapes import RobotShapes
from planner.errors import SceneError
from sim.events import Event, EventKind
from sim.recording.recorded_motion import RecordedMove, arm_joints
from sim.recording.recording import Recording
from sim.view.meshcat_commands import Command
from sim.view.telemetry.arms import MOVING_RAD_S, arms_that_move
from sim.view.telemetry.nearest import Nearest, NearestPairs
from sim.view.telemetry.stated_contacts import Contacts, StatedContacts

SAMPLES_PER_S = 20.0
MOST_SAMPLES = 600
"""How often the clearance is measured: so many times a second, fewer in a long recording."""

NO_MOTION, NO_BODY, NO_PAIR = "motion", "body", "pair"
"""Why there is no clearance: no arm has moved; the robot lacks links of the body that is measured;
nothing counts that could be near."""

ROWS_COMPARED, LEAST_WAY_M, SAME_PLACE = 16, 0.01, 1e-4
"""A body that no event says to be held is when at so many moments it is in the same place of a
hand, m and parts of a rotation, that has moved at least so far."""


@dataclass(frozen=True, slots=True, eq=False)
class ClearanceSample:
    """The nearest two at a time of a recording, s."""

    time_s: float
    nearest: Nearest


def recorded_clearance(
    recording: Recording, robot: Baxter, body: RobotBody | None = None
) -> Command | None:
    """The clearance as the page takes it; None where nothing moves, or the robot has no body.

    Args:
        recording: what happened.
        robot: the robot it happened to.
        body: what it is taken to be; `RobotBody.load()` when not given.
    """
    samples = clearance_samples(recording, robot, body)
    if not samples:
        return None
    every = [sample.nearest for sample in samples]
    names = list(dict.fromkeys(name for near in every for name in (near.first, near.second)))
    places = {name: number for number, name in enumerate(names)}
    pairs = [[places[near.first], places[near.second]] for near in every]
    times = np.array([sample.time_s for sample in samples]) - recording.times_s[0]
    return {
        "times": times.astype(np.float32),
        "distance_m": np.array([near.distance_m for near in every], np.float32),
        "names": names,
        "pairs": np.array(pairs, np.uint16).reshape(-1),
        "points": np.array([near.points_base for near in every], np.float32).reshape(-1),
    }


def clearance_samples(
    recording: Recording, robot: Baxter, body: RobotBody | None = None
) -> list[ClearanceSample]:
    """The nearest two at some times of a recording, in order; none where nothing moves.

    Arguments as of `recorded_clearance`.
    """
    shapes = RobotShapes(robot, body)
    pairs = _pairs(recording, shapes)
    if pairs is None:
        return []
    found = []
    moving = _moving_sides(recording)
    for row, contacts in _with_contacts(recording, robot):
        near = pairs.at(recording.q[row], _poses(recording, row), contacts, moving[row])
        if near is not None:
            found.append(ClearanceSample(float(recording.times_s[row]), near))
    return found


def why_unmeasured(recording: Recording, robot: Baxter, body: RobotBody | None = None) -> str:
    """Why a recording has no clearance: `NO_MOTION`, `NO_BODY` or `NO_PAIR`.

    Arguments as of `recorded_clearance`.
    """
    if not arms_that_move(recording):
        return NO_MOTION
    return NO_BODY if _pairs(recording, RobotShapes(robot, body)) is None else NO_PAIR


def _pairs(recording: Recording, shapes: RobotShapes) -> NearestPairs | None:
    """What is to be measured; None where nothing moves, or the robot lacks links of the body."""
    sides = arms_that_move(recording)
    try:
        return NearestPairs(shapes, sides, recording.bodies) if sides else None
    except SceneError:
        return None


def sampled_rows(times_s: FloatArray) -> Indices:
    """The snapshots at which the clearance is measured, the first and the last among them.

    Args:
        times_s: of all snapshots, shape (n,), increasing.
    """
    wanted = int((times_s[-1] - times_s[0]) * SAMPLES_PER_S) + 2
    grid = np.linspace(times_s[0], times_s[-1], min(wanted, MOST_SAMPLES))
    after = np.clip(np.searchsorted(times_s, grid), 1, max(len(times_s) - 1, 1))
    is_before = grid - times_s[after - 1] < times_s[np.minimum(after, len(times_s) - 1)] - grid
    rows: Indices = np.unique(np.minimum(after - is_before, len(times_s) - 1))
    return rows


def _poses(recording: Recording, row: int) -> dict[str, FloatArray]:
    """Where the bodies are that are there at a snapshot, by name, shape (4, 4)."""
    poses = {name: track[row] for name, track in recording.body_poses.items()}
    return {name: _matrix(pose) for name, pose in poses.items() if np.isfinite(pose).all()}


def _matrix(pose: FloatArray) -> FloatArray:
    quaternion = pin.Quaternion(pose[3:]).normalized()
    matrix: FloatArray = pin.SE3(quaternion, pose[:3]).homogeneous
    return matrix


def _with_contacts(recording: Recording, robot: Baxter) -> Iterator[tuple[int, Contacts]]:
    """Every sampled row, with what is held and may touch by then."""
    contacts = StatedContacts()
    for side, name in _held_from_the_start(recording, robot):
        contacts.hold(side, name)
    story = deque(_story(recording))
    for row in sampled_rows(recording.times_s).tolist():
        while story and story[0][0] <= recording.times_s[row]:
            what = story.popleft()[1]
            if isinstance(what, RecordedMove):
                contacts.on_move(what)
            else:
                contacts.on_event(what)
        yield row, contacts.now


def _moving_sides(recording: Recording) -> dict[int, tuple[str, ...]]:
    """By sampled row the arms that move then, or else those that moved last; empty before."""
    index = {name: number for number, name in enumerate(recording.joint_names)}
    rows = sampled_rows(recording.times_s)
    before, after = rows[np.maximum(np.arange(len(rows)) - 1, 0)], np.append(rows[1:], rows[-1])
    spans_s = recording.times_s[after] - recording.times_s[before]
    joints = {s: [index[n] for n in arm_joints(s)] for s in arms_that_move(recording)}
    ways = {s: np.abs(recording.q[after] - recording.q[before])[:, of] for s, of in joints.items()}
    found: dict[int, tuple[str, ...]] = {}
    moving: tuple[str, ...] = ()
    for number, row in enumerate(rows.tolist()):
        least = MOVING_RAD_S * spans_s[number]
        moving = tuple(s for s, way in ways.items() if way[number].max() > least) or moving
        found[row] = moving
    return found


def _story(recording: Recording) -> list[tuple[float, Event | RecordedMove]]:
    """Moves and events by time; what is grasped or let go at the start of a move, before it."""
    told: list[tuple[float, Event | RecordedMove]] = [(e.time_s, e) for e in recording.events]
    told += [(move.start_s, move) for move in recording.moves]
    return sorted(told, key=lambda item: item[0])


def _held_from_the_start(recording: Recording, robot: Baxter) -> Iterator[tuple[str, str]]:
    """Side and body where a hand holds something before any event says so.

    Either the first thing that it does is to let go, or a body keeps its place in the hand while
    that moves, as far as the first event of the hand.
    """
    seen: dict[str, Event] = {}
    for event in sorted(recording.events, key=lambda event: event.time_s):
        if event.kind in (EventKind.GRASPED, EventKind.RELEASED) and event.side is not None:
            seen.setdefault(event.side, event)
    for side in recording.limbs:
        first = seen.get(side)
        if first is not None and first.kind is EventKind.RELEASED and first.body is not None:
            yield side, first.body.name
        elif first is None:
            yield from ((side, name) for name in _carried(recording, robot, side))


def _carried(recording: Recording, robot: Baxter, side: str) -> Iterator[str]:
    """Movable bodies that keep their place in a hand wherever it goes, from first to last."""
    index = np.array([recording.joint_names.index(name) for name in robot.arm(side).joint_names])
    rows = np.unique(np.linspace(0, len(recording.q) - 1, ROWS_COMPARED).astype(int))
    T_base_tips = robot.arm(side).T_base_tips(recording.q[rows][:, index])
    if np.ptp(T_base_tips[:, :3, 3], axis=0).max() < LEAST_WAY_M:
        return
    for name, poses in recording.body_poses.items():
        if recording.bodies[name].is_movable and np.isfinite(poses[rows]).all():
            T_base_bodies = np.array([_matrix(pose) for pose in poses[rows]])
            T_tip_bodies = np.linalg.inv(T_base_tips) @ T_base_bodies
            if np.ptp(T_tip_bodies, axis=0).max() < SAME_PLACE:
                yield name
