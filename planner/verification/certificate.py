"""Certificate: what was checked about a plan, with every figure; as text and as data."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any

_RELATIONS = {"<=": operator.le, ">=": operator.ge, ">": operator.gt}


class Relation(str, Enum):
    """How a value must stand to its bound."""

    AT_MOST = "<="
    AT_LEAST = ">="
    ABOVE = ">"


@dataclass(frozen=True, slots=True)
class Check:
    """One property of a plan: its worst value, the bound, and where that was found.

    Attributes:
        name: what was checked, such as "velocity limit".
        value: the worst value; infinite when there is none, such as a support that is missing.
        relation: how it must stand to the bound.
        bound: the bound.
        unit: of value and bound; empty for a ratio or a count.
        where: move, time, joint or pair of shapes; or why there was nothing to check.
    """

    name: str
    value: float
    relation: Relation
    bound: float
    unit: str
    where: str

    @property
    def is_passed(self) -> bool:
        """Whether the value keeps the bound; a value that is no number keeps none."""
        kept: bool = _RELATIONS[self.relation.value](self.value, self.bound)
        return kept

    def __str__(self) -> str:
        """The finding as one phrase."""
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"{self.name} {self.value:.6g}{unit}, must be {self.relation.value} {self.bound:.6g}"
            f"{unit} ({self.where})"
        )


@dataclass(frozen=True, slots=True)
class Worst:
    """The worst value of something, and where it is found."""

    value: float
    where: str

    @property
    def negated(self) -> Worst:
        """The same with the other sign; zero has none."""
        return Worst(0.0 - self.value, self.where)

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


@dataclass(frozen=True, slots=True)
class Certificate:
    """Everything that was checked about a plan.

    Attributes:
        limb: the arm that moves.
        motion_time_s: duration of its moves.
        samples: configurations at which distances were computed.
        checks: in the order they were made.
    """

    limb: str
    motion_time_s: float
    samples: int
    checks: tuple[Check, ...]

    @property
    def is_valid(self) -> bool:
        """Whether every check is passed."""
        return not self.failures

    @property
    def failures(self) -> tuple[Check, ...]:
        """The checks that are not passed."""
        return tuple(check for check in self.checks if not check.is_passed)

    def __getitem__(self, name: str) -> Check:
        """The check of that name.

        Raises:
            KeyError: when there is none.
        """
        for check in self.checks:
            if check.name == name:
                return check
        raise KeyError(name)

    def __str__(self) -> str:
        """The verdict and the table."""
        return f"{self.verdict}\n{self.table()}"

    @property
    def verdict(self) -> str:
        """The verdict as one sentence; names the checks that are not passed."""
        what = f"{self.limb} arm, {self.motion_time_s:.3f} s of motion"
        if self.is_valid:
            return f"valid: {what}, all {len(self.checks)} checks passed"
        failed = "; ".join(str(check) for check in self.failures)
        return (
            f"not valid: {what}, {len(self.failures)} of {len(self.checks)} checks fail: {failed}"
        )

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
            "samples": self.samples,
            "checks": checks,
        }


def _row(check: Check) -> tuple[str, ...]:
    verdict = "ok" if check.is_passed else "FAILS"
    numbers = (f"{check.value:.6g}", check.relation.value, f"{check.bound:.6g}")
    return (verdict, check.name, *numbers, check.unit, check.where)
