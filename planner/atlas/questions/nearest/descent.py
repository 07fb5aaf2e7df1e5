"""The nearest pose from a start, in joint angles: bounded least squares.

What must stay of the pose is weighted so heavily that it stays within the tolerances of inverse
kinematics; the rest is what is made small. Damped steps (Levenberg and Marquardt), with joints held
at limits that they are pushed against (projected Newton; Bertsekas 1982). It finds a minimum next
to the start, and every configuration on the way is inside the limits.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray
from planner.atlas.questions.nearest.measure import Keep, PoseMeasure

STIFF = 1e4
"""Weight of what must stay, per m or rad: a distance of 0.1 draws at it by 1e-9."""

STEPS, STALLED_STEPS, GAIN = 400, 12, 1e-10
"""Steps at most, and after how many that gain less than this share the search ends."""


def descended(
    arm: Arm, T_base_tip: pin.SE3, q_start: FloatArray, measure: PoseMeasure
) -> FloatArray:
    """The configuration with the nearest pose that is found from a start, shape (7,), rad.

    Args:
        arm: whose.
        T_base_tip: the pose to come near.
        q_start: shape (7,), rad.
        measure: what must stay, and what counts.
    """
    q = q_start.clip(arm.limits.q_min, arm.limits.q_max)
    weights = _weights(measure)
    error, J = _linearized(arm, T_base_tip, q, weights)
    damping, stalled = 1e-3, 0
    for _ in range(STEPS):
        tried = _stepped(arm, q, error, J, damping)
        new_error, new_J = _linearized(arm, T_base_tip, tried, weights)
        gained = error @ error - new_error @ new_error
        stalled = 0 if gained > GAIN * (error @ error) else stalled + 1
        if gained > 0.0:
            q, error, J, damping = tried, new_error, new_J, damping / 4.0
        else:
            damping *= 5.0
        if stalled == STALLED_STEPS:
            break
        damping = min(max(damping, 1e-14), 1e8)
    return q


def _weights(measure: PoseMeasure) -> FloatArray:
    """Of the displacement and of the rotation vector, shape (6,)."""
    metres, radians = measure.weights
    metres = STIFF if measure.keep is Keep.POSITION else metres
    radians = STIFF if measure.keep is Keep.ORIENTATION else radians
    return np.repeat([metres, radians], 3)


def _stepped(
    arm: Arm, q: FloatArray, error: FloatArray, J: FloatArray, damping: float
) -> FloatArray:
    """A damped step inside the limits; by orthogonal factors, as the weights differ widely."""
    low, high = arm.limits.q_min, arm.limits.q_max
    descent = J.T @ error
    free = ~(((q <= low) & (descent < 0.0)) | ((q >= high) & (descent > 0.0)))
    step = np.zeros(7)
    if free.any():
        damped = np.vstack([J[:, free], np.sqrt(damping) * np.eye(int(free.sum()))])
        wanted = np.concatenate([error, np.zeros(int(free.sum()))])
        step[free] = np.linalg.lstsq(damped, wanted, rcond=None)[0]
    moved: FloatArray = (q + step).clip(low, high)
    return moved


def _linearized(
    arm: Arm, T_base_tip: pin.SE3, q: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Weighted error, shape (6,), and Jacobian, (6, 7), in axes of base."""
    T = arm.T_base_tip(q)
    turned = pin.log3(T_base_tip.rotation @ T.rotation.T)
    error = np.concatenate([T_base_tip.translation - T.translation, turned])
    return weights * error, weights[:, None] * arm.jacobian(q)
