"""Engine: all that solves one kind of request, and who builds it when it is first needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property

import pinocchio as pin

from baxter_kin.arrays import Vector
from baxter_kin.ik.explanation import Explainer
from baxter_kin.ik.kernel import ArmNumbers
from baxter_kin.ik.program import IpoptSearcher, NearestSearcher
from baxter_kin.ik.reach import ReachBound
from baxter_kin.ik.search import Backend, Desk, Search, Searcher, evaluated
from baxter_kin.ik.seeds import NullSpaceMap, Starts
from baxter_kin.ik.task import Task
from baxter_kin.ik.task_search import (
    TaskEvaluator,
    TaskReach,
    TaskSearcher,
    TaskStarts,
    task_functions,
)
from baxter_kin.ik.tolerance import Tolerance
from baxter_kin.model import Arm

MOST_TASKS = 16
"""How many tolerances are remembered; another one displaces the oldest."""


@dataclass(frozen=True, slots=True)
class Engine:
    """What solves one kind of request.

    Attributes:
        search: its searches.
        starts: where they start without a seed.
        explainer: says why there is no solution.
        search_one: one search with nothing checked, as `Searcher.search_one`; None where every
            request takes the long way.
        quick: the fast search, where the request is an exact pose of the gripper; or None.
        last_resort: makes another search, for what none of these starts solved; or None.
    """

    search: Search
    starts: Starts
    explainer: Explainer
    search_one: Callable[[Vector, pin.SE3], tuple[Vector, Vector]] | None
    quick: Searcher | None
    last_resort: Callable[[], Search] | None


class Engines:
    """The engines of one arm.

    Attributes:
        default: the engine for exact poses of the tip.
    """

    def __init__(self, arm: Arm, backend: Backend) -> None:
        self._arm, self._gripper_arm = arm, arm.at_gripper
        self._wanted = backend
        self._map, self._reach = NullSpaceMap(self._gripper_arm), ReachBound(self._gripper_arm)
        self._tasks: dict[Tolerance, Engine] = {}
        is_at_gripper = arm.tip_frame == arm.gripper_frame
        self.default = self._exact() if is_at_gripper else self.for_task(Tolerance())

    def for_task(self, tolerance: Tolerance) -> Engine:
        """The engine for what a tolerance leaves free."""
        if tolerance not in self._tasks:
            if len(self._tasks) >= MOST_TASKS:
                del self._tasks[next(iter(self._tasks))]
            self._tasks[tolerance] = self._task(Task(tolerance, self._arm.T_gripper_tip))
        return self._tasks[tolerance]

    def _exact(self) -> Engine:
        tolerance, is_fast = Tolerance(), self._wanted is not Backend.IPOPT
        quick = Searcher.of(self._arm, self._wanted) if is_fast else None
        ipopt = self._ipopt(self._map, tolerance)
        search: Search = quick or ipopt()
        explainer = Explainer(self._arm, search, self._map, self._reach, tolerance)
        last_resort = self._nearest(self._map) if quick else None
        search_one = quick.search_one if quick else None
        return Engine(search, self._map, explainer, search_one, quick, last_resort)

    def _task(self, task: Task) -> Engine:
        starts, reach = TaskStarts(self._map, task), TaskReach(self._reach, task)
        ipopt, search_one = self._ipopt(starts, task.tolerance), None
        if self._wanted is Backend.IPOPT:
            search: Search = ipopt()
        else:
            quick = TaskSearcher(self._arm, self._task_evaluator, task, starts)
            search, search_one = quick, quick.search_one
        explainer = Explainer(self._arm, search, starts, reach, task.tolerance)
        if search_one is None:
            return Engine(search, starts, explainer, None, None, None)
        last_resort = self._nearest(starts) if task.tolerance == Tolerance() else ipopt
        return Engine(search, starts, explainer, search_one, None, last_resort)

    def _nearest(self, starts: Starts) -> Callable[[], Search]:
        """What makes, once, the search for how near to a pose the arm comes."""
        return cache(lambda: NearestSearcher(self._arm, starts))

    def _ipopt(self, starts: Starts, tolerance: Tolerance) -> Callable[[], Search]:
        return cache(lambda: IpoptSearcher(self._arm, starts, tolerance))

    @cached_property
    def _task_evaluator(self) -> TaskEvaluator:
        """Made when it is first needed."""
        numbers = ArmNumbers.of(self._gripper_arm)
        functions, backend = evaluated(task_functions, numbers.shape, self._wanted)
        return TaskEvaluator(functions[0], Desk(functions[0], numbers.within()), backend, numbers)
