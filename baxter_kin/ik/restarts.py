"""The search from the setpoints nearest to a pose, one after the other, as one CasADi function.

Choosing them costs less than one iteration, and what the first solves never meets the others.
"""

from __future__ import annotations

import casadi as ca

from baxter_kin.ik.kernel import iterations_of, step_function
from baxter_kin.ik.seeds import MAP_STARTS, ROTATION_WEIGHT_M, NullSpaceMap
from baxter_kin.model import Arm


def map_search_function(arm: Arm, map_: NullSpaceMap) -> ca.Function:
    """The search from the map as `(T_base_tip, bounds) -> (q, report)`.

    Inputs: a valid pose, 4 x 4; lowest and highest joint positions, 14 x 1, rad.
    Outputs: the first iterate that converged, else the one that came nearest, 7 x 1; report, 5 x 1:
    1 if it converged, else 0; position error in m; orientation error in rad; iterations of all
    searches; starts.
    """
    T, bounds = ca.MX.sym("T", 4, 4), ca.MX.sym("bounds", 14)
    iterations, nearest = iterations_of(step_function(arm)), _nearest_function(map_.size)
    setpoints, infinity = ca.MX(ca.DM(map_.setpoints.T)), ca.MX(ca.inf)
    rest = _start(MAP_STARTS, iterations, nearest, setpoints, None)
    for rank in range(MAP_STARTS - 1, 0, -1):
        rest = _start(rank, iterations, nearest, setpoints, rest)
    nothing = -infinity, ca.MX.zeros(7), ca.vertcat(infinity, infinity), ca.MX(0)
    outputs = rest(T, bounds, _squares_function(map_)(T), *nothing)
    return ca.Function("map_search", [T, bounds], list(outputs))


def _start(
    rank: int,
    iterations: ca.Function,
    nearest: ca.Function,
    setpoints: ca.MX,
    rest: ca.Function | None,
) -> ca.Function:
    """The start of that rank, and behind a lazy switch the rest of them.

    `(T, bounds, squares, square of the one before, best q, its errors, iterations so far) -> (q,
    report)`.
    """
    inputs = T, bounds, squares, last, q_best, errors_best, count = _state(setpoints.shape[1])
    index, square = nearest(squares, last)
    q, outcome = iterations(setpoints[:, index], T, bounds)
    errors, total = outcome[1:3], count + outcome[3]
    is_better = ca.sum1(errors) < ca.sum1(errors_best)
    q, errors = ca.if_else(is_better, q, q_best), ca.if_else(is_better, errors, errors_best)
    outputs = [q, ca.vertcat(outcome[0], errors, total, rank)]
    if rest is not None:
        state = T, bounds, squares, square, q, errors, total
        outputs = list(_switch(rank, rest, setpoints.shape[1])(outcome[0], *state))
    return ca.Function(f"start_{rank}", list(inputs), outputs)


def _switch(rank: int, rest: ca.Function, size: int) -> ca.Function:
    """`(1 if it converged, state) -> (q, report)`: what was found, or what the rest finds."""
    state = _state(size)
    *_, q, errors, count = state
    stay = ca.Function("stay", list(state), [q, ca.vertcat(1, errors, count, rank)])
    go_on = ca.Function("go_on", list(state), list(rest(*state)))
    return ca.Function.if_else("switch", stay, go_on)


def _state(size: int) -> tuple[ca.MX, ...]:
    shapes = {
        "T": (4, 4),
        "bounds": (14, 1),
        "squares": (size, 1),
        "last": (1, 1),
        "q_best": (7, 1),
        "errors_best": (2, 1),
        "count": (1, 1),
    }
    return tuple(ca.MX.sym(name, *shape) for name, shape in shapes.items())


def _squares_function(map_: NullSpaceMap) -> ca.Function:
    """`T -> squared distances` to the regions' middles, but for what all have in common, n x 1."""
    T = ca.SX.sym("T", 4, 4)
    features = ca.vertcat(T[:3, 3], ROTATION_WEIGHT_M * ca.vec(T[:3, :3].T))
    middles = map_.middles
    squares = ca.SX((middles**2).sum(axis=1)) - 2 * ca.SX(middles) @ features
    return ca.Function("squares", [T], [squares])


def _nearest_function(size: int) -> ca.Function:
    """`(squares, last) -> (index, square)`: the least square above the last one."""
    squares, last = ca.SX.sym("squares", size), ca.SX.sym("last")
    index, least = ca.SX(0), ca.SX(ca.inf)
    for i in range(size):
        is_nearer = ca.logic_and(squares[i] > last, squares[i] < least)
        index = ca.if_else(is_nearer, i, index)
        least = ca.if_else(is_nearer, squares[i], least)
    return ca.Function("nearest", [squares, last], [index, least])
