"""Pink: differential IK, one quadratic program a step, in the loop its documentation shows."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np
import pinocchio as pin
from pink import Configuration, solve_ik
from pink.limits import ConfigurationLimit, VelocityLimit
from pink.tasks import FrameTask

from baxter_kin.benchmark.entrants import Contestant, short
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray

STEPS = 200
STEP_S = 1.0
"""So long that the velocity limits bound a step to 1.5 rad at least."""

DAMPING = 1e-2
"""Of the frame task (Levenberg-Marquardt). Of 0, 1e-3, 1e-2 and 1 it solves most and fastest."""

LIMIT_GAIN = 1.0
"""Lets a step go all the way to a joint limit; the default of 0.5 only approaches it."""

ERROR = 5e-7
"""The loop ends when the task's error, m and rad mixed, is no longer than this."""


def contestant(arm: Arm) -> Contestant:
    """The loop."""
    loop = _Loop(arm)
    return Contestant(
        name="pink",
        version=version("pin-pink"),
        settings=f"`solve_ik` with daqp, at most {STEPS} steps of {STEP_S:g} s until the error is "
        f"<= {short(ERROR)}; one `FrameTask`, costs 1 and 1, lm_damping {DAMPING:g}; position "
        f"limits with gain {LIMIT_GAIN:g} and velocity limits; no restarts",
        prepare=lambda pose, q_seed: (pose, q_seed.copy()),
        call=loop.solve,
        read=lambda q: q,
    )


class _Loop:
    def __init__(self, arm: Arm) -> None:
        self._model = arm.model.copy()  # pink writes attributes onto the model
        self._data = self._model.createData()
        self._limits = [
            ConfigurationLimit(self._model, config_limit_gain=LIMIT_GAIN),
            VelocityLimit(self._model),
        ]
        self._task = FrameTask(
            arm.tip_frame, position_cost=1.0, orientation_cost=1.0, lm_damping=DAMPING
        )

    def solve(self, T_base_tip: pin.SE3, q_seed: FloatArray) -> FloatArray | None:
        self._task.set_target(T_base_tip)
        configuration = Configuration(self._model, self._data, q_seed)
        for _ in range(STEPS):
            if np.linalg.norm(self._task.compute_error(configuration)) <= ERROR:
                return np.array(configuration.q)
            velocity = solve_ik(
                configuration, [self._task], STEP_S, solver="daqp", limits=self._limits
            )
            configuration.integrate_inplace(velocity, STEP_S)
        return None
