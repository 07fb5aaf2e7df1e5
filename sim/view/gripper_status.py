"""What the grippers do, in words that a viewer shows: open, closing, holding the block, missed.

Positions alone do not say it: fingers at rest half open may hold something or not. Events do. Those
that do not say of which side they are, as recordings kept them at first, tell nothing here.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import Enum

from baxter_kin.kinematics.arm import LIMBS
from sim.events import Event, EventKind
from sim.recording.recorded_motion import finger_joints
from sim.recording.recording import Recording

STILL_PERCENT = 1e-6
"""Fingers that moved less since the last look are at rest."""

END_PERCENT = 0.5
"""This near to an end, fingers count as fully open or closed."""


class GripperMood(str, Enum):
    """What a gripper's state means for the task; pages colour by it."""

    EMPTY = "empty"
    MOVING = "moving"
    HOLDING = "holding"
    MISSED = "missed"


@dataclass(frozen=True, slots=True)
class GripperPhase:
    """What one gripper does.

    Attributes:
        words: such as "closing" or "holding block".
        mood: what that means.
    """

    words: str
    mood: GripperMood

    @property
    def is_holding(self) -> bool:
        """Whether something is between the pads."""
        return self.mood is GripperMood.HOLDING

    def for_page(self) -> list[str]:
        """Words and mood, as the pages take them."""
        return [self.words, self.mood.value]


class GripperStatus:
    """Follows both grippers.

    Attributes:
        phases: by side, what each gripper does now; empty before the first look.
    """

    def __init__(self) -> None:
        self.phases: dict[str, GripperPhase] = {}
        self._percents: dict[str, float] = {}

    def see(self, percents: Mapping[str, float]) -> None:
        """Look at the fingers.

        Args:
            percents: position by side, 0 closed .. 100 open.
        """
        for side, percent in percents.items():
            change = percent - self._percents.get(side, percent)
            self._percents[side] = percent
            self.phases[side] = _next_phase(self.phases.get(side), percent, change)

    def hear(self, event: Event) -> None:
        """Take note of something that happened."""
        if event.side is None:
            return
        if event.kind is EventKind.GRASPED and event.body is not None:
            held = f"holding {event.body.name}"
            self.phases[event.side] = GripperPhase(held, GripperMood.HOLDING)
        elif event.kind is EventKind.MISSED:
            self.phases[event.side] = GripperPhase("missed", GripperMood.MISSED)
        elif event.kind is EventKind.RELEASED:
            self.phases[event.side] = _OPENING


_OPENING = GripperPhase("opening", GripperMood.MOVING)
_CLOSING = GripperPhase("closing", GripperMood.MOVING)


def sides_with_fingers(joint_names: Collection[str]) -> tuple[str, ...]:
    """The sides whose hand has fingers; a tool or a bare flange has no state of a gripper.

    Args:
        joint_names: the joints of a robot.
    """
    return tuple(side for side in LIMBS if finger_joints(side)[0] in joint_names)


def gripper_timelines(recording: Recording) -> dict[str, list[tuple[float, GripperPhase]]]:
    """For each side, the phases with their start times in recorded time.

    The timeline is empty for a hand without fingers and for an arm that was not recorded. At the
    beginning of a cut recording, phases are derived from the fingers' positions alone.
    """
    shown = set(sides_with_fingers(recording.joint_names)).intersection(recording.limbs)
    story = GripperStatus()
    timelines: dict[str, list[tuple[float, GripperPhase]]] = {side: [] for side in LIMBS}
    told = (event for event in recording.events if event.time_s >= recording.times_s[0])
    events = iter(sorted(told, key=lambda event: event.time_s))
    event = next(events, None)
    for time_s, percents in zip(
        recording.times_s.tolist(), recording.gripper_percent.tolist(), strict=True
    ):
        while event is not None and event.time_s < time_s:
            story.hear(event)
            _note(timelines, event.time_s, story.phases)
            event = next(events, None)
        both = zip(LIMBS, percents, strict=True)
        story.see({side: percent for side, percent in both if side in shown})
        _note(timelines, time_s, story.phases)
    return timelines


def _note(
    timelines: Mapping[str, list[tuple[float, GripperPhase]]],
    time_s: float,
    phases: Mapping[str, GripperPhase],
) -> None:
    for side, phase in phases.items():
        timeline = timelines[side]
        if not timeline or timeline[-1][1] != phase:
            timeline.append((time_s, phase))


def _next_phase(phase: GripperPhase | None, percent: float, change: float) -> GripperPhase:
    """What the fingers do after they moved by `change`."""
    if phase is not None and phase.is_holding:
        return phase
    if change > STILL_PERCENT:
        return _OPENING
    if phase is not None and phase.mood is GripperMood.MISSED:
        return phase
    return _CLOSING if change < -STILL_PERCENT else _at_rest(percent)


def _at_rest(percent: float) -> GripperPhase:
    if percent >= 100.0 - END_PERCENT:
        words = "open"
    elif percent <= END_PERCENT:
        words = "closed"
    else:
        words = f"{percent:.0f} % open"
    return GripperPhase(words, GripperMood.EMPTY)
