"""StraightPath: the configurations that take the tip along a straight line, as a smooth function.

Configurations at Chebyshev points, where the tip is on the line but for rounding, are interpolated
by one polynomial for each joint. Its derivatives are exact, and it is checked against the line
between the points (Trefethen, "Approximation Theory and Approximation Practice", 2013).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from baxter_kin import Arm, ConfigurationError, JointLimits
from baxter_kin.arrays import Vector, finite_scalar, float_array
from baxter_kin.copying import Frozen
from baxter_kin.display import OneLine, millimetres
from baxter_kin.errors import expect, millimetres_hint, quoted
from baxter_kin.frames import PoseLike
from baxter_kin.ik.reach import ReachBound
from planner.errors import MotionError, StraightMoveError
from planner.line_following import LineFollower, limit_reached
from planner.straight_line import StraightLine
from planner.timing import POSITION_TOLERANCE_RAD
from planner.trajectory import JointState

DEGREES = (4, 16, 32, 64, 128)
"""Degrees of polynomials that are tried in turn: 4 does for millimetres, 16 for most descents.

No higher one is taken than needed, for high ones multiply rounding in the derivatives."""

TAIL_RAD = 1e-9
"""Greatest last coefficient of a polynomial that counts as resolved."""

LINE_TOLERANCE = 1e-8
"""How far the tip may be off the line between the points, in m and rad together."""

_POINTS_PER_DEGREE = 8
_OUTSIDE = 1e-9
"""How far outside 0..1 a fraction may lie, by rounding."""


class PathPoint(NamedTuple):
    """Configuration and derivatives by s, each of shape (7,) or (m, 7); rad."""

    q: Vector
    dq: Vector
    ddq: Vector
    dddq: Vector


@dataclass(frozen=True, slots=True, repr=False)
class PathState(OneLine):
    """Where on a path, how fast and how hard; times `length_m` it is the tip's motion.

    Attributes:
        s: fraction of the way, 0..1.
        speed_per_s: ds/dt, not negative.
        acceleration_per_s2: of s.

    Raises:
        MotionError: when a number is none, or outside its range.
    """

    s: float
    speed_per_s: float = 0.0
    acceleration_per_s2: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("s", "speed_per_s", "acceleration_per_s2"):
            number = finite_scalar(getattr(self, name), f"{name} of a path state", MotionError)
            object.__setattr__(self, name, number)
        if not 0.0 <= self.s <= 1.0:
            raise MotionError(f"s is a fraction of the path, in 0..1, got {self.s:g}")
        if self.speed_per_s < 0.0:
            raise MotionError(
                f"speed_per_s must not be negative, got {self.speed_per_s:g}; to go back, reverse "
                "the path"
            )

    @property
    def is_at_rest(self) -> bool:
        """Whether nothing moves."""
        return self.speed_per_s == 0.0 and self.acceleration_per_s2 == 0.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class StraightPath(Frozen, OneLine):
    """The configurations q(s) along a straight line, for s from 0 to 1, the fraction of the way.

    Made by `plan_straight_path`. Going back the same line leads through the same configurations.

    Attributes:
        arm: whose tip moves.
        line: where it goes.
        coefficients: of Chebyshev polynomials in 2 s - 1, shape (degree + 1, 7), rad.

    Raises:
        ConfigurationError: when `coefficients` are not finite or of another shape.
    """

    arm: Arm
    line: StraightLine
    coefficients: Vector
    _derivatives: Vector = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Differentiate."""
        expect(self.arm, Arm, "arm", MotionError)
        expect(self.line, StraightLine, "line", MotionError)
        coefficients = float_array(self.coefficients, "coefficients", ConfigurationError)
        if coefficients.ndim != 2 or coefficients.shape[1] != 7 or len(coefficients) < 1:
            raise ConfigurationError(
                f"coefficients have shape {coefficients.shape}; it must be (degree + 1, 7)"
            )
        if not np.isfinite(coefficients).all():
            raise ConfigurationError("coefficients must be finite numbers")
        coefficients.setflags(write=False)
        object.__setattr__(self, "coefficients", coefficients)
        derivatives = _differentiated(coefficients)
        derivatives.setflags(write=False)
        object.__setattr__(self, "_derivatives", derivatives)

    @property
    def length_m(self) -> float:
        """How far the tip travels."""
        return self.line.length_m

    def at(self, s: ArrayLike) -> PathPoint:
        """Configuration and its first three derivatives by s.

        Args:
            s: one fraction of the way, or shape (m,), in 0..1.

        Raises:
            MotionError: when a fraction is no number, or outside 0..1.
        """
        fractions = float_array(s, "fractions of the path", MotionError)
        if fractions.ndim > 1:
            raise MotionError(f"fractions have shape {fractions.shape}; give one or shape (m,)")
        if not (np.abs(fractions - 0.5) <= 0.5 + _OUTSIDE).all():
            raise MotionError(
                f"fractions of the path are in 0..1, got {quoted(fractions.tolist())}"
            )
        # T_k(cos x) = cos(k x)
        angles = np.arccos(np.clip(2.0 * fractions - 1.0, -1.0, 1.0))
        values = np.cos(angles[..., None] * np.arange(len(self.coefficients)))
        rows = (values @ self._derivatives).reshape(*fractions.shape, 4, 7)
        return PathPoint(*(rows[..., i, :] for i in range(4)))

    def joint_state(self, state: PathState) -> JointState:
        """What the joints do when the tip passes s in that motion: arrays of shape (7,).

        `v = q' ds/dt` and `a = q'' (ds/dt)^2 + q' d2s/dt2`. A joint move that ends in this state
        and a motion along the path that starts there join without a jump.
        """
        expect(state, PathState, "state", MotionError)
        point, speed = self.at(state.s), state.speed_per_s
        a = point.ddq * speed * speed + point.dq * state.acceleration_per_s2
        return JointState(point.q, point.dq * speed, a)

    def reversed(self) -> StraightPath:
        """The way back."""
        line = StraightLine(self.line.T_base_goal, self.line.T_base_start)
        signs = (-1.0) ** np.arange(len(self.coefficients))
        return replace(self, line=line, coefficients=signs[:, None] * self.coefficients)

    def _facts(self) -> tuple[str, ...]:
        return repr(self.arm), millimetres(self.length_m), f"degree {len(self.coefficients) - 1}"


def plan_straight_path(
    arm: Arm, q_start: ArrayLike, T_base_goal: PoseLike, limits: JointLimits
) -> StraightPath:
    """The way of the joints from `q_start` along a straight line of the tip, no branch jumped.

    Args:
        arm: whose tip moves.
        q_start: where it begins, shape (7,), rad, inside the limits.
        T_base_goal: where the tip ends, seen from base; less than half a turn away.
        limits: of the arm's joints; only positions matter.

    Raises:
        ConfigurationError: when `q_start` has another shape, is not finite or outside the limits.
        PoseError: when `T_base_goal` is no pose.
        MotionError: when `limits` are of other joints.
        StraightMoveError: when the line leaves the arm's reach, crosses a singularity or leads a
            joint to a limit, or turns by half a turn.
    """
    _check_limits(expect(arm, Arm, "arm", MotionError), limits)
    q = limits.check(q_start, "q_start")
    line = StraightLine(arm.T_base_tip(q), T_base_goal)
    if line.is_point:
        return StraightPath(arm, line, q[None])
    follower = LineFollower(arm, line)
    for degree in DEGREES:
        path = _interpolated(arm, line, follower, q, degree)
        if path is None:
            continue
        _check_positions(path, limits)
        return path
    raise _why_not(follower, line, arm, q, limits)


def _interpolated(
    arm: Arm, line: StraightLine, follower: LineFollower, q_start: Vector, degree: int
) -> StraightPath | None:
    """The path of that degree, or None when it is not resolved."""
    s = _chebyshev_points(degree)
    q = follower.through(q_start, s)
    if q is None:
        return None
    vandermonde = chebyshev.chebvander(2.0 * s - 1.0, degree)
    path = StraightPath(arm, line, np.asarray(np.linalg.solve(vandermonde, q), dtype=np.float64))
    if np.abs(path.coefficients[-2:]).max() > TAIL_RAD:
        return None
    between = 0.5 * (s[1:] + s[:-1])
    errors = [
        line.error(x, arm.T_base_tip(q)) for x, q in zip(between, path.at(between).q, strict=True)
    ]
    return path if np.linalg.norm(errors, axis=1).max() <= LINE_TOLERANCE else None


def _why_not(
    follower: LineFollower, line: StraightLine, arm: Arm, q_start: Vector, limits: JointLimits
) -> StraightMoveError:
    end = follower.end(q_start, limits) or follower.nearest_to_singular(q_start)
    proof = ReachBound(arm).proof(line.T_base_goal)
    reason = end.reason if proof is None else f"the goal is out of reach, {proof}; {end.reason}"
    hint = millimetres_hint(*line.T_base_goal.translation)
    return StraightMoveError(end.fraction, f"{reason}{hint}")


def _check_limits(arm: Arm, limits: JointLimits) -> None:
    names = expect(limits, JointLimits, "limits", MotionError).names
    if names != arm.joint_names:
        raise MotionError(
            f"the limits are for {', '.join(names)}; the {arm.side} arm has "
            f"{', '.join(arm.joint_names)}"
        )


def _check_positions(path: StraightPath, limits: JointLimits) -> None:
    """Raise where the first joint leaves its limits, looked for at many points."""
    s = np.linspace(0.0, 1.0, 1 + _POINTS_PER_DEGREE * len(path.coefficients))
    q = path.at(s).q
    excess = np.maximum(limits.q_min - q, q - limits.q_max).max(axis=1)
    outside = np.flatnonzero(excess > POSITION_TOLERANCE_RAD)
    if not outside.size:
        return
    inside_s, outside_s = float(s[max(outside[0] - 1, 0)]), float(s[outside[0]])
    while outside_s - inside_s > _OUTSIDE:
        middle = 0.5 * (inside_s + outside_s)
        if limits.violations(path.at(middle).q, POSITION_TOLERANCE_RAD):
            outside_s = middle
        else:
            inside_s = middle
    raise StraightMoveError(inside_s, limit_reached(path.at(outside_s).q, limits))


def _chebyshev_points(degree: int) -> Vector:
    points: Vector = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)
    return points


def _differentiated(coefficients: Vector) -> Vector:
    """Coefficients of the polynomials and their first three derivatives by s: (n, 4 x 7)."""
    table = np.zeros((len(coefficients), 4, 7))
    for order in range(4):
        derived = chebyshev.chebder(coefficients, order, scl=2.0)
        table[: len(derived), order] = derived
    return table.reshape(-1, 28)
