from __future__ import annotations

from baxter_kin import Arm, IKService
from baxter_kin.ik import Tolerance


def test_many_tolerances_in_turn_cost_bounded_memory(left: Arm) -> None:
    service, T = IKService(left), left.T_base_tip(left.start)
    for i in range(40):
        tolerance = Tolerance.position_only(1e-3 * (1 + i))
        assert service.solve(T, left.start, tolerance=tolerance).is_valid
    assert len(service._solvers._others) <= 16
