"""The search from the setpoints nearest to a pose, one after the other, as one CasADi function.

Choosing them costs less than one iteration, and what the first solves never meets the others.
"""

from __future__ import annotations

import casadi as ca

from baxter_kin.ik.search.exact_search import arm_symbols, target_function
from baxter_kin.ik.seeds import FEATURE_WEIGHT_M, MAP_STARTS, setpoint_table
from baxter_kin.kinematics.symbolic import Shape
from baxter_kin.validation import FloatArray

PATIENCE = {8: 0.1, 10: 0.03, 12: 0.01}
"""The error, m and 0.6 rad together, that a search may have left at iterations of these numbers.
Of searches from the nearest setpoint up to 2 % have more and would have converged, and more than
7 of the 9 % that would not: the next setpoint is the better bet."""


def map_search_function(shape: Shape, iterations: ca.Function, side: str) -> ca.Function:
    """The search from the map as `(T_base_tip, arm) -> (q, report)`.

    Inputs: a valid pose, 4 x 4; `baxter_kin.ik.search.exact_search.ArmNumbers.within`.
    Outputs: the first iterate that converged, else the one that came nearest, 7 x 1; report, 5 x 1:
    1 if it converged, else 0; position error in m; orientation error in rad; iterations of all
    searches; starts.

    Args:
        shape: of the arms that it is for.
        iterations: as for `search_function`.
        side: "left" or "right": whose setpoints.
    """
    T = ca.MX.sym("T", 4, 4)
    arm, (bounds, dimensions, frames) = arm_symbols(shape)
    middles, table = setpoint_table(side)
    size, setpoints, infinity = len(table), ca.MX(ca.DM(table.T)), ca.MX(ca.inf)
    nearest = _nearest_function(size)
    rest = _start(MAP_STARTS, iterations, nearest, setpoints, None)
    for rank in range(MAP_STARTS - 1, 0, -1):
        rest = _start(rank, iterations, nearest, setpoints, rest)
    target, squares = target_function()(T, frames), _squares_function(middles)(T)
    nothing = -infinity, ca.MX.zeros(7), ca.vertcat(infinity, infinity), ca.MX(0)
    outputs = rest(target, bounds, dimensions, squares, *nothing)
    name = f"map_search_{side}_{shape.name.lower()}"
    return ca.Function(name, [T, arm], list(outputs))


def _start(
    rank: int,
    iterations: ca.Function,
    nearest: ca.Function,
    setpoints: ca.MX,
    rest: ca.Function | None,
) -> ca.Function:
    """The start of that rank, and behind a lazy switch the rest of them.

    `(T, bounds, dimensions, squares, square of the one before, best q, its errors, iterations so
    far) -> (q, report)`.
    """
    sizes = iterations.size1_in(3), setpoints.shape[1]
    state = T, bounds, dimensions, squares, last, q_best, errors_best, count = _state(*sizes)
    index, square = nearest(squares, last)
    start = ca.fmin(ca.fmax(setpoints[:, index], bounds[:7]), bounds[7:])
    q, outcome = iterations(start, T, bounds, dimensions)
    errors, total = outcome[1:3], count + outcome[3]
    is_better = ca.sum1(errors) < ca.sum1(errors_best)
    q, errors = ca.if_else(is_better, q, q_best), ca.if_else(is_better, errors, errors_best)
    outputs = [q, ca.vertcat(outcome[0], errors, total, rank)]
    if rest is not None:
        now = T, bounds, dimensions, squares, square, q, errors, total
        outputs = list(_switch(rank, rest, *sizes)(outcome[0], *now))
    return ca.Function(f"start_{rank}", list(state), outputs)


def _switch(rank: int, rest: ca.Function, dimensions: int, size: int) -> ca.Function:
    """`(1 if it converged, state) -> (q, report)`: what was found, or what the rest finds."""
    state = _state(dimensions, size)
    *_, q, errors, count = state
    stay = ca.Function("stay", list(state), [q, ca.vertcat(1, errors, count, rank)])
    go_on = ca.Function("go_on", list(state), list(rest(*state)))
    return ca.Function.if_else("switch", stay, go_on)


def _state(dimensions: int, size: int) -> tuple[ca.MX, ...]:
    shapes = {
        "T": (4, 4),
        "bounds": (14, 1),
        "dimensions": (dimensions, 1),
        "squares": (size, 1),
        "last": (1, 1),
        "q_best": (7, 1),
        "errors_best": (2, 1),
        "count": (1, 1),
    }
    return tuple(ca.MX.sym(name, *shape) for name, shape in shapes.items())


def _squares_function(middles: FloatArray) -> ca.Function:
    """`T -> squared distances` to the regions' middles, but for what all have in common, n x 1."""
    T = ca.SX.sym("T", 4, 4)
    features = ca.vertcat(T[:3, 3], FEATURE_WEIGHT_M * ca.vec(T[:3, :3].T))
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
