"""PickAndPlace, the task; PlanRequest, the arm, the scene and the requirements of a plan.

```
pick    open - approach - descend - close - retract
place   approach - descend - open - retract
```

The tip descends to a pose and retracts from it along lines, which are vertical by default (`Line`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin.display import millimetres_hint, phrase, position
from baxter_kin.errors import BaxterError
from baxter_kin.fields import field, frozen
from baxter_kin.frames import checked_pose
from baxter_kin.validation import FloatArray, expect_all, finite_array, positive_scalar
from planner.errors import TaskError
from planner.manipulator import Manipulator
from planner.motion.paths.straight_line import DEFAULT_TOLERANCE, LineTolerance, StraightLine
from planner.motion.upright import Upright
from planner.scene.bodies import MAX_DISTANCE_M, Attachment, Scene

PICK_LINES = ("pick: descend", "pick: close", "pick: retract")
"""Stages on the line of the pick, in order."""

PLACE_LINES = ("place: descend", "place: open", "place: retract")
"""Stages on the line of the place, in order."""

SIDEWAYS = ("pick: approach", "place: approach")
"""Stages in which the tip is free; in the other moves it follows lines."""

STAGES = ("pick: open", SIDEWAYS[0], *PICK_LINES, SIDEWAYS[1], *PLACE_LINES)
"""All stages, in order."""

MOVES = tuple(each for each in STAGES if each not in ("pick: open", "pick: close", "place: open"))
"""All stages in which the arm moves, in order."""

LINES = tuple(each for each in MOVES if each not in SIDEWAYS)
"""All stages in which the tip follows lines, in order."""

CARRYING = ("pick: retract", SIDEWAYS[1], "place: descend")
"""Stages in which the hand holds the body."""

INWARD = ("pick: descend", "place: descend")
"""Stages in which it follows them to the pick or to the place, instead of away from there."""

DEFAULT_HOVER_M = 0.15
"""Height above the place where the arm ends; the original demo's hover distance."""

DEFAULT_CLEAR_M = 0.05
"""Height above pick and place from which the arm may move sideways: a third of that."""

UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
"""Directions of vertical lines."""

TOOL = "tool"
"""The direction of a line along the axis of the hand."""

MIN_DIRECTION = 1e-6
"""Minimum length of a vector that is a direction."""

MAX_SLOPE = 1e-9
"""Maximum travel sideways of a vertical line, per metre."""


def checked_height_m(value: object, what: str, error: type[BaxterError]) -> float:
    """A height above zero, at most `MAX_DISTANCE_M`; raises `error` otherwise."""
    height_m = positive_scalar(value, what, error)
    if height_m > MAX_DISTANCE_M:
        hint = millimetres_hint(height_m)
        raise error(f"{what} must be at most {MAX_DISTANCE_M:g} m, got {height_m:g}{hint}")
    return height_m


def _checked_direction(value: Any) -> tuple[float, ...] | str:
    """A unit vector, or "tool"."""
    if isinstance(value, str):
        if value != TOOL:
            raise TaskError(f"the direction of a line is a vector or {TOOL!r}, got {value!r}")
        return value
    vector = finite_array(value, (3,), "the direction of a line", TaskError)
    size = float(np.linalg.norm(vector))
    if not MIN_DIRECTION <= size < math.inf:
        raise TaskError(
            f"the direction of a line must have a length from {MIN_DIRECTION:g} on, got {size:g}"
        )
    return tuple((vector / size).tolist())


@frozen(error=TaskError, eq=True)
class Line:
    """A straight line of the tip to a pick or place, or away from it; the hand does not turn.

    Attributes:
        direction: in which the tip moves: a vector seen from base, of any length, kept as a unit
            vector; or "tool", along the axis of the hand: forwards to a pose, backwards away from
            one.
        length_m: travel of the tip, above zero.

    Raises:
        TaskError: when the direction is neither, or the length is not a number above zero, or
            above `MAX_DISTANCE_M`.
    """

    direction: tuple[float, ...] | str = field(converter=_checked_direction)
    length_m: float = field(
        converter=partial(checked_height_m, what="length of a line", error=TaskError)
    )

    def reversed(self) -> Line:
        """The retreat that goes back along this approach, or the approach back along a retreat."""
        if isinstance(self.direction, str):
            return self
        x, y, z = self.direction
        return Line((-x, -y, -z), self.length_m)

    def turned(self, R: FloatArray) -> Line:
        """The same line, whose direction was seen from a frame of that rotation, seen from base."""
        if isinstance(self.direction, str):
            return self
        return Line(tuple((R @ np.array(self.direction)).tolist()), self.length_m)

    def start(self, T_base_goal: pin.SE3) -> pin.SE3:
        """The pose from which an approach along this line leads to another pose."""
        return self._moved(T_base_goal, -1.0, T_base_goal.rotation[:, 2])

    def goal(self, T_base_start: pin.SE3) -> pin.SE3:
        """The pose to which a retreat along this line leads from another pose."""
        return self._moved(T_base_start, 1.0, -T_base_start.rotation[:, 2])

    def _moved(self, T_base: pin.SE3, sign: float, along_tool: FloatArray) -> pin.SE3:
        is_along_tool = isinstance(self.direction, str)
        way = along_tool if is_along_tool else np.array(self.direction)
        return pin.SE3(T_base.rotation, T_base.translation + sign * self.length_m * way)

    def _facts(self) -> tuple[str, ...]:
        if isinstance(self.direction, str):
            return phrase(self.direction), f"{self.length_m:g} m"
        x, y, z = self.direction
        return f"({x:.3g}, {y:.3g}, {z:.3g})", f"{self.length_m:g} m"


Lines: TypeAlias = Line | tuple[Line, ...]
"""One line, or several in the order of motion."""


def back_along(lines: Sequence[Line]) -> tuple[Line, ...]:
    """The retreat back along the lines of an approach."""
    return tuple(line.reversed() for line in reversed(lines))


def retreat_poses(T_base_tip: pin.SE3, lines: Sequence[Line]) -> list[pin.SE3]:
    """A pose, and those at the ends of successive lines away from it."""
    poses = [T_base_tip]
    for line in lines:
        poses.append(line.goal(poses[-1]))
    return poses


def checked_lines(value: object) -> tuple[Line, ...]:
    """One line or several in the order of motion; none for None."""
    if value is None or isinstance(value, Line):
        return () if value is None else (value,)
    return expect_all(value, Line, "the lines of an approach or retreat", TaskError)


class Leg(NamedTuple):
    """One motion of a cycle.

    Attributes:
        label: of its move: its stage for the line that touches the pick or place; lines farther
            away are numbered outwards, from 2 on.
        stage: one of `MOVES`.
        T_base_goal: pose of the tip at its end.
        ends: poses of the tip at the ends of its line, the one that is nearer to the pick or place
            first; None where the tip is free.
        rests: whether the arm rests at its end.
    """

    label: str
    stage: str
    T_base_goal: pin.SE3
    ends: tuple[pin.SE3, pin.SE3] | None = None
    rests: bool = False

    @property
    def line(self) -> StraightLine | None:
        """The line of the tip, outwards; None where it is free."""
        return None if self.ends is None else StraightLine(*self.ends)

    @property
    def is_vertical(self) -> bool:
        """Whether its line leads straight up from the end nearer to the pick or place."""
        if self.ends is None:
            return False
        near, far = self.ends
        x, y, z = (far.translation - near.translation).tolist()
        return bool(z > 0.0 and math.hypot(x, y) <= MAX_SLOPE * z)


def inwards(
    stages: tuple[str, str], T_base_tip: pin.SE3, approach: Sequence[Line]
) -> Iterator[Leg]:
    """The free leg to the lines of an approach, and those along them, which end at rest."""
    (sideways, stage), poses = stages, [T_base_tip]
    for line in reversed(approach):
        poses.append(line.start(poses[-1]))
    yield Leg(sideways, sideways, poses[-1])
    for k, (near, far) in reversed(list(enumerate(pairwise(poses)))):
        yield Leg(numbered(stage, k), stage, near, (near, far), rests=True)


def outwards(
    stage: str, T_base_tip: pin.SE3, retreat: Sequence[Line], *, rests: bool
) -> Iterator[Leg]:
    """The legs away from a pose; all but the last end at rest, and that one if `rests`."""
    poses = retreat_poses(T_base_tip, retreat)
    for k, (near, far) in enumerate(pairwise(poses)):
        is_last = k + 1 == len(retreat)
        yield Leg(numbered(stage, k), stage, far, (near, far), rests or not is_last)


def numbered(stage: str, k: int) -> str:
    """The label of the line number k of a stage, counted from 0 outwards."""
    return f"{stage} {k + 1}" if k else stage


@frozen(error=TaskError)
class PickAndPlace:
    """One pick and one place.

    The tip moves to the pick and to the place, and away from them, along straight lines. By default
    they are vertical, `clear_m` long, the last one `hover_m`. `approach` and `retreat` are other
    lines of the pick, `place_approach` and `place_retreat` those of the place: one `Line`, or
    several in the order of motion, with a stop in between. A retreat that is not given leads back
    along the approach, if that is given.

    Attributes:
        body: name of the body to carry.
        T_base_pick: pose of the tip when the fingers close.
        T_base_place: pose of the tip when they open again.
        hover_m: height above the place where the arm ends, above zero.
        clear_m: height above pick and place from which the arm may move sideways, above zero; at
            most the hover distance counts.
        approach: lines to the pick; empty where it is vertical.
        retreat: lines away from the pick, with the body; empty for the default.
        place_approach: lines to the place, with the body; empty where it is vertical.
        place_retreat: lines away from the place; empty for the default.
        upright: the axis of the body that stays within a cone from grasp to release; None where it
            may lean.

    Raises:
        TaskError: when `body` is not a name, a height is not a number above zero, or above
            `MAX_DISTANCE_M`, or lines are not of type `Line`.
        PoseError: when a pose is invalid.
    """

    body: str
    T_base_pick: pin.SE3 = field(converter=checked_pose)
    T_base_place: pin.SE3 = field(converter=checked_pose)
    hover_m: float = field(
        default=DEFAULT_HOVER_M,
        converter=partial(checked_height_m, what="hover distance", error=TaskError),
    )
    clear_m: float = field(
        default=DEFAULT_CLEAR_M,
        converter=partial(checked_height_m, what="clear height", error=TaskError),
    )
    approach: Lines = field(default=(), converter=checked_lines, kw_only=True)
    retreat: Lines = field(default=(), converter=checked_lines, kw_only=True)
    place_approach: Lines = field(default=(), converter=checked_lines, kw_only=True)
    place_retreat: Lines = field(default=(), converter=checked_lines, kw_only=True)
    upright: Upright | None = field(default=None, kw_only=True)

    @property
    def legs(self) -> tuple[Leg, ...]:
        """The motions of the cycle, in order."""
        down = (Line(DOWN, min(self.clear_m, self.hover_m)),)
        hover = (Line(DOWN, self.hover_m),)
        pick, place = self.T_base_pick, self.T_base_place
        approach, retreat, place_approach, place_retreat = (
            checked_lines(each)
            for each in (self.approach, self.retreat, self.place_approach, self.place_retreat)
        )
        retreat = retreat or back_along(approach or down)
        place_retreat = place_retreat or back_along(place_approach or hover)
        return (
            *inwards(("pick: approach", "pick: descend"), pick, approach or down),
            *outwards("pick: retract", pick, retreat, rests=False),
            *inwards(("place: approach", "place: descend"), place, place_approach or down),
            *outwards("place: retract", place, place_retreat, rests=True),
        )

    @property
    def waypoints(self) -> tuple[Leg, ...]:
        """The first leg to each pose at which the tip stops or changes its direction, in order."""
        legs: dict[bytes, Leg] = {}
        for leg in self.legs:
            legs.setdefault(leg.T_base_goal.homogeneous.tobytes(), leg)
        return tuple(legs.values())

    @property
    def T_base_end(self) -> pin.SE3:
        """Pose at the end of the cycle."""
        return self.legs[-1].T_base_goal

    def _facts(self) -> tuple[str, ...]:
        way = f"from {position(self.T_base_pick)} to {position(self.T_base_place)}"
        return phrase(self.body), way, f"hover {self.hover_m:g} m"


class InAir(NamedTuple):
    """The end of a task that is in the air, where the other hand holds the body, too.

    Attributes:
        end: "pick" or "place".
        q: configuration of the arm there, or near there, shape (7,), rad; any when not given.
    """

    end: str
    q: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PlanRequest:
    """The arm, its surroundings, and the requirements of a plan; the planning functions check them.

    Attributes:
        manipulator: the arm and its hand, which is empty.
        scene: all bodies.
        q_start: initial configuration of the arm, within its limits, shape (7,), rad.
        margin_m: distance that everything keeps at all times, except for intended contacts, the
            hand from what it grasps, and links up to two joints apart.
        held: what the other hand holds.
        line_tolerance: maximum deviation of the tip from its straight lines.
        in_air: the end of the task that is in the air, if one is.
    """

    manipulator: Manipulator
    scene: Scene
    q_start: FloatArray
    margin_m: float = 0.0
    held: tuple[Attachment, ...] = ()
    line_tolerance: LineTolerance = DEFAULT_TOLERANCE
    in_air: InAir | None = None

    @property
    def gives(self) -> bool:
        """Whether the other hand holds the body when this one releases it."""
        return self.in_air is not None and self.in_air.end == "place"
