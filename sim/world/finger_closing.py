"""Closing: what the fingers meet on their way, what they push, and where they end.

Both fingers move alike, one along -y of the tip and one along +y, while the arm stands still. All
their shapes count. The model is quasi-static, in one dimension:

- A movable body that a finger meets moves with it from then on, along the closing axis only,
  unturned (see `planner.grasping.grasp`), and so does what stands on it, and what it meets in turn.
- When the other finger meets the body that a finger pushes directly, the fingers stop. The body is
  held when the hand's own prediction, `Hand.close_on`, says so.
- When anything immovable is in the way, of a finger or of what one pushes, the fingers stop there.
  So they do when two bodies are between them, or one that a finger is inside already.

Contacts press in by up to `PRESSING_TOLERANCE_M`, so that what slides along a table, or under a
hand that is not quite level, is not stopped by it. Opening fingers push nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

from baxter_kin.validation import Checked
from baxter_kin.value_objects import OneLine, millimetres
from planner.grasping import Grasp
from planner.grasping.grasp import Miss, MissKind
from sim.errors import SimulationError
from sim.world.pushing import Mover, Push, Squeeze
from sim.world.world import World

AGREEMENT_M = 1e-6
"""The pads stop on a body where the hand's prediction says, within this; contacts are found to
1e-8 m, and several add up."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Closing(Checked, OneLine, error=SimulationError):
    """How a close will end.

    Attributes:
        finger_m: finger position at the end.
        body: the body between the pads; None for a miss.
        grasp: where it is then; None for a miss.
        miss: why nothing is held; None for a grasp.
        pushes: the bodies that are moved on the way.
    """

    finger_m: float
    body: str | None = None
    grasp: Grasp | None = None
    miss: Miss | None = None
    pushes: tuple[Push, ...] = ()

    def _facts(self) -> tuple[str, ...]:
        found = self.grasp or self.miss
        return f"fingers at {millimetres(self.finger_m)}", "" if found is None else repr(found)


def closing_of(world: World, side: str, wanted: str | None = None) -> Closing:
    """What happens when an empty hand closes where it is.

    Args:
        world: the robot and the bodies.
        side: whose hand.
        wanted: name of the body that it shall hold; a miss is told of that one, where it is there.
    """
    squeeze = Squeeze(world, side)
    stop = squeeze.run()
    if stop is None:
        return _closed_fully(squeeze, wanted)
    first, second = stop
    if first.is_held_by(second) or second.is_held_by(first):
        return _met(squeeze, first if second.is_finger else second)
    return _ended(squeeze, miss=_blocked(first, second, squeeze))


def _closed_fully(squeeze: Squeeze, wanted: str | None) -> Closing:
    """Nothing stopped the fingers."""
    hand, scene = squeeze.hand, squeeze.world.scene
    miss = Miss(MissKind.NOTHING, "nothing is between the finger pads")
    if wanted is not None and wanted in scene.bodies:
        found = hand.close_on(squeeze.T_base_tip, scene[wanted], squeeze.begin_m)
        miss = found if isinstance(found, Miss) else miss
    return _ended(squeeze, miss=miss)


def _met(squeeze: Squeeze, mover: Mover) -> Closing:
    """Both fingers are on a body: as the hand predicts, or not with the pads."""
    body = squeeze.world.body(mover.name)
    found = squeeze.hand.close_on(squeeze.T_base_tip, body, squeeze.begin_m)
    if isinstance(found, Grasp) and abs(found.finger_m - squeeze.finger_m) <= AGREEMENT_M:
        squeeze.agree(mover, found)
        return _ended(squeeze, body=mover.name, grasp=found)
    if not isinstance(found, Miss) or found.kind is MissKind.NOTHING:
        text = f"the fingers touch {mover.name} outside of their pads"
        found = Miss(MissKind.EDGE, text, mover.name, 0.0)
    return _ended(squeeze, miss=found)


def _blocked(first: Mover, second: Mover, squeeze: Squeeze) -> Miss:
    """Why the fingers stopped and hold nothing."""
    if first.sign and second.sign:
        names = [mover.name for mover in (first, second) if not mover.is_finger]
        names += [mover.by for mover in (first, second) if mover.by and mover.is_pushed_indirectly]
        text = f"{' and '.join(dict.fromkeys(names))} are between the fingers, which hold only one"
        return Miss(MissKind.CROWDED, text, names[0])
    if second.is_movable:  # a finger is inside it
        body = squeeze.world.body(second.name)
        found = squeeze.hand.close_on(squeeze.T_base_tip, body, squeeze.begin_m)
        if isinstance(found, Miss) and found.kind is not MissKind.NOTHING:
            return found
        text = f"{second.name} reaches into {first.title} before they close"
        return Miss(MissKind.NOT_BETWEEN, text, second.name)
    text = f"{first.title} met {second.name}, which does not give way"
    return Miss(MissKind.BLOCKED, text, second.name)


def _ended(
    squeeze: Squeeze,
    *,
    body: str | None = None,
    grasp: Grasp | None = None,
    miss: Miss | None = None,
) -> Closing:
    """The closing, ended where the fingers are."""
    return Closing(squeeze.finger_m, body, grasp, miss, squeeze.pushes)
