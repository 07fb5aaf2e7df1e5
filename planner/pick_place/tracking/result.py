"""TrackingProof: what is proven of a plan on an arm of a stated response; as values and as text."""

from __future__ import annotations

from dataclasses import dataclass

from baxter_kin.validation import Checked, FloatArray, check_fields, float_array
from baxter_kin.value_objects import Frozen, OneLine, clear, count, millimetres, phrase, sentence
from planner.clearance import Clearance
from planner.errors import TaskError
from planner.motion.response import Response


@dataclass(frozen=True, slots=True, repr=False)
class MoveTracking(Checked, OneLine, error=TaskError):
    """What is proven of one move, wherever in its tube the joints are.

    Attributes:
        label: of the move.
        clearance_m: nothing comes nearer to the arm, or to what it carries, than this, but for what
            is touched on purpose; not above zero where that could not be proven.
        nearest: the least distance that was found where the arm may be, and when from the first
            set-point since it rested; None where there is nothing to come near.
        deviation_rad: how far any joint may be from where the plan has it then.
        tip_m: how far the tip may be off its path.
        allowance_m: how far the hand, and what it holds, may be off their path while what they
            touch on purpose is not proven to be apart from them; zero where it always is.
        settled_tip_m: how far the tip may be from its goal when all joints are measured as settled,
            and so when fingers close or open; None where the arm does not rest then.
        failure: why the move is not proven; None where it is.
    """

    label: str
    clearance_m: float
    nearest: Clearance | None
    deviation_rad: float
    tip_m: float
    allowance_m: float
    settled_tip_m: float | None = None
    failure: str | None = None

    def _facts(self) -> tuple[str, ...]:
        if self.failure is not None:
            return phrase(self.label), sentence(self.failure)
        allowance = f"{millimetres(self.allowance_m)} allowed" if self.allowance_m else ""
        off = f"tip up to {millimetres(self.tip_m)} off"
        return phrase(self.label), clear(self.clearance_m), off, allowance


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TrackingProof(Frozen, OneLine):
    """Whether a plan stays clear on an arm that follows its set-points so.

    Attributes:
        response: of the arm, and how set-points are sent.
        moves: what is proven of each move, in order; none of a plan that is invalid itself.
        margin_m: the distance that was asked for.
        most_off_m: how far the hand may be off its path in moves in which it may touch something.
        start_rad: how far each joint may be from the plan's start, as it is measured.
        rate_rad_s: greatest speed of each joint on the way, shape (7,), rad/s: the robot's own cap
            must be above it. Infinite for a joint that may catch up at once.
        greatest_speed: the greatest speed that is known to pass with all else as it is: that of the
            response where it passes, else one that was searched for; None where none was found.
        failure: why it is not proven, in a sentence; None where it is.

    Raises:
        TaskError: when a value is of another class.
    """

    response: Response
    moves: tuple[MoveTracking, ...]
    margin_m: float
    most_off_m: float
    start_rad: float
    rate_rad_s: FloatArray
    greatest_speed: float | None
    failure: str | None = None

    def __post_init__(self) -> None:
        check_fields(self, TaskError)
        rates = float_array(self.rate_rad_s, "rate_rad_s", TaskError)
        expected = self.response.settled_error_rad.shape
        if rates.shape != expected:
            raise TaskError(f"rate_rad_s has shape {rates.shape}; it must have shape {expected}")
        rates.setflags(write=False)
        object.__setattr__(self, "rate_rad_s", rates)

    @property
    def is_valid(self) -> bool:
        """Whether every path that the joints may take is proven."""
        return self.failure is None

    @property
    def clearance_m(self) -> float:
        """The least that is proven of all moves, contacts on purpose left out."""
        return min((move.clearance_m for move in self.moves), default=float("inf"))

    def __str__(self) -> str:
        verdict = "every path that the joints may take is clear"
        lines = [self.failure or verdict, *map(_told, self.moves)]
        return "\n".join(lines)

    def _facts(self) -> tuple[str, ...]:
        if self.failure is not None:
            return count(len(self.moves), "move"), sentence(self.failure)
        return count(len(self.moves), "move"), f"valid, {clear(self.clearance_m)}"


def _told(move: MoveTracking) -> str:
    """A move in a line."""
    parts = [
        clear(move.clearance_m),
        f"joints within {move.deviation_rad:.3f} rad",
        f"tip within {millimetres(move.tip_m)} of its path",
    ]
    if move.allowance_m:
        parts.append(f"{millimetres(move.allowance_m)} where it touches on purpose")
    if move.settled_tip_m is not None:
        parts.append(f"{millimetres(move.settled_tip_m)} from its goal when settled")
    return f"  {move.label}: {', '.join(parts)}"
