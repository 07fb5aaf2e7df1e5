"""The search for an exact pose from the null-space map, as one CasADi function.

It runs the iterations of `baxter_kin.ik.search.search_function` from one setpoint after the other,
and stops those that progress slowly.
"""

from __future__ import annotations

from functools import cache

import casadi as ca

from baxter_kin.ik.search.search_function import (
    arm_symbols,
    exact_step,
    iterations_of,
    last_axis,
    pose_check,
    search_function,
    seen_from_first,
    task_symbols,
)
from baxter_kin.ik.seeds import FEATURE_WEIGHT_M, MAP_STARTS, setpoint_table
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.kinematics.symbolic import Shape
from baxter_kin.validation import FloatArray

PATIENCE = {8: 0.1, 10: 0.03, 12: 0.01}
"""The largest error, m and 0.6 rad together, that a search from the map may have at iterations of
these numbers. Of searches from the nearest setpoint, up to 2 % exceed it and would have converged,
but also more than 7 of the 9 % that would not: the next setpoint is more promising."""


@cache
def search_functions(shape: Shape) -> tuple[ca.Function, ...]:
    """The functions for arms of a shape: from a start, from the left map, from the right one."""
    return search_function(shape), *(map_search_function(shape, side) for side in LIMBS)


def map_search_function(shape: Shape, side: str) -> ca.Function:
    """The search for exact poses from the map, as `(T_base_tip, T_base_gripper, task, arm) -> ...`.

    It starts from the setpoints nearest to the gripper's pose, one after the other. Finding them
    costs less than one iteration, and poses that the first setpoint solves do not need the others.

    Inputs: poses of tip and gripper, 4 x 4; `Task.numbers`; `ArmNumbers.within`. Outputs: the first
    iterate that converged, else the nearest one, 7 x 1; report, 6 x 1: 1 if it converged
    and the pose is valid, else 0; position error in m; orientation error in rad; iterations of all
    searches; 1 if the pose is valid; starts.

    Args:
        shape: the shape of the arms.
        side: "left" or "right", for the setpoints. They are constants; as inputs, they would be
            copied at every call, which takes a fifth of its time.
    """
    T, T_gripper = ca.MX.sym("T", 4, 4), ca.MX.sym("T_gripper", 4, 4)
    task, (tip, last, *_) = task_symbols()
    arm, (bounds, dimensions, first) = arm_symbols(shape)
    middles, table = setpoint_table(side)
    setpoints, iterations = ca.MX(ca.DM(table.T)), _patient_iterations(shape)
    rest = _start(MAP_STARTS, iterations, setpoints, None)
    for rank in range(MAP_STARTS - 1, 0, -1):
        rest = _start(rank, iterations, setpoints, rest)
    target = last_axis()(seen_from_first()(T, first), last)
    squares, infinity = _squares_function(middles)(T_gripper), ca.MX(ca.inf)
    no_result = -infinity, ca.MX.zeros(7), ca.vertcat(infinity, infinity), ca.MX(0)
    q, outcome = rest(target, tip[9:], bounds, dimensions, squares, *no_result)
    is_valid = pose_check()(T)
    found = ca.logic_and(outcome[0], is_valid)
    report = ca.vertcat(found, outcome[1:4], is_valid, outcome[4])
    name = f"map_search_{side}_{shape.name.lower()}"
    return ca.Function(name, [T, T_gripper, task, arm], [q, report])


@cache
def _patient_iterations(shape: Shape) -> ca.Function:
    return iterations_of(exact_step(shape), PATIENCE)


def _start(
    rank: int, iterations: ca.Function, setpoints: ca.MX, rest: ca.Function | None
) -> ca.Function:
    """The search from the start of a rank, and behind a lazy switch the rest of them.

    `(T, p_last_tip, bounds, dimensions, squares, square of the previous start, best q, its errors,
    iterations so far) -> (q, outcome)`.
    """
    sizes = iterations.size1_in(4), setpoints.shape[1]
    state = T, p_tip, bounds, dimensions, squares, last, q_best, errors_best, count = _state(*sizes)
    index, square = _nearest_function(sizes[1])(squares, last)
    start = ca.fmin(ca.fmax(setpoints[:, index], bounds[:7]), bounds[7:])
    q, outcome = iterations(start, T, p_tip, bounds, dimensions)
    errors, total = outcome[1:3], count + outcome[3]
    is_better = ca.sum1(errors) < ca.sum1(errors_best)
    q, errors = ca.if_else(is_better, q, q_best), ca.if_else(is_better, errors, errors_best)
    outputs = [q, ca.vertcat(outcome[0], errors, total, rank)]
    if rest is not None:
        now = T, p_tip, bounds, dimensions, squares, square, q, errors, total
        outputs = list(_switch(rank, rest, *sizes)(outcome[0], *now))
    return ca.Function(f"start_{rank}", list(state), outputs)


def _switch(rank: int, rest: ca.Function, dimensions: int, setpoints: int) -> ca.Function:
    """`(1 if it converged, state) -> (q, outcome)`: the result so far, or that of the rest."""
    state = _state(dimensions, setpoints)
    *_, q, errors, count = state
    stay = ca.Function("stay", list(state), [q, ca.vertcat(1, errors, count, rank)])
    go_on = ca.Function("go_on", list(state), list(rest(*state)))
    return ca.Function.if_else("switch", stay, go_on)


def _state(dimensions: int, setpoints: int) -> tuple[ca.MX, ...]:
    shapes = {
        "T": (3, 4),
        "p_last_tip": (3, 1),
        "bounds": (14, 1),
        "dimensions": (dimensions, 1),
        "squares": (setpoints, 1),
        "last": (1, 1),
        "q_best": (7, 1),
        "errors_best": (2, 1),
        "count": (1, 1),
    }
    return tuple(ca.MX.sym(name, *shape) for name, shape in shapes.items())


def _squares_function(middles: FloatArray) -> ca.Function:
    """`T -> squared distances` to the middles of the regions, less a common part, n x 1."""
    T = ca.SX.sym("T", 4, 4)
    features = ca.vertcat(T[:3, 3], FEATURE_WEIGHT_M * ca.vec(T[:3, :3].T))
    squares = ca.SX((middles**2).sum(axis=1)) - 2 * ca.SX(middles) @ features
    return ca.Function("squares", [T], [squares])


@cache
def _nearest_function(size: int) -> ca.Function:
    """`(squares, last) -> (index, square)`: the smallest square above `last`."""
    squares, last = ca.SX.sym("squares", size), ca.SX.sym("last")
    index, nearest = ca.SX(0), ca.SX(ca.inf)
    for i in range(size):
        is_nearer = ca.logic_and(squares[i] > last, squares[i] < nearest)
        index = ca.if_else(is_nearer, i, index)
        nearest = ca.if_else(is_nearer, squares[i], nearest)
    return ca.Function("nearest", [squares, last], [index, nearest])
