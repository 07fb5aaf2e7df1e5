"""Closed loop: it observes, checks its fingers, retries, and always ends with a result."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter
from baxter_kin.errors import PoseError
from planner import (
    Body,
    Box,
    Manipulator,
    Part,
    Plan,
    Scene,
    make_block,
    plan_pick_and_place,
    verify,
)
from sim import (
    ClosedLoop,
    Event,
    EventKind,
    Noise,
    NoisyPoses,
    Observer,
    Simulation,
    SimulationError,
    Transfer,
    TruePoses,
    World,
)
from sim.perception import Attempt, LoopResult, Sighting
from sim.perception.closed_loop import MAX_OBSERVATIONS, WIDTH_TOLERANCE_M, mean_of, split_at_close
from sim.perception.pose_source import displaced
from tests.conftest import at, state_at

UPRIGHT_M = 0.026
"""The tip above the bottom of the block."""

DOWN = np.diag([1.0, -1.0, -1.0])
SEEN_WITHIN_M = 1e-6
"""What exact source and exact plans leave."""

TIP, GOAL = at(0.0, 0.0, 0.02), at(0.7, 0.1, -0.155)


class Diary(Observer):
    def __init__(self) -> None:
        self.events: list[Event] = []

    def on_event(self, event: Event) -> None:
        self.events.append(event)

    def count(self, kind: EventKind) -> int:
        return sum(event.kind is kind for event in self.events)


class Bench:
    """Table, block and left arm, and the transfer that moves the block."""

    def __init__(self, robot: Baxter, manipulator: Manipulator, table: Body, block: Body) -> None:
        self.world, self.diary = World(robot), Diary()
        self.manipulator = manipulator
        self.truth = TruePoses(self.world)
        self.simulation = Simulation(self.world, [self.truth, self.diary])
        self.world.move_arm("left", manipulator.arm.start)
        self.simulation.spawn(table)
        self.simulation.spawn(block)
        T = block.T_base_body
        centre = block.centre_base
        tip = pin.SE3(DOWN, np.array([*centre[:2], T.translation[2] + UPRIGHT_M]))
        goal = pin.SE3(T.rotation, T.translation + np.array([0.05, -0.15, 0.0]))
        self.transfer = Transfer("block", T.inverse() * tip, goal)

    def run(self, source: Any = None, **options: Any) -> LoopResult:
        source = self.truth if source is None else source
        loop = ClosedLoop(self.simulation, self.manipulator, source, **options)
        return loop.pick_and_place(self.transfer)

    @property
    def off_m(self) -> float:
        """How far the block really is from where it should be."""
        goal = self.world.body("block").at(self.transfer.T_base_goal)
        off = self.world.body("block").centre_base - goal.centre_base
        return float(np.linalg.norm(off))


class Mistaken:
    """Sees the block moved sideways for some observations, then as it is."""

    def __init__(self, truth: TruePoses, shifts: list[float | None]) -> None:
        self._truth, self._shifts = truth, shifts

    def observe(self, name: str, time_s: float) -> Sighting | None:
        shift = self._shifts.pop(0) if self._shifts else 0.0
        sighting = self._truth.observe(name, time_s)
        if shift is None or sighting is None:
            return None
        moved = displaced(sighting.body, np.array([0.0, shift, 0.0]), 0.0)
        return Sighting(moved, sighting.time_s)


@pytest.fixture
def bench(robot: Baxter, manipulator: Manipulator, table: Body, block: Body) -> Bench:
    return Bench(robot, manipulator, table, block)


@pytest.mark.slow
def test_with_exact_source_the_first_attempt_succeeds(bench: Bench) -> None:
    result = bench.run()
    assert result.is_success
    assert len(result.attempts) == 1
    assert result.off_m is not None
    assert result.off_m <= SEEN_WITHIN_M
    assert bench.off_m <= SEEN_WITHIN_M
    assert result.plan is result.attempts[0].plan
    plan = result.plan
    assert plan is not None
    assert verify(plan).is_valid
    picking, placing = split_at_close(plan)
    assert (*picking.steps, *placing.steps) == plan.steps
    assert picking.steps[-1].label == "pick: close"
    assert picking.start is plan.start


def test_after_a_miss_it_observes_again_and_succeeds(bench: Bench) -> None:
    result = bench.run(Mistaken(bench.truth, [0.012]))
    assert result.is_success, result.failure
    assert [attempt.failure is None for attempt in result.attempts] == [False, True]
    assert bench.diary.count(EventKind.MISSED) == 1
    assert bench.off_m <= SEEN_WITHIN_M


@pytest.mark.parametrize(("retries", "words"), [(1, "2 attempts"), (0, "one attempt")])
def test_it_gives_up_after_as_many_retries_as_allowed(
    bench: Bench, retries: int, words: str
) -> None:
    """Observed on either side of where it is, because ways around what is observed take long."""
    result = bench.run(Mistaken(bench.truth, [-0.012, *[0.012] * 99]), retries=retries)
    assert not result.is_success
    assert len(result.attempts) == retries + 1
    failure = str(result.failure)
    assert failure.startswith(f"block was not placed in {words}; the last: pick: close: missed")
    assert "pads are 57.0 mm apart, so they do not hold block" in failure
    assert bench.world.holding("left") is None


def test_a_small_error_is_pushed_straight(bench: Bench) -> None:
    """What the pads push along the closing axis costs nothing at the place."""
    result = bench.run(Mistaken(bench.truth, [0.003]))
    assert result.is_success
    assert len(result.attempts) == 1
    assert bench.diary.count(EventKind.PUSHED) == 1
    assert bench.off_m <= SEEN_WITHIN_M


def test_a_body_that_is_not_seen_is_waited_for_and_then_ends_in_a_clear_result(
    bench: Bench,
) -> None:
    never = bench.run(Mistaken(bench.truth, [None] * 9999), retries=1)
    assert never.plan is None
    failure = str(never.failure)
    assert failure.startswith("block was not placed in 2 attempts; the last: block was not seen")
    assert failure.endswith(f" in {MAX_OBSERVATIONS + 1} observations")
    late = bench.run(Mistaken(bench.truth, [None] * (MAX_OBSERVATIONS - 1)))
    assert late.is_success
    assert len(late.attempts) == 1


def test_a_body_on_the_floor_ends_in_a_clear_result(bench: Bench) -> None:
    bench.world.place_body("block", at(0.3, 0.3, -0.93))
    result = bench.run(retries=1)
    assert not result.is_success
    assert "out of reach" in str(result.failure) or "collide" in str(result.failure)
    assert result.plan is not None
    assert not result.plan.is_valid
    bench.simulation.delete("block")
    assert "was not seen" in str(bench.run(retries=0).failure)


def test_a_body_that_vanishes_after_the_place_is_a_success_nobody_saw(bench: Bench) -> None:
    result = bench.run(Mistaken(bench.truth, [0.0, *[None] * MAX_OBSERVATIONS]))
    assert result.is_success
    assert result.placed is None
    assert result.off_m is None


def test_the_fingers_alone_decide_whether_it_holds(bench: Bench) -> None:
    """What it holds is wider than what it saw, so it is something else."""
    edge = 0.05 - WIDTH_TOLERANCE_M - 0.001
    middle = Part(Box((edge, edge, edge)), at(0.025, 0.025, 0.025))
    T_base_body = bench.world.body("block").T_base_body
    narrow = Body("block", (middle,), T_base_body, is_movable=True)

    class Wrong:
        def observe(self, _name: str, time_s: float) -> Sighting | None:
            return Sighting(narrow, time_s)

    result = bench.run(Wrong(), retries=0)
    assert "the finger pads are 50.0 mm apart, so they do not hold block" in str(result.failure)


def test_what_is_seen_stands_on_the_table_whatever_height_it_is_seen_at(bench: Bench) -> None:
    class High:
        def observe(self, name: str, time_s: float) -> Sighting | None:
            sighting = bench.truth.observe(name, time_s)
            assert sighting is not None
            return Sighting(displaced(sighting.body, np.array([0.0, 0.0, -0.01]), 0.0), time_s)

    result = bench.run(High())
    assert result.is_success, result.failure
    seen = result.attempts[0].seen
    assert seen is not None
    assert seen.extent_m((0, 0, 1))[0] == pytest.approx(-0.155, abs=1e-6)


def test_what_the_other_hand_holds_is_where_that_hand_is(bench: Bench) -> None:
    cube = make_block("cube", at(0.6, -0.5, 0.3), edge_m=0.04)
    bench.world.spawn(cube)
    T = bench.world.T_base_tip("right")
    bench.world.attach("right", "cube", at(0.0, 0.0, 0.0))
    scenes: list[Scene] = []

    def plan(task: Any, manipulator: Manipulator, scene: Scene, q: Any) -> Plan:
        scenes.append(scene)
        return plan_pick_and_place(task, manipulator, scene, q)

    assert bench.run(plan=plan).is_success
    assert [sorted(scene.bodies) for scene in scenes] == [["block", "cube", "table"]]
    assert scenes[0]["cube"].T_base_body.translation == pytest.approx(T.translation)


@pytest.mark.parametrize("seed", [0, 1])
def test_noise_costs_attempts_but_not_the_block(bench: Bench, seed: int) -> None:
    rng = np.random.default_rng(seed)
    source = NoisyPoses(bench.truth, Noise(0.003, np.radians(2.0), dropout=0.2, latency_s=0.1), rng)
    result = bench.run(source, retries=6)
    assert result.is_success, result.failure
    assert bench.off_m <= 0.015


@pytest.mark.slow
def test_the_same_noise_gives_the_same_run(
    robot: Baxter, manipulator: Manipulator, table: Body, block: Body
) -> None:
    ends = []
    for _ in range(2):
        bench = Bench(robot, manipulator, table, block)
        bench.run(NoisyPoses(bench.truth, Noise(0.005), np.random.default_rng(11)))
        ends.append((bench.simulation.time_s, bench.world.q.tolist(), bench.off_m))
    assert ends[0] == ends[1]


def _with_wall(bench: Bench, T_base_wall: pin.SE3, width_m: float, height_m: float) -> Any:
    """A planner after whose first plan a wall appears, so that the plan runs into it."""

    def plan(*task: Any) -> Plan:
        found = plan_pick_and_place(*task)
        if "wall" not in bench.world.scene.bodies:
            part = Part(Box((width_m, width_m, height_m)), at(0.0, 0.0, 0.0))
            bench.simulation.spawn(Body("wall", (part,), T_base_wall, is_movable=False))
        return found

    return plan


@pytest.mark.parametrize("edge_m", [0.05, 0.054])
def test_a_hand_that_stops_before_it_closes_holds_nothing(
    robot: Baxter, manipulator: Manipulator, table: Body, edge_m: float
) -> None:
    """Whatever the width of the body: the open hand is 57.0 mm wide."""
    part = Part(Box((edge_m, edge_m, edge_m)), at(0.5 * edge_m, 0.5 * edge_m, 0.5 * edge_m))
    block = Body("block", (part,), at(0.7, 0.15, -0.155), is_movable=True)
    bench = Bench(robot, manipulator, table, block)
    x, y, _ = block.centre_base
    result = bench.run(plan=_with_wall(bench, at(x, y + 0.037, -0.125), 0.012, 0.06), retries=0)
    assert not result.is_success
    assert "wall" in str(result.failure)
    assert bench.diary.count(EventKind.GRASPED) == 0


def test_a_body_that_could_not_be_placed_is_not_released_in_mid_air(bench: Bench) -> None:
    goal = bench.transfer.T_base_goal.translation
    wall = at(goal[0], goal[1], -0.005)
    result = bench.run(plan=_with_wall(bench, wall, 0.02, 0.3), retries=3)
    assert not result.is_success
    assert len(result.attempts) == 1
    assert bench.diary.count(EventKind.RELEASED) == 0
    assert bench.world.holding("left") is not None


def test_the_number_of_an_attempt_counts_those_that_saw_nothing(bench: Bench) -> None:
    numbers: list[int] = []
    result = bench.run(Mistaken(bench.truth, [None] * MAX_OBSERVATIONS), on_attempt=numbers.append)
    assert result.is_success
    assert numbers == [1, 2]
    moves = [event.text for event in bench.diary.events if event.kind is EventKind.MOVE_STARTED]
    assert not any("again" in text for text in moves)  # nothing was missed, so it does not rise


@settings(max_examples=25)
@given(
    st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)), min_size=1, max_size=5),
    st.lists(st.floats(-1.0, 1.0), min_size=5, max_size=5),
)
def test_centre_and_yaw_are_those_of_the_mean(
    block: Body, shifts: list[tuple[float, float]], yaws: list[float]
) -> None:
    pairs = list(zip(shifts, yaws, strict=False))
    mean = mean_of([displaced(block, np.array([*shift, 0.0]), yaw) for shift, yaw in pairs])
    centre = block.centre_base + np.array([*np.mean(shifts, axis=0), 0.0])
    assert mean.centre_base == pytest.approx(centre, abs=1e-9)
    R = mean.T_base_body.rotation
    assert np.arctan2(R[1, 0], R[0, 0]) == pytest.approx(np.mean(yaws[: len(pairs)]), abs=1e-9)
    assert R[2, 2] == pytest.approx(1.0)
    assert mean_of([block]).T_base_body.isApprox(block.T_base_body, 1e-12)


def test_every_retry_observes_once_more_often(bench: Bench) -> None:
    """The second attempt sees 12 mm and -12 mm, and takes the middle."""
    result = bench.run(Mistaken(bench.truth, [0.012, 0.012, -0.012]), retries=1)
    assert result.is_success, result.failure
    assert len(result.attempts) == 2
    assert bench.off_m <= SEEN_WITHIN_M


def test_wrong_arguments_are_refused(bench: Bench) -> None:
    bad: Any
    for bad in (-1, 1.5, None, True, "3"):
        with pytest.raises(SimulationError, match="retries"):
            bench.run(retries=bad)
    loop = ClosedLoop(bench.simulation, bench.manipulator, bench.truth)
    for bad in (None, "block", 5):
        with pytest.raises(SimulationError, match="transfer"):
            loop.pick_and_place(bad)
    for bad in (5, None, "source", TruePoses):
        with pytest.raises(SimulationError, match="observe"):
            ClosedLoop(bench.simulation, bench.manipulator, bad)
    bad = 5
    with pytest.raises(SimulationError, match="callable"):
        ClosedLoop(bench.simulation, bench.manipulator, bench.truth, plan=bad)
    with pytest.raises(SimulationError, match="closes no fingers"):
        split_at_close(Plan(state_at(np.zeros(7)), (), limb="left"))


# Transfers and results as values


@pytest.fixture(scope="module")
def plans(manipulator: Manipulator) -> list[Plan]:
    return [Plan(state_at(manipulator.arm.neutral), (), limb="left") for _ in range(2)]


def test_a_transfer_keeps_its_poses_when_the_callers_change() -> None:
    tip, goal = pin.SE3(TIP), pin.SE3(GOAL)
    transfer = Transfer("block", tip, goal)
    tip.translation, goal.translation = np.ones(3), np.ones(3)
    assert transfer.T_body_tip == TIP
    assert transfer.T_base_goal == GOAL


@pytest.mark.parametrize("name", ["hover_m", "clear_m"])
@pytest.mark.parametrize("height_m", [0.0, -0.1, np.nan, np.inf, None, "high"])
def test_a_height_that_is_not_above_zero_is_refused(name: str, height_m: Any) -> None:
    with pytest.raises(SimulationError, match=name):
        Transfer("block", TIP, GOAL, **{name: height_m})


def test_a_transfer_without_a_name_or_poses_is_refused() -> None:
    bad: Any
    for bad in (None, 5, ["block"]):
        with pytest.raises(SimulationError, match=r"Transfer\.body"):
            Transfer(bad, TIP, GOAL)
    for bad in (None, "here", np.zeros((4, 4))):
        with pytest.raises(PoseError):
            Transfer("block", bad, GOAL)
        with pytest.raises(PoseError):
            Transfer("block", TIP, bad)


def test_the_plan_of_a_result_is_that_of_the_last_attempt_that_saw_the_body(
    plans: list[Plan], block: Body
) -> None:
    seen = [Attempt(block, plan, "missed") for plan in plans]
    blind = Attempt(None, None, "block was not seen")
    assert LoopResult((*seen, blind), "gave up").plan is plans[1]
    assert LoopResult((blind,), "gave up").plan is None
    assert LoopResult((), "gave up").plan is None


def test_its_line_says_how_far_off_or_why_not(plans: list[Plan], block: Body) -> None:
    done = Attempt(block, plans[0], None)
    assert LoopResult((done,), None, block, 0.001).is_success
    assert not LoopResult((done,), "the block slipped").is_success
    assert "1 attempt, success, 1.0 mm off" in repr(LoopResult((done,), None, block, 0.001))
    assert "failed: gave up" in repr(LoopResult((done, done), "gave up"))
    assert "not seen" in repr(Attempt(None, None, "dark"))
