"""What a trajectory's numbers say: states at 1 kHz, and whether they are a motion within limits.

Positions are the cubics through the knots: `q + v t + a t^2 / 2 + j t^3 / 6` after each.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from referee.findings import Finding
from referee.solids import Array
from referee.urdf import Robot

STEP_S = 1e-3

ROUNDING = 1e-7
"""Largest difference of q, v or a that counts as none; rad, s."""


class States(NamedTuple):
    """Times, shape (n,), s, and states, shape (n, 7); rad and s."""

    t: Array
    q: Array
    v: Array
    a: Array


def sampled(trajectory: Any) -> States:
    """Every millisecond, every knot, and the end."""
    knots = np.array(trajectory.knots_s, dtype=float)
    t = np.union1d(np.arange(0.0, knots[-1], STEP_S), knots)
    return states_at(trajectory, t)


def states_at(trajectory: Any, t: Array) -> States:
    """The states at times within the motion, shape (n,)."""
    knots = np.array(trajectory.knots_s, dtype=float)
    i = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, max(len(knots) - 2, 0))
    dt = (t - knots[i])[:, None]
    q, v, a = (np.array(getattr(trajectory, name))[i] for name in "qva")
    j = np.array(trajectory.j)[i] if len(knots) > 1 else np.zeros_like(q)
    return States(
        t, q + dt * (v + dt * (a / 2 + dt * j / 6)), v + dt * (a + dt * j / 2), a + dt * j
    )


def motion_faults(plan: Any, robot: Robot) -> Iterator[Finding]:
    """Jumps, limits of the URDF that are exceeded, and motion where there should be rest."""
    joints = [robot.joint(name) for name in arm_joints(plan.limb)]
    lower, upper, speed = (
        np.array([getattr(joint, name) for joint in joints]) for name in ("lower", "upper", "speed")
    )
    q, v, a = np.array(plan.q_start, dtype=float), np.zeros(7), np.zeros(7)
    for step in plan.steps:
        if not hasattr(step, "trajectory"):
            yield from _unrest(step.label, v, a)
            continue
        label, trajectory = step.label, step.trajectory
        states = sampled(trajectory)
        for name, before, now in zip("qva", (q, v, a), states[1:], strict=True):
            yield from _jump(label, f"{name} at its start", now[0] - before)
        yield from _knot_jumps(label, trajectory)
        over = np.maximum(lower - states.q, states.q - upper).max(axis=0)
        yield from _excess(label, "position", over, joints)
        yield from _excess(label, "velocity", np.abs(states.v).max(axis=0) - speed, joints)
        q, v, a = states.q[-1], states.v[-1], states.a[-1]
    yield from _unrest("the end", v, a)


def arm_joints(limb: str) -> tuple[str, ...]:
    """The seven joints of an arm, from the shoulder on."""
    return tuple(f"{limb}_{name}" for name in ("s0", "s1", "e0", "e1", "w0", "w1", "w2"))


def _knot_jumps(label: str, trajectory: Any) -> Iterator[Finding]:
    """Where the cubic from one knot does not lead to the next."""
    knots = np.array(trajectory.knots_s, dtype=float)
    dt, j = np.diff(knots)[:, None], np.array(trajectory.j)
    q, v, a = (np.array(getattr(trajectory, name)) for name in "qva")
    before = q[:-1], v[:-1], a[:-1]
    ends = (
        before[0] + dt * (before[1] + dt * (before[2] / 2 + dt * j / 6)),
        before[1] + dt * (before[2] + dt * j / 2),
        before[2] + dt * j,
    )
    for name, end, now in zip("qva", ends, (q[1:], v[1:], a[1:]), strict=True):
        yield from _jump(label, f"{name} at a knot", end - now)


def _jump(label: str, what: str, difference: Array) -> Iterator[Finding]:
    jump = float(np.abs(difference).max(initial=0.0))
    if jump > ROUNDING:
        yield Finding("jumps", label, 0.0, what, "", jump)


def _unrest(label: str, v: Array, a: Array) -> Iterator[Finding]:
    left = float(max(np.abs(v).max(), np.abs(a).max()))
    if left > ROUNDING:
        yield Finding("moves where it should rest", label, 0.0, "arm", "", left)


def _excess(label: str, what: str, over: Array, joints: list[Any]) -> Iterator[Finding]:
    worst = int(over.argmax())
    if over[worst] > ROUNDING:
        yield Finding(f"{what} limit", label, 0.0, joints[worst].name, "", float(over[worst]))
