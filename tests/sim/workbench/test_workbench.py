"""A task in one line: done and measured, refused with a reason, or a sentence on what was wrong."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import PoseError, UnknownNameError
from planner import make_block, verify
from planner.errors import MotionError, SceneError, TaskError
from sim import EventKind, SimulationError, TaskResult, Workbench
from sim.workbench.tabletop import TABLE_Z_M, on_table
from tests.conftest import at
from tests.sim.runs import Witness

PLACED_WITHIN_M = 1e-5


@pytest.fixture
def bench(robot: Baxter) -> Workbench:
    """A red block before the left arm."""
    bench = Workbench(robot)
    bench.add_block("red", 0.70, 0.15)
    return bench


@pytest.fixture(scope="module")
def still(robot: Baxter) -> Workbench:
    """The same, where nothing is changed any more: for requests that are refused."""
    bench = Workbench(robot)
    bench.add_block("red", 0.70, 0.15)
    return bench


@pytest.fixture(scope="module")
def carried(robot: Baxter) -> tuple[Workbench, TaskResult]:
    """The red block brought elsewhere by the left arm; nothing is changed any more."""
    bench = Workbench(robot)
    bench.add_block("red", 0.70, 0.15)
    return bench, bench.carry("red", to=(0.75, 0.0), arm="left")


def middle_of(bench: Workbench, block: str) -> list[float]:
    middle: list[float] = bench.world.body(block).centre_base.tolist()
    return middle


def test_a_block_goes_where_it_is_sent(carried: tuple[Workbench, TaskResult]) -> None:
    bench, task = carried
    assert task.is_done
    assert middle_of(bench, "red") == pytest.approx(
        [0.75, 0.0, TABLE_Z_M + 0.025], abs=PLACED_WITHIN_M
    )
    assert bench.tasks == [task]
    assert bench.motion_s == task.motion_s > 1.0
    text = str(task)
    assert text.startswith("carry red: done by the left arm in ")
    assert re.search(r" mm off its place \(verified, \d+ checks\)$", text)
    assert "\n" not in text
    assert task.plan is not None
    assert verify(task.plan).is_valid
    recording = bench.recording()
    assert recording.times_s[-1] == bench.simulation.time_s
    assert set(recording.bodies) == {"table", "red"}
    assert bench.replay().html.startswith("<!DOCTYPE html>")


@pytest.mark.slow
def test_the_faster_arm_does_it_unless_one_is_named(robot: Baxter) -> None:
    for arm, done_by in ((None, "right"), ("left", "left")):
        bench = Workbench(robot)
        bench.add_block("red", 0.70, -0.05, edge_m=0.04)
        assert bench.carry("red", to=(0.70, -0.20), arm=arm).arm == done_by


@pytest.mark.slow
def test_a_block_stands_on_the_middle_of_another_turned_as_that_is(bench: Workbench) -> None:
    bench.add_block("blue", 0.70, -0.05, edge_m=0.04, yaw_rad=0.3)
    assert bench.carry("red", onto="blue", arm="left").is_done
    below, above = bench.world.body("blue"), bench.world.body("red")
    assert middle_of(bench, "red") == pytest.approx(
        [0.70, -0.05, TABLE_Z_M + 0.04 + 0.025], abs=PLACED_WITHIN_M
    )
    np.testing.assert_allclose(
        above.T_base_body.rotation, below.T_base_body.rotation, atol=PLACED_WITHIN_M
    )


@pytest.mark.slow
def test_a_block_takes_a_pose(bench: Workbench) -> None:
    goal = on_table(0.72, 0.05, 0.05)
    goal.rotation = pin.utils.rotate("z", math.radians(30.0))
    assert bench.carry("red", to=goal, arm="left").is_done
    assert bench.world.body("red").T_base_body.isApprox(goal, PLACED_WITHIN_M)


def test_a_block_has_the_colour_of_its_name_unless_another_is_given(bench: Workbench) -> None:
    bench.add_block("blue", 0.60, 0.0)
    bench.add_block("third", 0.60, 0.2, colour="yellow")
    colours = [bench.world.body(name).parts[0].rgba[:3] for name in ("red", "blue", "third")]
    assert colours == [
        make_block(name, at(0, 0, 0)).parts[0].rgba[:3] for name in ("red", "blue", "yellow")
    ]


@pytest.mark.parametrize(
    ("to", "why"),
    [
        ((1.40, 0.40), "left arm, place: .* right arm, place: "),
        ((0.30, 0.10), r"\(0.3, 0.1\) m is beside the table, which reaches from x = 0.54 to 1.46"),
        ((0.75, -0.60), "beside the table, .* from y = -0.46 to 0.46 m"),
    ],
)
def test_what_cannot_be_done_is_refused_with_the_reason_and_nothing_moves(
    still: Workbench, to: tuple[float, float], why: str
) -> None:
    before = still.world.q
    task = still.carry("red", to=to)
    assert not task.is_done
    assert task.arm == ""
    assert task.off_m is None
    assert str(task).startswith("carry red: refused: ")
    np.testing.assert_array_equal(still.world.q, before)
    with pytest.raises(AssertionError, match=why):
        raise AssertionError(str(task))


@pytest.mark.slow
def test_a_block_below_another_stays_there(bench: Workbench) -> None:
    bench.add_block("blue", 0.70, -0.10)
    assert bench.carry("red", onto="blue").is_done
    task = bench.carry("blue", to=(0.80, 0.15))
    assert str(task) == "carry blue: refused: red stands on blue; carry that away first"
    assert task.plan is None


def test_a_block_that_carries_a_plank_with_another_stays_there(bench: Workbench) -> None:
    bench.add_block("blue", 0.70, 0.05)
    bench.simulation.spawn(make_block("top", at(0.70, 0.10, 0.0), edge_m=(0.04, 0.14, 0.02)))
    for name in ("red", "blue"):
        task = bench.carry(name, to=(0.80, -0.15))
        assert task.verdict == f"refused: top stands on {name}, too; carry that away first"


def test_a_place_that_is_taken_is_refused_by_who_stands_there(bench: Workbench) -> None:
    bench.add_block("green", 0.70, -0.15)
    task = bench.carry("red", to=(0.71, -0.14), arm="left")
    assert "place: descend: green stands there: red would be" in task.verdict


def test_a_block_inside_a_table_that_is_measured_higher_is_lifted_out_of_it_with_a_warning(
    robot: Baxter, caplog: pytest.LogCaptureFixture
) -> None:
    bench = Workbench(robot)
    table = bench.world.body("table")
    bench.simulation.delete("table")
    bench.simulation.spawn(table.at(at(0.0, 0.0, 0.003) * table.T_base_body))
    bench.add_block("red", 0.70, 0.15)
    assert caplog.messages == ["red would be 3.0 mm inside table; it is put 3.0 mm higher"]
    bottom_m, _ = bench.world.body("red").extent_m((0.0, 0.0, 1.0))
    assert bottom_m == pytest.approx(TABLE_Z_M + 0.003, abs=1e-6)


def test_a_block_that_would_hang_in_the_air_is_refused_or_reported(still: Workbench) -> None:
    task = still.carry("red", to=on_table(0.75, 0.0, 0.05, above_m=0.1))
    assert not task.is_done
    assert "verified" not in task.verdict
    refused = still.carry("red", to=(1.40, 0.40), arm="left")
    assert refused.plan is not None
    assert str(refused.plan.failure) in str(refused)


NOWHERE: Any = [
    "0.7 0.0",
    (0.7,),
    (0.7, 0.0, 0.1),
    (0.7, math.nan),
    0.7,
    {},
]


@pytest.mark.parametrize(
    ("what", "where", "error", "words"),
    [
        ("green", {"to": (0.7, 0.0)}, SceneError, "'green' in the scene; it has: table, red"),
        ("red", {"onto": "green"}, SceneError, "no body 'green'"),
        (
            "table",
            {"to": (0.7, 0.0)},
            SceneError,
            "'table' is not a block",
        ),
        ("red", {"onto": "red"}, SceneError, "cannot stand on itself"),
        ("red", {"to": (0.7, 0.0), "arm": "middle"}, UnknownNameError, "middle"),
        ("red", {}, SimulationError, "where the block goes"),
        ("red", {"to": (0.7, 0.0), "onto": "red"}, SimulationError, "where the block goes"),
        ("red", {"to": pin.SE3(2.0 * np.eye(3), np.zeros(3))}, PoseError, "rotation"),
        *(("red", {"to": to}, SceneError, "a place is x and y in base in m") for to in NOWHERE),
        *(
            ("red", {"to": (0.7, 0.0), "upright_deg": deg}, MotionError, "upright_deg must be")
            for deg in (0.0, -5.0, 0.058, 181.0, math.nan, "5")
        ),
    ],
)
def test_an_order_that_has_no_meaning_is_refused(
    still: Workbench, what: str, where: dict[str, Any], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        still.carry(what, **where)


def test_blocks_are_put_on_the_table_and_not_inside_each_other(bench: Workbench) -> None:
    with pytest.raises(SceneError, match=r"no room for 'blue' at \(0.73, 0.16\) m: 'red' stands"):
        bench.add_block("blue", 0.73, 0.16, yaw_rad=0.4)
    with pytest.raises(SceneError, match=r"no room for 'blue': \(0.2, 0\) m is beside the table"):
        bench.add_block("blue", 0.2, 0.0)
    with pytest.raises(SceneError, match="'red'"):
        bench.add_block("red", 0.60, -0.2)  # the name is taken
    bench.add_block("blue", 0.75, 0.15)  # beside it, touching
    assert "blue" in bench.world.scene.bodies


IN_MILLIMETRES = (
    r"\(700, 150\) m is beside the table, which reaches from x = 0.54 to 1.46 m and from "
    r"y = -0.46 to 0.46 m; are these millimetres\? Lengths are in metres: 700 mm is 0.7 m$"
)


def test_a_place_in_millimetres_is_questioned(still: Workbench) -> None:
    with pytest.raises(SceneError, match=f"^no room for 'blue': {IN_MILLIMETRES}"):
        still.add_block("blue", 700, 150)
    for to in ((700, 150), at(700.0, 150.0, -130.0)):
        task = still.carry("red", to=to)
        assert re.fullmatch(f"refused: nothing to stand on, {IN_MILLIMETRES}", task.verdict)


@pytest.mark.parametrize("bad", [math.nan, "a", None])
def test_numbers_of_a_block_are_numbers(still: Workbench, bad: Any) -> None:
    for wrong in ({"x_m": bad}, {"y_m": bad}, {"edge_m": bad}, {"yaw_rad": bad}):
        arguments: dict[str, Any] = {"x_m": 0.6, "y_m": 0.0} | wrong
        with pytest.raises(SceneError, match=next(iter(wrong))):
            still.add_block("blue", **arguments)


def test_an_empty_arm_goes_back(robot: Baxter) -> None:
    bench = Workbench(robot)
    bench.world.move_arm("left", robot.arm("left").start)
    went = bench.withdraw("left")
    assert went.is_done
    np.testing.assert_allclose(bench.world.arm_q("left"), bench.robot.arm("left").neutral)
    assert "withdraw the left arm: done" in str(went)
    assert "it was there already" in str(bench.withdraw("left"))


@pytest.mark.slow
def test_a_plan_that_an_idle_arm_hinders_is_refused_with_the_way_out(bench: Workbench) -> None:
    bench.add_block("blue", 0.70, -0.05)
    plan = bench.plan("right", "blue", on_table(0.75, 0.05, 0.05))
    bench.carry("red", to=(0.75, 0.12), arm="left")
    verdict, is_done = bench.execute(bench.plan("right", "blue", on_table(0.75, 0.05, 0.05)))
    assert not is_done
    assert verdict.endswith(
        "; the left arm is in the way: withdraw('left') brings it back beside the table"
    )
    assert bench.withdraw("left").is_done
    assert bench.execute(plan)[1]


@pytest.mark.slow
def test_observers_are_notified_and_a_new_bench_can_be_recorded(robot: Baxter) -> None:
    diary = Witness()
    bench = Workbench(robot, observers=[diary])
    bench.add_block("red", 0.70, 0.15)
    assert bench.recording().times_s.tolist() == [0.0]
    bench.carry("red", to=(0.75, 0.0), arm="left")
    assert diary.kinds[:2] == [EventKind.SPAWNED] * 2
    assert {EventKind.GRASPED, EventKind.RELEASED} <= set(diary.kinds)
    first = bench.recording()
    bench.withdraw("left")
    assert len(bench.recording().times_s) > len(first.times_s)


def test_an_invalid_plan_is_not_executed(still: Workbench) -> None:
    invalid = still.plan("left", "red", on_table(2.0, 0.0, 0.05))
    verdict, is_done = still.execute(invalid)
    assert not is_done
    assert verdict.startswith("refused: ")
    assert still.simulation.time_s == 0.0


def test_wrong_arguments_are_refused(robot: Baxter, still: Workbench) -> None:
    wrong: Any
    for wrong in ({"robot": "baxter"}, {"observers": [robot]}, {"observers": robot}):
        with pytest.raises(SimulationError):
            Workbench(**wrong)
    wrong = "yes"
    with pytest.raises(SimulationError, match=r"TaskResult\.is_done"):
        TaskResult("carry red", "red", "left", 1.0, 1.0, 0.0, "verified", wrong)
    with pytest.raises(UnknownNameError, match="middle"):
        still.withdraw("middle")


def test_two_blocks_go_where_they_are_sent_at_the_same_time(robot: Baxter) -> None:
    bench = Workbench(robot)
    bench.add_block("red", 0.65, 0.25)
    bench.add_block("blue", 0.65, -0.25)
    places = {"red": (0.75, 0.12), "blue": (0.75, -0.12)}
    results = bench.carry_together(*places.items())
    assert [result.arm for result in results] == ["left", "right"]
    for result in results:
        assert result.is_done, result.verdict
        wanted = [*places[result.block], TABLE_Z_M + 0.025]
        assert middle_of(bench, result.block) == pytest.approx(wanted, abs=PLACED_WITHIN_M)
    assert tuple(bench.tasks) == results
    assert bench.motion_s < 0.6 * sum(result.motion_s for result in results)
    before = bench.world.q
    with pytest.raises(TaskError):
        bench.carry_together(left=("red", (0.7, 0.2)), right=("red", (0.7, 0.0)))
    beside = bench.carry_together(left=("red", (1.8, 0.2)), right=("blue", (0.7, -0.2)))
    assert [result.is_done for result in beside] == [False, False]
    assert all(result.verdict.startswith("refused: ") for result in beside)
    np.testing.assert_array_equal(bench.world.q, before)


def test_what_no_arm_reaches_at_both_ends_goes_from_hand_to_hand() -> None:
    bench = Workbench()
    bench.add_box("stick", 0.8, 0.38, size_m=(0.16, 0.04, 0.04), yaw_rad=np.pi / 2)
    T = bench.world.body("stick").T_base_body
    T_base_goal = pin.SE3(T.rotation, T.translation * (1.0, -1.0, 1.0))
    result = bench.carry("stick", to=T_base_goal)
    assert result.is_done, result
    assert "from the left to the right hand" in result.verdict
    placed = bench.world.body("stick").T_base_body
    np.testing.assert_allclose(placed.homogeneous, T_base_goal.homogeneous, atol=1e-5)
