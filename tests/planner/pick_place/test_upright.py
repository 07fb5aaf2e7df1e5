"""Bodies that stay upright from grasp to release, by the planner, in files, and as it is proven."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin.fields import evolve
from baxter_kin.frames import raised
from planner import (
    Claim,
    Manipulator,
    Move,
    PickAndPlace,
    Plan,
    Scene,
    Trajectory,
    Upright,
    load_plan,
    plan_free_move,
    plan_joint_move,
    save_plan,
    tilt_of,
    verify,
)
from planner.completion import state_of
from planner.errors import FreeMoveError, MotionError, TaskError
from planner.motion.upright import RESERVED_RAD, max_tilt_rad
from tests.conftest import overhead
from tests.planner.pick_place.conftest import PICK, PLACE, box, planned

MAX_TILT_RAD = math.radians(2.0)
"""Less than the demo's cycle leans, which is 2.6 deg."""

CARRIED = ("pick: retract", "place: approach", "place: descend")


def upright_task(upright: Upright | None, place: pin.SE3 = PLACE) -> PickAndPlace:
    return PickAndPlace("block", PICK, place, upright=upright)


@pytest.fixture(scope="module")
def kept(manipulator: Manipulator, scene: Scene) -> Plan:
    found = planned(upright_task(Upright(max_tilt_rad=MAX_TILT_RAD)), manipulator, scene)
    assert found.is_valid, str(found.failure)
    return found


def test_it_leans_no_further_than_allowed_and_takes_hardly_longer(kept: Plan, plan: Plan) -> None:
    assert tilt_of(plan) > MAX_TILT_RAD
    assert tilt_of(kept) < MAX_TILT_RAD
    assert kept.motion_time_s < 1.005 * plan.motion_time_s


def test_dense_samples_lean_no_further_either(kept: Plan, manipulator: Manipulator) -> None:
    for move in kept.moves:
        if move.label in CARRIED:
            times = np.linspace(0.0, move.trajectory.duration, 2000)
            R = manipulator.arm.T_base_tips(move.trajectory.sample(times).q)[:, :3, :3]
            up = (R @ PICK.rotation[2])[:, 2]  # of the axis that is vertical at the pick
            assert np.arccos(np.clip(up, -1.0, 1.0)).max() <= MAX_TILT_RAD, move.label


def test_moves_that_carry_state_the_cone_and_it_is_certified(kept: Plan, tmp_path: Path) -> None:
    assert tuple(move.label for move in kept.moves if move.claims) == CARRIED
    (claim,) = next(move.claims for move in kept.moves if move.claims)
    assert claim.kind == "upright"
    assert dict(claim.values)["max_tilt_rad"] == MAX_TILT_RAD
    save_plan(kept, tmp_path / "plan.json")
    certificate = verify(load_plan(tmp_path / "plan.json"))
    assert certificate.is_valid, certificate.verdict


def test_the_tilt_of_a_body_in_the_hand_is_measured_from_the_start_of_the_plan(
    plan: Plan, manipulator: Manipulator
) -> None:
    """Of the demo's cycle without its grasp, cut where the body leans."""
    index, move = next(
        (index, step)
        for index, step in enumerate(plan)
        if isinstance(step, Move) and step.label == "place: descend"
    )
    held = evolve(plan, start=state_of(move), steps=plan.steps[index : index + 1])
    R = manipulator.arm.T_base_tip(move.trajectory.q_start).rotation
    tilt_rad = max_tilt_rad(manipulator.arm, move.trajectory, tuple(R[2]))
    assert tilt_of(held) == pytest.approx(tilt_rad, abs=1e-9)
    assert tilt_of(held) < tilt_of(plan)


def with_values(plan: Plan, values: Mapping[str, float]) -> Plan:
    """A plan that states another cone of the move across."""

    def changed(step: Any) -> Any:
        if not isinstance(step, Move) or step.label != "place: approach":
            return step
        (claim,) = step.claims
        return evolve(step, claims=(Claim("upright", {**claim.values, **values}),))

    return evolve(plan, steps=tuple(map(changed, plan.steps)))


@pytest.mark.parametrize("share", [0.5, 0.9, 0.999])
def test_a_cone_that_is_too_narrow_is_refused(kept: Plan, share: float) -> None:
    stated = with_values(kept, {"max_tilt_rad": share * tilt_of(kept)})
    verdict = verify(stated).verdict
    assert "place: approach: the held body leans by up to" in verdict


def test_a_cone_just_wider_than_the_motion_is_proven(kept: Plan) -> None:
    assert verify(with_values(kept, {"max_tilt_rad": 1.001 * tilt_of(kept)})).is_valid


def test_another_axis_is_refused(kept: Plan) -> None:
    assert not verify(with_values(kept, {"axis_x": 0.6, "axis_z": 0.8})).is_valid


@pytest.fixture(scope="module")
def leaning() -> PickAndPlace:
    """The block is put down leaning by 3 deg."""
    turn = pin.SE3(pin.utils.rotate("y", math.radians(3.0)), np.zeros(3))
    return upright_task(Upright(max_tilt_rad=MAX_TILT_RAD), PLACE * turn)


def test_a_place_where_it_leans_is_refused_for_certain(
    manipulator: Manipulator, scene: Scene, leaning: PickAndPlace
) -> None:
    failure = planned(leaning, manipulator, scene).failure
    assert failure is not None
    assert failure.is_certain
    assert str(failure) == (
        "place: descend: block leans by 2.9997 deg, and at most 1.9989 deg are allowed: "
        "2 deg, less 0.0011 deg in reserve for the motion between samples"
    )


def test_where_it_need_not_stay_upright_it_may_lean(
    manipulator: Manipulator, scene: Scene, leaning: PickAndPlace
) -> None:
    higher, wish = raised(leaning.T_base_place, 0.002), evolve(leaning.upright, is_required=False)
    found = planned(evolve(leaning, T_base_place=higher, upright=wish), manipulator, scene)
    assert found.is_valid, str(found.failure)
    assert not any(move.claims for move in found.moves)
    assert tilt_of(found) >= math.radians(2.9)


def test_where_none_is_found_it_says_so_and_a_wish_is_dropped(
    manipulator: Manipulator, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No share of the cone is tried, so only the joint line could be upright."""
    for module in ("motion.free_move", "pick_place.cycles"):
        monkeypatch.setattr(f"planner.{module}.KNOT_SHARES", ())
    narrow = Upright(max_tilt_rad=math.radians(0.1))
    failure = planned(upright_task(narrow), manipulator, scene).failure
    assert failure is not None
    assert not failure.is_certain
    assert failure.reason.startswith("none found at 0.1 deg; 0.4 deg would do: ")
    wish = upright_task(evolve(narrow, is_required=False))
    assert planned(wish, manipulator, scene).is_valid


@pytest.mark.parametrize(
    "given",
    [
        {"axis": (0.0, 0.0, 0.0)},
        {"axis": (0.0, 0.0, 1e-7)},
        {"axis": (0.0, 1.7e308, 1.7e308)},
        {"axis": (0.0, 1.0)},
        {"axis": "up"},
        {"axis": (0.0, np.nan, 1.0)},
        {"max_tilt_rad": 0.0},
        {"max_tilt_rad": 5.0},
        {"max_tilt_rad": np.nan},
        {"max_tilt_rad": "5 deg"},
        {"is_required": 1},
    ],
    ids=str,
)
def test_what_is_no_cone_is_refused(given: dict[str, Any]) -> None:
    with pytest.raises(MotionError):
        Upright(**given)


def test_a_short_axis_is_made_a_unit_vector() -> None:
    assert Upright((0.0, 0.0, 1e-4)).axis == (0.0, 0.0, 1.0)


def test_what_is_not_upright_is_no_requirement_of_a_task() -> None:
    with pytest.raises(TaskError):
        upright_task("upright")  # type: ignore[arg-type]


# Free moves

HAND_DOWN = Upright((0.0, 0.0, -1.0), math.radians(5.0))


def test_a_free_move_keeps_the_tip_upright(manipulator: Manipulator) -> None:
    arm, context = manipulator.arm, manipulator.context(Scene.of([]))
    start = manipulator.ik.solve(overhead(0.6, 0.5, -0.1), current=arm.start).q
    goal = manipulator.ik.solve(overhead(0.8, -0.1, 0.2), current=start).q
    direct = plan_joint_move(start, goal, arm.limits)
    motion = plan_free_move(start, goal, arm.limits, context, upright=HAND_DOWN)
    assert max_tilt_rad(arm, direct, HAND_DOWN.axis) > HAND_DOWN.max_tilt_rad
    assert max_tilt_rad(arm, motion, HAND_DOWN.axis) <= HAND_DOWN.max_tilt_rad
    assert context.is_clear(motion)
    assert motion.duration <= 1.05 * direct.duration


def test_over_a_wall_too(manipulator: Manipulator, scene: Scene) -> None:
    arm = manipulator.arm
    wall = box("wall", (0.3, 0.02, 0.2), 0.72, 0.075, -0.055)
    context = manipulator.context(scene.without("block").with_body(wall))
    start, goal = (
        manipulator.ik.solve(overhead(0.7, y, -0.08), current=arm.start).q for y in (0.2, -0.05)
    )
    motion = plan_free_move(start, goal, arm.limits, context, upright=HAND_DOWN)
    assert max_tilt_rad(arm, motion, HAND_DOWN.axis) <= HAND_DOWN.max_tilt_rad
    assert context.is_clear(motion)


def test_the_search_for_an_upright_motion_ends_at_its_timeout(manipulator: Manipulator) -> None:
    """After the first guess; whether the cone is required makes no difference to a free move."""
    arm, context, judged = manipulator.arm, manipulator.context(Scene.of([])), [0, 0]
    start = manipulator.ik.solve(overhead(0.6, 0.5, -0.1), current=arm.start).q
    goal = manipulator.ik.solve(overhead(0.8, -0.1, 0.2), current=start).q
    wish = evolve(HAND_DOWN, is_required=False)
    for number, (timeout_s, message) in enumerate([(1e-6, "in 1e-06 s"), (600.0, "within 5 deg$")]):

        def is_clear(motion: Trajectory, number: int = number) -> bool:
            judged[number] += 1
            return False

        with pytest.raises(FreeMoveError, match=message):
            plan_free_move(
                *(start, goal, arm.limits, context, is_clear), timeout_s=timeout_s, upright=wish
            )
    assert 1 <= judged[0] < judged[1]


def test_an_end_that_leans_is_refused(manipulator: Manipulator) -> None:
    arm, context = manipulator.arm, manipulator.context(Scene.of([]))
    q = manipulator.ik.solve(overhead(0.6, 0.5, -0.1), current=arm.start).q
    for upright in (Upright(max_tilt_rad=0.5), Upright((1.0, 0.0, 0.0), 0.5)):
        with pytest.raises(FreeMoveError, match="start leans by"):
            plan_free_move(q, arm.start, arm.limits, context, upright=upright)
    with pytest.raises(MotionError):
        plan_free_move(q, q, arm.limits, context, upright=0.1)  # type: ignore[arg-type]


@pytest.mark.parametrize(("excess_rad", "is_refused"), [(-1e-6, False), (1e-6, True)])
def test_ends_may_lean_as_far_as_motions(
    manipulator: Manipulator, excess_rad: float, is_refused: bool
) -> None:
    """An end is refused as such if, and only if, no motion from it would be accepted."""
    arm, context = manipulator.arm, manipulator.context(Scene.of([]))
    q = manipulator.ik.solve(overhead(0.6, 0.5, -0.1), current=arm.start).q
    axis = Upright((0.3, 0.0, -0.9)).axis
    tilt_rad = max_tilt_rad(arm, Trajectory.stay(q, arm.limits), axis)
    bound_rad = tilt_rad - excess_rad + RESERVED_RAD
    upright = Upright(axis, bound_rad)
    if is_refused:
        with pytest.raises(FreeMoveError, match=r"start leans by .* in reserve"):
            plan_free_move(q, q, arm.limits, context, upright=upright)
    else:
        assert plan_free_move(q, q, arm.limits, context, upright=upright).duration == 0.0


def test_half_a_turn_allows_every_end(manipulator: Manipulator) -> None:
    arm, context = manipulator.arm, manipulator.context(Scene.of([]))
    q = manipulator.ik.solve(overhead(0.6, 0.5, -0.1), current=arm.start).q
    upright = Upright(tuple(-arm.T_base_tip(q).rotation[2]), math.pi)  # points down
    assert plan_free_move(q, q, arm.limits, context, upright=upright).duration == 0.0
