"""One problem from start to end: made, planned, verified, checked."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from planner import Plan, plan_pick_and_place, plan_start_move, verify
from referee.checker import check_plan
from referee.problems import Problem, make_problem
from referee.task import task_faults


@dataclass(frozen=True)
class Trial:
    """What came of one problem.

    Attributes:
        family: which kind.
        number: of the problem within its family.
        seed: of all.
        planning_s: processor time of the planner, which other processes do not change.
        waited_s: how long it really took.
        verify_s: processor time of the certificate; 0 without a plan.
        check_s: processor time of the independent check; 0 without a plan.
        motion_s: duration of the moves; 0 without a plan.
        refusal: why there is no plan, or None.
        rejected: why the certificate says no, or None.
        findings: what the independent check says against the plan.
        error: the exception, or None.
    """

    family: str
    number: int
    seed: int
    planning_s: float = 0.0
    waited_s: float = 0.0
    verify_s: float = 0.0
    check_s: float = 0.0
    motion_s: float = 0.0
    refusal: str | None = None
    rejected: str | None = None
    findings: tuple[str, ...] = ()
    error: str | None = None

    @property
    def is_valid(self) -> bool:
        """Whether the planner made a plan."""
        return self.refusal is None and self.planning_s > 0.0


def run_trial(family: str, number: int, seed: int) -> Trial:
    """All of it, in this process; an exception is part of the result."""
    known: dict[str, Any] = {}
    try:
        problem = make_problem(family, number, seed)
        started = time.perf_counter()
        plan = _timed(known, "planning_s", lambda: planned(problem))
        known["waited_s"] = time.perf_counter() - started
        if plan.failure is not None:
            return Trial(family, number, seed, **known, refusal=str(plan.failure))
        known["motion_s"] = plan.motion_time_s
        certificate = _timed(known, "verify_s", lambda: verify(plan))
        if not certificate.is_valid:
            known["rejected"] = certificate.verdict
        found = _timed(known, "check_s", lambda: check_plan(plan, margin_m=problem.margin_m))
        found += task_faults(plan, problem.task, problem.q_goal)
        return Trial(family, number, seed, **known, findings=tuple(map(str, found)))
    except Exception:  # whichever it is, it is counted
        return Trial(family, number, seed, **known, error=traceback.format_exc())


def planned(problem: Problem) -> Plan:
    """What the planner makes of a problem."""
    m, margin_m, held = problem.manipulator, problem.margin_m, problem.held
    if problem.task is None:
        goal = problem.q_goal
        return plan_start_move(
            m, problem.scene, problem.q_start, goal, margin_m=margin_m, held=held
        )
    return plan_pick_and_place(
        problem.task, m, problem.scene, problem.q_start, margin_m=margin_m, held=held
    )


def _timed(known: dict[str, Any], name: str, call: Callable[[], Any]) -> Any:
    """What a call returns; its processor time is noted."""
    started = time.process_time()
    found = call()
    known[name] = time.process_time() - started
    return found
