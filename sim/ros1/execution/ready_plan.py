"""What a plan becomes before it is carried out: options, what would be sent, and what was found."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from baxter_kin import Baxter
from baxter_kin.display import OneLine, clear, count, seconds
from baxter_kin.fields import evolve, field, frozen
from baxter_kin.kinematics.arm import JOINTS
from baxter_kin.validation import FloatArray, positive_scalar
from planner import Plan, Response
from sim.errors import SimulationError
from sim.outcome import Dwell
from sim.ros1.execution.guard.stages import GripStage, MoveStage
from sim.ros1.execution.preflight import Finding
from sim.ros1.execution.stream.set_points import Pace


@frozen(error=SimulationError, eq=True)
class ExecutionOptions:
    """How a plan is carried out.

    Attributes:
        pace: speed and lead.
        dwell: what closing and opening take at least; a second each, as in the original.
        timeout_s: of the whole execution; None for none.
        response: how the arm follows, for the tracking proof; None where nobody knows. What it
            says of speed and lead does not count.
        despite_lag: whether a simulated Baxter carries out what the tracking proof refuses.

    Raises:
        SimulationError: when a value has the wrong type, or the time-out is not above zero.
    """

    pace: Pace = field(factory=Pace)
    dwell: Dwell = field(factory=lambda: Dwell(1.0, 1.0))
    timeout_s: float | None = None
    response: Response | None = None
    despite_lag: bool = False

    def __attrs_post_init__(self) -> None:
        if self.timeout_s is not None:
            positive_scalar(self.timeout_s, "timeout_s", SimulationError)

    @property
    def sent_response(self) -> Response | None:
        """The response at the speed and lead that count; None where it is not known."""
        if self.response is None:
            return None
        return evolve(self.response, speed=self.pace.speed, lead_s=self.pace.lead_s)

    @property
    def rest_s(self) -> float:
        """How long the last set-point of a motion stands at least, as the tracking proof counts."""
        return (self.sent_response or Response((0.0, 0.0), speed=self.pace.speed)).rest_s


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ReadyPlan(OneLine):
    """A plan that may be carried out now.

    Attributes:
        plan: with the move to its start, where one is needed.
        robot: as it describes itself.
        stages: what is clear by how much.
        duration_s: how long the arm moves, as it is sent.
        peaks: greatest speeds that are sent, shape (7,), rad/s.
        ratio: the speed ratio that the robot is given.
    """

    plan: Plan
    robot: Baxter
    stages: tuple[MoveStage | GripStage, ...]
    duration_s: float
    peaks: FloatArray
    ratio: float

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
        """What the guard keeps on each move, and what it leaves out, a sentence each."""
        for stage in self.stages:
            for room in stage.rooms if isinstance(stage, MoveStage) else ():
                text = f"{room.label}: {clear(min(room.clear_m))}"
                if room.intended is not None:
                    text += f"; not guarded, as it is meant: {room.intended.text}"
                yield text

    def _facts(self) -> tuple[str, ...]:
        return (self.summary,)


@dataclass(frozen=True, slots=True, repr=False)
class Readiness(OneLine):
    """What was found before anything is sent.

    Attributes:
        findings: all conditions that were looked at, in order.
        ready: what would be sent; None where a condition does not hold.
    """

    findings: tuple[Finding, ...]
    ready: ReadyPlan | None

    @property
    def failures(self) -> tuple[Finding, ...]:
        """The conditions that do not hold."""
        return tuple(finding for finding in self.findings if not finding.is_ok)

    def _facts(self) -> tuple[str, ...]:
        return (count(len(self.findings), "finding"), f"{len(self.failures)} not ok")


class NotReadyError(SimulationError):
    """A plan was not carried out, as a condition does not hold; nothing was sent.

    Attributes:
        readiness: what was found.
    """

    def __init__(self, readiness: Readiness) -> None:
        self.readiness = readiness
        super().__init__("; ".join(map(str, readiness.failures)))
