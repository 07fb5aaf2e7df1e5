"""The demo's scene in a simulation, with a witness of all that it reports."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pinocchio as pin

from baxter_kin import Baxter
from planner import Body, Manipulator, PickAndPlace, Plan, plan_pick_and_place
from sim import Event, EventKind, Observer, Simulation, Snapshot, World
from tests.conftest import overhead

PICK, PLACE = overhead(0.70, 0.15, -0.129), overhead(0.75, 0.00, -0.129)

PICKS = {"left": ("red", 0.65, 0.25), "right": ("blue", 0.65, -0.25)}
PLACES = {"left": (0.75, 0.12), "right": (0.75, -0.12)}
"""What both arms pick and where they place it, at the same time."""


class Witness(Observer):
    """Stores all snapshots and events, in order."""

    def __init__(self) -> None:
        self.received: list[Event | Snapshot] = []

    def on_snapshot(self, snapshot: Snapshot) -> None:
        self.received.append(snapshot)

    def on_event(self, event: Event) -> None:
        self.received.append(event)

    @property
    def snapshots(self) -> list[Snapshot]:
        return [item for item in self.received if isinstance(item, Snapshot)]

    @property
    def events(self) -> list[Event]:
        return [item for item in self.received if isinstance(item, Event)]

    @property
    def kinds(self) -> list[EventKind]:
        return [event.kind for event in self.events]


class Run:
    """A simulation of the demo's scene, the left arm at its start, with a witness."""

    def __init__(
        self, robot: Baxter, bodies: Iterable[Body], manipulator: Manipulator, **options: Any
    ) -> None:
        self.manipulator = manipulator
        self.witness = Witness()
        self.world = World(robot)
        self.world.move_arm("left", manipulator.arm.start)
        self.simulation = Simulation(self.world, [self.witness], **options)
        for body in bodies:
            self.simulation.spawn(body)

    def plan(self, place: pin.SE3 = PLACE) -> Plan:
        task = PickAndPlace("block", PICK, place)
        start = self.world.arm_q("left")
        plan = plan_pick_and_place(task, self.manipulator, self.world.scene, start)
        assert plan.is_valid, str(plan.failure)
        return plan
