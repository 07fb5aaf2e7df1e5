from __future__ import annotations

from baxter_kin import Arm, IKService
from baxter_kin.ik import Backend, Tolerance
from baxter_kin.ik.search.ipopt import IpoptSearcher, NearestSearcher
from baxter_kin.ik.search.solver import MOST_SOLVERS, Solvers


def test_many_tolerances_in_turn_cost_bounded_memory(left: Arm) -> None:
    service, T = IKService(left), left.T_base_tip(left.start)
    for i in range(40):
        tolerance = Tolerance.position_only(1e-3 * (1 + i))
        assert service.solve(T, left.start, tolerance=tolerance).is_valid
    assert len(service._solvers._others) <= 16


def test_the_solver_of_a_tolerance_is_made_once_and_the_oldest_is_forgotten(left: Arm) -> None:
    solvers = Solvers(left, Backend.CASADI)
    first = solvers.within(Tolerance.position_only(1e-3))
    assert solvers.within(Tolerance.position_only(1e-3)) is first
    assert solvers.within(Tolerance()) is solvers.exact
    for i in range(MOST_SOLVERS):
        last = solvers.within(Tolerance.position_only(1.0 + i))
    assert solvers.within(Tolerance.position_only(float(MOST_SOLVERS))) is last
    assert solvers.within(Tolerance.position_only(1e-3)) is not first


def test_the_last_resort_of_exact_poses_comes_near_and_that_of_others_solves(left: Arm) -> None:
    solvers = Solvers(left, Backend.CASADI)
    assert isinstance(solvers.exact.last_resort, NearestSearcher)
    assert isinstance(solvers.within(Tolerance.about("z")).last_resort, IpoptSearcher)


def test_what_ipopt_does_not_solve_has_no_last_resort(left: Arm) -> None:
    solver = Solvers(left, Backend.IPOPT).exact
    assert solver.fast is None
    assert isinstance(solver.search, IpoptSearcher)
    assert solver.last_resort is None
