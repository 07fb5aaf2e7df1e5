"""What observers are notified of: events, snapshots, and samples of an execution on a robot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin.display import OneLine, count, phrase, quoted, seconds
from baxter_kin.fields import array, field, frozen, mapping, scalar
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from planner import Body, Move, State
from planner.grasping import Grasp
from planner.grasping.grasp import Miss
from sim.errors import SimulationError
from sim.world.contacts import Contact
from sim.world.falling import Rest
from sim.world.gripper import GripperState, Push

JOINTS_OF_ROBOT = (15, 17, 19)
"""Lengths of a full configuration: head, both arms, and the fingers of no hand, one or two."""


class EventKind(str, Enum):
    """The kinds of events."""

    SPAWNED = "spawned"
    DELETED = "deleted"
    ENABLED = "enabled"
    MOVE_STARTED = "move started"
    HIT = "hit"
    OPENED = "gripper opened"
    PUSHED = "pushed"
    GRASPED = "grasped"
    MISSED = "missed"
    RELEASED = "released"
    SETTLED = "settled"
    PEN_DOWN = "pen down"
    PEN_UP = "pen up"


Detail: TypeAlias = Contact | Push | Grasp | Miss | Rest
"""The facts of a hit, a push, a grasp, a miss, or of coming to rest."""


@frozen(error=SimulationError, eq=True)
class Event:
    """Something that happened.

    Attributes:
        time_s: simulated time.
        kind: what happened.
        text: one phrase for people; no code parses it.
        side: "left" or "right", where it concerns an arm or its gripper.
        move: the move of a plan that began, if that is what happened.
        body: the body concerned, where it stands then; read from a file, as the recording has it. A
            hit has its detail alone.
        detail: the facts behind the text, if any.
    """

    time_s: float = scalar()
    kind: EventKind
    text: str
    side: str | None = None
    move: Move | None = None
    body: Body | None = field(default=None, eq=False)
    detail: Detail | None = field(default=None, eq=False)

    def __attrs_post_init__(self) -> None:
        if self.side is not None and self.side not in LIMBS:
            raise SimulationError(f"a side is {' or '.join(LIMBS)}, got {quoted(self.side)}")

    @property
    def is_of_appearance(self) -> bool:
        """Whether its body appeared or disappeared."""
        return self.kind in (EventKind.SPAWNED, EventKind.DELETED)

    def _facts(self) -> tuple[str, ...]:
        return seconds(self.time_s), self.kind.value, phrase(self.text)


@frozen(error=SimulationError)
class Snapshot:
    """The world at one tick.

    Attributes:
        time_s: simulated time.
        q: full configuration, shape (19,), rad and m; fewer where a hand has no fingers.
        T_base_bodies: pose of every body present.
        grippers: what each gripper reports, by side.
        caption: what is going on, in words.
    """

    time_s: float = scalar()
    q: FloatArray = array(None)
    T_base_bodies: Mapping[str, pin.SE3] = mapping()
    grippers: Mapping[str, GripperState] = mapping()
    caption: str

    def __attrs_post_init__(self) -> None:
        if len(self.q) not in JOINTS_OF_ROBOT:
            raise SimulationError(
                f"q has {len(self.q)} joints; a robot has {', '.join(map(str, JOINTS_OF_ROBOT))}"
            )
        missing = [side for side in LIMBS if side not in self.grippers]
        if missing:
            raise SimulationError(f"the grippers lack {', '.join(missing)}")

    def _facts(self) -> tuple[str, ...]:
        return seconds(self.time_s), count(len(self.T_base_bodies), "body"), phrase(self.caption)


class Observer(OneLine):
    """Is notified of what a simulation does; the methods do nothing until overridden."""

    def on_start(self, state: State) -> None:
        """Called when a simulation begins in a state; time starts at zero."""

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Called at every tick."""

    def on_event(self, event: Event) -> None:
        """Called when something happens."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Sample(OneLine):
    """One tick of an execution.

    Attributes:
        time_s: time since the executor began.
        limb: the arm.
        q_path: configuration on the plan's path, shape (7,), rad.
        q_sent: the set-point, shape (7,), rad.
        q_measured: the last measurement, shape (7,), rad.
        v_measured: likewise, shape (7,), rad/s.
        age_s: age of that measurement.
        lateness_s: of the tick.
        is_enabled: as the robot reported last.
        is_stopped: likewise.
        has_error: likewise.
    """

    time_s: float
    limb: str
    q_path: FloatArray
    q_sent: FloatArray
    q_measured: FloatArray
    v_measured: FloatArray
    age_s: float
    lateness_s: float
    is_enabled: bool
    is_stopped: bool
    has_error: bool

    @property
    def deviation_rad(self) -> float:
        """Maximum deviation of a joint from its path."""
        return float(np.abs(self.q_measured - self.q_path).max())

    def _facts(self) -> tuple[str, ...]:
        return seconds(self.time_s), self.limb, f"{self.deviation_rad:.4f} rad off"


class SampleObserver(Observer):
    """Is notified of every tick of an execution, too."""

    def on_sample(self, sample: Sample) -> None:
        """Called when a set-point was sent."""


FULLY_OPEN = 99.9
"""Minimum position of a gripper, per cent, that is called open without a number."""


def grasp_text(body: str, grasp: Grasp, percent: float) -> str:
    """The text of a grasp; near an edge, with the overlap of a pad."""
    width = f"{1e3 * grasp.width_m:.1f} mm between the finger pads"
    text = f"{body} grasped, {width} ({percent:.0f} % open)"
    if not grasp.is_near_edge:
        return text
    on, off = f"{1e3 * grasp.pad_m:.1f} mm", f"{1e3 * grasp.centre_off_m:.1f} mm"
    return (
        f"{text}, near an edge: only {on} of a finger pad on it, its centre {off} outside of them"
    )


def opening_text(side: str, percent: float) -> str:
    """The text of the opening of an empty hand, with its position unless fully open."""
    return f"{side} gripper open" + ("" if percent >= FULLY_OPEN else f", {percent:.0f} %")


def miss_text(miss: Miss | None, wanted: str | None, gap_m: float, *, is_closed: bool) -> str:
    """The text of a miss and its reason."""
    how = "closed fully" if is_closed else "stopped"
    on = f" on {wanted}" if wanted else ""
    reason = f": {miss}" if miss is not None else ""
    return f"missed: the fingers {how}{on}, {1e3 * gap_m:.1f} mm apart, and hold nothing{reason}"


def push_text(push: Push, side: str) -> str:
    """The text of a push by a closing finger, or by what that pushes."""
    finger = f"the {push.finger} finger of the {side} hand"
    by = finger if push.by == f"{push.finger} finger" else f"{push.by}, which {finger} pushes"
    return f"{push.body} pushed {1e3 * push.distance_m:.1f} mm by {by}"


def contact_text(contact: Contact, side: str) -> str:
    """The text of a collision."""
    what = _what(contact, side)
    if contact.stops:
        return f"{what} would pass through the {contact.other}; the arm stops before it"
    return f"{what} hit {contact.other}, which is left where it is"


def stop_text(contact: Contact, side: str) -> str:
    """The reason of a move that ended early."""
    return f"{_what(contact, side)} would pass through the {contact.other}"


def rest_text(body: str, rest: Rest) -> str:
    """The text of a body that has come to rest."""
    text = f"{body} at rest on {' and '.join(rest.supports)}"
    if rest.tilt_rad > 0.0:
        text += f", tilted by {math.degrees(rest.tilt_rad):.2f} deg as that lies"
    if rest.fell_off:
        text += f"; it tipped off {' and '.join(rest.fell_off)}"
    if rest.beside_m > 0.0:
        text += f"; it leans, its centre {1e3 * rest.beside_m:.1f} mm outside of what it stands on"
    return text


def _what(contact: Contact, side: str) -> str:
    if contact.is_held:
        return f"the held {contact.mover}"
    is_hand = "gripper" in contact.mover or "hand" in contact.mover
    return f"the {side} {'hand' if is_hand else 'arm'} ({contact.mover})"
