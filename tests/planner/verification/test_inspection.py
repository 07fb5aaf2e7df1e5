"""A good plan is certified; each way to spoil it is refused with its own reason."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, IKService, pose_from_quaternion
from baxter_kin.fields import evolve
from baxter_kin.frames import raised
from planner import (
    Body,
    Box,
    Certificate,
    Claim,
    Manipulator,
    Move,
    Part,
    PickAndPlace,
    Plan,
    PlanFailure,
    Scene,
    State,
    Trajectory,
    plan_file,
    plan_joint_move,
    plan_pick_and_place,
    plan_straight_move,
    verify,
)
from planner.clearance import Clearance, ContinuousProof
from planner.errors import TaskError
from planner.plan import Step
from planner.scene.contact import Contact
from tests.conftest import at
from tests.planner.verification.conftest import (
    BLOCK,
    DOWN,
    PICK,
    PLACE,
    TABLE_M,
    failed,
    forged,
    move_of,
    spoiled,
    standing_box,
    with_bodies,
    with_moves,
)

Change = Callable[[Plan], Plan]


def refused(plan: Plan, reason: str, state: State | None = None) -> Certificate:
    """The certificate of a plan that the checker refuses for a reason."""
    found = verify(plan, state)
    assert not found.is_valid
    assert re.search(reason, found.reason), found.verdict
    assert found.reason in found.verdict
    assert found["clearance"] in found.failures
    return found


# Plans that are good


def test_the_plan_of_the_readme_is_certified(certificate: Certificate) -> None:
    assert certificate.is_valid, certificate.verdict
    assert certificate.rows > 500
    labels = [label for label, _ in certificate.clearances_m]
    assert labels[0] == "what stands still"
    assert "place: retract" in labels
    least = min(clear for _, clear in certificate.clearances_m)
    names = ("clearance", "clearance of fingers", "clearance of the rest")
    assert least == min(certificate[name].value for name in names)


def test_a_plan_that_stops_at_every_waypoint_is_certified(stopping: Plan) -> None:
    found = verify(stopping)
    assert found.is_valid, found.verdict


@pytest.mark.slow
def test_the_right_arm_is_certified_too(robot: Baxter, table: Body) -> None:
    right = Manipulator.of(robot, "right")
    part = Part(Box((0.04, 0.04, 0.05)), at(0.0, 0.0, 0.025))
    narrow = Body("block", (part,), at(0.70, -0.15, -0.155), is_movable=True)
    scene = Scene.of([table, narrow])
    task = PickAndPlace("block", pose_from_quaternion((0.70, -0.15, -0.129), DOWN), PLACE)
    made = plan_pick_and_place(task, right, scene, right.arm.neutral)
    found = verify(made, State.of(right, scene))
    assert found.is_valid, found.verdict


def slowed(trajectory: Trajectory, times: float) -> Trajectory:
    """The same way in a multiple of its time."""
    rates = (getattr(trajectory, name) / times**n for n, name in enumerate("vaj", start=1))
    return Trajectory(trajectory.limits, trajectory.knots_s * times, trajectory.q, *rates)


def test_a_slow_plan_costs_no_more_rows_than_a_fast_one(
    plan: Plan, certificate: Certificate
) -> None:
    slow = with_moves(plan, {move.label: slowed(move.trajectory, 1e6) for move in plan.moves})
    found = verify(slow)
    assert found.is_valid, found.verdict
    assert found.rows < 1.5 * certificate.rows


def test_a_plan_that_moves_nothing_is_valid(manipulator: Manipulator, world: Scene) -> None:
    start = State.of(manipulator, world)
    stay = Move("stay", Trajectory.stay(manipulator.arm.neutral, manipulator.limits))
    assert verify(Plan(start, (stay,))).is_valid
    found = verify(Plan(start, (), limb="left"))
    assert found.is_valid, found.verdict
    assert found.verdict.startswith("valid: left arm, a plan without steps, all ")


def test_a_plan_of_one_arm_while_the_other_hand_holds_something_is_valid(
    cube_plan: Plan, holding: State
) -> None:
    found = verify(cube_plan, holding)
    assert found.is_valid, found.verdict


def test_a_hand_that_holds_something_carries_it_from_the_start(tracked_plan: Plan) -> None:
    lift = [step.label for step in tracked_plan].index("pick: retract")
    state = tracked_plan.steps[lift].state
    assert state is not None
    found = verify(evolve(tracked_plan, start=state, steps=tracked_plan.steps[lift:]))
    assert found.is_valid, found.verdict


def joined(plan: Plan, manipulator: Manipulator, label: str, **rates: Any) -> Trajectory:
    move = move_of(plan, label).trajectory
    return plan_joint_move(move.q_start, move.q_goal, manipulator.limits, **rates)


def test_passing_a_waypoint_in_motion_is_fine(stopping: Plan, manipulator: Manipulator) -> None:
    v = np.full(7, 0.01)
    moves = {
        "pick: approach": joined(stopping, manipulator, "pick: approach", v_goal=v),
        "pick: descend": joined(stopping, manipulator, "pick: descend", v_start=v),
    }
    found = verify(with_moves(stopping, moves))
    assert found.is_valid, found.verdict


# The world is another one


def moved(name: str, x: float, y: float, z: float) -> Change:
    return lambda plan: with_bodies(plan, lambda scene: scene.moved(name, at(x, y, z)))


def with_body(body: Body) -> Change:
    return lambda plan: with_bodies(plan, lambda scene: scene.with_body(body))


def boxed(size: tuple[float, float, float], x: float, y: float, z: float) -> Change:
    return with_body(Body("box", (Part(Box(size), at(0, 0, 0)),), at(x, y, z)))


def instead(*parts: Part, T: pin.SE3 = BLOCK) -> Change:
    """Another block."""
    body = Body("block", parts, T, is_movable=True)
    return lambda plan: with_bodies(plan, lambda scene: scene.without("block").with_body(body))


def opened(**by: float) -> Change:
    """Fingers of the left hand at other multiples of their opening."""

    def change(plan: Plan) -> Plan:
        joints = dict(plan.start.joints)
        for finger, times in by.items():
            joints[f"l_gripper_{finger}_finger_joint"] *= times
        return evolve(plan, start=evolve(plan.start, joints=joints))

    return change


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (moved("block", 0.675, 0.135, -0.155), "pick: close: .*inside block"),
        (moved("block", 0.775, 0.125, -0.155), "do not meet block"),
        (moved("block", 0.675, 0.125, -0.14), "would fall farther"),
        (lambda p: with_bodies(p, lambda scene: scene.without("block")), "no movable body 'block'"),
        (boxed((0.02, 0.02, 0.02), 0.482, 0.271, 0.345), "box"),
        (opened(l=1.01, r=1.01), "outside their stroke"),
        (opened(r=0.96), "not equally open"),
    ],
)
def test_a_plan_in_a_world_that_it_was_not_made_for_is_refused(
    plan: Plan, change: Change, reason: str
) -> None:
    refused(change(plan), reason)


STEM = Part(Box((0.02, 0.02, 0.08)), at(0.0, 0.0, 0.04))
BAR = Part(Box((0.02, 0.05, 0.02)), at(0.0, 0.0, 0.07))
ON_TABLE = at(0.70, 0.15, TABLE_M)


def post(x: float, y: float) -> Change:
    return with_body(standing_box("post", (0.010, 0.008, 0.05), x, y, TABLE_M))


def pushed_into_a_neighbour(plan: Plan) -> Plan:
    beside = standing_box("beside", (0.02, 0.008, 0.004), 0.70, 0.15 + 0.012, TABLE_M)
    return with_body(beside)(moved("block", 0.70, 0.146, TABLE_M)(plan))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (post(0.715, 0.1726), "pick: close: .*post"),
        (post(0.765, 0.0226), "place: open: .*post"),
        (pushed_into_a_neighbour, "pick: close: .*beside"),
        (instead(STEM, BAR, T=ON_TABLE), "block"),
    ],
)
def test_fingers_may_not_touch_bodies_that_they_do_not_close_on(
    cube_plan: Plan, change: Change, reason: str
) -> None:
    refused(change(cube_plan), reason)


@pytest.mark.slow
def test_fingers_that_open_half_way_stay_clear_of_the_post(cube_plan: Plan) -> None:
    found = verify(stepping("place: open", opening_m=0.006)(post(0.765, 0.0226)(cube_plan)))
    assert found.is_valid, found.verdict
    assert found["clearance of fingers"].value < 0.01


@pytest.mark.slow
def test_a_body_that_the_fingers_push_is_certified(plan: Plan, cube_plan: Plan) -> None:
    for aside in (
        moved("block", 0.675, 0.128, -0.155)(plan),
        moved("block", 0.70, 0.146, TABLE_M)(cube_plan),
    ):
        found = verify(aside)
        assert found.is_valid, found.verdict


def test_the_other_arm_in_the_way_is_found(plan: Plan, robot: Baxter) -> None:
    right = robot.arm("right")
    reached = IKService(right).solve(pose_from_quaternion((0.75, 0.0, 0.03), DOWN))
    joints = {**plan.start.joints, **right.joints(reached.q)}
    refused(evolve(plan, start=evolve(plan.start, joints=joints)), "right_|r_gripper")


def test_a_body_in_the_other_hand_is_an_obstacle(cube_plan: Plan, holding: State) -> None:
    crossing = at(0.70, 0.15, TABLE_M + 0.06)
    rod = Body("stick", (Part(Box((0.3, 0.006, 0.006)), at(0, 0, 0)),), crossing)
    tip, scene = holding.scene["stick"].T_base_body, holding.scene.without("stick")
    held = evolve(holding.attachments[0], T_link_body=tip.inverse() * crossing)
    refused(cube_plan, "stick", State(scene.with_body(rod), holding.joints, (held,)))


def test_a_held_body_away_from_its_hand_is_refused(cube_plan: Plan, holding: State) -> None:
    away = holding.scene["stick"].T_base_body * at(0.0, 0.0, 0.01)
    elsewhere = evolve(holding, scene=holding.scene.moved("stick", away))
    refused(cube_plan, "stick stands 10.00 mm off the hand", elsewhere)


# The plan is another one


def stepping(label: str, **changes: Any) -> Change:
    """Another step."""

    def change(plan: Plan) -> Plan:
        steps = tuple(evolve(s, **changes) if s.label == label else s for s in plan)
        return evolve(plan, steps=steps)

    return change


def asking(label: str, T: pin.SE3) -> Change:
    """Another pose of the tip, seen from the one that was asked for."""

    def change(plan: Plan) -> Plan:
        asked = move_of(plan, label).T_base_tip
        assert asked is not None
        return stepping(label, T_base_tip=asked * T)(plan)

    return change


def without(label: str) -> Change:
    return lambda p: evolve(p, steps=tuple(step for step in p if step.label != label))


TURN = pin.SE3(pin.exp3(np.array([0.0, 0.0, 4e-6])), np.zeros(3))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "reason", "row"),
    [
        (
            lambda p: evolve(p, failure=PlanFailure("place: retract", "no way up")),
            "failed",
            "failed steps",
        ),
        (stepping("place: approach", claims=(Claim("polite"),)), "claim", ""),
        (stepping("place: approach", claims=(Claim("upright"),)), "upright axis", ""),
        (asking("place: approach", at(0, 0, 2e-6)), "tip ends elsewhere", "tip position"),
        (asking("pick: descend", TURN), "tip ends elsewhere", "tip orientation"),
        (stepping("pick: descend", T_base_tip=None), "no pose of the tip", ""),
        (stepping("pick: descend", is_straight=True), "pick: descend: .*line", ""),
        (without("place: open"), "place: descend: block and table", ""),
    ],
)
def test_a_plan_that_was_changed_is_refused(
    stopping: Plan, change: Change, reason: str, row: str
) -> None:
    found = refused(change(stopping), reason)
    assert not row or not found[row].is_passed


def going(label: str, **rates: Any) -> Callable[[Plan, Manipulator], Plan]:
    return lambda p, m: with_moves(p, {label: joined(p, m, label, **rates)})


def closing_in_motion(plan: Plan, manipulator: Manipulator) -> Plan:
    v = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-4])
    moves = {
        "pick: descend": joined(plan, manipulator, "pick: descend", v_goal=v),
        "pick: retract": joined(plan, manipulator, "pick: retract", v_start=v),
    }
    return with_moves(plan, moves)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "reason", "row"),
    [
        (
            going("place: approach", v_start=np.full(7, 1e-3)),
            "begin where the arm is",
            "velocity jump between moves",
        ),
        (
            going("place: approach", a_start=np.full(7, 1e-3)),
            "begin where the arm is",
            "acceleration jump between moves",
        ),
        (closing_in_motion, "does not rest", "velocity at stops"),
        (going("place: retract", v_goal=np.full(7, 1e-4)), "does not rest", "velocity at stops"),
    ],
)
def test_a_motion_that_jumps_or_does_not_stop_is_refused(
    stopping: Plan,
    manipulator: Manipulator,
    change: Callable[[Plan, Manipulator], Plan],
    reason: str,
    row: str,
) -> None:
    found = refused(change(stopping, manipulator), reason)
    assert not found[row].is_passed


@pytest.mark.parametrize(
    ("name", "share", "reason", "row"),
    [
        ("j_max", 1 / 1.01, "jerk beyond", "jerk of limit"),
        ("a_max", 1 - 1e-6, "acceleration beyond", "acceleration of limit"),
        ("v_max", 1 - 1e-6, "velocity beyond", "velocity of limit"),
    ],
)
def test_a_limit_is_the_plans_too(
    plan: Plan, name: str, share: float, reason: str, row: str
) -> None:
    trajectory = move_of(plan, "pick: approach").trajectory
    names = ("v_max", "a_max", "j_max")
    peak = trajectory.peak_ratios()[names.index(name)]
    strict: Any = {name: share * peak * np.asarray(getattr(trajectory.limits, name))}
    limits = evolve(trajectory.limits, **strict)
    found = refused(spoiled(plan, "pick: approach", limits=limits), reason)
    assert not found[row].is_passed


def test_a_joint_beyond_its_range_between_knots_is_refused(plan: Plan) -> None:
    trajectory = move_of(plan, "place: approach").trajectory
    q_max = np.array(trajectory.limits.q_max)
    q_max[3] = trajectory.position_extrema()[1][3] - 1e-7
    limits = evolve(trajectory.limits, q_max=q_max)
    found = refused(spoiled(plan, "place: approach", limits=limits), "position beyond")
    assert "left_e1" in found["position margin"].where


def test_the_callers_limits_count(plan: Plan, manipulator: Manipulator) -> None:
    limits, reasons = manipulator.limits, set()
    for name in ("v_max", "a_max", "j_max"):
        strict: Any = {name: 0.5 * np.asarray(getattr(limits, name))}
        found = verify(plan, limits=evolve(limits, **strict))
        assert not found["stated limits of those judged by"].is_passed
        reasons.add(found.reason.split(" ")[2])
    assert reasons == {"velocity", "acceleration", "jerk"}


# Contacts in turn


BESIDE_A_FINGER = moved("block", 0.675, 0.12887, -0.155)
"""The block so far aside that a finger presses it by 0.04 mm on its way straight down."""


def test_a_finger_may_touch_the_block_right_before_it_closes(plan: Plan) -> None:
    found = verify(BESIDE_A_FINGER(plan))
    assert found.is_valid, found.verdict


def test_a_finger_may_not_touch_the_block_earlier(plan: Plan, manipulator: Manipulator) -> None:
    q, high = move_of(plan, "pick: descend").trajectory.q_goal, raised(PICK, 0.05)
    up = plan_straight_move(manipulator.arm, q, high, manipulator.limits)
    again = Move("second try", up.reversed(), PICK, is_straight=True)
    steps = list(plan)
    steps[3:3] = [Move("up again", up), again]
    refused(BESIDE_A_FINGER(evolve(plan, steps=tuple(steps))), "pick: descend: .*block")


def test_a_block_dragged_along_the_table_is_refused(plan: Plan, manipulator: Manipulator) -> None:
    held = move_of(plan, "pick: retract").trajectory
    aside = pin.SE3(PICK.rotation, PICK.translation + np.array([0.0, -0.02, 0.0]))
    drag = plan_straight_move(manipulator.arm, held.q_start, aside, manipulator.limits)
    back = plan_joint_move(drag.q_goal, held.q_start, manipulator.limits)
    steps = list(plan)
    steps[4:4] = [Move("drag", drag, aside), Move("drag back", back)]
    refused(evolve(plan, steps=tuple(steps)), "drag: it slides")


# What a plan states of itself


def stated(plan: Plan, label: str, proven_m: float, margin_m: float = 0.0) -> Plan:
    near = Clearance(proven_m, "finger", "table", 0.0)
    return stepping(label, proof=ContinuousProof(proven_m, near, margin_m, 1, 1))(plan)


def test_a_stated_proof_is_compared_with_what_is_certified(cube_plan: Plan) -> None:
    found = verify(stated(cube_plan, "pick: approach", 5.0))
    assert failed(found) == {"stated proofs beyond what is certified"}
    assert "5000.000 mm stated" in found.verdict
    found = verify(stated(cube_plan, "pick: approach", 0.001, margin_m=0.002))
    assert failed(found) == {"stated proofs that contradict themselves"}


def test_statements_about_another_world_are_not_compared(tracked_plan: Plan) -> None:
    scene = tracked_plan.start.scene
    T = scene["block"].T_base_body * at(0.0, 0.001, 0.0)
    found = verify(tracked_plan, evolve(tracked_plan.start, scene=scene.moved("block", T)))
    assert found.is_valid, found.verdict
    assert found["stated proofs beyond what is certified"].where == "no proofs are stated"


def mutated(plan: Plan, number: int, **changes: object) -> Plan:
    """A plan of which one step states something else, past every check of its class."""
    steps = list(plan.steps)
    steps[number] = forged(steps[number], **changes)
    return forged(plan, steps=tuple(steps))


def shift(rng: np.random.Generator) -> pin.SE3:
    """By 1.1 mm to 0.1 m, or turned by 1.6 to 60 deg; no symmetry hides either."""
    along = rng.normal(size=3)
    along /= np.linalg.norm(along)
    if rng.random() < 0.5:
        return pin.SE3(np.eye(3), along * 10 ** rng.uniform(-2.95, -1))
    return pin.SE3(pin.exp3(along * np.radians(10 ** rng.uniform(0.2, 1.8))), np.zeros(3))


def elsewhere(rng: np.random.Generator, state: State) -> State:
    name = str(rng.choice(list(state.scene.bodies)))
    return evolve(state, scene=state.scene.moved(name, state.scene[name].T_base_body * shift(rng)))


def another_joint(rng: np.random.Generator, state: State) -> State:
    name = str(rng.choice(list(state.joints)))
    by = 10 ** rng.uniform(-3.2, -1) * rng.choice([-1, 1])
    return evolve(state, joints={**state.joints, name: state.joints[name] + by})


def without_a_body(rng: np.random.Generator, state: State) -> State:
    held = {each.body for each in state.attachments}
    name = str(rng.choice(sorted(set(state.scene.bodies) - held)))
    return evolve(state, scene=state.scene.without(name))


def held_otherwise(rng: np.random.Generator, state: State) -> State:
    """Lost, taken by the other hand, taken when it is not, or off in the hand."""
    if not state.attachments:
        side = str(rng.choice(["left", "right"]))
        return state.held_by(f"{side}_gripper", "block", shift(rng))
    (held,) = state.attachments
    off = evolve(held, T_link_body=held.T_link_body * shift(rng))
    others: list[Any] = [(), (evolve(held, link="right_gripper"),), (off,)]
    return evolve(state, attachments=others[rng.integers(3)])


def another_state(rng: np.random.Generator, step: Step) -> dict[str, object]:
    changes = [elsewhere, another_joint, without_a_body, held_otherwise]
    assert step.state is not None
    return {"state": changes[rng.integers(4)](rng, step.state)}


def another_contact(rng: np.random.Generator, step: Step) -> dict[str, object]:
    """One more contact, or one that is longer, deeper or earlier."""
    contacts = step.contacts
    which = int(rng.integers(4 if contacts else 1))
    if which == 0 or not isinstance(step, Move):
        odd = Contact("block", str(rng.choice(["torso", "pole", "right hand"])))
        return {"contacts": (*contacts, odd)}
    number = int(rng.integers(len(contacts)))
    chosen = contacts[number]
    changed = {
        1: evolve(chosen, end_s=chosen.end_s + 10 ** rng.uniform(-2, 0)),
        2: evolve(chosen, least_m=chosen.least_m - 10 ** rng.uniform(-5, -2)),
        3: evolve(chosen, begin_s=-(10 ** rng.uniform(-3, 0))),
    }[which]
    return {"contacts": (*contacts[:number], changed, *contacts[number + 1 :])}


@pytest.mark.parametrize(
    "seed",
    [*range(6), *(pytest.param(seed, marks=pytest.mark.campaign) for seed in range(6, 40))],
)
@pytest.mark.parametrize("otherwise", [another_state, another_contact])
def test_any_other_statement_is_refused(
    tracked_plan: Plan,
    otherwise: Callable[[np.random.Generator, Step], dict[str, object]],
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    number = int(rng.integers(len(tracked_plan.steps)))
    step = tracked_plan.steps[number]
    found = verify(mutated(tracked_plan, number, **otherwise(rng, step)))
    assert not found.is_valid
    if found.reason:
        assert re.search(f"step {number + 1}|{step.label}|stated", found.reason)


# Wrong questions


@pytest.mark.parametrize(("name", "count"), [("steps", 9), ("bodies", 1), ("parts", 3)])
def test_a_plan_too_large_is_refused(
    plan: Plan, monkeypatch: pytest.MonkeyPatch, name: str, count: int
) -> None:
    monkeypatch.setattr(plan_file, "MAX_COUNTS", {**plan_file.MAX_COUNTS, name: count - 1})
    with pytest.raises(TaskError, match=f"{name}; at most {count - 1} can be checked"):
        verify(plan)


def test_wrong_arguments_are_refused(plan: Plan, world: Scene, manipulator: Manipulator) -> None:
    foreign = Manipulator.of(manipulator.robot, "right").limits
    asked: list[tuple[Any, dict[str, Any], str]] = [
        ("plan", {}, "plan must be of class Plan"),
        (plan, {"state": State(world, {})}, "no joint head_pan"),
        (plan, {"straight": ["pick: lift"]}, "no move 'pick: lift'"),
        (plan, {"limits": foreign}, "the limits are of right_s0"),
        (plan, {"response": 0.4}, "response"),
    ]
    for given, arguments, reason in asked:
        with pytest.raises(TaskError, match=reason):
            verify(given, **arguments)


def test_a_plan_of_statements_is_certified(tracked_certificate: Certificate) -> None:
    assert tracked_certificate.is_valid, tracked_certificate.verdict
