"""Samples of arms as recordings have them, and what is true of every motion along them."""

from __future__ import annotations

import numpy as np

from baxter_kin import Arm
from baxter_kin.validation import FloatArray
from planner import Trajectory, plan_joint_move

TOLERANCE_RAD = 0.01
NOISE_RAD = 1e-3
STEP_S = 0.01


def planned(arm: Arm, rng: np.random.Generator) -> FloatArray:
    """Moves from rest to rest that use the limits fully, with a pause."""
    q, samples = arm.start, []
    for _ in range(4):
        goal = (q + rng.uniform(-0.5, 0.5, 7)).clip(arm.limits.q_min, arm.limits.q_max)
        move = plan_joint_move(q, goal, arm.limits)
        samples.append(move.sample(np.arange(0.0, move.duration, STEP_S)).q)
        samples.append(np.tile(goal, (40, 1)))
        q = goal
    return np.concatenate(samples)


def guided(arm: Arm, rng: np.random.Generator, speed: float = 1.0) -> FloatArray:
    """Smooth wandering, as by a hand that guides the arm; it ends in motion."""
    t = np.arange(0.0, 6.0, STEP_S)[:, None]
    q = np.tile(arm.start, (len(t), 1))
    for hertz in (0.07, 0.15, 0.31, 0.6):
        phase, size = rng.uniform(0.0, 2.0 * np.pi, 7), 0.12 / (hertz / 0.15 + 0.5)
        q += (
            size
            * np.sin(2.0 * np.pi * hertz * speed * t + phase)
            * np.sin(0.5 * np.pi * np.minimum(1.0, t)) ** 2
        )
    return q


MAKERS = {"planned": planned, "guided": guided}


def noisy(q: FloatArray, rng: np.random.Generator) -> FloatArray:
    return np.asarray(q + NOISE_RAD * rng.normal(size=q.shape))


def times_of(q: FloatArray) -> FloatArray:
    return np.asarray(STEP_S * np.arange(len(q)))


def assert_within_limits(motion: Trajectory) -> None:
    """Exactly, at the extrema; at rest at both ends."""
    low, high = motion.position_extrema()
    assert max(motion.peak_ratios()) <= 1.0
    assert (low >= motion.limits.q_min).all()
    assert (high <= motion.limits.q_max).all()
    for ends in (motion.v[[0, -1]], motion.a[[0, -1]]):
        assert np.abs(ends).max(initial=0.0) < 1e-8
