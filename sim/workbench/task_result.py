"""Task result: what came of one task on the workbench."""

from __future__ import annotations

from typing import Any

from baxter_kin.display import phrase
from baxter_kin.fields import field, frozen
from planner import Plan
from sim.errors import SimulationError


@frozen(error=SimulationError, eq=True)
class TaskResult:
    """What came of one task; as text, one line that says it.

    Attributes:
        task: what was to be done, such as "carry red".
        block: which block it was about; empty for an arm alone.
        arm: "left" or "right"; empty when no arm could.
        motion_s: how long the arm moved, as planned.
        planning_s: how long planning took, by the clock.
        off_m: how far from its place the block ended, metres; None when it was not carried.
        verdict: how it ended: what was verified, or why it was refused or failed.
        is_done: whether everything is as it was asked for.
        plan: of those that were made, the one that was executed, or the best of those refused;
            None when there was no need of one.

    Raises:
        SimulationError: when a value has the wrong type.
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
        cls, block: str, why: str, planning_s: float = 0.0, plan: Plan | None = None
    ) -> TaskResult:
        """That a block is not carried, and why."""
        task, verdict = f"carry {block}", f"refused: {why}"
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
        """The whole sentence where a notebook shows it, be it long."""
        printer.text(str(self))

    def _facts(self) -> tuple[str, ...]:
        return (phrase(self),)
