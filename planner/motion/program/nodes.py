"""What is asked of the tip at a node of a motion, with first and second derivatives.

CasADi functions of the joint angles, for any arm: its geometry is numbers among the inputs. All is
seen from the arm's first axis, as Denavit-Hartenberg parameters describe it. Those that are asked
at every knot run as machine code where a C compiler is found, compiled once for all robots.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

import casadi as ca
import numpy as np

from baxter_kin import Arm
from baxter_kin.compilation.machine_code import compiled
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.kinematics.symbolic import Shape, SymbolicChain, dimensions_of
from baxter_kin.validation import FloatArray
from planner.motion.straight_line import StraightLine

LINE_NUMBERS = 19
"""First position and rotation, way, axis and angle of the turn."""

GEOMETRY_NUMBERS = 31 + 9 + 4
"""Dimensions of the chain, rotation of the tip, what is up."""


@dataclass(frozen=True, slots=True, eq=False)
class NodeFunctions:
    """A function and its derivatives; the node's own numbers come first, the arm's last.

    Attributes:
        value: `(z, numbers, geometry) -> e`.
        first: `(z, numbers, geometry) -> de/dz`, dense.
        second: `(z, numbers, geometry, multipliers) -> d2(multipliers . e)/dz2`, dense.
    """

    value: ca.Function
    first: ca.Function
    second: ca.Function

    @property
    def all(self) -> tuple[ca.Function, ca.Function, ca.Function]:
        """In this order."""
        return self.value, self.first, self.second

    @classmethod
    def of(cls, name: str, e: ca.SX, z: ca.SX, numbers: ca.SX, geometry: ca.SX) -> NodeFunctions:
        """Differentiate."""
        given, multipliers = [z, numbers, geometry], ca.SX.sym("multipliers", e.numel())
        hessian, _ = ca.hessian(ca.dot(multipliers, e), z)
        options = {"cse": True}
        return cls(
            ca.Function(name, given, [e], options),
            ca.Function(f"{name}_first", given, [ca.densify(ca.jacobian(e, z))], options),
            ca.Function(f"{name}_second", [*given, multipliers], [ca.densify(hessian)], options),
        )


def on_line() -> NodeFunctions:
    """How far the tip is from a line: z is (q, s), e is (position, m; rotation, rad), 6 x 1.

    Against the pose at the fraction s of the way. The rotation is the sine of its angle, about the
    axes of that pose; numbers are `line_numbers`.
    """
    return _at_knots()[0]


def above() -> NodeFunctions:
    """How far the tip is above a height of base, m: z is q, the number is the height."""
    return _at_knots()[1]


@cache
def _at_knots() -> tuple[NodeFunctions, NodeFunctions]:
    functions = _on_line(), _above()
    machine_code = compiled([each for node in functions for each in node.all])
    if machine_code is None:
        return functions
    return NodeFunctions(*machine_code[:3]), NodeFunctions(*machine_code[3:])


def _on_line() -> NodeFunctions:
    q, p_tip, R_tip, geometry = _tip()
    s, numbers = ca.SX.sym("s"), ca.SX.sym("line", LINE_NUMBERS)
    p_start, R_start, way, axis, angle = ca.vertsplit(numbers, [0, 3, 12, 15, 18, 19])
    cross = ca.skew(axis)
    turn = ca.SX.eye(3) + ca.sin(angle * s) * cross + (1 - ca.cos(angle * s)) * cross @ cross
    E = (turn @ ca.reshape(R_start, 3, 3)).T @ R_tip
    skew = ca.vertcat(E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]) / 2
    e = ca.vertcat(p_tip - p_start - s * way, skew)
    return NodeFunctions.of("on_line", e, ca.vertcat(q, s), numbers, geometry)


@cache
def moving() -> NodeFunctions:
    """What a tip's motion lacks to one along a line: z is (q, q', q'', T), e is 12 x 1.

    Derivatives of q are by the fraction of the duration T; e is the tip's velocity, linear and
    angular, and acceleration by that fraction, less those of the line, m and rad. Numbers are
    `line_numbers`, then first and second derivative of the line's fraction by time.
    """
    q, p_tip, R_tip, geometry = _tip()
    dq, ddq, T = ca.SX.sym("dq", 7), ca.SX.sym("ddq", 7), ca.SX.sym("T")
    numbers = ca.SX.sym("numbers", LINE_NUMBERS + 2)
    _, way, axis, angle, speed, acceleration = ca.vertsplit(numbers, [0, 12, 15, 18, 19, 20, 21])
    W = ca.reshape(ca.jtimes(ca.vec(R_tip), q, dq), 3, 3) @ R_tip.T
    twist = ca.vertcat(ca.jtimes(p_tip, q, dq), W[2, 1], W[0, 2], W[1, 0])
    state, rates = ca.vertcat(q, dq), ca.vertcat(dq, ddq)
    line = ca.vertcat(way, angle * axis)
    e = ca.vertcat(
        twist - T * speed * line, ca.jtimes(twist, state, rates) - T**2 * acceleration * line
    )
    return NodeFunctions.of("moving", e, ca.vertcat(q, dq, ddq, T), numbers, geometry)


def _above() -> NodeFunctions:
    q, p_tip, _, geometry = _tip()
    height = ca.SX.sym("height")
    up = geometry[-4:]
    e = ca.dot(up[:3], p_tip) + up[3] - height
    return NodeFunctions.of("above", e, q, height, geometry)


def line_numbers(line: StraightLine, arm: Arm) -> FloatArray:
    """A line of the tip as `on_line` takes it, shape (19,)."""
    first = _parameters(arm).T_base_first.inverse()
    start, way, turn = first * line.T_base_start, *np.split(line.twist, 2)
    angle = np.linalg.norm(turn)
    axis = turn / angle if angle > 0.0 else np.array([0.0, 0.0, 1.0])
    parts = start.translation, start.rotation.ravel("F"), first.rotation @ way
    return np.concatenate([*parts, first.rotation @ axis, [angle]])


_parameters = lru_cache(maxsize=8)(DHParameters.of)


def geometry_numbers(arm: Arm) -> FloatArray:
    """An arm as all of them take it, shape (44,)."""
    dh = _parameters(arm)
    up = np.append(dh.T_base_first.rotation[2], dh.T_base_first.translation[2])
    return np.concatenate([dimensions_of(dh), dh.T_last_tip.rotation.ravel("F"), up])


def _tip() -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Joint angles, the tip's position and rotation seen from the first axis, the geometry."""
    chain, others = SymbolicChain.of_shape(Shape.GENERAL), ca.SX.sym("others", 9 + 4)
    p_tip = chain.p_link_last + chain.R_link_last @ chain.p_last_tip
    R_tip = chain.R_link_last @ ca.reshape(others[:9], 3, 3)
    return chain.q, p_tip, R_tip, ca.vertcat(chain.dimensions, others)
