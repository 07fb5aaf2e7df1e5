"""Motion programs: their phases, their task, their unknowns, and the layout of their parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
import pinocchio as pin

from baxter_kin import Arm, JointLimits
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.kinematics.symbolic import dimensions_of
from baxter_kin.validation import FloatArray, Indices
from planner.motion.paths.pieces import MIN_LENGTH, Piece

PIECE_NUMBERS = 25
"""Initial position and rotation, axis and angle of the turn, three coefficients of the position."""

TILT_NUMBERS = 4
"""An axis seen from the tip, and 1 - cos of its maximum tilt."""

GEOMETRY_NUMBERS = 31 + 9 + 4
"""Dimensions of the chain, rotation of the tip, direction and offset of the vertical."""

POSE_NUMBERS = 12
"""Position, and rotation by columns."""

HOLDING_NUMBERS = GEOMETRY_NUMBERS + POSE_NUMBERS + POSE_NUMBERS + 2
"""The second arm's geometry, the pose of its first axis seen from the first arm's, the relative
pose that is held, and the tolerance of that."""


MAX_KEPT = 0.1
"""Maximum fraction of a piece that is kept from each of its ends."""


@dataclass(frozen=True, slots=True, eq=False)
class Unknowns:
    """Indices of the unknowns; the given states of start and goal follow them.

    Attributes:
        count: number of unknowns.
        controls: of each phase, shape (n + 3, joints). Where the arm rests, three successive ones
            are the same.
        durations: of each phase, shape (phases,).
        fractions: of the piece at each knot, shape (n + 1,); None for phases without a piece.
    """

    count: int
    controls: tuple[Indices, ...]
    durations: Indices
    fractions: tuple[Indices | None, ...]

    @classmethod
    def of(cls, phases: Sequence[Phase], joints: int) -> Unknowns:
        """Number the unknowns, phase by phase."""
        count = 0

        def new(*shape: int) -> Indices:
            nonlocal count
            first, count = count, count + int(np.prod(shape))
            return np.arange(first, count).reshape(shape)

        controls, durations, fractions = [], [], []
        start, goal = np.arange(-2 * joints, 0).reshape(2, 1, joints)  # counted from the end
        none = np.zeros((0, joints), dtype=np.intp)
        resting = none if phases[0].enters or phases[0].is_moving else start
        for phase in phases:
            begin = np.repeat(resting, 3, axis=0)
            resting = goal if phase.at_goal else new(1, joints) if phase.rests else none
            end = np.repeat(resting, 3, axis=0)
            inner = new(phase.intervals + 3 - len(begin) - len(end), joints)
            controls.append(np.concatenate([begin, inner, end]))
            durations.append(int(new(1)[0]))
            fractions.append(None if phase.piece is None else new(phase.intervals + 1))
        total = count + 2 * joints  # with the angles of start and goal
        placed = tuple(np.where(where < 0, where + total, where) for where in controls)
        return cls(count, placed, np.array(durations), tuple(fractions))

    @property
    def joints(self) -> int:
        """Number of joints."""
        return int(self.controls[0].shape[1])

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of the Hessian."""
        return self.count, self.count


class Numbers:
    """The parameters of a program, as symbols.

    Attributes:
        all: in a column.
        q_ends: angles of start and goal, two for each joint.
        rates_start: initial velocity and acceleration, two for each joint.
        limits: of velocity, acceleration and jerk, three for each joint.
        geometry: `geometry_numbers`.
        tolerance: of pieces, m and rad, 2 x 1.
        speed: maximum speed of the tip, m per unit of time.
        rates: where a line is entered and left at speed, 4 x 1.
        heights: m, one for each phase with a minimum height.
        tilt: the axis that stays upright and 1 - cos of its maximum tilt, 4 x 1.
        holding: `holding_numbers`, in programs with a phase that holds a relative pose.
        pieces: `piece_numbers` of each.
    """

    def __init__(self, phases: Sequence[Phase], joints: int) -> None:
        pieces = 1 + max((phase.piece for phase in phases if phase.piece is not None), default=-1)
        heights = sum(phase.keeps_height for phase in phases)
        holding = HOLDING_NUMBERS if any(phase.holds for phase in phases) else 0
        few = GEOMETRY_NUMBERS, 2, 1, 4, heights, TILT_NUMBERS, holding
        sizes = [2 * joints, 2 * joints, 3 * joints, *few, *[PIECE_NUMBERS] * pieces]
        self.all = ca.MX.sym("numbers", sum(sizes))
        parts = ca.vertsplit(self.all, np.cumsum([0, *sizes]).tolist())
        self.q_ends, self.rates_start, self.limits, self.geometry, self.tolerance, *parts = parts
        self.speed, self.rates, self.heights, self.tilt, self.holding, *self.pieces = parts


def numbers_of(
    task: MotionTask, arm: Arm | None, limits: JointLimits, unit_s: float = 1.0
) -> FloatArray:
    """The values of the parameters; without an arm for a task without constraints on its tip.

    Times are in units of `unit_s`.
    """
    pieces = [piece_numbers(piece, arm, task.axis) for piece in task.pieces if arm is not None]
    geometry, holding = np.zeros(GEOMETRY_NUMBERS), np.zeros(0)
    if arm is not None:
        geometry = geometry_numbers(arm, task.axis, task.T_tip_frame)
        if task.holding is not None:
            holding = holding_numbers(arm, task.holding)
    bounds = limits.v_max * unit_s, limits.a_max * unit_s**2, limits.j_max * unit_s**3
    still = np.zeros_like(task.q_start)
    moving = (still, still) if task.start_rates is None else task.start_rates
    start = moving[0] * unit_s, moving[1] * unit_s**2
    rates = np.array(task.rates) * np.tile([unit_s, unit_s**2], 2)
    few = np.array([*task.tolerance, task.speed_m_s * unit_s, *rates, *task.heights_m, *task.tilt])
    return np.concatenate([*ends_of(task), *start, *bounds, geometry, few, holding, *pieces])


def ends_of(task: MotionTask) -> tuple[FloatArray, FloatArray]:
    """Start and goal, as they follow the unknowns."""
    return task.q_start, task.q_start if task.q_goal is None else task.q_goal


class Phase(NamedTuple):
    """One phase of a motion.

    Attributes:
        intervals: of its spline.
        piece: number of the piece that the tip follows; None where it is free.
        ends: fractions of the piece at the start and at the end.
        rests: whether the arm rests at the end.
        at_goal: whether it rests there at the given configuration; its height on the way is then
            not bounded.
        enters: whether the tip has a given speed along its line at the start; for the first phase.
        leaves: the same at the end; for the last phase.
        is_moving: whether the arm has a given velocity and acceleration at the start; for the first
            phase.
        may_sink: whether a phase without a line has no minimum height.
        keeps_upright: whether the axis of the task stays upright at the knots in between.
        only_ends: whether the tip is on the piece at the end of the phase only.
        holds: whether the tips of two arms keep a relative pose at the knots, and exactly at the
            end.
    """

    intervals: int
    piece: int | None = None
    ends: tuple[float, float] = (0.0, 1.0)
    rests: bool = False
    at_goal: bool = False
    enters: bool = False
    leaves: bool = False
    is_moving: bool = False
    may_sink: bool = False
    keeps_upright: bool = False
    only_ends: bool = False
    holds: bool = False

    @property
    def keeps_height(self) -> bool:
        """Whether its tip stays above a height."""
        return self.piece is None and not self.at_goal and not self.may_sink


class Holding(NamedTuple):
    """The relative pose that two arms keep.

    Attributes:
        other: the second arm; its joints follow those of the first.
        T_frame_tip: pose of its tip, seen from the frame of the first arm that follows pieces.
        tolerance: at the knots, along and about each axis, m and rad.
    """

    other: Arm
    T_frame_tip: pin.SE3
    tolerance: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class MotionTask:
    """The parameters of a problem; with two arms, pieces, heights and tilt are those of the first.

    Attributes:
        q_start: initial configuration, shape (7,) or, with two arms, (14,), rad.
        pieces: those of the phases, by their numbers.
        tolerance: of the pieces, at the knots, along and about each axis, m and rad.
        heights_m: minimum height of the tip in base, for each phase that keeps one.
        q_goal: final configuration at rest, if given, shape (7,), rad.
        rates: first and second time derivative of the fraction of the line where it is entered at
            speed, then where it is left.
        start_rates: initial velocity and acceleration, shape (7,) each, rad/s and rad/s^2; None
            at rest.
        speed_m_s: maximum speed of the tip, in programs that bound it.
        axis: of the tip, about which its rotation is free in programs that leave one free.
        tilt: of the phases that keep upright: the axis that does, a unit vector seen from the tip,
            and 1 - cos of its maximum tilt.
        near: a configuration, shape (7,), rad, and the maximum distance of each joint from it at
            the end, where the arm rests; None for any end.
        T_tip_frame: pose of the frame that follows pieces and stays upright, seen from the tip; by
            default, the tip itself.
        holding: the relative pose of phases that hold one.
    """

    q_start: FloatArray
    pieces: tuple[Piece, ...] = ()
    tolerance: tuple[float, float] = (1.0, 1.0)
    heights_m: tuple[float, ...] = ()
    q_goal: FloatArray | None = None
    rates: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    start_rates: tuple[FloatArray, FloatArray] | None = None
    speed_m_s: float = 1.0
    axis: str = "z"
    tilt: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)
    near: tuple[FloatArray, float] | None = None
    T_tip_frame: pin.SE3 | None = None
    holding: Holding | None = None

    def kept_from_ends(self, piece: int) -> float:
        """The fraction that knots of a piece keep from an end at which the arm rests.

        It is the tolerance: no tip within that passes the end, and puts a body down twice.
        """
        length_m = max(self.pieces[piece].length_m, MIN_LENGTH)
        return min(self.tolerance[0] / length_m, MAX_KEPT)


def piece_numbers(piece: Piece, arm: Arm, axis: str = "z") -> FloatArray:
    """The parameters of a piece of the tip's path, shape (25,); its z axis is `axis` of the tip."""
    R = _parameters(arm).T_base_first.rotation.T
    start = _parameters(arm).T_base_first.inverse() * piece.T_base_start
    angle = piece.angle_rad
    turn = R @ piece.turn / angle if angle > 0.0 else np.array([0.0, 0.0, 1.0])
    R_start = start.rotation @ _AS_Z[axis]
    position = (R @ piece.coefficients.T).ravel("F")
    return np.concatenate([start.translation, R_start.ravel("F"), turn, [angle], position])


_parameters = lru_cache(maxsize=8)(DHParameters.of)

_AS_Z = {axis: np.roll(np.eye(3), "zyx".index(axis), axis=1) for axis in "xyz"}
"""Rotations whose third column is x, y or z."""


def geometry_numbers(arm: Arm, axis: str = "z", T_tip_frame: pin.SE3 | None = None) -> FloatArray:
    """The parameters of an arm, shape (44,); the z axis of its tip is `axis` of the tip.

    The tip may be replaced by a frame that is fixed to it.
    """
    dh = _parameters(arm)
    if T_tip_frame is not None:
        dh = replace(dh, T_last_tip=dh.T_last_tip * T_tip_frame)
    up = np.append(dh.T_base_first.rotation[2], dh.T_base_first.translation[2])
    R_tip = dh.T_last_tip.rotation @ _AS_Z[axis]
    return np.concatenate([dimensions_of(dh), R_tip.ravel("F"), up])


def holding_numbers(arm: Arm, holding: Holding) -> FloatArray:
    """The parameters of a relative pose, shape (70,)."""
    first, other = (_parameters(each).T_base_first for each in (arm, holding.other))
    poses = first.inverse() * other, holding.T_frame_tip
    numbers = [np.append(T.translation, T.rotation.ravel("F")) for T in poses]
    return np.concatenate([geometry_numbers(holding.other), *numbers, holding.tolerance])
