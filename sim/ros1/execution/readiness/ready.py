"""How a plan is executed, what was found about it and the robot, and what is ready to be sent."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from baxter_kin import Baxter
from baxter_kin.display import OneLine, clear, count, phrase, seconds
from baxter_kin.fields import FrozenMapping, evolve, field, frozen
from baxter_kin.kinematics.arm import JOINTS, LIMBS
from baxter_kin.validation import FloatArray, positive_scalar
from planner import Manipulator, Plan, Response, TwoArmPlan
from sim.errors import SimulationError
from sim.ros1.execution.guard import MoveClearance
from sim.ros1.execution.set_points import Pace
from sim.simulation import Dwell


def _kept(given: object) -> object:
    """A read-only copy of a mapping; anything else as it is."""
    return FrozenMapping(given) if isinstance(given, Mapping) else given


@frozen(error=SimulationError, eq=True)
class ExecutionOptions:
    """How a plan is executed.

    Attributes:
        pace: speed and lead.
        dwell: minimum duration of closing and opening; a second each, as in the original.
        timeout_s: of the whole execution; None for none.
        response: how the arms follow, for the tracking proof: one response of each arm that is
            driven, or "left" and "right" -> their own; None where it is not known. Speed and lead
            are those of the pace.
        despite_lag: whether a simulated Baxter executes what the tracking proof refuses.

    Raises:
        SimulationError: when a value has the wrong type, or the time-out is not above zero.
    """

    pace: Pace = field(factory=Pace)
    dwell: Dwell = field(factory=lambda: Dwell(1.0, 1.0))
    timeout_s: float | None = None
    response: Response | Mapping[str, Response] | None = field(default=None, converter=_kept)
    despite_lag: bool = False

    def __attrs_post_init__(self) -> None:
        if self.timeout_s is not None:
            positive_scalar(self.timeout_s, "timeout_s", SimulationError)

    def response_of(self, limb: str) -> Response | None:
        """An arm's response at the speed and lead of the pace; None where it is not known."""
        given = self.response
        own = given.get(limb) if isinstance(given, Mapping) else given
        if own is None:
            return None
        return evolve(own, speed=self.pace.speed, lead_s=self.pace.lead_s)

    @property
    def rest_s(self) -> float:
        """Minimum time that a motion's last set-point stands; the tracking proof assumes it."""
        known = [self.response_of(limb) for limb in LIMBS]
        none = Response((0.0, 0.0), speed=self.pace.speed)
        return max((each or none).rest_s for each in known)


@frozen(error=SimulationError, eq=True)
class Finding:
    """One condition, and whether it holds.

    Attributes:
        name: of the condition, such as "joint states".
        is_ok: whether it holds.
        text: what was found; where it does not hold, what to do.
    """

    name: str
    is_ok: bool
    text: str

    def __str__(self) -> str:
        return f"{self.name}: {self.text}"

    def _facts(self) -> tuple[str, ...]:
        return "ok" if self.is_ok else "not ok", phrase(self.name), self.text


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ReadyPlan(OneLine):
    """A plan that may be executed now.

    Attributes:
        plan: complete, with the move to its start where one is needed.
        options: how it is executed, as it was checked.
        manipulator: the arm of the robot as it describes itself.
        clearances: of each move.
        duration_s: how long the arm moves, as it is sent.
        peaks: greatest speeds that are sent, shape (7,), rad/s.
        ratio: the speed ratio that the robot is given.
    """

    plan: Plan
    options: ExecutionOptions
    manipulator: Manipulator
    clearances: tuple[MoveClearance, ...]
    duration_s: float
    peaks: FloatArray
    ratio: float

    @property
    def robot(self) -> Baxter:
        """The robot as it describes itself."""
        return self.manipulator.robot

    @property
    def summary(self) -> str:
        """Duration, peak speed and ratio in one line."""
        worst = int(self.peaks.argmax())
        return (
            f"{self.plan.limb} arm, {count(len(self.plan.moves), 'move')}, "
            f"{seconds(self.duration_s)} of motion, up to {self.peaks[worst]:.2f} rad/s "
            f"({JOINTS[worst]}), speed ratio {self.ratio:.2f}"
        )

    def guarded(self) -> Iterator[str]:
        """The clearance of each move and the contacts excluded from it, one sentence each."""
        for each in self.clearances:
            text = f"{each.label}: {clear(min(each.clear_m))}"
            if each.intended is not None:
                text += f"; not guarded, as it is meant: {each.intended.text}"
            yield text

    def _facts(self) -> tuple[str, ...]:
        return (self.summary,)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ReadyTwoArmPlan(OneLine):
    """A plan of both arms that may be executed now.

    Attributes:
        plan: complete, from where the robot's joints are, with the moves to its start that are
            needed.
        arms: "left" and "right": each arm's own plan, ready in a world without the other arm.
        apart_m: proven distance of both arms, with what they handle, at every instant of the clock.
        ramp_s: how long the clock takes to slow to rest.
        max_late_s: how late set-points may be in total between two waits of the clock, as the
            tracking proof assumes; infinite without one.
    """

    plan: TwoArmPlan
    arms: Mapping[str, ReadyPlan]
    apart_m: float
    ramp_s: float
    max_late_s: float = math.inf

    @property
    def options(self) -> ExecutionOptions:
        """How it is executed, as it was checked."""
        return self.arms[LIMBS[0]].options

    @property
    def robot(self) -> Baxter:
        """The robot as it describes itself."""
        return self.arms[LIMBS[0]].robot

    @property
    def summary(self) -> str:
        """Duration, distance of the arms, and what each arm does, in one line."""
        duration_s = self.plan.duration_s / self.options.pace.speed
        arms = "; ".join(self.arms[side].summary for side in LIMBS)
        return f"{seconds(duration_s)} on one clock, {clear(self.apart_m)} of each other; {arms}"

    def guarded(self) -> Iterator[str]:
        """As `ReadyPlan.guarded`, of each arm in a world without the other one."""
        for side in LIMBS:
            yield from (f"{side} arm, {text}" for text in self.arms[side].guarded())

    def _facts(self) -> tuple[str, ...]:
        return (self.summary,)


ReadyT_co = TypeVar("ReadyT_co", ReadyPlan, ReadyTwoArmPlan, covariant=True)


@dataclass(frozen=True, slots=True, repr=False)
class Readiness(OneLine, Generic[ReadyT_co]):
    """What was found before anything is sent.

    Attributes:
        findings: all conditions that were checked, in order.
        ready: what would be sent; None where a condition does not hold.
    """

    findings: tuple[Finding, ...]
    ready: ReadyT_co | None

    @property
    def failures(self) -> tuple[Finding, ...]:
        """The conditions that do not hold."""
        return tuple(finding for finding in self.findings if not finding.is_ok)

    def _facts(self) -> tuple[str, ...]:
        return (count(len(self.findings), "finding"), f"{len(self.failures)} not ok")


class NotReadyError(SimulationError):
    """A plan was not executed, as a condition does not hold; nothing was sent.

    Attributes:
        readiness: what was found.
    """

    def __init__(self, readiness: Readiness[ReadyPlan] | Readiness[ReadyTwoArmPlan]) -> None:
        self.readiness = readiness
        super().__init__("; ".join(map(str, readiness.failures)))
