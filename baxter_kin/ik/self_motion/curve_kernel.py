"""Newton's method and continuation on the self-motion of a pose, as CasADi functions.

One evaluation at `q` factors the transposed Jacobian, `J' = Q [R; 0]`, by Householder reflections
(Golub and Van Loan, Matrix Computations, 4th ed., section 5.2.2). From the factors follow

- the step of least norm to the pose, `dq = Q [R'^-1 e; 0]` (Gauss-Newton);
- the null vector of J, `Q e7`, with the sign that makes `det [J; null']` positive;
- that determinant, which is the product of the diagonal of R;
- a measure of rank: `1 / |R^-1|`, in the Frobenius norm at most the smallest singular value of J,
  and more than a third of it.

One step of continuation (with the criteria of `baxter_kin.ik.self_motion.continuation`) is four
evaluations; `BLOCK` steps are one function, since a call from Python costs as much as several
steps.

All dimensions of an arm are inputs: for arms as drawn, fewer would save no time, and their right
angles would be exact only to the eleven digits of the URDF.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from baxter_kin.compilation.buffered import BufferedFunction
from baxter_kin.compilation.machine_code import compiled
from baxter_kin.ik.search.search_function import SEEN_FROM, rotation_error, symbols
from baxter_kin.kinematics.arm import Arm
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.kinematics.symbolic import Shape, SymbolicChain, dimensions_of
from baxter_kin.validation import FloatArray

BLOCK = 32
"""Steps of continuation in one call."""

LANES = 32
"""Number of configurations that one call corrects."""

CORRECTIONS = 3
"""Newton steps of one call: from a distance of 0.01 rad to rounding."""

MAX_TURN_RAD = 0.2
"""Maximum turn of the tangent in one step, for which cubics between the points are accurate to
1e-4 rad, mostly to 1e-5."""

MIN_STEP_RAD = 1e-6
"""A curve that needs shorter steps turns as sharply as where branches meet."""

SINGULAR = 1e-6
"""Smallest singular value of J, in m and rad, at which its rank counts as five.

It grows in proportion to the distance from the singularity, by 0.001 to 1 per rad. Two branches
this close reach poses that differ by about 1e-12 to a thousand times as much: they cannot be
distinguished safely."""

_MAX_CORRECTION = 0.25
"""Maximum correction as a share of the step; beyond, it may lead to another branch."""

_MAX_NEWTON_RAD = 1.0

RESIDUAL_TOLERANCE = 1e-12
"""Norm of the pose error of a corrected configuration, in m and rad together. Rounding causes
1e-15."""

_GROWTH = 1.5
"""Growth of the step where the curve is straight enough for the longer one."""


@cache
def curve_functions() -> tuple[ca.Function, ...]:
    """The functions to measure one, correct one, correct `LANES`, and march `BLOCK` steps.

    The last two inputs of each are a pose of the last axis seen from the first, 4 x 4, and the
    arm's dimensions (`dimensions_of`).
    """
    newton = _newton_function()
    correct = _correct_function(newton)
    many = correct.map("correct_many", "serial", LANES, [2, 3], [])
    return _measure_function(newton), correct, many, _march_function(_step_function(newton))


def _newton_function() -> ca.Function:
    """`(q, T_first_last, dimensions) -> (dq, null vector, determinant, residual, rank)`."""
    chain, T = SymbolicChain.of_shape(Shape.GENERAL, SEEN_FROM), ca.SX.sym("T", 4, 4)
    R_target = chain.R_link_first @ T[:3, :3]
    p_target = chain.R_link_first @ T[:3, 3] + chain.p_link_first + R_target @ chain.p_last_tip
    p_tip = chain.p_link_last + chain.R_link_last @ chain.p_last_tip
    e = ca.vertcat(p_target - p_tip, rotation_error(R_target, chain.R_link_last)[0])
    columns = [
        ca.vertcat(ca.cross(axis, p_tip - origin), axis)
        for axis, origin in zip(chain.axes, chain.origins, strict=True)
    ]
    factors = _Householder(ca.horzcat(*columns).T)
    determinant = factors.determinant
    sign = ca.if_else(determinant >= 0, 1, -1)
    outputs = [
        factors.rotated(ca.vertcat(factors.forward(e), 0)),
        sign * factors.rotated(ca.SX([0, 0, 0, 0, 0, 0, 1])),
        sign * determinant,
        ca.norm_2(e),
        factors.rank,
    ]
    return ca.Function("newton", [chain.q, T, chain.dimensions], outputs, {"cse": True})


class _Householder:
    """`A = Q [R; 0]` for a matrix with one row more than columns, as expressions.

    Attributes:
        determinant: the product of the diagonal of R: det [A, Q e_n] for an even number of
            reflections.
        rank: 1 / |R^-1|.
    """

    def __init__(self, A: ca.SX) -> None:
        rows, n = A.shape
        columns = [A[:, j] for j in range(n)]
        self._n, self._reflectors = n, []
        for k in range(n):
            x = columns[k][k:]
            norm = ca.norm_2(x)
            sign = ca.if_else(x[0] >= 0, 1, -1)
            v = ca.vertcat(x[0] + sign * norm, x[1:])
            self._reflectors.append((v, 1 / (norm * (norm + ca.fabs(x[0])))))
            columns[k] = ca.vertcat(columns[k][:k], -sign * norm, ca.SX.zeros(rows - k - 1))
            for j in range(k + 1, n):
                columns[j] = self._reflected(k, columns[j])
        self._R = ca.horzcat(*columns)[:n, :]
        self.determinant = math.prod((self._R[k, k] for k in range(n)), start=ca.SX(1))
        inverse = [self.forward(unit) for unit in ca.horzsplit(ca.SX.eye(n))]
        self.rank = 1 / ca.norm_fro(ca.horzcat(*inverse))

    def forward(self, b: ca.SX) -> ca.SX:
        """`R'^-1 b`."""
        y: list[ca.SX] = []
        for i in range(self._n):
            known = sum((self._R[k, i] * y[k] for k in range(i)), start=ca.SX(0))
            y.append((b[i] - known) / self._R[i, i])
        return ca.vertcat(*y)

    def rotated(self, y: ca.SX) -> ca.SX:
        """`Q y`."""
        for k in reversed(range(self._n)):
            y = self._reflected(k, y)
        return y

    def _reflected(self, k: int, y: ca.SX) -> ca.SX:
        v, beta = self._reflectors[k]
        return ca.vertcat(y[:k], y[k:] - beta * ca.dot(v, y[k:]) * v)


def _measure_function(newton: ca.Function) -> ca.Function:
    """`(q, ...) -> (q, null vector, determinant, residual, rank)` as a column of 17."""
    q, *arm = symbols(newton)
    return ca.Function("measure", [q, *arm], [ca.vertcat(q, *newton(q, *arm)[1:])])


def _correct_function(newton: ca.Function) -> ca.Function:
    """`(q, normal, ...) -> (q, null vector, determinant, residual, rank)` as a column of 17."""
    (q, *arm), normal = symbols(newton), ca.MX.sym("normal", 7)
    moved = q
    for _ in range(CORRECTIONS):
        dq, null, *_ = newton(moved, *arm)
        along = ca.dot(normal, null)
        is_plane = ca.fabs(along) > 0
        moved = moved + _bounded(dq - ca.if_else(is_plane, ca.dot(normal, dq) / along, 0) * null)
    column = ca.vertcat(moved, *newton(moved, *arm)[1:])
    return ca.Function("correct", [q, normal, *arm], [column])


def _bounded(dq: ca.MX) -> ca.MX:
    """A Newton step, shortened to the range in which the linearisation is useful."""
    return dq / ca.fmax(1, ca.norm_2(dq) / _MAX_NEWTON_RAD)


def _march_function(attempt: ca.Function) -> ca.Function:
    """`BLOCK` attempts in a row: `(state, max step, ...) -> states`, 25 x `BLOCK`."""
    state, *shared = inputs = symbols(attempt)
    states = []
    for _ in range(BLOCK):
        state = attempt(state, *shared)
        states.append(state)
    return ca.Function("march", inputs, [ca.horzcat(*states)])


def _step_function(newton: ca.Function) -> ca.Function:
    """One attempt `(state, max step, ...) -> state`.

    State, a column of 25: q, tangent, d(tangent)/ds, step, determinant, 1 if accepted, residual.
    """
    state, longest = ca.MX.sym("state", 25), ca.MX.sym("longest")
    _, *arm = symbols(newton)
    q, tangent, bend, step = state[:7], state[7:14], state[14:21], state[21]
    predicted = q + step * (tangent + 0.5 * step * bend)
    moved = predicted
    for _ in range(CORRECTIONS):
        moved = moved + _bounded(newton(moved, *arm)[0])
    _, null, size, residual, rank = newton(moved, *arm)
    way = ca.if_else(ca.dot(null, tangent) >= 0, 1, -1)
    ahead, determinant = way * null, way * size
    cosine = ca.dot(ahead, tangent)
    is_good = residual <= RESIDUAL_TOLERANCE
    for condition in (
        ca.norm_2(moved - predicted) <= _MAX_CORRECTION * step,
        cosine > math.cos(MAX_TURN_RAD),
        determinant * state[22] >= 0,
        rank > SINGULAR,
        step >= MIN_STEP_RAD,
    ):
        is_good = ca.logic_and(is_good, condition)
    longer = ca.fmin(longest, _GROWTH * step)
    next_step = ca.if_else(cosine > math.cos(MAX_TURN_RAD / _GROWTH), longer, step)
    taken = ca.vertcat(moved, ahead, (ahead - tangent) / step, next_step, determinant, 1, residual)
    refused = ca.vertcat(q, tangent, bend, 0.5 * step, state[22], 0, state[24])
    new = ca.if_else(is_good, taken, refused)
    return ca.Function("attempt", [state, longest, *arm], [new])


class Corrected(NamedTuple):
    """n configurations after Newton's method, with their measures.

    Attributes:
        q: shape (n, 7), rad.
        tangent: unit null vectors with positive `det [J; tangent']`, shape (n, 7).
        determinant: that determinant, shape (n,).
        residual: norm of the pose error, m and rad together, shape (n,).
        rank: between a third of the smallest singular value of J and that value, shape (n,).
    """

    q: FloatArray
    tangent: FloatArray
    determinant: FloatArray
    residual: FloatArray
    rank: FloatArray


class Steps(NamedTuple):
    """n accepted steps of continuation, and the state to continue from.

    Attributes:
        q: shape (n, 7), rad.
        tangent: unit directions of travel, shape (n, 7).
        determinant: `det [J; tangent']`, shape (n,).
        residual: norm of the pose error, m and rad together, shape (n,).
        state: of the last attempt, for the next call.
    """

    q: FloatArray
    tangent: FloatArray
    determinant: FloatArray
    residual: FloatArray
    state: FloatArray

    @property
    def step_rad(self) -> float:
        """The length of the next attempt."""
        return float(self.state[21])


class CurveKernel:
    """The functions for one arm, for any number of threads."""

    def __init__(self, dh: DHParameters, functions: Sequence[ca.Function]) -> None:
        self._measure, self._one, self._many, self._march = map(BufferedFunction, functions)
        self._dimensions = dimensions_of(dh)[None]
        self._first = dh.T_base_first.inverse().homogeneous
        self._last = dh.T_last_tip.inverse().homogeneous

    @classmethod
    def of(cls, arm: Arm) -> CurveKernel:
        """The kernel of an arm, as machine code if possible."""
        return _kernel(arm)

    def measured(self, q: FloatArray, T: FloatArray) -> Corrected:
        """The measures of one configuration, without correction.

        Args:
            q: shape (7,), rad.
            T: the pose as a matrix, shape (4, 4).
        """
        return _corrected(self._measure(q[None], *self._shared(T))[0])

    def corrected(self, q: FloatArray, normal: FloatArray, T: FloatArray) -> Corrected:
        """One configuration, moved onto the curve within a hyperplane.

        Args:
            q: shape (7,), rad.
            normal: of the hyperplane, shape (7,); zeros for the step of least norm.
            T: the pose as a matrix, shape (4, 4).

        Returns:
            Arrays for n = 1; NaN where a matrix is singular.
        """
        return _corrected(self._one(q[None], normal[None], *self._shared(T))[0])

    def corrected_many(self, q: FloatArray, normal: FloatArray, T: FloatArray) -> Corrected:
        """As `corrected`, for configurations of one pose, shape (n, 7)."""
        parts, shared = [np.empty((0, 17))], self._shared(T)
        for at in range(0, len(q), LANES):
            part = slice(at, at + LANES)
            count = len(q[part])
            parts.append(self._many(q[part], normal[part], *shared)[0][:count])
        return _corrected(np.concatenate(parts))

    def start_state(
        self, q: FloatArray, tangent: FloatArray, determinant: float, step_rad: float
    ) -> FloatArray:
        """The state from which `march` starts: a point of the curve and its direction of travel."""
        return np.concatenate([q, tangent, np.zeros(7), [step_rad, determinant, 1.0, 0.0]])

    def march(self, state: FloatArray, T: FloatArray, max_step_rad: float) -> Steps:
        """Make `BLOCK` attempts at a step; a failed attempt halves the next one.

        Args:
            state: from `start_state` or the last call.
            T: the pose as a matrix, shape (4, 4).
            max_step_rad: the longest step.
        """
        states = self._march(state[None], np.array([[max_step_rad]]), *self._shared(T))[0]
        taken = states[states[:, 23] == 1.0]
        return Steps(taken[:, :7], taken[:, 7:14], taken[:, 22], taken[:, 24], states[-1])

    def _shared(self, T: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The last two inputs of each function, for a pose of the tip."""
        return (self._first @ T @ self._last).T, self._dimensions


@lru_cache(maxsize=16)
def _kernel(arm: Arm) -> CurveKernel:
    return CurveKernel(DHParameters.of(arm), _functions())


@cache
def _functions() -> Sequence[ca.Function]:
    functions = curve_functions()
    return compiled(functions) or functions


def _corrected(rows: FloatArray) -> Corrected:
    return Corrected(rows[:, :7], rows[:, 7:14], rows[:, 14], rows[:, 15], rows[:, 16])
