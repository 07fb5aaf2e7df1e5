"""A body to move by what is seen of it, and how that went."""

from __future__ import annotations

import pinocchio as pin

from baxter_kin.display import count, millimetres, phrase, position
from baxter_kin.fields import field, frozen
from baxter_kin.frames import checked_pose
from planner import Body, Plan
from planner.pick_place.task import DEFAULT_CLEAR_M, DEFAULT_HOVER_M, checked_height_m
from sim.errors import SimulationError


@frozen(error=SimulationError)
class Transfer:
    """A body to move, by how it is grasped and where it shall be.

    Attributes:
        body: its name.
        T_body_tip: pose of the tip seen from the body when the fingers close.
        T_base_goal: pose of the body when they open again.
        hover_m: height above the place where the arm ends.
        clear_m: height above pick and place from which it may move sideways.

    Raises:
        SimulationError: when `body` is no name, or a height not a number above zero.
        PoseError: when a pose is not a valid one.
    """

    body: str
    T_body_tip: pin.SE3 = field(converter=checked_pose)
    T_base_goal: pin.SE3 = field(converter=checked_pose)
    hover_m: float = DEFAULT_HOVER_M
    clear_m: float = DEFAULT_CLEAR_M

    def __attrs_post_init__(self) -> None:
        for name in ("hover_m", "clear_m"):
            checked_height_m(getattr(self, name), name, SimulationError)

    def _facts(self) -> tuple[str, ...]:
        return phrase(self.body), f"to {position(self.T_base_goal)}", f"hover {self.hover_m:g} m"


@frozen(error=SimulationError)
class Attempt:
    """One look, and what came of it.

    Attributes:
        seen: the body where it was believed to be; None when it was not seen.
        plan: what was planned; None when it was not seen.
        failure: None when it ended as planned, else why not, as one sentence.
    """

    seen: Body | None
    plan: Plan | None
    failure: str | None

    def _facts(self) -> tuple[str, ...]:
        seen = "not seen" if self.seen is None else f"seen at {position(self.seen.T_base_body)}"
        return seen, "done" if self.failure is None else f"failed: {phrase(self.failure)}"


@frozen(error=SimulationError)
class LoopResult:
    """How a transfer ended.

    Attributes:
        attempts: every look and what came of it, in order.
        failure: None, or why the body is not where it should be, as one sentence.
        placed: the body where it was seen at the end; None when it was not placed, or not seen.
        off_m: how far its centre is from where it should be, by that sighting; None likewise.
    """

    attempts: tuple[Attempt, ...]
    failure: str | None
    placed: Body | None = None
    off_m: float | None = None

    @property
    def is_success(self) -> bool:
        """Whether it was picked and placed."""
        return self.failure is None

    @property
    def plan(self) -> Plan | None:
        """What was planned last; None when the body was never seen."""
        plans = [attempt.plan for attempt in self.attempts if attempt.plan is not None]
        return plans[-1] if plans else None

    def _facts(self) -> tuple[str, ...]:
        attempts = count(len(self.attempts), "attempt")
        if self.failure is not None:
            return attempts, f"failed: {self.failure}"
        return attempts, "success", "" if self.off_m is None else f"{millimetres(self.off_m)} off"
