"""Roboticstoolbox for Python: Levenberg-Marquardt with random restarts, in C++ (`ETS.ik_LM`).

The elementary transforms are built from the arm's own joint placements, so it is the same chain.
"""

from __future__ import annotations

from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np
import pinocchio as pin
from roboticstoolbox import ET, ETS

from baxter_kin.benchmark.entrants import Contestant, short
from baxter_kin.benchmark.solvers.chain import placements_about_z
from baxter_kin.kinematics.arm import Arm

SEARCHES = 1000
"""Starts before it gives up; the package's default of 100 fails on a few poses."""


def contestant(arm: Arm, *, tolerance: float) -> Contestant:
    """The solver.

    Args:
        arm: whose tip to place.
        tolerance: on half the squared length of the pose error (m and rad mixed).
    """
    ets = _transforms(arm)
    return Contestant(
        name=f"roboticstoolbox (tol {short(tolerance)})",
        version=version("roboticstoolbox-python"),
        settings=f"`ETS.ik_LM`, tol {short(tolerance)} on half the squared error, slimit "
        f"{SEARCHES}, else its defaults (Chan, 30 iterations a search)",
        prepare=lambda T_base_tip, q_seed: (T_base_tip.homogeneous, q_seed.copy()),
        call=partial(ets.ik_LM, tol=tolerance, slimit=SEARCHES),
        read=lambda solution: solution.q if solution.success else None,
        forward=lambda q: np.asarray(ets.eval(q)),
    )


def _transforms(arm: Arm) -> Any:
    *placements, last = placements_about_z(arm)
    limits = zip(arm.limits.q_min, arm.limits.q_max, strict=True)
    parts = [
        part
        for placement, (lower, upper) in zip(placements, limits, strict=True)
        for part in (_fixed(placement), ET.Rz(qlim=[lower, upper]))
    ]
    return ETS([*parts, _fixed(last)])


def _fixed(placement: pin.SE3) -> Any:
    return ET.SE3(placement.homogeneous)
