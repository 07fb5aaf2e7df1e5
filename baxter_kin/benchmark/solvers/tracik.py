"""TRAC-IK through pytracik: KDL's Newton and NLopt's SQP, side by side in two threads.

It reads the stock robot's URDF, so with a robot of one's own it does not take part. Two threads are
its nature and cannot be turned off.
"""

from __future__ import annotations

from importlib.metadata import version

import numpy as np
from trac_ik import TracIK

from baxter_kin.benchmark.entrants import Contestant, short
from baxter_kin.description import StockFiles
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray

TIMEOUT_S = 0.005
"""As published by its authors for Baxter (Beeson and Ames, Humanoids 2015), and its default."""


def contestant(arm: Arm, *, epsilon: float) -> Contestant:
    """The solver.

    Args:
        arm: whose tip to place.
        epsilon: greatest error along and about each axis, m and rad; 1e-5 is its default.
    """
    urdf = str(StockFiles.installed().urdf)
    solver = TracIK("base", arm.tip_frame, urdf, timeout=TIMEOUT_S, epsilon=epsilon)
    solver.joint_limits = arm.limits.q_min, arm.limits.q_max  # it reads them in single precision

    def forward(q: FloatArray) -> FloatArray:
        T_base_tip = np.eye(4)
        T_base_tip[:3, 3], T_base_tip[:3, :3] = solver.fk(q)
        return T_base_tip

    return Contestant(
        name=f"TRAC-IK (eps {short(epsilon)})",
        version=f"pytracik {version('pytracik')}",
        settings=f"`TracIK.ik`, Speed, {1e3 * TIMEOUT_S:g} ms, eps {short(epsilon)} per axis; it "
        "always runs two threads",
        prepare=lambda pose, q_seed: (pose.translation.copy(), pose.rotation.copy(), q_seed.copy()),
        call=solver.ik,
        read=lambda q: q,
        forward=forward,
    )
