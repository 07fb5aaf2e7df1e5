"""What a hand grasps and lets go, where fingers start, and what a plan states of itself."""

from __future__ import annotations

from dataclasses import replace

import pytest

from planner import Body, Box, Move, Part, Plan, State, verify
from planner.clearance import Clearance, ContinuousProof
from tests.conftest import at
from tests.planner.verification.conftest import BLOCK, TABLE_M, failed, with_bodies

NO_ROOM = {"room in the open hand", "gap of closed pads", "press of contacts"}
"""What fails when the fingers come down onto the body."""

COAL_M = 1e-6
"""Accuracy of coal's distances as it is set by default."""

PAD_M = 0.00035
"""How much further in the pads of the meshes stand than the URDF's boxes."""


def stated(plan: Plan, label: str, proof: ContinuousProof) -> Plan:
    steps = [
        replace(step, proof=proof) if isinstance(step, Move) and step.label == label else step
        for step in plan
    ]
    return replace(plan, steps=tuple(steps))


def claim(
    proven_m: float, margin_m: float = 0.0, nearest_m: float | None = None
) -> ContinuousProof:
    near = Clearance(proven_m if nearest_m is None else nearest_m, "finger", "table", 0.0)
    return ContinuousProof(proven_m, near, margin_m, 1, 1)


def test_fingers_start_within_their_stroke(plan: Plan) -> None:
    joints = dict(plan.start.joints)
    for name in ("l_gripper_l_finger_joint", "l_gripper_r_finger_joint"):
        joints[name] *= 1.01
    found = verify(replace(plan, start=replace(plan.start, joints=joints)))
    assert "finger start outside the stroke" in failed(found)
    assert "l_gripper_" in found["finger start outside the stroke"].where


def test_fingers_start_equally_open(plan: Plan) -> None:
    joints = {**plan.start.joints, "l_gripper_r_finger_joint": -0.02}
    found = verify(replace(plan, start=replace(plan.start, joints=joints)))
    assert "fingers unequally open" in failed(found)


def test_a_block_beside_the_hand_has_no_room(plan: Plan) -> None:
    moved = with_bodies(plan, lambda scene: scene.moved("block", at(0.675, 0.135, -0.155)))
    assert failed(verify(moved)) == NO_ROOM


def test_a_block_that_the_fingers_push_by_3_mm_passes(plan: Plan) -> None:
    moved = with_bodies(plan, lambda scene: scene.moved("block", at(0.675, 0.128, -0.155)))
    found = verify(moved)
    assert found.is_valid, found.verdict
    assert found["room in the open hand"].value == pytest.approx(0.000833 - PAD_M, abs=1e-5)


def test_a_block_let_go_in_the_air_falls(plan: Plan) -> None:
    moved = with_bodies(plan, lambda scene: scene.moved("block", at(0.675, 0.125, -0.14)))
    found = verify(moved)
    assert failed(found) == {"drop at release"}
    assert found["drop at release"].value == pytest.approx(0.015, abs=COAL_M)


def test_a_block_too_wide_for_the_hand_is_found(plan: Plan, block: Body) -> None:
    part = Part(Box((0.05, 0.07, 0.05)), at(0.025, 0.025, 0.025))
    wide = Body("block", (part,), BLOCK, is_movable=True)
    found = verify(with_bodies(plan, lambda scene: scene.without("block").with_body(wide)))
    assert failed(found) == NO_ROOM


def test_the_hand_may_not_stand_inside_the_body_it_grasps_by_its_stem(cube_plan: Plan) -> None:
    stem = Part(Box((0.02, 0.02, 0.08)), at(0.0, 0.0, 0.04))
    bar = Part(Box((0.02, 0.05, 0.02)), at(0.0, 0.0, 0.07))
    tee = Body("block", (stem, bar), at(0.70, 0.15, TABLE_M), is_movable=True)
    found = verify(with_bodies(cube_plan, lambda scene: scene.without("block").with_body(tee)))
    assert "gap of closed pads" in failed(found)  # the fingers meet the crossbar first
    assert found["gap of closed pads"].value > 0.005


def test_a_stated_proof_of_five_metres_is_not_believed(cube_plan: Plan) -> None:
    found = verify(stated(cube_plan, "pick: approach", claim(5.0)))
    assert failed(found) == {"stated proofs beyond what is measured"}
    assert "5000.000 mm" in found.verdict


def test_a_stated_distance_of_five_metres_is_not_believed(cube_plan: Plan) -> None:
    found = verify(stated(cube_plan, "pick: approach", claim(0.001, nearest_m=5.0)))
    assert failed(found) == {"stated proofs beyond what is measured"}


def test_a_true_claim_is_accepted(cube_plan: Plan) -> None:
    assert verify(stated(cube_plan, "pick: approach", claim(0.001))).is_valid


def test_a_margin_above_its_proof_is_not_believed(cube_plan: Plan) -> None:
    found = verify(stated(cube_plan, "pick: approach", claim(0.001, margin_m=0.002)))
    assert failed(found) == {"stated proofs that contradict themselves"}


def test_a_stated_margin_must_be_kept(cube_plan: Plan) -> None:
    found = verify(stated(cube_plan, "pick: descend", claim(0.1, margin_m=0.1)))
    assert "clearance beyond the stated margin" in failed(found)


def test_what_is_held_stands_where_its_hand_is(cube_plan: Plan, holding: State) -> None:
    away = holding.scene["stick"].T_base_body * at(0.0, 0.0, 0.01)
    elsewhere = replace(holding, scene=holding.scene.moved("stick", away))
    assert failed(verify(cube_plan, elsewhere)) == {"held bodies off their hands"}
