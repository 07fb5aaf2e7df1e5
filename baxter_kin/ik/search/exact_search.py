"""The fast search: Levenberg-Marquardt on the nonlinear program, as one CasADi function.

One iteration computes kinematics, geometric Jacobian `J`, error `e`, and the damped step of least
norm over the joints that are free,

```
dq = D J^T (J D J^T + (c |e|^2 + eps) 1)^-1 e,     q <- clip(q + dq)
```

with `D` the diagonal that freezes a joint at a limit which the gradient `J^T e` pushes outward
(active set), and damping proportional to the squared error (Sugihara, "Solvability-unconcerned
inverse kinematics by the Levenberg-Marquardt method", IEEE Trans. Robotics 27(5), 2011). It turns
into Gauss-Newton near a solution, so the last digits cost one iteration. The position part of `e`
and `J` is that of the wrist, where the last two axes meet or come nearest, not that of the tip:
these joints hardly move it, which makes an iteration cheaper, and more of them succeed.

The whole search, with its early end, is one function of start, pose and arm: CasADi's virtual
machine evaluates it, or C generated from it (`baxter_kin.compilation.machine_code`). The arm's
geometry and limits are numbers among its inputs, so that what was compiled once serves every robot:
one function for arms of right angles, as Baxter is drawn, and one for arms as they are calibrated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import casadi as ca
import numpy as np

from baxter_kin.frames import ROTATION_TOLERANCE
from baxter_kin.kinematics.symbolic import Shape, SymbolicChain

ITERATIONS = 15
"""Per start. Measured on 4,000 uniform poses: from the middle of the joint ranges 85 % converge in
at most 15 iterations and 87 % in 20; giving up earlier and starting elsewhere costs less."""

SEEN_FROM = 1
"""The link that the formulas are seen from, the one that s0 turns: 838 operations an iteration for
right angles, 1,146 in general, which take 1.1 times as long. From other links as many."""

ROTATION_WEIGHT_M = 0.6
"""What a radian of error counts in metres. Between 0.2 and 1.0 the cost changes by 5 %."""

DAMPING = 0.07
"""Damping over squared error. Between 0.03 and 0.1 the cost changes by 3 %."""

LEAST_DAMPING = 1e-12

CONVERGED_M = CONVERGED_RAD = 1e-9
"""Where a search ends: a thousandth of what counts as a solution, one Gauss-Newton step away."""

SEED_TOLERANCE_RAD = 0.02
"""Seeds this far outside the limits are clamped: arms at rest report a little more than their
limits. Farther out they are refused."""

_LEAST_COSINE = 1e-6


def search_function(shape: Shape, iterations: ca.Function) -> ca.Function:
    """The search as `(q_start, T_base_tip, arm) -> (q, report)`.

    Inputs: first iterate, 7 x 1, rad, clamped to the bounds; pose, 4 x 4; `ArmNumbers.within`.
    Outputs: last iterate, 7 x 1; report, 5 x 1: 1 if it converged and the inputs were valid, else
    0; position error in m; orientation error in rad; iterations; 1 if the inputs were valid. They
    are when the pose is one and no joint of the first iterate was outside by more than
    `SEED_TOLERANCE_RAD`.

    Args:
        shape: of the arms that it is for.
        iterations: `iterations_of` the `step_function` of that shape.
    """
    q_start, T = ca.MX.sym("q_start", 7), ca.MX.sym("T", 4, 4)
    arm, (bounds, dimensions, frames) = arm_symbols(shape)
    q_clamped, is_valid = input_check()(q_start, T, bounds)
    q, outcome = iterations(q_clamped, target_function()(T, frames), bounds, dimensions)
    report = ca.vertcat(ca.logic_and(outcome[0], is_valid), outcome[1:], is_valid)
    return ca.Function(f"search_{shape.name.lower()}", [q_start, T, arm], [q, report])


def arm_symbols(shape: Shape) -> tuple[ca.MX, list[ca.MX]]:
    """`ArmNumbers.within` as symbols, and its parts: bounds, dimensions, frames."""
    edges = np.cumsum([0, 14, len(shape.value), 24]).tolist()
    arm = ca.MX.sym("arm", edges[-1])
    return arm, ca.vertsplit(arm, edges)


def target_function() -> ca.Function:
    """`(T_base_tip, frames) -> T_first_last`, 4 x 4: where the last axis shall be."""
    T, frames = ca.SX.sym("T", 4, 4), ca.SX.sym("frames", 24)
    first, last = (_pose(part) for part in ca.vertsplit(frames, 12))
    return ca.Function("target", [T, frames], [first @ T @ last])


def _pose(numbers: ca.SX) -> ca.SX:
    rows = ca.horzcat(ca.reshape(numbers[:9], 3, 3), numbers[9:])
    return ca.sparsify(ca.vertcat(rows, ca.horzcat(0, 0, 0, 1)))


def iterations_of(
    step: ca.Function, patience: Mapping[int, float] = MappingProxyType({})
) -> ca.Function:
    """`(q, ...) -> (last iterate, (arrived, position error, orientation error, count))`.

    Each iteration holds the rest of them behind a lazy switch, so that what comes after the last
    one needed costs nothing. After all of them the errors are measured once more, so that errors
    and iterate belong together.

    Args:
        step: `(q, ...) -> (q_next, position error at q, orientation error at q)`; what follows `q`
            is handed through. `q` must be inside the bounds.
        patience: the greatest error, m and rad (weighted) together, to go on with at iterations of
            these numbers; others go on whatever it is.
    """
    q, *given = symbols(step)
    _, *errors = step(q, *given)
    outcome = ca.vertcat(_arrived(*errors), *errors, ITERATIONS + 1)
    rest = ca.Function("measure", [q, *given], [q, outcome])
    for count in range(ITERATIONS, 0, -1):
        rest = _iteration(count, step, rest, patience.get(count, math.inf))
    return rest


def _iteration(count: int, step: ca.Function, rest: ca.Function, most: float) -> ca.Function:
    """The iteration of that number: tell the errors at `q`; if too large, step and go on."""
    (q, *given), q_next, outcome = symbols(step), ca.MX.sym("q_next", 7), ca.MX.sym("outcome", 4)
    inputs = [q, q_next, outcome, *given]
    stay = ca.Function("stay", inputs, [q, outcome])
    go_on = ca.Function("go_on", inputs, list(rest(q_next, *given)))
    switch = ca.Function.if_else("switch", stay, go_on)
    q_new, *errors = step(q, *given)
    is_end = arrived = _arrived(*errors)
    if most < math.inf:
        is_end = ca.logic_or(arrived, errors[0] + ROTATION_WEIGHT_M * errors[1] > most)
    outputs = switch(is_end, q, q_new, ca.vertcat(arrived, *errors, count), *given)
    return ca.Function(f"iteration_{count}", [q, *given], list(outputs))


def symbols(function: ca.Function) -> list[ca.MX]:
    """A symbol for each of its inputs."""
    return [ca.MX.sym(function.name_in(i), *function.size_in(i)) for i in range(function.n_in())]


def _arrived(offset: ca.MX, angle: ca.MX) -> ca.MX:
    return ca.logic_and(offset <= CONVERGED_M, angle <= CONVERGED_RAD)


def step_function(shape: Shape) -> ca.Function:
    """`(q, T_first_last, bounds, dimensions) -> (q_next, errors of position and orientation at q)`.

    The errors are those of the tip.
    """
    chain = SymbolicChain.of_shape(shape, SEEN_FROM)
    q, T, bounds = chain.q, ca.SX.sym("T", 4, 4), ca.SX.sym("bounds", 14)
    R_target = chain.R_link_first @ T[:3, :3]
    wrist_error = chain.R_link_first @ T[:3, 3] + chain.p_link_first - chain.p_link_last
    p_error = wrist_error + (R_target - chain.R_link_last) @ chain.p_last_tip
    r_error, angle = rotation_error(R_target, chain.R_link_last)
    e = ca.vertcat(wrist_error, ROTATION_WEIGHT_M * r_error)
    q_next = damped_step(q, _wrist_jacobian(chain), e, bounds)
    inputs, outputs = [q, T, bounds, chain.dimensions], [q_next, ca.norm_2(p_error), angle]
    return ca.Function("step", inputs, outputs, {"cse": True})


def damped_step(q: ca.SX, J: ca.SX, e: ca.SX, bounds: ca.SX) -> ca.SX:
    """The next iterate, 7 x 1, for a Jacobian, 6 x 7, and an error, 6 x 1; rotations in m."""
    low, high = bounds[:7], bounds[7:]
    J_free = J @ ca.diag(_is_free(J.T @ e, q, low, high))
    damping = DAMPING * ca.sumsqr(e) + LEAST_DAMPING
    y = solve_symmetric(J_free @ J.T + damping * ca.SX.eye(6), e)
    return ca.fmin(ca.fmax(q + J_free.T @ y, low), high)


def _wrist_jacobian(chain: SymbolicChain) -> ca.SX:
    """The geometric Jacobian of W, 6 x 7, rotations in the unit that `ROTATION_WEIGHT_M` makes.

    W lies on the last axis, which does not move it; where the last two axes meet, nor does the one
    before.
    """
    wrist, axes = chain.p_link_last, list(zip(chain.axes, chain.origins, strict=True))
    linear = [ca.cross(axis, wrist - origin) for axis, origin in axes[:6]]
    columns = ca.horzcat(*linear, ca.SX(3, 1)), ROTATION_WEIGHT_M * ca.horzcat(*chain.axes)
    return ca.sparsify(ca.vertcat(*columns))


def rotation_error(R_target: ca.SX, R: ca.SX) -> tuple[ca.SX, ca.SX]:
    """`2 sin(angle / 2) axis` of the rotation still missing, axes of base, and its length.

    The skew part of a rotation matrix is `sin(angle) axis`; over `2 cos(angle / 2)`, a root of the
    trace, it becomes a quaternion's vector part, which grows with the angle up to half a turn.
    """
    E = R_target @ R.T
    trace = E[0, 0] + E[1, 1] + E[2, 2]
    two_cosine = ca.sqrt(ca.fmax(1 + trace, _LEAST_COSINE))
    skew = ca.vertcat(E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1])
    error = skew / two_cosine
    length = ca.if_else(trace > 0, ca.norm_2(error), 2.0)  # near half a turn skew vanishes as well
    return error, length


def _is_free(gradient: ca.SX, q: ca.SX, low: ca.SX, high: ca.SX) -> ca.SX:
    """0 for each joint at a limit that the step would push it through, 1 for the others, 7 x 1."""
    free = []
    for i in range(q.numel()):
        at_low = ca.logic_and(q[i] <= low[i], gradient[i] < 0)
        at_high = ca.logic_and(q[i] >= high[i], gradient[i] > 0)
        free.append(ca.logic_not(ca.logic_or(at_low, at_high)))
    return ca.vertcat(*free)


def solve_symmetric(A: ca.SX, b: ca.SX) -> ca.SX:
    """`A^-1 b` for a positive definite `A`, n x n, by its LDL^T factors written out.

    Golub and Van Loan, Matrix Computations, 4th ed., section 4.1.2.
    """
    n = b.shape[0]
    L = [[ca.SX(0)] * n for _ in range(n)]
    scaled = [[ca.SX(0)] * n for _ in range(n)]  # L times the diagonal
    inverse_pivots = []
    for j in range(n):
        pivot = A[j, j] - sum(L[j][k] * scaled[j][k] for k in range(j))
        inverse_pivots.append(1 / pivot)
        for i in range(j + 1, n):
            scaled[i][j] = A[i, j] - sum(L[i][k] * scaled[j][k] for k in range(j))
            L[i][j] = scaled[i][j] * inverse_pivots[j]
    x: list[ca.SX] = []
    for i in range(n):
        x.append(b[i] - sum(L[i][k] * x[k] for k in range(i)))
    x = [value * inverse for value, inverse in zip(x, inverse_pivots, strict=True)]
    for i in reversed(range(n)):
        x[i] = x[i] - sum(L[k][i] * x[k] for k in range(i + 1, n))
    return ca.vertcat(*x)


def input_check() -> ca.Function:
    """`(q, T, bounds) -> (clamped q, 1 if q and T are acceptable, else 0)`.

    A pose is one by the tests of `baxter_kin.frames.checked_pose`.
    """
    q, T, bounds = ca.SX.sym("q", 7), ca.SX.sym("T", 4, 4), ca.SX.sym("bounds", 14)
    clamped = ca.fmin(ca.fmax(q, bounds[:7]), bounds[7:])
    is_near = _all_within(q - clamped, SEED_TOLERANCE_RAD)
    R = T[:3, :3]
    is_orthonormal = _all_within(ca.vec(R.T @ R - ca.SX.eye(3)), ROTATION_TOLERANCE)
    is_affine = _all_within(T[3, :].T - ca.DM([0.0, 0.0, 0.0, 1.0]), ROTATION_TOLERANCE)
    is_rigid = ca.logic_and(is_orthonormal, is_affine)
    is_pose = ca.logic_and(is_rigid, ca.det(R) > 0)
    return ca.Function("check", [q, T, bounds], [clamped, ca.logic_and(is_near, is_pose)])


def _all_within(values: ca.SX, tolerance: float) -> ca.SX:
    """1 if every value is that close to zero, else 0; NaN is not, while norms would drop it."""
    within = ca.SX(1)
    for i in range(values.numel()):
        within = ca.logic_and(within, ca.fabs(values[i]) <= tolerance)
    return within
