"""Solvers: all that answers requests of one tolerance, made when the first of them comes."""

from __future__ import annotations

from functools import cached_property

from baxter_kin.ik.search.explanation import Explainer
from baxter_kin.ik.search.ipopt import IpoptSearcher, NearestSearcher
from baxter_kin.ik.search.searcher import Backend, Search, Searcher
from baxter_kin.ik.seeds import NullSpaceMap
from baxter_kin.ik.tolerance import EXACT, Tolerance
from baxter_kin.kinematics.arm import Arm

MOST_SOLVERS = 16
"""How many tolerances are remembered; another one displaces the oldest."""


class Solver:
    """What solves the requests of one tolerance for one arm.

    Attributes:
        arm: whose tip is placed.
        fast: the fast search; None with the backend IPOPT.
        search: what searches: the fast one, or IPOPT.
        starts: where searches start without a seed.
        explainer: says why there is no solution.
    """

    def __init__(self, arm: Arm, backend: Backend, tolerance: Tolerance) -> None:
        self.arm, self._tolerance = arm, tolerance
        self.starts = NullSpaceMap(arm, tolerance)
        is_fast = backend is not Backend.IPOPT
        self.fast = Searcher(arm, backend, tolerance) if is_fast else None
        self.search: Search = self.fast or self._ipopt
        self.explainer = Explainer(arm, self.search, self.starts, tolerance)

    @cached_property
    def last_resort(self) -> Search | None:
        """Another search, for what the fast one did not solve from any start.

        For exact poses, the one for how near to them the arm comes.
        """
        if self.fast is None:
            return None
        return NearestSearcher(self.arm, self.starts) if self._tolerance == EXACT else self._ipopt

    @cached_property
    def _ipopt(self) -> IpoptSearcher:
        return IpoptSearcher(self.arm, self.starts, self._tolerance)


class Solvers:
    """The solvers of one arm.

    Attributes:
        exact: the solver for poses met in every respect.
    """

    def __init__(self, arm: Arm, backend: Backend) -> None:
        self._arm, self._backend = arm, backend
        self._others: dict[Tolerance, Solver] = {}
        self.exact = Solver(arm, backend, EXACT)

    def within(self, tolerance: Tolerance) -> Solver:
        """The solver for what a tolerance leaves free."""
        if tolerance == EXACT:
            return self.exact
        solver = self._others.get(tolerance)
        if solver is None:
            solver = Solver(self._arm, self._backend, tolerance)
            for oldest in list(self._others)[: 1 - MOST_SOLVERS]:
                self._others.pop(oldest, None)  # another thread may have been quicker
            self._others[tolerance] = solver
        return solver
