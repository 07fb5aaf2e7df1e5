"""The demo with both arms: each fetches the block on the other one's side, both at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from baxter_kin.kinematics.arm import LIMBS
from planner import (
    Body,
    LineTolerance,
    Move,
    PickAndPlace,
    TwoArmCertificate,
    TwoArmPlan,
    make_block,
    save_two_arm_plan,
    transfer_bound_s,
    verify_both,
)
from planner.two_arms.together import plan_together
from sim import Outcome, Simulation
from sim.demo import Interrupt
from sim.demo.options import DemoOptions, Point
from sim.demo.report import Json, Report
from sim.demo.scene import BLOCK_EDGE_M, STANDS_Z_M, demo_table, overhead
from sim.demo.session import DemoSession


class Transfer(NamedTuple):
    """What one arm does: a block, where it is, and where it goes, in base."""

    block: str
    pick_m: Point
    place_m: Point


TRANSFERS: Mapping[str, Transfer] = {
    "left": Transfer("red", (0.62, -0.12, STANDS_Z_M), (0.62, 0.30, STANDS_Z_M)),
    "right": Transfer("blue", (0.74, 0.12, STANDS_Z_M), (0.70, -0.30, STANDS_Z_M)),
}
"""By the arm. The blocks change sides, so the arms' ways cross."""


class BothReport(Report):
    """The report of both arms: a cycle of each, and what is common to them."""

    _together: Json | None = None

    def _row(self, move: Move) -> str:
        """The row of a move, with the arm in front."""
        return f"{move.limb[0].upper()}{super()._row(move)[1:]}"

    def add_together(self, plan: TwoArmPlan) -> None:
        """Add the plan of both arms, after those of each arm."""
        self._together = {
            "planned": plan.is_valid,
            "failure": None if plan.failure is None else str(plan.failure),
            "in_turn": plan.in_turn,
            "duration_s": plan.duration_s,
            "grip_s": plan.grip_s,
            "proven_clearance_m": None if plan.proof is None else plan.proof.proven_m,
            "steps": [
                {"arm": side, "label": step.label, "begin_s": begin_s, "end_s": end_s}
                for begin_s, end_s, side, step in plan.steps
            ],
        }
        if plan.is_valid:
            order = f"in turn ({plan.in_turn})" if plan.in_turn else "at once"
            self.say(f"both arms: {plan.duration_s:.2f} s, {order}")

    def add_verdict(self, certificate: TwoArmCertificate) -> None:
        """Add what the independent checker says of the plan."""
        if self._together is not None:
            self._together |= {
                "verified": certificate.is_valid,
                "verdict": certificate.verdict,
            }
        self.say(f"independent check: {certificate.verdict}")

    def end_together(
        self, plan: TwoArmPlan, outcome: Outcome, blocks_m: Mapping[str, Point]
    ) -> None:
        """Complete the cycles of both arms."""
        for entry, side in zip(self._cycles, LIMBS, strict=True):
            block_m = blocks_m.get(TRANSFERS[side].block)
            self._complete(entry, plan.plans[side], outcome, block_m)
        if plan.proof is not None and self._min_clearance_m is not None:
            between_m = plan.proof.nearest.distance_m
            self._min_clearance_m = min(self._min_clearance_m, between_m)

    def as_json(self) -> Json:
        """JSON-serialisable representation: as of one arm, with the arm of each cycle."""
        found = super().as_json()
        for name in ("block", "block_poses", "noise"):
            del found[name]
        for entry, side in zip(found["cycles"], LIMBS, strict=False):
            entry |= {"limb": side, "block": TRANSFERS[side].block}
        blocks = {each.block: self._block(each.block) for each in TRANSFERS.values()}
        return {**found, "limb": "both", "together": self._together, "blocks": blocks}


class BothArms(DemoSession):
    """Both arms pick a block each and place it, at the same time."""

    def __init__(self, options: DemoOptions, interrupt: Interrupt, report: BothReport) -> None:
        super().__init__(options, interrupt, report)
        self._both = report

    def _bodies(self) -> Iterable[Body]:
        yield demo_table()
        for block, pick_m, _ in TRANSFERS.values():
            yield make_block(block, pin.SE3(np.eye(3), np.array(pick_m)), edge_m=BLOCK_EDGE_M)

    def _work(self, simulation: Simulation) -> str | None:
        """Move both arms to their starts, one after the other, then exchange the blocks."""
        for side in LIMBS:
            failure = self._start(simulation, self._manipulator(side))
            if failure is not None:
                return failure
        plan = self._planned(self._plan_together)
        for number, (side, transfer) in enumerate(TRANSFERS.items(), start=1):
            ends_m = transfer.pick_m, transfer.place_m
            arm = self._manipulator(side)
            bound_s = transfer_bound_s(arm.ik, arm.limits, *map(overhead, ends_m))
            self._both.add_plan(number, *ends_m, plan.plans[side], bound_s)
        self._both.add_together(plan)
        if plan.failure is not None:
            return str(plan.failure)
        with self._interrupt.deferred():
            certificate = verify_both(plan, description=self._robot.description)
        self._both.add_verdict(certificate)
        if not certificate.is_valid:
            return certificate.verdict
        if self._options.plan is not None:
            save_two_arm_plan(plan, self._options.plan)
        outcome = simulation.execute(plan, certificate=certificate)
        self._both.end_together(plan, outcome, self._blocks_m())
        return outcome.failure

    def _plan_together(self) -> TwoArmPlan:
        options = self._options
        return plan_together(
            {
                side: PickAndPlace(block, overhead(pick_m), overhead(place_m), options.hover_m)
                for side, (block, pick_m, place_m) in TRANSFERS.items()
            },
            {side: self._manipulator(side) for side in LIMBS},
            self._world.state,
            margin_m=options.margin_m,
            line_tolerance=LineTolerance(*options.line_tolerance),
        )

    def _blocks_m(self) -> dict[str, Point]:
        names = [transfer.block for transfer in TRANSFERS.values()]
        return {name: self._centre_m(name) for name in names if name in self._world.scene.bodies}
