"""The nearest pair of a robot and the bodies around it over time, in recordings and live views.

The planner's `ClearanceChecker` measures an arm that moves against the rest of the robot and all
bodies, and the body in its hand against everything but that hand. Contacts that a plan states with
a move are excluded, unless they press deeper than allowed, until the next move of that arm begins.
After a release, the hand may touch the released body. Where no plan states them, as at first, after
a grasp and in files of earlier versions, a hand may touch every movable body, and the body in it
every other body.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin import Arm, Baxter
from baxter_kin.kinematics.arm import LIMBS, arm_joints
from baxter_kin.validation import FloatArray, Indices
from planner import Body, Scene
from planner.clearance import Clearance
from planner.collision import ClearanceChecker
from planner.collision.robot.robot_body import RobotBody
from planner.collision.robot.robot_shapes import RobotShapes
from planner.errors import SceneError
from planner.scene.bodies import Attachment
from planner.scene.contact import PartContact
from sim.events import Event, EventKind
from sim.recording.recorded_motion import RecordedMove
from sim.recording.recording import Recording
from sim.view.meshcat_commands import Command
from sim.view.panel import moving_arms

SAMPLES_PER_S = 20.0
MAX_SAMPLES = 600
"""Measurements a second, and their maximum number, which a long recording has."""

NO_MOTION, NO_BODY, NO_PAIR = "motion", "body", "pair"
"""Why there is no clearance: no arm has moved; the robot lacks links of its collision body; there
is no pair to measure."""

MIN_SPEED_RAD_S = 0.02
"""An arm moves while one of its joints is faster than this."""

TIE_M = 1e-4
"""Pairs whose distances differ by no more than this, the last digit shown, are equally near. Among
these, a pair of the moving hand is preferred."""

MIN_CARRIED_M, SAME_PLACE, ROWS_COMPARED = 0.01, 1e-4, 16
"""A body is held, though no event says so, if it is in the same place of a hand, m and entries of a
rotation matrix, at this number of instants, and the hand has moved at least so far."""

SAME_GRASP = 1e-9
"""Maximum difference of equal poses of a body in a hand, m and entries of a rotation matrix."""


@dataclass(frozen=True, slots=True)
class HandState:
    """What a hand holds, and which contacts are intended.

    Attributes:
        held: name of the body in the hand, or None.
        touchable: name of the body that the hand may come near and touch, or None.
        supports: what the held body may touch, as of `ClearanceChecker`; None where it is unknown
            what the hand and the body may touch.
    """

    held: str | None = None
    touchable: str | None = None
    supports: frozenset[PartContact | str] | None = None


class Hands:
    """Follows both hands through moves and events, in order of time.

    Attributes:
        now: the state of each hand, by side.
    """

    def __init__(self, held: Mapping[str, str]) -> None:
        """Begin with the names of the held bodies, by side."""
        self.now = {side: HandState(held.get(side)) for side in LIMBS}

    def on_event(self, event: Event) -> None:
        """Process a grasp or a release; other events change nothing."""
        if event.side is not None and event.body is not None:
            if event.kind is EventKind.GRASPED:
                self.now[event.side] = HandState(event.body.name)
            elif event.kind is EventKind.RELEASED:
                self.now[event.side] = HandState(None, event.body.name, frozenset())

    def on_move(self, move: RecordedMove) -> None:
        """Process the beginning of a move."""
        held, hand = self.now[move.limb].held, f"{move.limb} hand"
        if move.contacts is None:
            self.now[move.limb] = HandState(held)
            return
        near = [each.body for each in move.contacts if each.other == hand]
        supports = [each.support for each in move.contacts if each.body == held]
        self.now[move.limb] = HandState(held, near[0] if near else None, frozenset(supports))


Nearest: TypeAlias = tuple[Clearance, FloatArray]
"""The nearest pair, the one that moves first, and the nearest points of both, shape (2, 3), m, in
base. Their distance is that of the pair, unless it touches."""


class _Surroundings:
    """What one arm is measured against while no body moves but the one in its hand.

    Attributes:
        checker: of the arm.
        pairs: numbers of the pairs that count.
    """

    def __init__(
        self,
        shapes: RobotShapes,
        arm: Arm,
        scene: Scene,
        hand: HandState,
        held: Sequence[Attachment],
    ) -> None:
        self.checker = ClearanceChecker(
            shapes,
            arm,
            scene,
            touchable=hand.touchable if hand.touchable in scene.bodies else None,
            held=held,
            supports=list(scene.bodies) if hand.supports is None else hand.supports,
        )
        placed = self.checker.geometry.geometryObjects
        self._names = np.array([shape.name.rpartition("/")[0] for shape in placed])
        self.pairs: Indices = np.arange(len(self.checker.pairs))
        if hand.supports is None:
            of_hand = self.pairs_of({shapes.links[i] for i in shapes.of_hand(arm)})
            of_bodies = self.pairs_of({body.name for body in scene if body.is_movable})
            self.pairs = np.setdiff1d(self.pairs, np.intersect1d(of_hand, of_bodies))

    def names_of(self, pair: int) -> list[str]:
        """The two links or bodies of a pair."""
        names: list[str] = self._names[self.checker.pairs[pair]].tolist()
        return names

    def pairs_of(self, names: Collection[str]) -> Indices:
        """The pairs that some links or bodies belong to."""
        is_of = np.isin(self._names, list(names))
        pairs: Indices = self.pairs[is_of[self.checker.pairs[self.pairs]].any(axis=1)]
        return pairs

    def result(self, pair: int, distance_m: float, moving: Collection[str]) -> Nearest:
        """The result for a pair whose distance was just measured; of names, those that move."""
        checked = self.checker.checked
        numbers = checked.pairs[pair]
        points = checked.distances.points(pair, distance_m)
        between = points[1] - points[0]
        gap_m = float(np.linalg.norm(between))
        thickness_m = checked.overshoot_m[numbers]
        if not checked.is_contact[pair]:
            thickness_m = thickness_m + checked.shape_padding_m[numbers]
        if gap_m > thickness_m.sum():
            points = points + np.outer(thickness_m * [1.0, -1.0], between / gap_m)
        if distance_m > 0.0:
            distance_m = float(np.linalg.norm(points[1] - points[0]))
        first, second = self.names_of(pair)
        if second in moving and first not in moving:
            first, second, points = second, first, points[::-1]
        return Clearance(distance_m, first, second), points


class ClearanceMeter:
    """Measures the nearest pair of a robot and some bodies; not to be shared between threads."""

    def __init__(self, shapes: RobotShapes, bodies: Mapping[str, Body]) -> None:
        """Store the shapes of the robot and the bodies.

        Args:
            shapes: the robot's; a SceneError is raised if it lacks links of its collision body.
            bodies: those that count, by name.
        """
        _ = shapes.made
        self._shapes, self._bodies = shapes, dict(bodies)
        self._known: dict[str, tuple[tuple[object, ...], list[Attachment], _Surroundings]] = {}

    def at(
        self,
        q: FloatArray,
        T_base_bodies: Mapping[str, pin.SE3],
        hands: Mapping[str, HandState],
        moving: Sequence[str],
    ) -> Nearest | None:
        """The nearest pair at one instant; None where there is none.

        The distances of an arm at rest do not change while the other arm moves; they are measured
        only while it moves itself.

        Args:
            q: a full configuration, shape (19,), rad and m.
            T_base_bodies: poses of the bodies that are present, by name; unknown ones do not count.
            hands: the state of each hand, by side.
            moving: the sides of the arms that move, at least one.
        """
        present = {name: T_base_bodies[name] for name in self._bodies if name in T_base_bodies}
        around = [self._surroundings(side, q, present, hands) for side in moving]
        found = [(each, *each.checker.nearest(q, each.pairs)) for each in around]
        best, pair, distance_m = min(found, key=lambda each: each[2])
        if np.isinf(distance_m):
            return None
        shapes, arms = self._shapes, [self._shapes.robot.arm(side) for side in moving]
        held = {hands[side].held or "" for side in moving}
        of_arms, of_hands = (
            held.union(shapes.links[i] for arm in arms for i in of(arm))
            for of in (shapes.of_arm, shapes.of_hand)
        )
        below_m = distance_m + TIE_M
        for each in around if of_hands.isdisjoint(best.names_of(pair)) else ():
            number, its_m = each.checker.nearest(q, each.pairs_of(of_hands), below_m)
            if its_m < below_m:
                best, pair, distance_m, below_m = each, number, its_m, its_m
        return best.result(pair, distance_m, of_arms)

    def _surroundings(
        self,
        side: str,
        q: FloatArray,
        T_base_bodies: Mapping[str, pin.SE3],
        hands: Mapping[str, HandState],
    ) -> _Surroundings:
        """The surroundings of an arm; made again when they have changed since the last call."""
        robot, hand = self._shapes.robot, hands[side]
        arm, name, held = robot.arm(side), hand.held, list[Attachment]()
        if name is not None and name in T_base_bodies:
            holding = [each for each in hands if hands[each].held == name]
            for each in (robot.arm(other) for other in sorted(holding, key=lambda s: s != side)):
                T_tip_base = each.T_base_tip(q[list(robot.indices(each.joint_names))]).inverse()
                held.append(Attachment(name, each.tip_frame, T_tip_base * T_base_bodies[name]))
        poses = {n: T.homogeneous.tobytes() for n, T in T_base_bodies.items() if n != name}
        key = (hand, *poses.items())
        known = self._known.get(side)
        if known is None or known[0] != key or not _are_same_grasps(known[1], held):
            scene = Scene.of(self._bodies[each].at(T) for each, T in T_base_bodies.items())
            around = _Surroundings(self._shapes, arm, scene, hand, held)
            known = self._known[side] = key, held, around
        return known[2]


def _are_same_grasps(some: Sequence[Attachment], others: Sequence[Attachment]) -> bool:
    return len(some) == len(others) and all(
        one.side == other.side and one.T_link_body.isApprox(other.T_link_body, SAME_GRASP)
        for one, other in zip(some, others, strict=True)
    )


def recorded_clearance(
    recording: Recording, robot: Baxter, body: RobotBody | None = None
) -> tuple[Command | None, str]:
    """The clearance over time as the page reads it, or None and the reason why there is none.

    Args:
        recording: what happened.
        robot: the robot it happened to.
        body: its collision body; `RobotBody.load()` when not given.
    """
    if not moving_arms(recording):
        return None, NO_MOTION
    try:
        meter = ClearanceMeter(RobotShapes(robot, body), recording.bodies)
    except SceneError:
        return None, NO_BODY
    samples = list(_samples(recording, robot, meter))
    if not samples:
        return None, NO_PAIR
    times = np.array([time_s for time_s, _ in samples]) - recording.times_s[0]
    every = [near for _, (near, _) in samples]
    names = list(dict.fromkeys(name for near in every for name in (near.first, near.second)))
    index = {name: number for number, name in enumerate(names)}
    pairs = [(index[near.first], index[near.second]) for near in every]
    content = {
        "times": times.astype(np.float32),
        "distance_m": np.array([near.distance_m for near in every], np.float32),
        "names": names,
        "pairs": np.array(pairs, np.uint16).reshape(-1),
        "points": np.array([points for _, (_, points) in samples], np.float32).reshape(-1),
    }
    return content, ""


def _samples(
    recording: Recording, robot: Baxter, meter: ClearanceMeter
) -> Iterator[tuple[float, Nearest]]:
    rows = sampled_rows(recording.times_s)
    hands = _hands_at(recording, robot, recording.times_s[rows])
    for row, moving, now in zip(rows.tolist(), _moving_at(recording, rows), hands, strict=True):
        near = meter.at(recording.q[row], _poses(recording, row), now, moving)
        if near is not None:
            yield float(recording.times_s[row]), near


def sampled_rows(times_s: FloatArray) -> Indices:
    """The snapshots at which the clearance is measured, including the first and the last.

    Args:
        times_s: of all snapshots, shape (n,), increasing.
    """
    wanted = int((times_s[-1] - times_s[0]) * SAMPLES_PER_S) + 2
    grid = np.linspace(times_s[0], times_s[-1], min(wanted, MAX_SAMPLES))
    after = np.clip(np.searchsorted(times_s, grid), 1, max(len(times_s) - 1, 1))
    is_before = grid - times_s[after - 1] < times_s[np.minimum(after, len(times_s) - 1)] - grid
    rows: Indices = np.unique(np.minimum(after - is_before, len(times_s) - 1))
    return rows


def _poses(recording: Recording, row: int) -> dict[str, pin.SE3]:
    """The poses of the bodies that are present at a snapshot, by name."""
    tracks = {name: track[row] for name, track in recording.body_poses.items()}
    return {name: _pose(pose) for name, pose in tracks.items() if np.isfinite(pose).all()}


def _pose(pose: FloatArray) -> pin.SE3:
    return pin.SE3(pin.Quaternion(pose[3:]).normalized(), pose[:3])


def _moving_at(recording: Recording, rows: Indices) -> Iterator[tuple[str, ...]]:
    """The sides of the arms that move at each row, or that moved last; all movers at first."""
    index = {name: number for number, name in enumerate(recording.joint_names)}
    sides = moving_arms(recording)
    before, after = np.append(rows[:1], rows[:-1]), np.append(rows[1:], rows[-1:])
    ways = np.abs(recording.q[after] - recording.q[before])
    longest = [ways[:, [index[name] for name in arm_joints(s)]].max(axis=1) for s in sides]
    spans_s = recording.times_s[after] - recording.times_s[before]
    moving = sides
    for is_fast in (np.array(longest) > MIN_SPEED_RAD_S * spans_s).T:
        moving = tuple(s for s, fast in zip(sides, is_fast, strict=True) if fast) or moving
        yield moving


def _hands_at(
    recording: Recording, robot: Baxter, times_s: FloatArray
) -> Iterator[dict[str, HandState]]:
    """The states of the hands at increasing times; events come before a move of the same time."""
    hands = Hands(_held_from_the_start(recording, robot))
    steps = [(event.time_s, partial(hands.on_event, event)) for event in recording.events]
    steps += [(move.start_s, partial(hands.on_move, move)) for move in recording.moves]
    following = deque(sorted(steps, key=lambda item: item[0]))
    for time_s in times_s:
        while following and following[0][0] <= time_s:
            following.popleft()[1]()
        yield dict(hands.now)


def _held_from_the_start(recording: Recording, robot: Baxter) -> dict[str, str]:
    """The bodies that hands hold before any event says so, by side.

    Where a recording does not state it, either the first thing that the hand does is to release the
    body, or it does nothing, and the body keeps its place in it while it moves.
    """
    if recording.start is not None:
        return {each.side: each.body for each in recording.start.attachments}
    first: dict[str, Event] = {}
    for event in sorted(recording.events, key=lambda event: event.time_s):
        if event.kind in (EventKind.GRASPED, EventKind.RELEASED) and event.side is not None:
            first.setdefault(event.side, event)
    held: dict[str, str] = {}
    for side in recording.limbs:
        if side not in first:
            held.update((side, name) for name in _carried(recording, robot, side))
        elif first[side].kind is EventKind.RELEASED and (body := first[side].body) is not None:
            held[side] = body.name
    return held


def _carried(recording: Recording, robot: Baxter, side: str) -> Iterator[str]:
    """Movable bodies that keep their place in a hand from the first snapshot to the last."""
    joints = [recording.joint_names.index(name) for name in robot.arm(side).joint_names]
    rows = np.unique(np.linspace(0, len(recording.q) - 1, ROWS_COMPARED).astype(int))
    T_base_tips = robot.arm(side).T_base_tips(recording.q[rows][:, joints])
    if np.ptp(T_base_tips[:, :3, 3], axis=0).max() < MIN_CARRIED_M:
        return
    for name, poses in recording.body_poses.items():
        if recording.bodies[name].is_movable and np.isfinite(poses[rows]).all():
            T_base_bodies = np.array([_pose(pose).homogeneous for pose in poses[rows]])
            T_tip_bodies = np.linalg.solve(T_base_tips, T_base_bodies)
            if np.ptp(T_tip_bodies, axis=0).max() < SAME_PLACE:
                yield name
