"""What fingers do in a plan: a miss ends it, and what is let go falls."""

from __future__ import annotations

import math

import pytest

from planner import Grip, GripperAction, Move, Plan, load_object, plan_straight_move
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from sim import Dwell, EventKind, Outcome, Simulation, SimulationError
from sim.world import Contact
from sim.world.falling import GRAVITY_M_S2
from tests.conftest import at, state_at
from tests.sim.runs import PICK, Run, Witness

TIME_S = 1e-9
"""Sums of some dozen durations below 10 s."""

REST_M = 1e-7
FALL_M = 0.15


def test_dwells_are_added_once_each_and_the_arm_stands_still(
    run: Run, cycle: tuple[Run, Outcome], plan: Plan
) -> None:
    witness, dwell = Witness(), Dwell(after_grasp_s=0.4, after_release_s=0.3)
    outcome = Simulation(run.world, [witness], dwell=dwell).execute(plan)
    # the cycle begins with an opening, which dwells as well
    assert outcome.duration_s == pytest.approx(cycle[1].duration_s + 0.4 + 2 * 0.3, abs=TIME_S)
    begin = next(e.time_s for e in witness.events if e.kind is EventKind.GRASPED)
    during = {s.q.tobytes() for s in witness.snapshots if begin < s.time_s <= begin + 0.4}
    assert len(during) == 1


class TestMiss:
    """A close on nothing is noticed and ends the plan there."""

    def test_it_is_an_outcome_that_names_step_body_and_gap(self, run: Run, plan: Plan) -> None:
        run.world.place_body("block", at(0.9, -0.2, -0.155))
        outcome = run.simulation.execute(plan)
        assert not outcome.is_success
        assert outcome.failure == (
            "pick: close: missed: the fingers closed fully on block, 15.3 mm apart, and hold "
            "nothing: block is 395 mm to the side of the tip and 2 mm behind it, not "
            "between the finger pads"
        )
        state = run.simulation.grippers["left"].state
        assert (state.percent, state.is_gripping, state.has_missed) == (0.0, False, True)
        assert run.witness.kinds[-1] is EventKind.MISSED
        tip = run.world.T_base_tip("left")
        assert tip.translation == pytest.approx(PICK.translation, abs=1e-6)
        moves_s = sum(move.trajectory.duration for move in plan.moves[:2])
        stroke_s = run.world.hands["left"].stroke_m / FINGER_SPEED_M_S
        assert outcome.duration_s == pytest.approx(moves_s + stroke_s, abs=TIME_S)

    def test_another_body_between_the_fingers_is_not_the_right_one(
        self, run: Run, plan: Plan
    ) -> None:
        run.simulation.delete("block")
        run.simulation.spawn(
            load_object("block", at(0.6725, 0.1265, -0.155), name="brick", is_movable=True)
        )
        outcome = run.simulation.execute(plan)
        assert outcome.failure == "pick: close: grasped brick instead of block"

    def test_a_hand_that_is_full_is_refused(self, run: Run, plan: Plan) -> None:
        run.simulation.execute(Plan(state_at(plan.q_start), plan.steps[:4]))
        close = Plan(
            state_at(run.world.arm_q("left")), (Grip("close", GripperAction.CLOSE),), limb="left"
        )
        with pytest.raises(SimulationError, match="closed on 'block'"):
            run.simulation.execute(close)


def test_what_is_let_go_falls_with_gravity_however_soon_the_fingers_are_open(
    run: Run, plan: Plan
) -> None:
    arm, limits = run.manipulator.arm, run.manipulator.limits
    q_pick, T_base_above = plan.moves[1].trajectory.q_goal, at(0.0, 0.0, FALL_M) * PICK
    rise = Move("rise", plan_straight_move(arm, q_pick, T_base_above, limits))
    run.simulation.execute(Plan(state_at(plan.q_start), (*plan.steps[:4], rise)))
    run.witness.received.clear()
    opening = (Grip("drop", GripperAction.OPEN),)
    run.simulation.execute(Plan(state_at(run.world.arm_q("left")), opening, limb="left"))
    assert run.world.supports["block"] == ("table",)
    assert run.world.body("block").centre_base[2] == pytest.approx(-0.130, abs=REST_M)
    released, settled = (
        next(e.time_s for e in run.witness.events if e.kind is kind)
        for kind in (EventKind.RELEASED, EventKind.SETTLED)
    )
    assert settled - released == pytest.approx(math.sqrt(2 * FALL_M / GRAVITY_M_S2), abs=2e-3)
    snapshots = [s for s in run.witness.snapshots if released <= s.time_s < settled]
    heights = [s.T_base_bodies["block"].translation[2] for s in snapshots]
    drops = [GRAVITY_M_S2 * (s.time_s - released) ** 2 / 2 for s in snapshots]
    top = heights[0] + drops[0]
    moving = [(h, d) for h, d in zip(heights, drops, strict=True) if d < 0.14]
    assert len(moving) > 10
    for height, drop in moving:
        assert top - height == pytest.approx(drop, abs=1e-9)


def test_an_outcome_is_a_success_when_nothing_failed_and_names_the_deepest_hit() -> None:
    assert Dwell() == Dwell(after_grasp_s=0.0, after_release_s=0.0)
    assert repr(Outcome(None, 6.5)) == "Outcome(6.50 s, success)"
    failed = Outcome("pick: close:\nmissed", 2.0)
    assert not failed.is_success
    assert "failed: pick: close: missed" in repr(failed)
    shallow, deep = (
        Contact(1.0, "l_gripper_l_finger", name, False, depth_m, False, 0.99)
        for name, depth_m in (("red", 0.001), ("box", 0.022))
    )
    outcome = Outcome(None, 2.0, hits=(shallow, deep))
    assert outcome.is_success
    assert "2 hits: l_gripper_l_finger 22.0 mm inside box" in repr(outcome)
