"""Gripper phases as text for viewers: open, closing, holding the block, missed.

Positions alone do not determine it: fingers at rest half open may hold something or not. Events do;
those without a side, as in the first recordings, have no effect here.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import Enum

from baxter_kin.description.hands import finger_joints
from baxter_kin.kinematics.arm import LIMBS
from sim.events import Event, EventKind
from sim.recording.recording import Recording

MOTION_TOLERANCE_PERCENT = 0.1
"""Fingers at rest begin to move when they are farther than this from where they came to rest: the
noise of a real gripper is smaller."""

MIN_CHANGE_PERCENT = 1e-6
"""Moving fingers that advance by less between two observations have come to rest."""

END_TOLERANCE_PERCENT = 0.5
"""Within this distance from an end, fingers are fully open or closed."""


class GripperMood(str, Enum):
    """What a gripper's state means for the task, by which pages colour it."""

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
        """Words and mood, as the pages read them."""
        return [self.words, self.mood.value]


_OPENING = GripperPhase("opening", GripperMood.MOVING)
_CLOSING = GripperPhase("closing", GripperMood.MOVING)


class GripperStatus:
    """Tracks the phase of each gripper from positions and events.

    Attributes:
        phases: what each gripper does now, by side; empty before the first observation.
    """

    def __init__(self) -> None:
        self.phases: dict[str, GripperPhase] = {}
        self._percents: dict[str, float] = {}  # at the last change

    def on_percents(self, percents: Mapping[str, float]) -> None:
        """Process positions by side, 0 closed .. 100 open."""
        for side, percent in percents.items():
            change = percent - self._percents.get(side, percent)
            phase = _next_phase(self.phases.get(side), percent, change)
            is_at_rest = phase.mood in (GripperMood.EMPTY, GripperMood.MISSED)
            if not is_at_rest or abs(change) > MOTION_TOLERANCE_PERCENT:
                self._percents[side] = percent
            self._percents.setdefault(side, percent)
            self.phases[side] = phase

    def on_event(self, event: Event) -> None:
        """Process an event."""
        if event.side is None:
            return
        if event.kind is EventKind.GRASPED and event.body is not None:
            held = f"holding {event.body.name}"
            self.phases[event.side] = GripperPhase(held, GripperMood.HOLDING)
        elif event.kind is EventKind.MISSED:
            self.phases[event.side] = GripperPhase("missed", GripperMood.MISSED)
        elif event.kind is EventKind.RELEASED:
            self.phases[event.side] = _OPENING


def sides_with_fingers(joint_names: Collection[str]) -> tuple[str, ...]:
    """The sides whose hand has fingers, by the joints of a robot; a tool has no status."""
    return tuple(side for side in LIMBS if finger_joints(side)[0] in joint_names)


def gripper_timelines(recording: Recording) -> dict[str, list[tuple[float, GripperPhase]]]:
    """The phases of each side with their start times in recorded time.

    The timeline is empty for a hand without fingers and for an arm that was not recorded. At the
    beginning of a cut recording, phases follow from the fingers' positions alone.
    """
    sides = set(sides_with_fingers(recording.joint_names)).intersection(recording.limbs)
    status, (start_s, end_s) = GripperStatus(), recording.times_s[[0, -1]].tolist()
    timelines: dict[str, list[tuple[float, GripperPhase]]] = {side: [] for side in LIMBS}
    # an event comes after the snapshot of its own time
    steps: list[tuple[float, int, Event | dict[str, float]]] = [
        (event.time_s, 1, event) for event in recording.events if start_s <= event.time_s <= end_s
    ]
    for time_s, row in zip(recording.times_s.tolist(), recording.gripper_percent, strict=True):
        percents = zip(LIMBS, row.tolist(), strict=True)
        steps.append((time_s, 0, {side: each for side, each in percents if side in sides}))
    for time_s, _, item in sorted(steps, key=lambda each: each[:2]):
        if isinstance(item, Event):
            status.on_event(item)
        else:
            status.on_percents(item)
        for side, phase in status.phases.items():
            if not timelines[side] or timelines[side][-1][1] != phase:
                timelines[side].append((time_s, phase))
    return timelines


def _next_phase(phase: GripperPhase | None, percent: float, change: float) -> GripperPhase:
    """The phase after the fingers have moved by `change` since the last change."""
    if phase is not None and phase.is_holding:
        return phase
    if change > (MIN_CHANGE_PERCENT if phase == _OPENING else MOTION_TOLERANCE_PERCENT):
        return _OPENING
    if phase is not None and phase.mood is GripperMood.MISSED:
        return phase
    if -change > (MIN_CHANGE_PERCENT if phase == _CLOSING else MOTION_TOLERANCE_PERCENT):
        return _CLOSING
    words = f"{percent:.0f} % open"
    if percent >= 100.0 - END_TOLERANCE_PERCENT:
        words = "open"
    elif percent <= END_TOLERANCE_PERCENT:
        words = "closed"
    return GripperPhase(words, GripperMood.EMPTY)
