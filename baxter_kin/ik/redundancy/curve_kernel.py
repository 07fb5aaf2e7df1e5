"""The functions of `baxter_kin.ik.redundancy.curve_functions` for one arm, ready to run.

They run as machine code where a C compiler is found, compiled once for all robots, else in CasADi's
virtual machine, six times as slow.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from baxter_kin.compilation.buffered import BufferedFunction
from baxter_kin.compilation.machine_code import compiled
from baxter_kin.ik.redundancy.curve_functions import LANES, curve_functions
from baxter_kin.kinematics.arm import Arm
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.kinematics.symbolic import dimensions_of
from baxter_kin.validation import FloatArray


class Corrected(NamedTuple):
    """Configurations after Newton's method, and what is measured there; n of them.

    Attributes:
        q: shape (n, 7), rad.
        tangent: unit null vectors with positive `det [J; tangent']`, shape (n, 7).
        determinant: that determinant, shape (n,).
        residual: norm of the pose error, m and rad together, shape (n,).
        rank: at most the smallest singular value of J and more than a third of it, shape (n,).
    """

    q: FloatArray
    tangent: FloatArray
    determinant: FloatArray
    residual: FloatArray
    rank: FloatArray


class Steps(NamedTuple):
    """Accepted steps of continuation, n of them, and what goes on from there.

    Attributes:
        q: shape (n, 7), rad.
        tangent: unit directions of travel, shape (n, 7).
        determinant: `det [J; tangent']`, shape (n,).
        residual: norm of the pose error, m and rad together, shape (n,).
        state: of the last attempt; hand it to the next call.
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
    """The functions for one arm; any number of threads."""

    def __init__(self, dh: DHParameters, functions: Sequence[ca.Function]) -> None:
        self._measure, self._one, self._many, self._march = map(BufferedFunction, functions)
        self._dimensions = dimensions_of(dh)[None]
        self._first = dh.T_base_first.inverse().homogeneous
        self._last = dh.T_last_tip.inverse().homogeneous

    @classmethod
    def of(cls, arm: Arm) -> CurveKernel:
        """That of an arm, as machine code where it can be.

        Raises:
            DescriptionError: when the arm is not built like Baxter's.
        """
        return _kernel(arm)

    def measured(self, q: FloatArray, T: FloatArray) -> Corrected:
        """What `corrected` tells of one configuration, shape (7,), rad, where it is.

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
            Rows of one; no number where a matrix is singular.
        """
        return _corrected(self._one(q[None], normal[None], *self._shared(T))[0])

    def corrected_many(self, q: FloatArray, normal: FloatArray, T: FloatArray) -> Corrected:
        """The same for configurations of one pose, shape (n, 7)."""
        parts, shared = [np.empty((0, 17))], self._shared(T)
        for at in range(0, len(q), LANES):
            part = slice(at, at + LANES)
            count = len(q[part])
            parts.append(self._many(q[part], normal[part], *shared)[0][:count])
        return _corrected(np.concatenate(parts))

    def start_state(
        self, q: FloatArray, tangent: FloatArray, determinant: float, step_rad: float
    ) -> FloatArray:
        """What `march` starts from: a point of the curve and its direction of travel."""
        return np.concatenate([q, tangent, np.zeros(7), [step_rad, determinant, 1.0, 0.0]])

    def march(self, state: FloatArray, T: FloatArray, max_step_rad: float) -> Steps:
        """`BLOCK` attempts at a step; those that fail halve the next one.

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
