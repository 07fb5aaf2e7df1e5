"""Robots as a factory calibrates them: joints a little beside where they are drawn."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from baxter_kin import Arm, Baxter

MOST_M, MOST_RAD = 0.005, 0.01
"""How far an origin may be off, and how much an axis may be turned."""


def calibrated_arm(robot: Baxter, side: str, rng: np.random.Generator, share: float = 1.0) -> Arm:
    """An arm whose joints, and tip, are off by up to a share of the most in all coordinates."""
    model = robot.model.copy()
    tip = model.getFrameId(f"{side}_gripper")
    joints = [model.getJointId(f"{side}_{name}") for name in ("s0", "s1", "e0", "e1")]
    joints += [model.getJointId(f"{side}_{name}") for name in ("w0", "w1", "w2")]
    for joint in joints:
        model.jointPlacements[joint] = model.jointPlacements[joint] * _off(rng, share)
    model.frames[tip].placement = model.frames[tip].placement * _off(rng, share)
    return Arm(side, model)


def _off(rng: np.random.Generator, share: float) -> pin.SE3:
    turn, shift = (_within(rng, share * most) for most in (MOST_RAD, MOST_M))
    return pin.SE3(pin.exp3(turn), shift)


def _within(
    rng: np.random.Generator, radius: float
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    direction = rng.standard_normal(3)
    return radius * direction / np.linalg.norm(direction)  # as far as may be
