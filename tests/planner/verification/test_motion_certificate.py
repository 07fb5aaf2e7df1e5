"""Certified motions are clear by coal; others have a pair and an instant that coal confirms."""

from __future__ import annotations

import json
from collections.abc import Callable
from math import factorial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.errors import UnknownNameError
from planner import (
    Body,
    Box,
    Manipulator,
    Part,
    Plan,
    Scene,
    State,
    Trajectory,
    plan_joint_move,
)
from planner.certificate.checking import check
from planner.certificate.errors import NotCertifiedError
from planner.errors import PlanFileError, TaskError, TrajectoryError
from planner.plan_file import plan_document
from planner.prover.problem import SHARES
from planner.verification import MotionCertificate, PolynomialMotion, certify
from planner.verification.witness import SoughtTimeline, body_of, witness_of
from tests.conftest import at
from tests.planner.certificate.conftest import checked_alone

Array = NDArray[np.float64]
Data = dict[str, Any]

PADDING_M = 1e-3
"""The planner's body, which coal measures, contains the meshes with up to 0.5 mm to spare; so of
two links twice that."""

SAME_M = 1e-9

HELD_M = 1e-6
"""Likewise while a body is held: the planner's fingers and a certificate's close on it to this."""

INSTANTS = 1_500
"""Coal takes 0.8 ms for each."""

TOP_M = 0.12
"""Height of the wall."""


@pytest.fixture(scope="module")
def wall() -> Body:
    """A wall beside the robot, 2 cm thin, that the hand passes over."""
    part = Part(Box((0.3, 0.02, 1.0)), at(0.0, 0.0, 0.0))
    return Body("wall", (part,), at(0.95, 0.54, TOP_M - 0.5))


@pytest.fixture(scope="module")
def over(manipulator: Manipulator) -> Array:
    """Waypoints from one side of the wall over its top to the other."""
    q = np.tile(manipulator.arm.neutral, (3, 1))
    q[:, 0], q[:, 1] = (0.0, -0.45, -0.9), (-0.3, -0.7, -0.3)
    return q


@pytest.fixture(scope="module")
def before_wall(manipulator: Manipulator, wall: Body, over: Array) -> State:
    return State.of(manipulator, Scene.of([wall]), q=over[0])


@pytest.fixture(scope="module")
def quintic(over: Array) -> PolynomialMotion:
    """Over the wall from rest to rest, through its top at speed and with some acceleration."""
    q, v, a = over.copy(), np.zeros_like(over), np.zeros_like(over)
    q[1, 1], v[1, 0], a[1, 0], a[1, 1] = -0.67, -0.35, 0.1, 0.1
    return PolynomialMotion.through([0.0, 2.0, 4.0], q, v, a)


@pytest.fixture(scope="module")
def motions(quintic: PolynomialMotion, over: Array) -> list[PolynomialMotion]:
    rng, times_s = np.random.default_rng(7), np.linspace(0.0, 4.0, 81)
    noisy = positions(quintic, times_s) + rng.normal(scale=1e-4, size=(81, 7))
    noisy[0] = over[0]
    return [quintic, PolynomialMotion.waypoints(over), PolynomialMotion.through(times_s, noisy)]


def positions(motion: PolynomialMotion, times_s: Array) -> Array:
    """By Taylor's formula, term by term."""
    i = np.clip(np.searchsorted(motion.knots_s, times_s, "right") - 1, 0, None)
    i = np.minimum(i, len(motion.derivatives) - 1)
    since = (times_s - motion.knots_s[i])[:, None]
    q, term = np.zeros((len(times_s), 7)), np.ones_like(since)
    for k in range(motion.derivatives.shape[1]):
        q = q + motion.derivatives[i, k] * term
        term = term * since / (k + 1)
    return q


def moving(found: MotionCertificate) -> float:
    """What the motion itself keeps, without what stands still."""
    assert found.certified is not None, found.reason
    return dict(found.certified.clearances_m)["motion"]


@pytest.mark.slow
def test_no_instant_of_a_certified_motion_is_nearer_by_coal(
    motions: list[PolynomialMotion], manipulator: Manipulator, before_wall: State
) -> None:
    rng = np.random.default_rng(3)
    for motion in motions:
        found = certify(motion, "left", before_wall)
        assert found.is_certified, found.reason
        scene = before_wall.scene
        space = manipulator.context(
            scene, finger_m=manipulator.finger_m, margin_m=found.clearance_m - PADDING_M
        )
        drawn = rng.uniform(0.0, motion.duration_s, INSTANTS // len(motions))
        assert all(space.is_free(q) for q in positions(motion, drawn))
        q = positions(motion, np.linspace(0.0, motion.duration_s, 81))
        nearest_m = min(space.clearance(each).distance_m for each in q)
        assert 0.97 * nearest_m - PADDING_M <= found.clearance_m <= nearest_m + PADDING_M


def elevated(motion: PolynomialMotion) -> PolynomialMotion:
    """The same polynomials with higher derivatives that are 0."""
    n, k, joints = motion.derivatives.shape
    zeros = np.zeros((n, 6 - k, joints))
    return PolynomialMotion(
        motion.knots_s,
        np.concatenate([motion.derivatives, zeros], axis=1),
        is_timed=motion.is_timed,
    )


def split(motion: PolynomialMotion) -> PolynomialMotion:
    """The same motion in twice as many pieces."""
    knots, rows = [0.0], []
    for t, until, own in zip(
        motion.knots_s[:-1], motion.knots_s[1:], motion.derivatives, strict=True
    ):
        middle, shifted = 0.5 * (t + until), []
        for k in range(len(own)):  # derivatives in the middle, by Taylor's formula
            powers = [(middle - t) ** i / factorial(i) for i in range(len(own) - k)]
            shifted.append(np.array(powers) @ own[k:])
        rows += [own, np.array(shifted)]
        knots += [middle, until]
    return PolynomialMotion(np.array(knots), np.array(rows), is_timed=motion.is_timed)


@pytest.mark.slow
def test_another_representation_of_a_motion_is_judged_the_same(
    motions: list[PolynomialMotion], over: Array, before_wall: State
) -> None:
    """Bounds on speeds in shorter pieces are tighter, so rows may show a little more."""
    for motion in motions[:2]:
        kept_m = moving(certify(motion, "left", before_wall))
        assert moving(certify(elevated(motion), "left", before_wall)) == pytest.approx(kept_m)
        twin_m = moving(certify(split(motion), "left", before_wall))
        assert twin_m == pytest.approx(kept_m, rel=0.03)
    low = PolynomialMotion.waypoints(over + 0.1 * np.eye(7)[1] * [[0.0], [1.0], [0.0]])
    for motion in (low, elevated(low), split(low)):
        found = certify(motion, "left", before_wall)
        assert not found.is_certified
        assert found.pair is not None
        assert "wall" in found.pair


@pytest.mark.slow
def test_a_move_of_a_plan_keeps_what_its_plan_says(tracked_plan: Plan, robot: Baxter) -> None:
    """Asked for the same share of the distance; a plan's certificate asks for what it states."""
    document, text = plan_document(tracked_plan), robot.description.text
    timeline = SoughtTimeline(document, text)
    asked = witness_of(timeline, body_of(text).digest, timeline.found, share=SHARES[0])
    of_plan = dict(check(document, text, certificate=asked).clearances_m)
    for move in tracked_plan.moves:
        state = move.state
        assert state is not None
        contacts = [(each.body, each.other) for each in move.contacts]
        found = certify(move.trajectory, "left", state, contacts)
        same_m = HELD_M if state.attachments else SAME_M
        assert moving(found) == pytest.approx(of_plan[move.label], abs=same_m)


def test_a_motion_through_the_wall_is_refused_where_coal_finds_the_contact(
    over: Array, manipulator: Manipulator, before_wall: State
) -> None:
    space = manipulator.context(before_wall.scene, finger_m=manipulator.finger_m)
    for motion in (
        PolynomialMotion.waypoints(over[[0, 2]]),
        PolynomialMotion.through([0.0, 3.0], over[[0, 2]], np.zeros((2, 7)), np.zeros((2, 7))),
    ):
        found = certify(motion, "left", before_wall)
        assert not found.is_certified
        assert found.pair is not None
        assert "wall" in found.pair
        assert found.time_s is not None
        assert found.distance_m is not None
        assert found.distance_m <= 0.0
        near = space.clearance(positions(motion, np.array([found.time_s]))[0])
        assert "wall" in (near.first, near.second)
        assert near.distance_m < 0.0
        assert str(found).startswith("not certified: ")


def test_a_path_bends_over_the_wall_and_its_short_cut_does_not(
    over: Array, before_wall: State
) -> None:
    found = certify(over, "left", before_wall)
    assert 0.005 < found.clearance_m < 0.01
    before, after = over[1] + 0.3 * (over[0] - over[1]), over[1] + 0.3 * (over[2] - over[1])
    short = certify(np.array([over[0], before, after, over[2]]), "left", before_wall)
    assert short.pair is not None
    assert "wall" in short.pair


def test_limits_that_are_not_judged_are_listed(
    motions: list[PolynomialMotion], before_wall: State, over: Array
) -> None:
    quintic, path, _ = motions
    assert "limits not judged: velocity, acceleration, jerk" in str(
        certify(path, "left", before_wall)
    )
    judged = certify(quintic, "left", before_wall, a_max=3.0, j_max=20.0)
    assert judged.certified is not None
    assert judged.certified.not_judged == ()
    assert "acceleration beyond" in certify(quintic, "left", before_wall, a_max=0.3).reason
    assert "jerk beyond" in certify(quintic, "left", before_wall, j_max=0.3).reason
    bent = PolynomialMotion.through([0.0, 2.0, 4.0], over)
    assert certify(bent, "left", before_wall).is_certified
    assert "the velocity jumps" in certify(bent, "left", before_wall, a_max=2.0).reason
    fast = PolynomialMotion.through([0.0, 0.25, 4.0], over)
    assert "velocity beyond its limit, joint 1" in certify(fast, "left", before_wall).reason
    beyond = over + np.eye(7)[1] * [[0.0], [-1.6], [0.0]]
    assert "position beyond its limit, joint 2" in certify(beyond, "left", before_wall).reason


def test_assumed_contacts_are_listed(tracked_plan: Plan) -> None:
    moves = {move.label: move for move in tracked_plan.moves}
    descend = moves["place: descend"]
    assert descend.state is not None
    found = certify(descend.trajectory, "left", descend.state, [("block", "table")])
    assert found.certified is not None
    assert found.certified.assumed == (
        "the left hand holds block firmly",
        "block may touch table",
    )
    without = certify(descend.trajectory, "left", descend.state)
    assert without.pair == ("block", "table")


def test_columns_may_be_in_any_order_and_arms_be_either(
    quintic: PolynomialMotion, robot: Baxter, before_wall: State
) -> None:
    names = robot.arm("left").joint_names
    order = np.argsort(names)
    mixed = PolynomialMotion(
        quintic.knots_s, quintic.derivatives[:, :, order], tuple(names[i] for i in order)
    )
    assert moving(certify(mixed, "left", before_wall)) == moving(
        certify(quintic, "left", before_wall)
    )
    right = State.of(Manipulator.of(robot, "right"), before_wall.scene)
    q = right.q(robot.arm("right").joint_names)
    assert certify(np.array([q, q + 0.05]), "right", right).is_certified


def test_points_are_interpolated_as_polynomials_of_the_stated_ends() -> None:
    rng, times_s = np.random.default_rng(1), np.array([0.0, 0.3, 1.1, 1.15])
    points = rng.normal(size=(3, 4, 7))
    for known in (1, 2, 3):
        motion = PolynomialMotion.through(times_s, *points[:known])
        assert motion.derivatives.shape == (3, 2 * known, 7)
        for i, h in enumerate(np.diff(times_s)):
            own = np.polynomial.Polynomial
            for joint in range(7):
                d = motion.derivatives[i, :, joint]
                p = own([x / float(np.prod(range(1, k + 1))) for k, x in enumerate(d)])
                for k in range(known):
                    assert p.deriv(k)(0.0) == pytest.approx(points[k, i, joint])
                    assert p.deriv(k)(h) == pytest.approx(points[k, i + 1, joint], abs=1e-8)


def test_coefficients_are_those_of_rising_powers(quintic: PolynomialMotion) -> None:
    factorials = np.array([1.0, 1.0, 2.0, 6.0, 24.0, 120.0])[:, None]
    same = PolynomialMotion.of_coefficients(quintic.knots_s, quintic.derivatives / factorials)
    np.testing.assert_allclose(same.derivatives, quintic.derivatives, rtol=1e-15)


def test_without_a_compiler_a_margin_is_certified(
    quintic: PolynomialMotion, before_wall: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    full_m = certify(quintic, "left", before_wall).clearance_m
    monkeypatch.setattr("planner.verification.motion_certificate.rows_kernel", lambda: None)
    assert 0.005 <= certify(quintic, "left", before_wall).clearance_m <= full_m / 0.98


# The file


@pytest.fixture(scope="module")
def saved(
    quintic: PolynomialMotion, before_wall: State, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    path = tmp_path_factory.mktemp("motion") / "motion.json"
    certify(quintic, "left", before_wall).save(path)
    return path


def test_a_file_is_checked_with_numpy_alone(saved: Path, robot: Baxter) -> None:
    said = checked_alone(saved, robot.description.text)
    assert "certified: " in said
    assert "not judged: limits of jerk" in said


def test_a_motion_without_a_certificate_is_not_saved(
    over: Array, before_wall: State, tmp_path: Path
) -> None:
    found = certify(over[[0, 2]], "left", before_wall)
    with pytest.raises(PlanFileError, match="without a certificate"):
        found.save(tmp_path / "motion.json")


def put(*path: Any, value: Any = None, by: float | None = None) -> Callable[[Data], None]:
    """Set an entry, or increase it."""

    def change(motion: Data) -> None:
        container: Any = motion
        for key in path[:-1]:
            container = container[key]
        container[path[-1]] = value if by is None else container[path[-1]] + by

    return change


def steep(motion: Data) -> None:
    for derivatives in motion["trajectory"]["derivatives"]:
        derivatives += [[0.0] * 7]


def untimed(motion: Data) -> None:
    motion["is_timed"], motion["a_max"] = False, [9.0] * 7


ROWS = ("trajectory", "derivatives")

CHANGES: list[tuple[Callable[[Data], None], str]] = [
    (put(*ROWS, 0, 0, 1, by=0.02), "begin where the arm is|jumps"),
    (put(*ROWS, 1, 1, 1, by=0.3), "proven only|beyond"),  # a kink, and another end
    (put("trajectory", "knots_s", -1, by=0.5), "proven only|beyond|goes on|too soon"),
    (put(*ROWS, 1, 0, 3, by=1e-6), "jumps at a knot"),
    (steep, "degree above 5"),
    (put("trajectory", "knots_s", 1, value=5.0), "do not increase"),
    (put(*ROWS, 0, 2, 0, value=float("nan")), "not finite"),
    (put(*ROWS, 1, 5, 0, value=1e300), "beyond|jumps"),
    (put("contacts", value=[{"body": "wall", "other": "wall"}]), "cannot touch"),
    (put("a_max", value=[0.1] * 7), "acceleration beyond"),
    (untimed, "has no times"),
    (put("j_max", value=[float("nan")] * 7), "jerk beyond"),
    (put(*ROWS, value={"a": 1}), "malformed"),
    (lambda motion: motion.pop("is_timed"), "malformed"),
]


@pytest.mark.filterwarnings("ignore:.*encountered in:RuntimeWarning")
@pytest.mark.parametrize(("change", "reason"), CHANGES)
def test_a_changed_motion_is_not_certified(
    saved: Path, robot: Baxter, change: Callable[[Data], None], reason: str
) -> None:
    document = json.loads(saved.read_bytes())
    change(document["plan"]["steps"][0])
    with pytest.raises(NotCertifiedError, match=reason):
        check(document, robot.description.text)


def test_a_scene_that_comes_nearer_is_not_certified(saved: Path, robot: Baxter) -> None:
    document = json.loads(saved.read_bytes())
    wall = document["plan"]["start"]["scene"]["bodies"]["wall"]
    wall["T_base_body"]["translation"][2] += 0.002
    with pytest.raises(NotCertifiedError, match="proven only"):
        check(document, robot.description.text)


def test_neither_a_plan_holds_a_motion_nor_a_motion_a_move(
    saved: Path, plan: Plan, robot: Baxter
) -> None:
    motion = json.loads(saved.read_bytes())
    document: Data = {**plan_document(plan), "certificate": motion["certificate"]}
    text = robot.description.text
    with pytest.raises(NotCertifiedError, match="no file of one motion"):
        check({**document, "format": motion["format"], "version": 1}, text)
    document["plan"]["steps"][0] = motion["plan"]["steps"][0]
    with pytest.raises(NotCertifiedError, match="a plan has no step of type Motion"):
        check(document, text)


# Inputs at the door


@pytest.mark.parametrize(
    "make",
    [
        lambda q: PolynomialMotion.waypoints(q[:1]),
        lambda q: PolynomialMotion.waypoints(np.nan * q),
        lambda q: PolynomialMotion.waypoints(q[:, :6]),
        lambda q: PolynomialMotion.waypoints(q, joint_names=["a"] * 7),
        lambda q: PolynomialMotion.waypoints(q, joint_names=("left_s0",)),
        lambda q: PolynomialMotion.through([0.0, 1.0, 1.0], q),
        lambda q: PolynomialMotion.through([0.1, 1.0, 2.0], q),
        lambda q: PolynomialMotion.through([0.0, 1.0], q),
        lambda q: PolynomialMotion.through([0.0, 1.0, 2.0], q, None, q),
        lambda q: PolynomialMotion.through([0.0, 1.0, 2.0], q, np.nan * q),
        lambda q: PolynomialMotion(np.arange(2.0), np.tile(0.0 * q[:1], (1, 7, 1))),
        lambda q: PolynomialMotion(np.arange(2.0), 0.0 * q[None, :1]),
        lambda q: PolynomialMotion(np.zeros(1), 0.0 * q[None, :2][:0]),
        lambda q: PolynomialMotion(np.arange(2.0), 0.0 * q[None, :, :6]),
        lambda q: PolynomialMotion(np.arange(3.0), np.array([[q[0], q[1]], [q[0], q[1]]])),
    ],
)
def test_an_invalid_motion_is_refused(
    over: Array, make: Callable[[Array], PolynomialMotion]
) -> None:
    with pytest.raises(TrajectoryError):
        make(over)


def test_arguments_that_do_not_match_the_state_are_refused(
    over: Array, before_wall: State, manipulator: Manipulator, plan: Plan
) -> None:
    stay = Trajectory.stay(over[0], manipulator.limits)
    right = PolynomialMotion.waypoints(
        over, joint_names=[f"right_{name[5:]}" for name in manipulator.arm.joint_names]
    )
    timed = PolynomialMotion.through([0.0, 2.0, 4.0], over)
    other = plan_joint_move(over[1], over[2], manipulator.limits)
    refused: list[tuple[tuple[Any, ...], dict[str, Any], type[Exception]]] = [
        ((over, "middle", before_wall), {}, UnknownNameError),
        ((over, "left", before_wall.scene), {}, TaskError),
        ((stay, "left", before_wall), {}, TrajectoryError),
        ((right, "left", before_wall), {}, TaskError),
        ((other, "left", before_wall), {}, TaskError),
        ((over + 1e-6, "left", before_wall), {}, TaskError),
        ((over, "left", before_wall, [("wall", "right hand")]), {}, TaskError),
        ((over, "left", before_wall, [("nothing", "left hand")]), {}, TaskError),
        ((over, "left", before_wall, [("wall", "wall")]), {}, TaskError),
        ((over, "left", before_wall, ["wall"]), {}, TaskError),
        ((over, "left", before_wall), {"a_max": 1.0}, TaskError),
        ((timed, "left", before_wall), {"a_max": -1.0}, TaskError),
        ((timed, "left", before_wall), {"j_max": [1.0, 2.0]}, TaskError),
        ((over, "left", before_wall), {"description": "baxter"}, TaskError),
    ]
    for arguments, options, error in refused:
        with pytest.raises(error):
            certify(*arguments, **options)
