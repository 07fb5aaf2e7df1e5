"""Starts that are nearly solutions: inverse kinematics in closed form, except for the wrist offset.

For a given s0 the shoulder S is known, and the pose gives the wrist W (letters as in
`baxter_kin.ik.reach.linkage`). If the wrist were on the forearm's axis, |W - S| would give e1, the
height of W above the plane in which s1 turns would give e0, the direction within that plane s1, and
the tool's direction w0 and w1: two solutions each for e1, e0 and the wrist. Because of the offset
of 10 mm, all of these depend slightly on w0; a few rounds of substitution take it into account.
Sines and cosines out of range are clipped: such a start is the nearest configuration, no solution.
If the wrist is nearly straight, w0 follows from the offset alone, and the result depends on the
initial value of the substitution.

A sweep over s0 visits the whole self-motion of a pose. So if a start is inside the limits, or
nearly so, one search from it finds the solution.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from baxter_kin.ik.reach.linkage import Linkage
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray

SUBSTITUTIONS = 3

BLOCK = 64
"""Number of poses computed together, whose arrays fit in the processor's cache."""

_MIN_M = 1e-12

_SIGNS = np.array([(e1, e0, w1) for e1 in (1, -1) for e0 in (1, -1) for w1 in (1, -1)], float)

_Parts: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""A direction along a stage's axis, along its offset, and along axis x offset; or a point, m."""


class ClosedForm:
    """Configurations of one arm that nearly reach a pose, over all of its self-motion."""

    def __init__(self, arm: Arm, *, turns: int, rolls: int) -> None:
        """Read the arm's dimensions.

        Args:
            arm: the arm.
            turns: number of angles of s0, in equal steps.
            rolls: number of initial values of w0 for the substitution.
        """
        self._arm = Linkage.of(arm)
        self._q_min, self._q_max = arm.limits.q_min, arm.limits.q_max
        self._s0 = np.linspace(self._q_min[0], self._q_max[0], turns)
        self._w0 = np.repeat(np.arange(rolls) * (2.0 * np.pi / rolls), len(_SIGNS))
        self._signs = np.tile(_SIGNS.T, rolls)

    def starts(self, Ts: FloatArray, count: int) -> FloatArray:
        """Starts for poses, those that violate the limits least first, clipped to the limits.

        Args:
            Ts: poses as matrices seen from base, shape (m, 4, 4).
            count: number of starts for each pose.

        Returns:
            Shape (m, count, 7), rad.
        """
        chosen = np.empty((len(Ts), count, 7))
        for at in range(0, len(Ts), BLOCK):
            part = slice(at, at + BLOCK)
            q, misfit = self.configurations(Ts[part])
            excess = np.maximum(self._q_min - q, q - self._q_max).clip(min=0.0).sum(axis=2)
            best = np.argsort(excess + misfit, axis=1, kind="stable")[:, :count]
            chosen[part] = np.take_along_axis(q, best[:, :, None], axis=1)
        return chosen.clip(self._q_min, self._q_max)

    def configurations(self, Ts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """All configurations; only the limits of s0 are taken into account.

        Args:
            Ts: poses as matrices seen from base, shape (m, 4, 4).

        Returns:
            Configurations, shape (m, n, 7), rad, all angles in [-pi, pi); and the amounts by which
            sines and cosines were clipped, shape (m, n), zero for those that reach the pose.
        """
        targets = self._arm.targets(Ts)
        s0 = self._turns(targets[:, :3, 3])
        tool_z, tool_x, wrist = (_seen(targets[:, :3, i], s0) for i in (2, 0, 3))
        radially, down, sideways = wrist
        target = (radially - self._arm.shoulder_offset_m, down, sideways)
        e1_sign, e0_sign, w1_sign = self._signs
        w0 = self._w0
        for _ in range(SUBSTITUTIONS):
            e1, misfit = self._elbow(target, w0, e1_sign)
            s1, e0, clipped = self._shoulder_angles(target, e1, w0, e0_sign)
            along, swing, across = _bent(_rolled(_bent(tool_z, s1), e0), e1)
            w0 = np.arctan2(w1_sign * across, w1_sign * swing)
        w1 = np.arctan2(w1_sign * np.hypot(across, swing), along)
        forearm = _rolled(_bent(_rolled(_bent(tool_x, s1), e0), e1), w0)
        _, x, y = _bent(forearm, w1)
        angles = np.broadcast_arrays(s0[:, :, None], s1, e0, e1, w0, w1, np.arctan2(y, x))
        q = np.stack(angles, axis=-1).reshape(len(Ts), -1, 7) - self._arm.q_offset
        q[..., 1:] = (q[..., 1:] + np.pi) % (2.0 * np.pi) - np.pi
        return q, (misfit + clipped).reshape(len(Ts), -1)

    def _turns(self, wrist: FloatArray) -> FloatArray:
        """The angles of s0 to try for wrists seen from the first axis, (m, 3): shape (m, n).

        In addition to equal steps, the two at which the shoulder points to the wrist or away from
        it: at the end of its reach the arm has no other solutions.
        """
        aligned = np.arctan2(wrist[:, 1], wrist[:, 0])
        both = np.stack([aligned, aligned + np.pi], axis=1)
        wrapped = np.arctan2(np.sin(both), np.cos(both)).clip(self._q_min[0], self._q_max[0])
        return np.hstack([np.tile(self._s0, (len(wrist), 1)), wrapped])

    def _elbow(
        self, target: _Parts, w0: FloatArray, sign: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """e1 from |W - S|, and the amount by which its cosine was clipped."""
        arm, offset = self._arm, self._arm.wrist_offset_m * np.cos(w0)
        square = sum(part**2 for part in target) - arm.upper_span_m**2 - arm.fore_span_m**2
        cosine_part = arm.upper_m * arm.fore_m + arm.elbow_offset_m * offset
        sine_part = arm.elbow_offset_m * arm.fore_m - arm.upper_m * offset
        cosine = 0.5 * square / np.hypot(cosine_part, sine_part)
        inside = cosine.clip(-1.0, 1.0)
        e1 = np.arctan2(sine_part, cosine_part) + sign * np.arccos(inside)
        return e1, np.abs(cosine - inside)

    def _shoulder_angles(
        self, target: _Parts, e1: FloatArray, w0: FloatArray, sign: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """s1 and e0 from the direction of W - S, and the amount by which a sine was clipped."""
        arm, (radially, down, sideways) = self._arm, target
        swing, across = arm.wrist_offset_m * np.cos(w0), arm.wrist_offset_m * np.sin(w0)
        u = arm.upper_m + arm.fore_m * np.cos(e1) - swing * np.sin(e1)
        r = arm.elbow_offset_m + arm.fore_m * np.sin(e1) + swing * np.cos(e1)
        radius = np.hypot(r, across).clip(min=_MIN_M)
        sine = sideways / radius
        inside = sine.clip(-1.0, 1.0)
        rise = np.arcsin(inside)
        roll = np.where(sign > 0.0, rise, np.pi - rise)
        s1 = np.arctan2(down, radially) - np.arctan2(radius * np.cos(roll), u)
        return s1, roll - np.arctan2(across, r), np.abs(sine - inside)


def _seen(v: FloatArray, azimuth: FloatArray) -> _Parts:
    """Components of vectors of base, (m, 3), radially, down and sideways, each (m, n, 1)."""
    (x, y, z), c, s = v.T[:, :, None], np.cos(azimuth), np.sin(azimuth)
    down = np.broadcast_to(-z, azimuth.shape)
    return (c * x + s * y)[..., None], down[..., None], (c * y - s * x)[..., None]


def _bent(parts: _Parts, angle: FloatArray) -> _Parts:
    """Components of a direction along the axes of a stage after its bend."""
    (axis, offset, across), c, s = parts, np.cos(angle), np.sin(angle)
    return c * axis + s * offset, c * offset - s * axis, across


def _rolled(parts: _Parts, angle: FloatArray) -> _Parts:
    """Components of a direction along the axes of a stage after its roll."""
    (axis, offset, across), c, s = parts, np.cos(angle), np.sin(angle)
    return axis, c * offset + s * across, c * across - s * offset
