"""A tray in both hands: the relative pose of the tips, clearance, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import PoseError
from baxter_kin.fields import evolve
from baxter_kin.ik import sample_solutions
from baxter_kin.validation import FloatArray
from planner import (
    Attachment,
    Body,
    Box,
    LineTolerance,
    Manipulator,
    PairMove,
    Part,
    Scene,
    State,
    Upright,
    context_of_both,
    limits_of_both,
    plan_pair_move,
)
from planner.collision.context import sample_times
from planner.errors import FreeMoveError, MotionError, StraightMoveError, TaskError
from planner.motion.joint_move import RATIO_TOLERANCE
from tests.conftest import at

HALF_M = 0.22


def tips_of(half_m: float) -> dict[str, pin.SE3]:
    """The hands hold the tray at both ends and point at each other."""
    R_left = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    R_right = np.array([[-1.0, 0, 0], [0, 0, 1.0], [0, 1.0, 0]])
    return {
        "left": pin.SE3(R_left, np.array([0.0, half_m, 0.0])),
        "right": pin.SE3(R_right, np.array([0.0, -half_m, 0.0])),
    }


T_TRAY_TIP = tips_of(HALF_M)

END_M = 1e-7

WAYS = {
    "up": ((0.60, 0.0, -0.05), (0.60, 0.0, 0.25)),
    "sideways": ((0.60, 0.15, 0.10), (0.60, -0.15, 0.10)),
    "forward": ((0.45, 0.0, 0.15), (0.70, 0.0, 0.15)),
}


@pytest.fixture(scope="module")
def manipulators(robot: Baxter) -> dict[str, Manipulator]:
    return {side: Manipulator.of(robot, side) for side in ("left", "right")}


@pytest.fixture(scope="module")
def held_at(
    robot: Baxter, manipulators: dict[str, Manipulator], table: Body
) -> Callable[..., State]:
    """States in which both hands hold the tray at a pose, far from the limits of their joints."""

    def state_at(T: pin.SE3, *others: Body, half_m: float = HALF_M) -> State:
        tips, sizes = tips_of(half_m), (0.2, 2.0 * half_m + 0.06, 0.02)
        tray = Body("tray", (Part(Box(sizes), pin.SE3.Identity()),), T)
        held = [
            Attachment("tray", manipulators[side].arm.tip_frame, T_tip.inverse())
            for side, T_tip in tips.items()
        ]
        state = State.of(manipulators["left"], Scene.of([table, tray, *others]), held)
        solutions = []
        for side, T_tip in tips.items():
            found = sample_solutions(manipulators[side].ik, T * T_tip)
            limits = manipulators[side].limits
            middle = (limits.q_min + limits.q_max) / 2.0
            solutions.append(found[np.argsort(np.abs(found - middle).max(axis=1))])
        context = context_of_both(manipulators, evolve(state, scene=Scene.of([table, tray])))
        qs = (np.concatenate([a, b]) for a in solutions[0][:20] for b in solutions[1][:20])
        q = next(q for q in qs if context.is_free(q))
        names = limits_of_both(manipulators).names
        return state.moved(robot, dict(zip(names, q.tolist(), strict=True)))

    return state_at


def relative(robot: Baxter, q: FloatArray) -> pin.SE3:
    """The right tip seen from the left one, by Pinocchio."""
    return robot.arm("left").T_base_tip(q[:7]).actInv(robot.arm("right").T_base_tip(q[7:]))


def check(
    robot: Baxter,
    manipulators: dict[str, Manipulator],
    state: State,
    move: PairMove,
    T_goal: pin.SE3,
    *,
    half_m: float = HALF_M,
) -> None:
    """Everything that is promised, at random or dense instants."""
    motion, rng, tips = move.trajectory, np.random.default_rng(0), tips_of(half_m)
    wanted = tips["left"].actInv(tips["right"])
    times = rng.uniform(0.0, motion.duration, 2000)
    errors = [wanted.actInv(relative(robot, q)) for q in motion.sample(times).q]
    off_m = max(float(np.linalg.norm(each.translation)) for each in errors)
    off_rad = max(float(np.linalg.norm(pin.log3(each.rotation))) for each in errors)
    assert off_m <= move.deviation.position_m <= 1e-4
    assert off_rad <= move.deviation.rotation_rad <= np.radians(0.02)
    assert max(motion.peak_ratios()) <= 1.0 + RATIO_TOLERANCE
    assert not np.any([motion.v[[0, -1]], motion.a[[0, -1]]])
    np.testing.assert_allclose(move.T_base_bodies[-1], T_goal.homogeneous, atol=END_M)
    start = state.scene["tray"].T_base_body.homogeneous
    np.testing.assert_allclose(move.T_base_bodies[0], start, atol=1e-5)
    context = context_of_both(manipulators, state)
    qs = motion.sample(sample_times(motion, 0.02)).q
    nearest_m = min(context.clearance(q).distance_m for q in qs)
    assert 0.0 < move.proof.proven_m <= nearest_m + 2e-3  # links are a little thicker for coal
    names = motion.limits.names
    there = state.moved(robot, dict(zip(names, motion.q_goal.tolist(), strict=True)))
    assert there.scene["tray"].T_base_body.isApprox(T_goal, 1e-6)


@pytest.mark.parametrize("is_straight", [False, True])
@pytest.mark.parametrize("way", WAYS)
def test_the_hands_keep_their_relative_pose_at_every_instant(
    robot: Baxter,
    manipulators: dict[str, Manipulator],
    held_at: Callable[..., State],
    way: str,
    is_straight: bool,
) -> None:
    start, goal = (at(*xyz) for xyz in WAYS[way])
    state = held_at(start)
    move = plan_pair_move(manipulators, state, goal, is_straight=is_straight)
    check(robot, manipulators, state, move, goal)
    if is_straight:
        bodies = [
            robot.arm("left").T_base_tip(q[:7]) * T_TRAY_TIP["left"].inverse()
            for q in move.trajectory.sample(np.linspace(0.0, move.duration_s, 500)).q
        ]
        along = goal.translation - start.translation
        along /= np.linalg.norm(along)
        off = np.array([each.translation - start.translation for each in bodies])
        assert np.linalg.norm(off - np.outer(off @ along, along), axis=1).max() < 1e-4
        assert max(np.linalg.norm(pin.log3(each.rotation)) for each in bodies) < np.radians(0.02)


def test_a_tray_is_turned_and_stays_upright(
    robot: Baxter, manipulators: dict[str, Manipulator], held_at: Callable[..., State]
) -> None:
    state, upright = held_at(at(0.50, 0.1, 0.1)), Upright(max_tilt_rad=np.radians(2.0))
    goal = at(0.50, -0.1, 0.2) * pin.SE3(pin.utils.rotate("z", 0.2), np.zeros(3))
    move = plan_pair_move(manipulators, state, goal, upright=upright)
    check(robot, manipulators, state, move, goal)
    qs = move.trajectory.sample(np.linspace(0.0, move.duration_s, 2000)).q
    R = robot.arm("left").T_base_tips(qs[:, :7]) @ T_TRAY_TIP["left"].inverse().homogeneous
    assert np.arccos(R[:, 2, 2].clip(-1.0, 1.0)).max() <= np.radians(2.0)


def test_a_post_in_the_way_is_passed(
    robot: Baxter, manipulators: dict[str, Manipulator], held_at: Callable[..., State]
) -> None:
    post = Body("post", (Part(Box((0.03, 0.03, 0.26)), pin.SE3.Identity()),), at(0.72, 0.0, -0.05))
    start, goal = at(0.60, 0.15, 0.10), at(0.60, -0.15, 0.10)
    state = held_at(start, post)
    plain = plan_pair_move(manipulators, evolve(state, scene=state.scene.without("post")), goal)
    assert not context_of_both(manipulators, state).is_clear(plain.trajectory)
    move = plan_pair_move(manipulators, state, goal)
    check(robot, manipulators, state, move, goal)
    assert move.duration_s >= 0.999 * plain.duration_s


GAP = {"half_m": 0.19, "x": 0.41, "y": -0.14, "yaw": 0.25, "from": 0.23, "to": 0.46}
"""A tray that the left arm reaches at both heights and, with the same turn, not in between."""


def in_gap(z: float) -> pin.SE3:
    return at(GAP["x"], GAP["y"], z) * pin.SE3(pin.utils.rotate("z", GAP["yaw"]), np.zeros(3))


def test_a_straight_line_with_a_gap_is_refused_before_the_program(
    manipulators: dict[str, Manipulator], held_at: Callable[..., State]
) -> None:
    state, goal = held_at(in_gap(GAP["from"]), half_m=GAP["half_m"]), in_gap(GAP["to"])
    with pytest.raises(FreeMoveError, match="straight line is out of reach of the left arm"):
        plan_pair_move(manipulators, state, goal, is_straight=True)
    ik, T_tip = manipulators["left"].ik, tips_of(GAP["half_m"])["left"]
    is_reached = [
        bool(len(sample_solutions(ik, in_gap(z) * T_tip, turns=400)))
        for z in np.linspace(GAP["from"], GAP["to"], 24)
    ]
    assert is_reached[0]
    assert is_reached[-1]
    assert not all(is_reached)


def test_any_other_way_leads_around_the_gap(
    robot: Baxter, manipulators: dict[str, Manipulator], held_at: Callable[..., State]
) -> None:
    state, goal = held_at(in_gap(GAP["from"]), half_m=GAP["half_m"]), in_gap(GAP["to"])
    move = plan_pair_move(manipulators, state, goal)
    check(robot, manipulators, state, move, goal, half_m=GAP["half_m"])


def one_hand(state: State) -> State:
    return evolve(state, attachments=state.attachments[:1])


def elsewhere(state: State) -> State:
    left, right = state.attachments
    moved = evolve(right, T_link_body=right.T_link_body * at(0.0, 0.01, 0.0))
    return evolve(state, attachments=(left, moved))


HALF_TURN = pin.SE3(pin.utils.rotate("z", np.pi), np.zeros(3))

GOAL = at(0.60, 0.0, 0.2)


@pytest.mark.parametrize(
    ("changes", "error", "text"),
    [
        ({"state": one_hand}, TaskError, "both hands must hold one body"),
        ({"state": elsewhere}, TaskError, "not where their attachments"),
        ({"state": None}, TaskError, None),
        ({"manipulators": {}}, TaskError, "left and right"),
        ({"T_base_goal": at(0.95, 0.0, 0.15)}, FreeMoveError, "out of reach of the left arm: "),
        ({"T_base_goal": at(0.7, -0.15, 0.39)}, FreeMoveError, "right arm does not reach the goal"),
        ({"T_base_goal": at(0.6, 0.0, -0.3)}, FreeMoveError, None),
        ({"T_base_goal": "there"}, PoseError, None),
        (
            {
                "T_base_goal": at(0.6, 0.0, 0.2)
                * pin.SE3(pin.utils.rotate("z", np.pi), np.zeros(3)),
                "is_straight": True,
            },
            MotionError,
            None,
        ),
        ({"tolerance": LineTolerance.about("z")}, MotionError, "free about z"),
        ({"upright": Upright((1.0, 0.0, 0.0), 0.1)}, FreeMoveError, "start leans"),
        ({"margin_m": -1.0}, MotionError, "negative"),
    ],
)
def test_refuses_what_both_hands_cannot_do(
    manipulators: dict[str, Manipulator],
    held_at: Callable[..., State],
    changes: dict[str, Any],
    error: type[Exception],
    text: str | None,
) -> None:
    given: dict[str, Any] = {"manipulators": manipulators, "T_base_goal": GOAL}
    given["state"] = held_at(at(0.60, 0.0, 0.05))
    changed = dict(changes)
    if callable(changed.get("state")):
        changed["state"] = changed["state"](given["state"])
    with pytest.raises(error, match=text):
        plan_pair_move(**{**given, **changed})


def test_a_start_inside_something_is_refused(
    manipulators: dict[str, Manipulator], held_at: Callable[..., State]
) -> None:
    wall = Body("wall", (Part(Box((0.1, 0.1, 0.1)), pin.SE3.Identity()),), at(0.6, 0.0, 0.05))
    with pytest.raises(FreeMoveError, match="start in collision"):
        plan_pair_move(manipulators, held_at(at(0.60, 0.0, 0.05), wall), GOAL)


def test_a_line_that_an_arm_cannot_follow_says_so(
    manipulators: dict[str, Manipulator], held_at: Callable[..., State]
) -> None:
    with pytest.raises((FreeMoveError, StraightMoveError)):
        plan_pair_move(
            manipulators,
            held_at(at(0.60, 0.0, 0.05)),
            at(0.6, -0.45, 0.6),
            is_straight=True,
        )
