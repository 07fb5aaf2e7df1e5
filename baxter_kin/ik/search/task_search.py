"""Tasks with freedom: the search for a pose that need not be met in every respect.

The same iterations as in `baxter_kin.ik.search.exact_search` on other errors, the coordinates of
the tip's deviation (`baxter_kin.ik.tolerance`). What is free counts neither as error nor in the
Jacobian. What is inside its bounds is no error, but held; released, it leaves them by the next
step, and the search wavers: of poses with bounds of 1 cm and 0.1 rad, 56 % converged from the first
setpoint instead of 97 %. What is outside its bounds is drawn to half of them, well inside; a tilt
outside its cone, straight towards the cone's axis. Tolerances, the tip's place on the hand and the
arm are inputs: one function serves all.
"""

from __future__ import annotations

import casadi as ca

from baxter_kin.ik.search.exact_search import (
    CONVERGED_M,
    ROTATION_WEIGHT_M,
    arm_symbols,
    damped_step,
    input_check,
    iterations_of,
    target_function,
)
from baxter_kin.kinematics.symbolic import Shape, SymbolicChain

INSET = 2 * CONVERGED_M
"""In m and rad: the search aims this far inside a tolerance, and so ends within it."""

AIM = 0.5
"""Where to in its bounds, as a share of them, a coordinate is drawn from outside."""

_NO_TURN = ca.DM([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])

_SMALL = 1e-6  # below, angles are taken from their series
_LEAST_COSINE = 1e-3


def task_search_function(shape: Shape) -> ca.Function:
    """The search as `(q_start, T_base_tip, T_last_tip, tolerance, roll_is_free, arm) -> ...`.

    Inputs: first iterate, 7 x 1, rad; requested pose of the tip, 4 x 4; the tip seen from the last
    axis (`DHParameters`), 4 x 4; what is allowed along (m) and about (rad) the axes of the
    requested tip frame, infinite where free, and of tilt in any direction (rad), 7 x 1; 1 if the
    rotation about z is free and only its tilt counts, else 0; `ArmNumbers.within`. Outputs as of
    `baxter_kin.ik.search.exact_search.search_function`; errors are what exceeds the tolerance.
    """
    step = _step_function(shape)
    q_start, T, *task = (ca.MX.sym(step.name_in(i), *step.size_in(i)) for i in range(5))
    arm, (bounds, dimensions, frames) = arm_symbols(shape)
    q_clamped, is_valid = input_check()(q_start, T, bounds)
    target = target_function()(T, ca.vertcat(frames[:12], _NO_TURN))
    q, outcome = iterations_of(step)(q_clamped, target, *task, bounds, dimensions)
    report = ca.vertcat(ca.logic_and(outcome[0], is_valid), outcome[1:], is_valid)
    inputs = [q_start, T, *task, arm]
    return ca.Function(f"task_search_{shape.name.lower()}", inputs, [q, report])


def _step_function(shape: Shape) -> ca.Function:
    """One iteration: `(q, T_first_tip, T_last_tip, tolerance, roll_is_free, bounds, dimensions)`.

    Outputs of `kernel.step_function`.
    """
    chain = SymbolicChain.of_shape(shape)
    T, tool = ca.SX.sym("T", 4, 4), ca.SX.sym("tool", 4, 4)
    tolerance, roll_is_free = ca.SX.sym("tolerance", 7), ca.SX.sym("roll_is_free")
    bounds = ca.SX.sym("bounds", 14)
    p_tip = chain.p_link_last + chain.R_link_last @ tool[:3, 3]
    R_tip = chain.R_link_last @ tool[:3, :3]
    x = task_coordinates(T, p_tip, R_tip, roll_is_free)
    inside = ca.fmax(tolerance - INSET, 0)
    allowed, cone = inside[:6], inside[6]
    excess = _beyond(x, allowed)
    turned = ca.norm_2(excess[3:])
    error = _beyond(x, AIM * allowed) * (ca.fabs(x) > allowed)
    error[3:] *= ca.if_else(turned > cone, 1 - AIM * cone / turned, 0)
    unit = ca.vertcat(*[1.0] * 3, *[ROTATION_WEIGHT_M] * 3)
    J = ca.diag(unit * (allowed < ca.inf)) @ ca.jacobian(x, chain.q)
    q_next = damped_step(chain.q, J, -unit * error, bounds)
    errors = ca.norm_2(excess[:3]), ca.fmax(turned - cone, 0)
    inputs = [chain.q, T, tool, tolerance, roll_is_free, bounds, chain.dimensions]
    return ca.Function("task_step", inputs, [q_next, *errors], {"cse": True})


def _beyond(x: ca.SX, allowed: ca.SX) -> ca.SX:
    return x - ca.fmin(ca.fmax(x, -allowed), allowed)


def task_coordinates(T: ca.SX, p_tip: ca.SX, R_tip: ca.SX, roll_is_free: ca.SX) -> ca.SX:
    """The deviation of a tip from a pose along and about the axes of that pose, 6 x 1, m and rad.

    As `baxter_kin.ik.tolerance` says: displacement and rotation vector; with the roll free the
    rotation vector of the tilt of z, and zero.
    """
    R = T[:3, :3].T @ R_tip
    rotation = ca.if_else(roll_is_free, _tilt(R[:, 2]), _rotation_vector(R))
    return ca.vertcat(T[:3, :3].T @ (p_tip - T[:3, 3]), rotation)


def _rotation_vector(R: ca.SX) -> ca.SX:
    """By way of the quaternion `sin(angle / 2) axis, cos(angle / 2)`, half a root of 1 + trace.

    Within 0.1 deg of half a turn, where the axis is undecided, it is too short.
    """
    two_cosine = ca.sqrt(ca.fmax(1 + ca.trace(R), _LEAST_COSINE**2))
    skew = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1])
    return _lengthened(skew / (2 * two_cosine), two_cosine / 2, 2)


def _tilt(z: ca.SX) -> ca.SX:
    """The rotation vector of the shortest rotation from (0, 0, 1) to a unit vector."""
    return _lengthened(ca.vertcat(-z[1], z[0], 0), z[2], 1)


def _lengthened(v: ca.SX, cosine: ca.SX, turns: int) -> ca.SX:
    """`turns` times the angle of which `v` is the axis times the sine."""
    square = ca.sumsqr(v)
    is_small = ca.logic_and(square < _SMALL**2, cosine > 0)
    sine = ca.sqrt(ca.fmax(square, _SMALL**2))
    factor = ca.if_else(is_small, 1 + square / 6, ca.atan2(sine, cosine) / sine)
    return turns * factor * v
