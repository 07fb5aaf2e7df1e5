"""Certificate: what was proven of a plan, with every number; as text and as data."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any

from baxter_kin.display import count, seconds
from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import field, field_names, frozen, number_or_nan
from baxter_kin.files.json_data import plain_data
from baxter_kin.validation import expect
from planner.errors import TaskError
from planner.plan import Plan
from planner.state import State

NOT_KNOWN = "not known"
"""Text of a value that is not a number."""


class Relation(str, Enum):
    """The relation that a value must have to its bound."""

    AT_MOST = "<="
    AT_LEAST = ">="
    ABOVE = ">"


_RELATIONS = {
    Relation.AT_MOST: operator.le,
    Relation.AT_LEAST: operator.ge,
    Relation.ABOVE: operator.gt,
}


@frozen(error=TaskError, eq=True)
class Check:
    """One property of a plan: its worst value, the bound, and where the worst value occurs.

    Attributes:
        name: the property, such as "velocity of limit".
        value: the worst value; infinite where nothing limits it, NaN where nothing was proven.
        relation: the relation that the value must have to the bound.
        bound: the bound.
        unit: of value and bound; empty for a ratio or a count.
        where: move, time, joint or pair of shapes; or why there was nothing to check.

    Raises:
        TaskError: when a value has the wrong type.
    """

    name: str
    value: float = number_or_nan()
    relation: Relation
    bound: float
    unit: str
    where: str

    @property
    def is_passed(self) -> bool:
        """Whether the value satisfies the bound; NaN never does."""
        return bool(_RELATIONS[self.relation](self.value, self.bound))

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        value = NOT_KNOWN if math.isnan(self.value) else f"{self.value:.6g}{unit}"
        return (
            f"{self.name} {value}, must be {self.relation.value} {self.bound:.6g}"
            f"{unit} ({self.where})"
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON; a value that is not finite is null."""
        data = {name: getattr(self, name) for name in field_names(self)}
        plain = {"value": _finite(self.value), "relation": self.relation.value}
        return {**data, **plain, "is_passed": self.is_passed}

    def _facts(self) -> tuple[str, ...]:
        return "passed" if self.is_passed else "failed", str(self)


@dataclass(frozen=True, slots=True)
class Worst:
    """The worst value of a property, and where it occurs."""

    value: float
    where: str

    def at_most(self, bound: float, name: str, unit: str = "") -> Check:
        """The check that the value does not exceed a bound."""
        return Check(name, float(self.value), Relation.AT_MOST, bound, unit, self.where)

    def at_least(self, bound: float, name: str, unit: str = "") -> Check:
        """The check that the value does not fall below a bound."""
        return Check(name, float(self.value), Relation.AT_LEAST, bound, unit, self.where)

    def above(self, bound: float, name: str, unit: str = "") -> Check:
        """The check that the value is above a bound."""
        return Check(name, float(self.value), Relation.ABOVE, bound, unit, self.where)


def greatest(found: Iterable[Worst], nothing: str, value: float = 0.0) -> Worst:
    """The item of greatest value; `value` and the reason `nothing` where there is no item."""
    return max(found, key=lambda worst: worst.value, default=Worst(value, nothing))


def least(found: Iterable[Worst], nothing: str, value: float = math.inf) -> Worst:
    """The item of least value; `value` and the reason `nothing` where there is no item."""
    return min(found, key=lambda worst: worst.value, default=Worst(value, nothing))


@frozen(error=TaskError)
class Subject:
    """The objects that a certificate was made for; they are not saved or pickled with it.

    Attributes:
        plan: the plan that was checked.
        state: the world that it was checked in.
        is_standard: whether it was checked for the plan's own robot and, where the plan states a
            response, with that response.
    """

    plan: Plan
    state: State
    is_standard: bool


@frozen(error=TaskError, eq=True)
class Certificate:
    """What was proven of a plan, or why nothing was.

    Attributes:
        limb: the arm that moves.
        motion_time_s: total duration of the moves, s.
        checks: the table of worst values.
        reason: why the checker does not certify the plan, as a sentence; empty when it does.
        rows: number of inequalities that were checked, each of which holds in an interval of time.
        clearances_m: the proven clearance of each step at every instant, m, by label and in order;
            inf where nothing can come near. The first is of everything that stands still.
        bare: links of the robot without a shape, for which no clearance is proven.
        steps: number of steps of the plan.
        limits: the acceleration and jerk limits that the plan was judged by, as a phrase.
        geometry: the shapes of the robot, as a phrase.
        subject: plan and state that were checked; None unless `verify` made the certificate in this
            process.
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
    subject: Subject | None = field(default=None, repr=False, eq=False)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle everything but the subject."""
        kept = (getattr(self, name) for name in field_names(self) if name != "subject")
        return type(self), tuple(kept)

    @property
    def is_valid(self) -> bool:
        """Whether the checker certifies the plan and every check is passed."""
        return not (self.reason or self.failures)

    @property
    def failures(self) -> tuple[Check, ...]:
        """The checks that are not passed."""
        return tuple(check for check in self.checks if not check.is_passed)

    def is_of(self, plan: Plan, state: State | None = None) -> bool:
        """Whether `verify` made this certificate in this process, for this plan and this world.

        The plan must be the same object; a copy, or the same plan read from a file again, does not
        count. All bodies, joints and attachments of the world must be equal to the last bit, except
        for the joints of the arm that moves. False as well for a certificate that was made for
        another robot, or with another response than the plan states.

        Args:
            plan: the plan that is about to be executed.
            state: the world before its first step; the plan's own when not given.

        Raises:
            TaskError: when an argument has the wrong type.
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
            UnknownNameError: when there is no such check.
        """
        for check in self.checks:
            if isinstance(name, str) and check.name == name:
                return check
        raise UnknownNameError("check", name, [check.name for check in self.checks])

    def __str__(self) -> str:
        return f"{self.verdict}\n{self.table()}"

    @property
    def verdict(self) -> str:
        """The verdict as one sentence, with the checker's reason or the checks that fail."""
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
        """Plain data for JSON; a value that is not finite is null."""
        return {
            "is_valid": self.is_valid,
            "limb": self.limb,
            "motion_time_s": self.motion_time_s,
            "reason": self.reason,
            "rows": self.rows,
            "clearances_m": [[label, _finite(clear)] for label, clear in self.clearances_m],
            "bare": list(self.bare),
            "steps": self.steps,
            "limits": self.limits,
            "geometry": self.geometry,
            "checks": [check.as_dict() for check in self.checks],
        }

    def _facts(self) -> tuple[str, ...]:
        checks = count(len(self.checks), "check")
        if self.reason:
            state = f"not valid: {self.reason}"
        elif self.failures:
            state = f"not valid, {len(self.failures)} of {checks} failed"
        else:
            state = f"valid, {checks}"
        return self.limb, count(self.steps, "step"), seconds(self.motion_time_s), state


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _world(state: State, limb: str) -> Any:
    """The parts of a state that matter for `is_of`: no colours, no joints of the limb's arm."""
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
