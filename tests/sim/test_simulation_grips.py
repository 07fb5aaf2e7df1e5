"""What fingers do in a plan: a miss ends it, and what is let go falls."""

from __future__ import annotations

import math

import pytest

from planner import (
    Body,
    Box,
    Grip,
    GripperAction,
    Move,
    Part,
    Plan,
    load_object,
    plan_straight_move,
)
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from sim import Dwell, EventKind, Outcome, Simulation, SimulationError
from sim.world.falling import GRAVITY_M_S2
from tests.conftest import at, state_at
from tests.sim.runs import PICK, Run, Witness

TIME_S = 1e-9
"""Sums of some dozen durations below 10 s."""

REST_M = 1e-7
FALL_M = 0.15
ORIGIN = at(0.0, 0.0, 0.0)


def test_dwells_are_added_once_each(run: Run, cycle: tuple[Run, Outcome]) -> None:
    dwelling = Simulation(run.world, dwell=Dwell(after_grasp_s=0.4, after_release_s=0.3))
    outcome = dwelling.execute(run.plan())
    # the cycle begins with an opening, which dwells as well
    assert outcome.duration_s == pytest.approx(cycle[1].duration_s + 0.4 + 2 * 0.3, abs=TIME_S)


def test_the_arm_stands_still_while_it_dwells(run: Run) -> None:
    witness = Witness()
    simulation = Simulation(run.world, [witness], dwell=Dwell(after_grasp_s=0.5))
    simulation.execute(run.plan())
    begin = next(e.time_s for e in witness.events if e.kind is EventKind.GRASPED)
    during = {s.q.tobytes() for s in witness.snapshots if begin < s.time_s <= begin + 0.5}
    assert len(during) == 1


class TestMiss:
    """A close on nothing is noticed and ends the plan there."""

    @pytest.fixture
    def missed(self, run: Run) -> tuple[Run, Outcome]:
        plan = run.plan()
        run.world.place_body("block", at(0.9, -0.2, -0.155))
        return run, run.simulation.execute(plan)

    def test_it_is_an_outcome_that_names_stage_body_and_gap(
        self, missed: tuple[Run, Outcome]
    ) -> None:
        _, outcome = missed
        assert not outcome.is_success
        assert outcome.failure == (
            "pick: close: missed: the fingers closed fully on block, 15.3 mm apart, and hold "
            "nothing: block is 395 mm to the side of the tip and 2 mm behind it, not "
            "between the finger pads"
        )

    def test_the_gripper_reports_it(self, missed: tuple[Run, Outcome]) -> None:
        state = missed[0].simulation.grippers["left"].state
        assert (state.percent, state.is_gripping, state.has_missed) == (0.0, False, True)

    def test_the_last_event_is_the_miss(self, missed: tuple[Run, Outcome]) -> None:
        assert missed[0].witness.kinds[-1] is EventKind.MISSED

    def test_the_arm_stays_at_the_pick(self, missed: tuple[Run, Outcome]) -> None:
        tip = missed[0].world.T_base_tip("left")
        assert tip.translation == pytest.approx(PICK.translation, abs=1e-6)

    def test_time_is_that_until_the_fingers_have_closed(
        self, missed: tuple[Run, Outcome], plan: Plan
    ) -> None:
        run, outcome = missed
        moves_s = sum(move.trajectory.duration for move in plan.moves[:2])
        stroke_s = run.world.hands["left"].stroke_m / FINGER_SPEED_M_S
        assert outcome.duration_s == pytest.approx(moves_s + stroke_s, abs=TIME_S)

    def test_another_body_between_the_fingers_is_not_the_right_one(self, run: Run) -> None:
        plan = run.plan()
        run.simulation.delete("block")
        run.simulation.spawn(
            load_object("block", at(0.6725, 0.1265, -0.155), name="brick", is_movable=True)
        )
        outcome = run.simulation.execute(plan)
        assert outcome.failure == "pick: close: grasped brick instead of block"

    def test_a_block_wider_than_the_hand_is_missed(self, run: Run) -> None:
        plan = run.plan()
        run.simulation.delete("block")
        part = Part(Box((0.06, 0.06, 0.05)), ORIGIN)
        run.simulation.spawn(Body("block", (part,), at(0.70, 0.15, -0.13), is_movable=True))
        assert "missed" in str(run.simulation.execute(plan).failure)

    def test_a_hand_that_is_full_is_refused(self, run: Run) -> None:
        plan = run.plan()
        run.simulation.execute(Plan(state_at(plan.q_start), plan.steps[:4]))
        close = Plan(
            state_at(run.world.arm_q("left")), (Grip("close", GripperAction.CLOSE),), limb="left"
        )
        with pytest.raises(SimulationError, match="closed on 'block'; open it first"):
            run.simulation.execute(close)


class TestRelease:
    """What is let go falls as things fall."""

    @pytest.fixture
    def dropped(self, run: Run) -> Run:
        """The block let go 15 cm above the table, at rest now."""
        plan = run.plan()
        run.simulation.execute(
            Plan(state_at(plan.q_start), (*plan.steps[:4], self.rise(run, plan)))
        )
        run.witness.received.clear()
        opening = Plan(
            state_at(run.world.arm_q("left")), (Grip("drop", GripperAction.OPEN),), limb="left"
        )
        run.simulation.execute(opening)
        return run

    @staticmethod
    def rise(run: Run, plan: Plan) -> Move:
        """From the pick straight up to rest; the plan's own retract passes on at speed."""
        arm, limits = run.manipulator.arm, run.manipulator.limits
        q_pick = plan.moves[1].trajectory.q_goal
        T_base_above = at(0.0, 0.0, FALL_M) * PICK
        return Move("rise", plan_straight_move(arm, q_pick, T_base_above, limits))

    def test_it_ends_at_rest_on_the_table(self, dropped: Run) -> None:
        assert dropped.world.supports["block"] == ("table",)
        assert dropped.world.body("block").centre_base[2] == pytest.approx(-0.130, abs=REST_M)

    def test_it_falls_with_gravity(self, dropped: Run) -> None:
        released = next(e.time_s for e in dropped.witness.events if e.kind is EventKind.RELEASED)
        settled = next(e.time_s for e in dropped.witness.events if e.kind is EventKind.SETTLED)
        snapshots = [s for s in dropped.witness.snapshots if released <= s.time_s < settled]
        heights = [s.T_base_bodies["block"].translation[2] for s in snapshots]
        drops = [GRAVITY_M_S2 * (s.time_s - released) ** 2 / 2 for s in snapshots]
        top = heights[0] + drops[0]
        moving = [(h, d) for h, d in zip(heights, drops, strict=True) if d < 0.14]
        assert len(moving) > 10
        for height, drop in moving:
            assert top - height == pytest.approx(drop, abs=1e-9)

    def test_a_fall_takes_its_time_even_when_the_fingers_are_open_sooner(
        self, dropped: Run
    ) -> None:
        released, settled = (
            next(e.time_s for e in dropped.witness.events if e.kind is kind)
            for kind in (EventKind.RELEASED, EventKind.SETTLED)
        )
        assert settled - released == pytest.approx(math.sqrt(2 * FALL_M / GRAVITY_M_S2), abs=2e-3)
