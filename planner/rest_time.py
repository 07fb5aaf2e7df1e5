"""How long the fastest motion between two configurations at rest takes, in closed form.

One joint accelerates, cruises and brakes, each change of acceleration at full jerk. Short ways
reach neither the greatest acceleration nor velocity, longer ones the first, long ones both
(Biagiotti and Melchiorri, "Trajectory Planning for Automatic Machines and Robots", Springer 2008,
section 3.4). The slowest joint sets the duration of all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin import JointLimits
from baxter_kin.arrays import Vector, float_array
from baxter_kin.errors import expect
from planner.errors import MotionError


def rest_to_rest_s(displacement: ArrayLike, limits: JointLimits) -> Vector:
    """Durations of the fastest motions from rest to rest, shape (...,), s.

    What `plan_joint_move` takes, a hundred times faster and for many ways at once.

    Args:
        displacement: of the joints, shape (..., n), rad, finite.
        limits: of those n joints.

    Raises:
        MotionError: when the last axis is none of n finite numbers.
    """
    names = expect(limits, JointLimits, "limits", MotionError).names
    way = np.abs(float_array(displacement, "displacement", MotionError))
    if not way.ndim or way.shape[-1] != len(names) or not np.isfinite(way).all():
        raise MotionError(f"a displacement is {len(names)} finite numbers, got shape {way.shape}")
    v, a, j = limits.v_max, limits.a_max, limits.j_max
    a_top = np.minimum(a, np.sqrt(v * j))  # what velocity leaves room for
    unlimited = 4.0 * np.cbrt(way / (2.0 * j))
    v_top = 0.5 * (np.sqrt((a_top**2 / j) ** 2 + 4.0 * a_top * way) - a_top**2 / j)
    steady = 2.0 * (v_top / a_top + a_top / j)
    cruising = way / v + v / a_top + a_top / j
    needs_less = j * unlimited / 4.0 <= a_top
    joints = np.where(needs_less, unlimited, np.where(v_top <= v, steady, cruising))
    slowest: Vector = joints.max(axis=-1)
    return slowest
