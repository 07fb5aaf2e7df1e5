"""Plans of both arms and responses that the tests of this folder use."""

from __future__ import annotations

import pytest

from planner import Manipulator, Response, TwoArmPlan, TwoArmTrackingProof, prove_tracking_of_both

TYPICAL = Response((0.02, 0.06), 0.003, 0.3)
"""A lag of some set-points, at the executor's default speed."""


@pytest.fixture(scope="session")
def plain_proof(
    plain_plan: TwoArmPlan, manipulators: dict[str, Manipulator]
) -> TwoArmTrackingProof:
    return prove_tracking_of_both(plain_plan, TYPICAL, manipulators=manipulators)
