"""Paths of a tip: polylines, arcs and curves, as pieces one after the other."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice, pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin.display import count, millimetres, millimetres_hint
from baxter_kin.fields import array, field, frozen, scalar
from baxter_kin.frames import PoseLike, angle_between, checked_pose
from baxter_kin.validation import FloatArray
from planner.errors import MotionError, StraightMoveError
from planner.motion.paths.pieces import MIN_LENGTH, Piece
from planner.motion.paths.straight_line import StraightLine
from planner.scene.bodies import MAX_DISTANCE_M

MAX_PIECE_M, MAX_PIECE_RAD, MAX_ARC_RAD = 0.15, 0.5, math.pi / 4.0
"""Maximum length and rotation of a piece, and angle of an arc in one: a cubic is off an arc of 45
deg by 4.3e-6 of its radius."""

CURVE_ACCURACY_M, CURVE_ACCURACY_RAD, MAX_HALVINGS = 2e-6, 2e-5, 10
"""Accuracy of the pieces of a curve, and how often a piece of it is halved for it."""

CURVE_SAMPLES = tuple((np.arange(1, 24) * 0.6180339887498949 % 1.0).tolist())
"""Fractions of a piece at which it is compared with its curve: multiples of the golden ratio, which
no period of a curve fits."""

MAX_PIECES, MAX_ANGLE_RAD = 2000, 1000.0
"""Maximum number of pieces of a part of a path, and maximum angle of an arc."""

MAX_GAP_M, MAX_GAP_RAD = 1e-6, 1e-6
"""Maximum distance between the end of a part of a path and the start of the next."""

MAX_RAMP = 0.25
"""Maximum share of a piece in which the tip takes up its speed."""

CORNER_RAD = 1e-3
"""Minimum change of the direction of a path that is a corner."""


def _poses(values: Iterable[PoseLike]) -> tuple[pin.SE3, ...]:
    if not isinstance(values, Iterable):
        raise MotionError(f"a polyline needs a sequence of poses, got {type(values).__name__}")
    poses = tuple(map(checked_pose, values))
    if len(poses) < 2:
        raise MotionError(f"a polyline needs at least two poses, got {len(poses)}")
    return poses


@frozen(error=MotionError)
class Polyline:
    """Straight lines from each pose to the next; the orientation turns the shortest way.

    Attributes:
        poses: of the tip in base, at least two; each turned by less than half a turn.

    Raises:
        PoseError: when a pose is invalid.
        MotionError: when there are fewer than two.
    """

    poses: tuple[pin.SE3, ...] = field(converter=_poses)

    if TYPE_CHECKING:  # the converter takes more than the field holds

        def __init__(self, poses: Iterable[PoseLike]) -> None: ...

    def pieces(self) -> Iterator[Piece]:
        """Its lines, cut where they are long."""
        for number, (start, goal) in enumerate(pairwise(self.poses), 1):
            try:
                line = StraightLine(start, goal)
            except StraightMoveError as cause:
                raise MotionError(f"pose {number} of the polyline: {cause.reason}") from cause
            if not line.is_point:
                yield from line.parts(_parts(line))

    def _facts(self) -> tuple[str, ...]:
        return (count(len(self.poses), "pose"),)


@frozen(error=MotionError)
class Arc:
    """A part of a circle, or several turns.

    Attributes:
        T_base_start: pose at its start.
        centre: a point of the axis in base, shape (3,), m.
        normal: direction of the axis in base, of any length, shape (3,).
        angle_rad: angle about that axis by the right-hand rule, not zero, up to 1000.
        turns_hand: whether the orientation turns with the arc, instead of staying the same.

    Raises:
        PoseError: when the pose is invalid.
        MotionError: when a value is not finite, the normal or the angle is zero, or the start is on
            the axis or farther from it than `MAX_DISTANCE_M`.
    """

    T_base_start: pin.SE3 = field(converter=checked_pose)
    centre: FloatArray = array(3)
    normal: FloatArray = array(3)
    angle_rad: float = scalar()
    turns_hand: bool = False

    def __attrs_post_init__(self) -> None:
        if not self.normal.any() or not 0.0 < abs(self.angle_rad) <= MAX_ANGLE_RAD:
            raise MotionError(
                "an arc needs a normal other than zero, and an angle other than zero and up to "
                f"{MAX_ANGLE_RAD:g} rad; got {self.angle_rad:g}"
            )
        if not MIN_LENGTH < self.radius_m <= MAX_DISTANCE_M:
            raise MotionError(
                f"an arc starts beside its axis, up to {MAX_DISTANCE_M:g} m from it; got "
                f"{self.radius_m:g} m{millimetres_hint(self.radius_m)}"
            )

    @property
    def radius_m(self) -> float:
        """Radius of the circle."""
        return float(np.linalg.norm(self._spoke))

    @property
    def _axis(self) -> FloatArray:
        axis: FloatArray = self.normal / np.abs(self.normal).max()
        return axis / np.linalg.norm(axis)

    @property
    def _spoke(self) -> FloatArray:
        """From the axis to the start, perpendicular to the axis."""
        spoke = self.T_base_start.translation - self.centre
        across: FloatArray = spoke - (spoke @ self._axis) * self._axis
        return across

    def pieces(self) -> Iterator[Piece]:
        """Its parts, of at most 45 deg each."""
        axis, middle = self._axis, self.T_base_start.translation - self._spoke
        longest_rad = min(MAX_ARC_RAD, MAX_PIECE_M / self.radius_m)
        if self.turns_hand:
            longest_rad = min(longest_rad, MAX_PIECE_RAD)
        parts = math.ceil(abs(self.angle_rad) / longest_rad - 1e-9)
        step = self.angle_rad / parts
        tangent = 4.0 * math.tan(step / 4.0)  # of the cubic nearest to the arc

        def at(k: int) -> tuple[pin.SE3, FloatArray]:
            R, T = pin.exp3(k * step * axis), self.T_base_start
            spoke = R @ self._spoke
            turned = R @ T.rotation if self.turns_hand else T.rotation
            return pin.SE3(turned, middle + spoke), tangent * np.cross(axis, spoke)

        for k in range(parts):
            (start, first), (goal, last) = at(k), at(k + 1)
            yield Piece.between(start, goal, np.array([first, last]))

    def _facts(self) -> tuple[str, ...]:
        return f"radius {millimetres(self.radius_m)}", f"{math.degrees(self.angle_rad):g} deg"


@frozen(error=MotionError)
class Curve:
    """A smooth curve, given by a function.

    Attributes:
        pose_at: pose of the tip at a length along the curve, 0 to `length_m`; position and
            orientation change smoothly. Details of less than about 10 mm may be missed.
        length_m: of the whole curve, up to `MAX_DISTANCE_M`.

    Raises:
        MotionError: when the length is not in its range.
    """

    pose_at: Callable[[float], Any]
    length_m: float = scalar(above=0.0, most=MAX_DISTANCE_M)

    def pieces(self) -> Iterator[Piece]:
        """Cubics, as many as its accuracy needs.

        Raises:
            MotionError: when the curve is not smooth.
        """
        parts = math.ceil(self.length_m / MAX_PIECE_M)
        ends = np.linspace(0.0, self.length_m, parts + 1).tolist()
        for begin, end in pairwise(ends):
            yield from self._between(begin, end, MAX_HALVINGS)

    def _between(self, begin: float, end: float, halvings: int) -> Iterator[Piece]:
        length = end - begin
        slopes = np.array([self._slope(begin), self._slope(end)]) * length
        piece = Piece.between(self._at(begin), self._at(end), slopes)
        off = [piece.error(s, self._at(begin + s * length)) for s in CURVE_SAMPLES]
        is_near = all(
            np.linalg.norm(each[:3]) <= CURVE_ACCURACY_M
            and np.linalg.norm(each[3:]) <= CURVE_ACCURACY_RAD
            for each in off
        )
        if is_near and piece.angle_rad <= MAX_PIECE_RAD:
            yield piece
            return
        if not halvings:
            raise MotionError(
                f"the curve is not smooth near {begin:g} m: give its corners as a polyline, or as "
                "curves one after the other"
            )
        middle = (begin + end) / 2.0
        yield from self._between(begin, middle, halvings - 1)
        yield from self._between(middle, end, halvings - 1)

    def _at(self, length_m: float) -> pin.SE3:
        return checked_pose(self.pose_at(length_m))

    def _slope(self, length_m: float) -> FloatArray:
        """Derivative of the position, by differences of fourth order inside the curve."""
        h = 1e-3 * self.length_m
        at = min(max(length_m, 2.0 * h), self.length_m - 2.0 * h)
        p = np.array([self._at(at + k * h).translation for k in range(-2, 3)])
        u = (length_m - at) / h  # the derivative at u of the polynomial through five points
        powers = np.vander(np.arange(-2.0, 3.0), increasing=True)
        slope: FloatArray = (np.arange(1.0, 5.0) * u ** np.arange(4)) @ (
            np.linalg.solve(powers, p)[1:]
        )
        return slope / h

    def _facts(self) -> tuple[str, ...]:
        return (millimetres(self.length_m),)


TipPath: TypeAlias = Polyline | Arc | Curve
"""A part of a path."""


def pieces_of(path: TipPath | Sequence[TipPath]) -> tuple[Piece, ...]:
    """The pieces of a path, or of several that follow one another.

    Raises:
        MotionError: when a part has the wrong type, is a point, or starts elsewhere than the
            previous one ends.
    """
    kinds = Polyline, Arc, Curve
    parts = [path] if isinstance(path, kinds) else path
    pieces: list[Piece] = []
    for number, part in enumerate(parts if isinstance(parts, Sequence) else [None]):
        if not isinstance(part, kinds):
            raise MotionError(
                "a path is a Polyline, an Arc, a Curve or a sequence of them; got "
                f"{type(path if part is None else part).__name__}"
            )
        of_part = tuple(islice(part.pieces(), MAX_PIECES + 1))
        if not 1 <= len(of_part) <= MAX_PIECES:
            size = "has no length" if not of_part else f"needs more than {MAX_PIECES} pieces"
            raise MotionError(f"part {number} of the path {size}")
        if pieces:
            _refuse_gap(pieces[-1].T_base_goal, of_part[0].T_base_start, number)
        pieces += of_part
    if not pieces:
        raise MotionError("the path has no parts")
    return tuple(pieces)


def graded(pieces: Sequence[Piece], ramp_m: float) -> tuple[Piece, ...]:
    """The same path, with short pieces at corners and at its ends, where the speed changes.

    Args:
        pieces: of the path.
        ramp_m: length of the short pieces; pieces that are not much longer stay whole.
    """
    corners = corners_of(pieces)
    found: list[Piece] = []
    for piece, begins, ends in zip(pieces, corners[:-1], corners[1:], strict=True):
        share = ramp_m / max(piece.length_m, MIN_LENGTH)
        if share > MAX_RAMP:
            found.append(piece)
            continue
        at = [0.0, *([share] if begins else []), *([1.0 - share] if ends else []), 1.0]
        found += [piece.part(*part) for part in pairwise(at)]
    return tuple(found)


def corners_of(pieces: Sequence[Piece]) -> list[bool]:
    """Whether the direction of the tip changes at the start of each piece, and at the end of all.

    The ends of the path are corners, since the tip rests there.
    """
    return [True, *(_is_corner(*pair) for pair in pairwise(pieces)), True]


def _is_corner(before: Piece, after: Piece) -> bool:
    first, last = (each.slope_at(s) for each, s in ((before, 1.0), (after, 0.0)))
    lengths = np.linalg.norm(first), np.linalg.norm(last)
    if min(lengths) < MIN_LENGTH:
        return True
    return float(np.linalg.norm(first / lengths[0] - last / lengths[1])) > CORNER_RAD


def _parts(line: StraightLine) -> int:
    return max(1, math.ceil(max(line.length_m / MAX_PIECE_M, line.angle_rad / MAX_PIECE_RAD)))


def _refuse_gap(end: pin.SE3, start: pin.SE3, number: int) -> None:
    gap_m = float(np.linalg.norm(end.translation - start.translation))
    gap_rad = angle_between(end.rotation, start.rotation)
    if gap_m > MAX_GAP_M or gap_rad > MAX_GAP_RAD:
        raise MotionError(
            f"part {number} of the path starts {1e3 * gap_m:.4g} mm and {gap_rad:.4g} rad from the "
            "end of the previous one; let each start where the one before ends"
        )
