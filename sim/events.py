"""What a simulation tells its observers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TypeAlias

import pinocchio as pin

from baxter_kin.errors import quoted
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, check_fields, finite_array, finite_scalar, float_array
from baxter_kin.value_objects import Frozen, FrozenMapping, OneLine, count, phrase, seconds
from planner import Body, Move, Situation
from planner.grasping import Grasp
from planner.grasping.grasp import Miss
from sim.errors import SimulationError
from sim.world.contacts import Contact
from sim.world.falling import Rest
from sim.world.gripper import GripperState
from sim.world.pushing import Push

JOINTS_OF_ROBOT = (15, 17, 19)
"""Of a full configuration: head, both arms, and the fingers of no hand, one or two."""


class EventKind(str, Enum):
    """What can happen."""

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


Detail: TypeAlias = Contact | Push | Grasp | Miss | Rest
"""The facts of a hit, a push, a grasp, a miss, or of coming to rest."""


@dataclass(frozen=True, slots=True, repr=False)
class Event(OneLine):
    """Something that happened.

    Attributes:
        time_s: simulated time.
        kind: what.
        text: one readable phrase, which nothing reads but people.
        side: "left" or "right", where it is about an arm or its gripper.
        move: of a plan, that began, if that is what happened.
        body: which it is about, where it stands then; read from a file, as the recording has it. A
            hit is told of by its detail alone.
        detail: the facts behind the text, where there are some.

    Raises:
        SimulationError: when a value is of another class, or there is no such side.
    """

    time_s: float
    kind: EventKind
    text: str
    side: str | None = None
    move: Move | None = None
    body: Body | None = field(default=None, compare=False)
    detail: Detail | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        check_fields(self, SimulationError)
        finite_scalar(self.time_s, "time_s", SimulationError)
        if self.side is not None and self.side not in LIMBS:
            raise SimulationError(f"a side is {' or '.join(LIMBS)}, got {quoted(self.side)}")

    @property
    def is_of_appearance(self) -> bool:
        """Whether its body appeared or disappeared then."""
        return self.kind in (EventKind.SPAWNED, EventKind.DELETED)

    def _facts(self) -> tuple[str, ...]:
        return seconds(self.time_s), self.kind.value, phrase(self.text)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Snapshot(Frozen, OneLine):
    """The world at one tick.

    Attributes:
        time_s: simulated time.
        q: full configuration, shape (19,), rad and m; fewer where a hand has no fingers.
        T_base_bodies: pose of every body present.
        grippers: what each gripper reports, by side.
        caption: what is going on, in words.

    Raises:
        SimulationError: when a value is of another class.
    """

    time_s: float
    q: FloatArray
    T_base_bodies: Mapping[str, pin.SE3]
    grippers: Mapping[str, GripperState]
    caption: str

    def __post_init__(self) -> None:
        check_fields(self, SimulationError)
        count = float_array(self.q, "q", SimulationError).size
        joints = count if count in JOINTS_OF_ROBOT else JOINTS_OF_ROBOT[-1]
        q = finite_array(self.q, (joints,), "q", SimulationError)
        object.__setattr__(self, "q", q)
        for name in ("T_base_bodies", "grippers"):
            object.__setattr__(self, name, FrozenMapping(getattr(self, name)))
        finite_scalar(self.time_s, "time_s", SimulationError)
        missing = [side for side in LIMBS if side not in self.grippers]
        if missing:
            raise SimulationError(f"the grippers lack {', '.join(missing)}")

    def _facts(self) -> tuple[str, ...]:
        return seconds(self.time_s), count(len(self.T_base_bodies), "body"), phrase(self.caption)


class Observer(OneLine):
    """Sees what a simulation does; the methods do nothing until overridden."""

    def on_start(self, situation: Situation) -> None:
        """A simulation begins, with these bodies in its world; time starts at zero."""

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """A tick has passed."""

    def on_event(self, event: Event) -> None:
        """Something happened."""
