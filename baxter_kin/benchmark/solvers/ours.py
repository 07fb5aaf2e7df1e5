"""This toolkit's IK service as a contestant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pinocchio as pin

from baxter_kin.benchmark.entrants import Contestant
from baxter_kin.benchmark.report import version_of
from baxter_kin.ik import IKResult, IKService
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray


def contestant(arm: Arm, **options: Any) -> Contestant:
    """The IK service.

    Args:
        arm: whose tip to place.
        options: of `IKService`, such as another solver; none gives the default.
    """
    service = IKService(arm, **options)

    def solve_batch(poses: Sequence[pin.SE3], seeds: Sequence[FloatArray]) -> Sequence[IKResult]:
        return service.solve_batch(poses, seeds=seeds)

    chosen = ", ".join(f"{name} {value}" for name, value in options.items())
    return Contestant(
        name=f"baxter-kin ({chosen})" if chosen else "baxter-kin",
        version=version_of("baxter-kin"),
        settings=f"`IKService.solve`, {chosen or 'all defaults'}",
        prepare=lambda T_base_tip, q_seed: (T_base_tip, q_seed),
        call=service.solve,
        read=lambda result: result.q if result.is_valid else None,
        call_batch=solve_batch,
        is_ours=True,
    )
