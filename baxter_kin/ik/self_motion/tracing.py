"""The self-motion of a pose: the curve of configurations that keep the tip at the pose.

The configurations of seven joints that reach a pose of six coordinates form a curve: the elbow of
the arm swings while the hand stands still (Burdick, "On the inverse kinematics of redundant
manipulators: characterization of the self-motion manifolds", ICRA 1989). Joint limits cut it into
connected pieces. `trace_self_motion` follows the piece through one configuration to both its ends,
by the method of `baxter_kin.ik.self_motion.continuation`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.display import count
from baxter_kin.errors import ConfigurationError, RequestError
from baxter_kin.fields import array, field, frozen
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.ik.self_motion.continuation import CurveEnd, EndKind, filled, walk_both_ways
from baxter_kin.ik.self_motion.curve_cubics import Segment, arc_lengths
from baxter_kin.ik.self_motion.solution_curve import CurvePoint, CurvePoints, SolutionCurve
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import (
    FloatArray,
    expect,
    finite_array,
    finite_scalar,
    positive_scalar,
)

STEP_RAD = 0.02
"""Default longest step along a curve: a few hundred points for a whole curve."""

ALLOWED_STEPS_RAD = 0.001, 0.2
"""Range of the longest step: shorter ones give curves of ten thousands of points; with longer ones
the corrector may converge to another branch."""

_OUTSIDE_RAD = 1e-9
"""Distance beyond the ends of a curve that is attributed to rounding."""

_NEAREST_ITERATIONS = 20


def _copied(given: Any) -> Any:
    return pin.SE3(given) if isinstance(given, pin.SE3) else given


@frozen(error=ConfigurationError)
class SelfMotion:
    """One connected piece of the self-motion of a pose, as n points.

    Its direction is the one in which `det [J; tangent']` is positive, independent of the start of
    the tracing. A closed curve begins and ends at the configuration from which it was traced.

    Attributes:
        arm: the arm.
        T_base_tip: the pose, seen from base.
        q: configurations along the curve, shape (n, 7), rad, inside the limits.
        s: length of the curve in joint space up to each of them, shape (n,), rad, from 0.
        tangent: unit direction dq/ds at each, shape (n, 7); zeros for a curve of one point.
        manipulability: sqrt(det(J J')) at each, shape (n,), of J in m and rad (Yoshikawa,
            "Manipulability of robotic mechanisms", 1985).
        limit_distance_rad: distance of the joint nearest to a limit from that limit, (n,), rad.
        pose_residual: the largest norm of the pose error at any of them, m and rad together.
        s_start: length along the curve at which the tracing began, rad.
        ends: why the curve ends, at its first and at its last point.
    """

    arm: Arm
    T_base_tip: pin.SE3 = field(converter=_copied)
    q: FloatArray = array(None, 7)
    s: FloatArray = array(None)
    tangent: FloatArray = array(None, 7)
    manipulability: FloatArray = array(None)
    limit_distance_rad: FloatArray = array(None)
    pose_residual: float
    s_start: float
    ends: tuple[CurveEnd, CurveEnd]

    def __attrs_post_init__(self) -> None:
        arrays = self.q, self.s, self.tangent, self.manipulability, self.limit_distance_rad
        lengths = {len(each) for each in arrays}
        if len(lengths) > 1 or lengths == {0}:
            raise ConfigurationError(
                "the arrays of a curve must have one point or more, and as many each; got "
                f"{', '.join(map(str, sorted(lengths)))}"
            )

    @property
    def is_closed(self) -> bool:
        """Whether the last configuration is the first one again."""
        return self.ends[1].kind is EndKind.CLOSED

    @property
    def length_rad(self) -> float:
        """The length of the whole curve in joint space."""
        return float(self.s[-1])

    def at(self, s: float) -> FloatArray:
        """The configuration at a length `s` along the curve, shape (7,), rad, inside the limits.

        It is exact: interpolated, then corrected to the pose. On a closed curve `s` is periodic.
        """
        return self.sampler()(finite_scalar(s, "s", RequestError))

    def sampler(self) -> Callable[[float], FloatArray]:
        """The function `at` for finite numbers, which is faster for many of them."""
        solution_curve, limits = SolutionCurve(self.arm, self.T_base_tip), self.arm.limits

        def at(s: float) -> FloatArray:
            s = self._on_curve(s)
            if len(self.q) == 1:
                return np.array(self.q[0])
            i, u = self._placed(s)
            return np.clip(self._segment(solution_curve, i).exact(u), limits.q_min, limits.q_max)

        return at

    def nearest(self, q: ArrayLike) -> tuple[float, float]:
        """The point of the curve nearest to `q`: its length along the curve, and its distance, rad.

        Args:
            q: shape (7,), rad; any finite values. Exact if `q` is closer than the bends of the
                curve.
        """
        q = finite_array(q, (7,), "q", ConfigurationError)
        s, at = self._nearest_on_chords(q), self.sampler()
        for _ in range(_NEAREST_ITERATIONS):
            here = at(s)
            ahead = s + float((q - here) @ self._direction(s))
            ahead = ahead if self.is_closed else min(max(ahead, 0.0), self.length_rad)
            if abs(ahead - s) < 1e-12:
                break
            s = ahead
        distance = float(np.linalg.norm(at(s) - q))
        return self._on_curve(s), distance

    def _facts(self) -> tuple[str, ...]:
        form = "closed" if self.is_closed else "open"
        return repr(self.arm), count(len(self.q), "point"), f"{self.length_rad:.3g} rad long", form

    def _on_curve(self, s: float) -> float:
        length = self.length_rad
        if self.is_closed:
            return s % length
        if not -_OUTSIDE_RAD <= s <= length + _OUTSIDE_RAD:
            raise RequestError(
                f"s = {s:.6g} rad is not on the curve, which spans 0 .. {length:.6g}"
            )
        return min(max(s, 0.0), length)

    def _nearest_on_chords(self, q: FloatArray) -> float:
        if len(self.q) == 1:
            return 0.0
        chords = np.diff(self.q, axis=0)
        shares = ((q - self.q[:-1]) * chords).sum(axis=1) / (chords * chords).sum(axis=1)
        shares = np.clip(shares, 0.0, 1.0)
        offsets = self.q[:-1] + shares[:, None] * chords - q
        i = int(np.argmin((offsets * offsets).sum(axis=1)))
        return float(self.s[i] + shares[i] * (self.s[i + 1] - self.s[i]))

    def _direction(self, s: float) -> FloatArray:
        if len(self.q) == 1:
            return np.array(self.tangent[0])
        i, u = self._placed(self._on_curve(s))
        direction: FloatArray = (1.0 - u) * self.tangent[i] + u * self.tangent[i + 1]
        return direction

    def _placed(self, s: float) -> tuple[int, float]:
        """The segment that contains `s`, and the share of it before `s`."""
        i = min(int(np.searchsorted(self.s, s, side="right")), len(self.s) - 1) - 1
        return i, float((s - self.s[i]) / (self.s[i + 1] - self.s[i]))

    def _segment(self, solution_curve: SolutionCurve, i: int) -> Segment:
        a, b = (CurvePoint(self.q[j], self.tangent[j], 0.0, 0.0, 0.0) for j in (i, i + 1))
        return Segment(solution_curve, a, b)


def trace_self_motion(
    arm: Arm,
    q: ArrayLike,
    *,
    T_base_tip: PoseLike | None = None,
    step_rad: float = STEP_RAD,
    towards: ArrayLike | None = None,
) -> SelfMotion:
    """The connected piece of a pose's self-motion that contains `q`.

    If `q` is singular, two branches cross there and the piece is not a curve. One branch is then
    followed through `q`; at any other singularity tracing stops. If no branch leaves `q`, the
    result is that single point.

    Args:
        arm: the arm.
        q: a configuration inside the limits, shape (7,), rad.
        T_base_tip: the pose, if `q` reaches it only approximately; the curve then begins next to
            `q`. By default the pose that `q` reaches.
        step_rad: longest step along the curve; steps are shorter where it turns sharply.
        towards: for a singular `q`, the direction of the branch to follow, shape (7,).

    Raises:
        ConfigurationError: when `q` has another shape, is not finite or is outside the limits, or
            when no configuration next to it reaches `T_base_tip` inside the limits.
        RequestError: when the step is outside `ALLOWED_STEPS_RAD`, `towards` is not a direction, or
            `arm` is not an `Arm`.
        PoseError: when `T_base_tip` is not a valid pose.
    """
    q = expect(arm, Arm, "arm", RequestError).limits.check(q, "q")
    step_rad = checked_step(step_rad)
    direction = None if towards is None else _checked_direction(towards)
    solution_curve = SolutionCurve(
        arm, arm.T_base_tip(q) if T_base_tip is None else checked_pose(T_base_tip)
    )
    if T_base_tip is not None:
        q = solution_curve.onto(q)
    start = solution_curve.start(q, direction)
    if start is None:
        residual = float(np.linalg.norm(solution_curve.error(q)))
        alone = CurvePoint(q, np.zeros(7), 0.0, residual, float(solution_curve.clearance_rad(q)))
        end = CurveEnd(EndKind.SINGULARITY)
        return assembled(solution_curve, CurvePoints.of([alone]), 0, (end, end), step_rad)
    return assembled(solution_curve, *walk_both_ways(solution_curve, start), step_rad)


def checked_step(step_rad: float) -> float:
    """A step along a curve, if it is allowed."""
    step = positive_scalar(step_rad, "step_rad", RequestError)
    shortest, longest = ALLOWED_STEPS_RAD
    if not shortest <= step <= longest:
        raise RequestError(f"step_rad must be in {shortest:g} .. {longest:g}, got {step:g}")
    return step


def _checked_direction(towards: ArrayLike) -> FloatArray:
    direction = finite_array(towards, (7,), "towards", RequestError)
    if not direction.any():
        raise RequestError("towards must be a direction in joint space, got zeros")
    return direction


def assembled(
    solution_curve: SolutionCurve,
    points: CurvePoints,
    start: int,
    ends: tuple[CurveEnd, CurveEnd],
    step_rad: float,
) -> SelfMotion:
    """The curve through the points of a walk, with others between them.

    Args:
        solution_curve: the solution set of the pose.
        points: as of `baxter_kin.ik.self_motion.continuation.walk`.
        start: index of the point at which the tracing began.
        ends: why the curve ends.
        step_rad: the longest step.
    """
    if len(points) == 1:
        return curve_of(solution_curve, points, 0, ends)
    points, places = filled(solution_curve, points, step_rad)
    return curve_of(solution_curve, points, int(places[start]), ends)


def curve_of(
    solution_curve: SolutionCurve, points: CurvePoints, start: int, ends: tuple[CurveEnd, CurveEnd]
) -> SelfMotion:
    """The curve of points that are close enough; arguments as of `assembled`."""
    lengths = arc_lengths(np.diff(points.q, axis=0), points.tangent[:-1], points.tangent[1:])
    s = np.concatenate([[0.0], np.cumsum(lengths)])
    return SelfMotion(
        arm=solution_curve.arm,
        T_base_tip=solution_curve.T_base_tip,
        q=points.q,
        s=s,
        tangent=points.tangent,
        manipulability=np.abs(points.determinant),
        limit_distance_rad=points.clearance_rad,
        pose_residual=float(points.residual.max()),
        s_start=float(s[start]),
        ends=ends,
    )
