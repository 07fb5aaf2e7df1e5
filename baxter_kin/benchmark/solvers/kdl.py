"""Orocos KDL through PyKDL: Newton-Raphson with clamped joint limits, no restarts.

The chain is built from the arm's own joint placements.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import PyKDL

from baxter_kin.benchmark.entrants import Contestant, short
from baxter_kin.benchmark.solvers.chain import placements_about_z
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray

ITERATIONS = 100
"""Its default."""

EPSILON = 5e-7
"""Greatest error along and about each axis, m and rad: the loosest that implies 1e-6 altogether."""


def contestant(arm: Arm) -> Contestant:
    """The solver."""
    chain = _Chain(arm)
    return Contestant(
        name="KDL",
        version=f"PyKDL {getattr(PyKDL, '__version__', 'unknown')}",
        settings=f"`ChainIkSolverPos_NR_JL` on `ChainIkSolverVel_pinv`, {ITERATIONS} iterations, "
        f"eps {short(EPSILON)} per axis; no restarts",
        prepare=lambda pose, q_seed: (_joints(q_seed), _frame(pose)),
        call=chain.solve,
        read=lambda answer: None if answer is None else np.array(list(answer)),
        forward=chain.forward,
    )


class _Chain:
    """Keeps what the solvers only refer to alive."""

    def __init__(self, arm: Arm) -> None:
        self._chain = _chain(arm)
        self._forward = PyKDL.ChainFkSolverPos_recursive(self._chain)
        self._velocity = PyKDL.ChainIkSolverVel_pinv(self._chain)
        self._solver = PyKDL.ChainIkSolverPos_NR_JL(
            self._chain,
            _joints(arm.limits.q_min),
            _joints(arm.limits.q_max),
            self._forward,
            self._velocity,
            ITERATIONS,
            EPSILON,
        )

    def solve(self, q_seed: Any, T_base_tip: Any) -> Any | None:
        q = PyKDL.JntArray(q_seed.rows())
        status = self._solver.CartToJnt(q_seed, T_base_tip, q)
        return q if status >= 0 else None

    def forward(self, q: FloatArray) -> FloatArray:
        frame = PyKDL.Frame()
        self._forward.JntToCart(_joints(q), frame)
        return np.array([[frame[row, column] for column in range(4)] for row in range(3)] + [_LAST])


_LAST = [0.0, 0.0, 0.0, 1.0]


def _chain(arm: Arm) -> Any:
    """A segment of KDL is a joint and what comes after it, so the first one is a fixed one."""
    placements = placements_about_z(arm)
    chain = PyKDL.Chain()
    chain.addSegment(PyKDL.Segment(PyKDL.Joint(), _frame(placements[0])))
    for placement in placements[1:]:
        chain.addSegment(PyKDL.Segment(PyKDL.Joint(PyKDL.Joint.RotZ), _frame(placement)))
    return chain


def _frame(T: pin.SE3) -> Any:
    return PyKDL.Frame(PyKDL.Rotation(*T.rotation.ravel()), PyKDL.FloatArray(*T.translation))


def _joints(q: FloatArray) -> Any:
    array = PyKDL.JntArray(len(q))
    for index, value in enumerate(q):
        array[index] = value
    return array
