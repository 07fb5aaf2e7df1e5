"""Certificate: what was proven of a plan, with every figure; as text and as data."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields
from enum import Enum
from typing import Any

from baxter_kin.display import OneLine, count, seconds, sentence
from baxter_kin.errors import UnknownNameError
from baxter_kin.json_data import plain_data
from baxter_kin.validation import Checked, check_fields, expect
from planner.errors import TaskError
from planner.plan import Plan
from planner.state import State

NOT_KNOWN = "not known"
"""Stands for a value that is not a number."""

_RELATIONS = {"<=": operator.le, ">=": operator.ge, ">": operator.gt}


class Relation(str, Enum):
    """How a value must stand to its bound."""

    AT_MOST = "<="
    AT_LEAST = ">="
    ABOVE = ">"


@dataclass(frozen=True, slots=True, repr=False)
class Check(OneLine):
    """One property of a plan: its worst value, the bound, and where that was found.

    Attributes:
        name: what was checked, such as "velocity limit".
        value: the worst value; infinite when there is none, such as a support that is missing; not
            a number where nothing was proven.
        relation: how it must stand to the bound.
        bound: the bound.
        unit: of value and bound; empty for a ratio or a count.
        where: move, time, joint or pair of shapes; or why there was nothing to check.

    Raises:
        TaskError: when a value is of another class.
    """

    name: str
    value: float
    relation: Relation
    bound: float
    unit: str
    where: str

    def __post_init__(self) -> None:
        check_fields(self, TaskError, may_be_nan=("value",))

    @property
    def is_passed(self) -> bool:
        """Whether the value keeps the bound; a value that is not known keeps none."""
        kept: bool = _RELATIONS[self.relation.value](self.value, self.bound)
        return kept

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        value = NOT_KNOWN if math.isnan(self.value) else f"{self.value:.6g}{unit}"
        return (
            f"{self.name} {value}, must be {self.relation.value} {self.bound:.6g}"
            f"{unit} ({self.where})"
        )

    def _facts(self) -> tuple[str, ...]:
        return "passed" if self.is_passed else "failed", sentence(self)


@dataclass(frozen=True, slots=True)
class Worst:
    """The worst value of something, and where it is found."""

    value: float
    where: str

    def at_most(self, bound: float, name: str, unit: str = "") -> Check:
        """The check that it does not exceed a bound."""
        return Check(name, float(self.value), Relation.AT_MOST, bound, unit, self.where)

    def at_least(self, bound: float, name: str, unit: str = "") -> Check:
        """The check that it does not fall below a bound."""
        return Check(name, float(self.value), Relation.AT_LEAST, bound, unit, self.where)

    def above(self, bound: float, name: str, unit: str = "") -> Check:
        """The check that it is above a bound."""
        return Check(name, float(self.value), Relation.ABOVE, bound, unit, self.where)


def greatest(found: Iterable[Worst], nothing: str, value: float = 0.0) -> Worst:
    """The one of greatest value; of none, that value and why there is nothing."""
    return max(found, key=lambda worst: worst.value, default=Worst(value, nothing))


def least(found: Iterable[Worst], nothing: str, value: float = math.inf) -> Worst:
    """The one of least value; of none, that value and why there is nothing."""
    return min(found, key=lambda worst: worst.value, default=Worst(value, nothing))


@dataclass(frozen=True, slots=True, eq=False)
class Subject(Checked, error=TaskError):
    """What a certificate was made of, as the objects themselves; no file holds them.

    Attributes:
        plan: the plan that was checked.
        state: the world that it was checked in.
        is_standard: whether it was checked for the robot that the plan is for, and a plan that
            states a response with that one.
    """

    plan: Plan
    state: State
    is_standard: bool


@dataclass(frozen=True, slots=True, repr=False)
class Certificate(Checked, OneLine, error=TaskError):
    """What was proven of a plan, or why nothing was.

    Attributes:
        limb: the arm that moves.
        motion_time_s: duration of its moves.
        checks: the table of worst values.
        reason: why the checker does not certify it, as a sentence; empty when it does.
        rows: how many inequalities were checked for it, each of which holds in an interval of time.
        clearances_m: what each step keeps at every instant, m, by its label and in order; inf where
            nothing can come near. The first is of what stands still.
        bare: links of the robot without a shape, which nothing keeps apart from.
        steps: of the plan.
        limits: the acceleration and jerk that it was judged by.
        geometry: what shapes the robot has.
        subject: what it was made of; None where somebody else than `verify` made it.
    """

    limb: str
    motion_time_s: float
    checks: tuple[Check, ...]
    reason: str = ""
    rows: int = 0
    clearances_m: tuple[tuple[str, float], ...] = ()
    bare: tuple[str, ...] = ()
    steps: int = 1
    limits: str = "no limits"
    geometry: str = "Rethink's meshes"
    subject: Subject | None = field(default=None, repr=False, compare=False)

    def __reduce__(self) -> tuple[Any, ...]:
        kept = (getattr(self, each.name) for each in fields(self) if each.name != "subject")
        return type(self), tuple(kept)

    @property
    def is_valid(self) -> bool:
        """Whether the checker certifies it and every check is passed."""
        return not (self.reason or self.failures)

    @property
    def failures(self) -> tuple[Check, ...]:
        """The checks that are not passed."""
        return tuple(check for check in self.checks if not check.is_passed)

    def is_of(self, plan: Plan, state: State | None = None) -> bool:
        """Whether `verify` made it in this process, of this very plan in just that world.

        The plan must be the same object; a copy, or one read from a file again, is another one.
        Of the world, all bodies, joints and what the hands hold must be the same to the last bit,
        but not the joints of the arm that moves. For another robot, or with another response than
        the plan states, it is of none.

        Args:
            plan: what is about to be executed.
            state: the world before its first step; the plan's own when not given.

        Raises:
            TaskError: when one of them is of another class.
        """
        expect(plan, Plan, "plan", TaskError)
        if state is not None:
            expect(state, State, "state", TaskError)
        subject, known = self.subject, plan.start if state is None else state
        if subject is None or subject.plan is not plan:
            return False
        made_in = subject.state
        is_same = made_in is known or _world(made_in, plan.limb) == _world(known, plan.limb)
        return subject.is_standard and is_same

    def __getitem__(self, name: str) -> Check:
        """The check of that name.

        Raises:
            UnknownNameError: when there is none.
        """
        for check in self.checks:
            if isinstance(name, str) and check.name == name:
                return check
        raise UnknownNameError("check", name, [check.name for check in self.checks])

    def __str__(self) -> str:
        return f"{self.verdict}\n{self.table()}"

    @property
    def verdict(self) -> str:
        """The verdict as one sentence; gives the checker's reason, or the checks that fail."""
        motion = f"{self.motion_time_s:.3f} s of motion" if self.steps else "a plan without steps"
        what = f"{self.limb} arm, {motion}"
        if self.is_valid:
            return f"valid: {what}, all {len(self.checks)} checks passed; {self.basis}"
        if self.reason:
            return f"not valid: {what}: {self.reason}; {self.basis}"
        failed = "; ".join(str(check) for check in self.failures)
        count = f"{len(self.failures)} of {len(self.checks)} checks fail"
        return f"not valid: {what}, {count}: {failed}; {self.basis}"

    @property
    def basis(self) -> str:
        """The limits and the shapes that the verdict rests on, as a phrase."""
        return f"judged by {self.limits}, on {self.geometry}"

    def table(self) -> str:
        """The checks as a text table, one line each."""
        head = ("", "check", "worst", "", "bound", "unit", "where")
        rows = [head, *(_row(check) for check in self.checks)]
        widths = [max(len(row[column]) for row in rows) for column in range(len(head))]
        return "\n".join(
            "  ".join(
                cell.rjust(width) if column in (2, 4) else cell.ljust(width)
                for column, (cell, width) in enumerate(zip(row, widths, strict=True))
            ).rstrip()
            for row in rows
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON; a value without a number is null."""
        checks = [
            {**asdict(check), "relation": check.relation.value, "is_passed": check.is_passed}
            for check in self.checks
        ]
        for check in checks:
            if not math.isfinite(check["value"]):
                check["value"] = None
        return {
            "is_valid": self.is_valid,
            "limb": self.limb,
            "motion_time_s": self.motion_time_s,
            "reason": self.reason,
            "rows": self.rows,
            "clearances_m": [
                [label, clear if math.isfinite(clear) else None]
                for label, clear in self.clearances_m
            ],
            "bare": list(self.bare),
            "steps": self.steps,
            "limits": self.limits,
            "geometry": self.geometry,
            "checks": checks,
        }

    def _facts(self) -> tuple[str, ...]:
        checks = count(len(self.checks), "check")
        if self.reason:
            state = f"not valid: {sentence(self.reason)}"
        elif self.failures:
            state = f"not valid, {len(self.failures)} of {checks} failed"
        else:
            state = f"valid, {checks}"
        return self.limb, count(self.steps, "step"), seconds(self.motion_time_s), state


def _world(state: State, limb: str) -> Any:
    """All that counts of a state: no colours, and no joints of the arm of that limb."""
    data = plain_data(state, State)
    bodies = list(data["scene"]["bodies"].values())
    for part in (part for body in bodies for part in body["parts"]):
        del part["rgba"]
    joints = {n: at for n, at in data["joints"].items() if not n.startswith(f"{limb}_")}
    return bodies, joints, data["attachments"]


def _row(check: Check) -> tuple[str, ...]:
    verdict = "ok" if check.is_passed else "FAILS"
    value = NOT_KNOWN if math.isnan(check.value) else f"{check.value:.6g}"
    numbers = (value, check.relation.value, f"{check.bound:.6g}")
    return (verdict, check.name, *numbers, check.unit, check.where)
