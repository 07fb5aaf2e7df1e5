"""The result of one task on the workbench."""

from __future__ import annotations

from typing import Any

from baxter_kin.display import phrase
from baxter_kin.fields import field, frozen
from planner import Plan
from sim.errors import SimulationError


@frozen(error=SimulationError, eq=True)
class TaskResult:
    """The result of one task, readable as a sentence.

    Attributes:
        task: the task, such as "carry red".
        block: name of its block; empty for an arm alone.
        arm: "left" or "right"; empty when no arm could.
        motion_s: planned duration of the arm's moves.
        planning_s: wall time of planning.
        off_m: distance of the block from its goal at the end, m; None when it was not carried.
        verdict: how it ended: what was verified, or why it was refused or failed.
        is_done: whether everything is as requested.
        plan: the plan that was executed, or the best of those refused; None without any.
    """

    task: str
    block: str
    arm: str
    motion_s: float
    planning_s: float
    off_m: float | None
    verdict: str
    is_done: bool
    plan: Plan | None = field(default=None, eq=False)

    @classmethod
    def refused(
        cls, block: str, reason: str, planning_s: float = 0.0, plan: Plan | None = None
    ) -> TaskResult:
        """The result for a block that is not carried."""
        task, verdict = f"carry {block}", f"refused: {reason}"
        return cls(task, block, "", 0.0, planning_s, None, verdict, False, plan)

    def __str__(self) -> str:
        if not self.is_done:
            return f"{self.task}: {self.verdict}"
        off = "" if self.off_m is None else f", {1e3 * self.off_m:.3f} mm off its place"
        return (
            f"{self.task}: done by the {self.arm} arm in {self.motion_s:.2f} s of motion{off} "
            f"({self.verdict})"
        )

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:  # noqa: ARG002 - IPython's
        """The whole sentence where a notebook shows it, however long."""
        printer.text(str(self))

    def _facts(self) -> tuple[str, ...]:
        return (phrase(self),)
