"""Plans as CSV that a robot can grasp with."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import sim.recording
from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner import Body, Grip, GripperAction, Manipulator, Move, Plan, Scene, plan_joint_move
from planner.plan import PlanFailure
from planner.scene.bodies import Attachment
from planner.state import State
from sim import Recording, read_rsdk_csv, write_csv
from sim.errors import RecordingError
from sim.outcome import ROBOT_DWELL_S
from sim.recording.csv_writing import STROKE_M, TRAVEL_S, PlanCsvFile
from tests.conftest import state_at
from tests.served_urdf import served_urdf, variant
from tests.sim.runs import Run

DIGITS = 1e-11
"""Values are written with twelve significant digits."""

Table = dict[str, NDArray[np.float64]]


@pytest.fixture(scope="module")
def plan(robot: Baxter, manipulator: Manipulator, table: Body, block: Body) -> Plan:
    return Run(robot, [table, block], manipulator).plan()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "plan.csv"


def table_of(path: Path) -> Table:
    """The columns by name, by the standard library."""
    with path.open(newline="", encoding="ascii") as file:
        header, *rows = list(csv.reader(file))
    return dict(zip(header, np.array(rows, dtype=np.float64).T, strict=True))


def joints(found: Table, limb: str) -> NDArray[np.float64]:
    names = [f"{limb}_{joint}" for joint in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")]
    return np.array([found[name] for name in names]).T


def periods(plan: Plan, dwell_s: float) -> Iterator[tuple[float, float, Any]]:
    """When each step begins and ends: moves take what they take, grips the fingers' travel."""
    time_s = 0.0
    for step in plan:
        takes_s = step.trajectory.duration if isinstance(step, Move) else 2.0 * dwell_s + TRAVEL_S
        yield time_s, time_s + takes_s, step
        time_s += takes_s


def expected_q(plan: Plan, times: NDArray[np.float64], dwell_s: float) -> NDArray[np.float64]:
    """Where the arm is at these times, by the plan's own trajectories."""
    q = np.tile(plan.moves[-1].trajectory.q_goal, (len(times), 1))
    for begin, end, step in reversed(list(periods(plan, dwell_s))):
        inside = times <= end
        if isinstance(step, Move):
            local = np.clip(times[inside] - begin, 0.0, step.trajectory.duration)
            q[inside] = step.trajectory.sample(local).q
            start = step.trajectory.q_start
        q[times <= begin] = start if isinstance(step, Move) else q[times <= begin]
    return q


class TestRows:
    """What the file says, row by row."""

    @pytest.mark.parametrize("dwell_s", [0.0, 0.123, 1.0])
    def test_joints_are_those_of_the_trajectories_at_100_hz(
        self, plan: Plan, path: Path, dwell_s: float
    ) -> None:
        write_csv(plan, path, dwell_s=dwell_s)
        found = table_of(path)
        np.testing.assert_allclose(np.diff(found["time"]), 0.01, atol=1.1e-6)
        assert found["time"][0] == 0.0
        exact = 0.01 * np.arange(len(found["time"]), dtype=np.float64)
        expected = expected_q(plan, exact, dwell_s)
        np.testing.assert_allclose(joints(found, plan.limb), expected, rtol=DIGITS, atol=1e-12)

    def test_the_last_row_is_where_the_plan_ends(self, plan: Plan, path: Path) -> None:
        write_csv(plan, path)
        found = table_of(path)
        *_, (_, end_s, _) = periods(plan, ROBOT_DWELL_S)
        assert end_s <= found["time"][-1] <= end_s + 0.01
        goal = plan.moves[-1].trajectory.q_goal
        np.testing.assert_allclose(joints(found, plan.limb)[-1], goal, rtol=DIGITS)

    def test_the_other_arm_stands_where_the_plan_says(
        self, plan: Plan, robot: Baxter, path: Path
    ) -> None:
        write_csv(plan, path)
        found = joints(table_of(path), "right")
        np.testing.assert_array_equal(found, np.tile(robot.arm("right").neutral, (len(found), 1)))

    def test_it_is_read_back_as_a_recording_of_both_arms(
        self, plan: Plan, robot: Baxter, path: Path
    ) -> None:
        write_csv(plan, path)
        found, notes = read_rsdk_csv(path, robot)
        assert notes == ()
        assert found.limbs == ("left", "right")


class TestGrippers:
    """Grippers as they are commanded, while the arm stands."""

    @pytest.mark.parametrize("dwell_s", [0.0, 0.5, 1.0, None])
    def test_each_command_comes_at_once_amid_dwells(
        self, plan: Plan, path: Path, dwell_s: float | None
    ) -> None:
        write_csv(plan, path, dwell_s=dwell_s)
        stated_s = 1.0 if dwell_s is None else dwell_s
        found = table_of(path)
        percent, q = found["left_gripper"], joints(found, "left")
        changes = np.flatnonzero(np.diff(percent)) + 1
        assert percent[changes].tolist() == [0.0, 100.0]
        for row in changes:
            before = slice(row - int(stated_s / 0.01), row + 1)
            after = slice(row, row + int((stated_s + TRAVEL_S) / 0.01) - 1)
            for rows in (before, after):
                assert np.ptp(q[rows], axis=0).max() == 0.0

    def test_fingers_are_told_to_close_and_not_where_the_block_stops_them(
        self, plan: Plan, path: Path
    ) -> None:
        write_csv(plan, path)
        assert table_of(path)["left_gripper"].min() == 0.0
        assert set(table_of(path)["left_gripper"]) == {0.0, 100.0}

    @given(st.floats(0.0, STROKE_M))
    def test_an_opening_is_told_in_per_cent(
        self, plan: Plan, tmp_path_factory: pytest.TempPathFactory, opening_m: float
    ) -> None:
        path = tmp_path_factory.getbasetemp() / "open.csv"
        part = Grip("open a little", GripperAction.OPEN, opening_m=opening_m)
        write_csv(evolve(plan, steps=(part,)), path, dwell_s=0.0)
        percent = table_of(path)["left_gripper"]
        assert percent[-1] == pytest.approx(100.0 * opening_m / STROKE_M, rel=DIGITS)

    def test_the_stroke_is_that_of_the_robot(self, robot: Baxter) -> None:
        index = robot.indices(("l_gripper_l_finger_joint",))[0]
        assert robot.model.upperPositionLimit[index] == STROKE_M

    def test_a_hand_that_holds_something_stays_closed(self, plan: Plan, path: Path) -> None:
        held = Attachment("block", "right_gripper", plan.start.scene["block"].T_base_body)
        state = State(plan.start.scene, plan.start.joints, (held,))
        write_csv(evolve(plan, steps=plan.steps[:1], start=state), path)
        assert set(table_of(path)["right_gripper"]) == {0.0}


def arm_at(plan: Plan, q: FloatArray) -> State:
    """The start of a plan with its arm elsewhere."""
    return evolve(plan.start, joints={**plan.start.joints, **state_at(q).joints})


class TestSeveralPlans:
    """Plans after one another are one file."""

    def test_they_go_on_where_the_last_one_ended(self, plan: Plan, path: Path) -> None:
        back = plan_joint_move(
            plan.moves[-1].trajectory.q_goal, plan.q_start, plan.moves[0].trajectory.limits
        )
        home = evolve(plan, start=arm_at(plan, back.q_start), steps=(Move("home", back),))
        with PlanCsvFile(path, dwell_s=0.2) as file:
            for each in (plan, home, plan):
                file.add(each)
        found = table_of(path)
        np.testing.assert_allclose(np.diff(found["time"]), 0.01, atol=1.1e-6)
        assert np.count_nonzero(np.diff(found["left_gripper"])) == 4
        assert np.abs(np.diff(joints(found, "left"), axis=0)).max() < 0.05

    def test_one_that_starts_elsewhere_is_refused(self, plan: Plan, path: Path) -> None:
        with PlanCsvFile(path) as file:
            file.add(plan)
            with pytest.raises(RecordingError, match="rad from where the left arm stands after"):
                file.add(plan)


class TestRefused:
    """What is no plan for a robot."""

    def test_an_invalid_plan(self, plan: Plan, path: Path) -> None:
        invalid = evolve(plan, failure=PlanFailure("pick: approach", "it is too far"))
        with pytest.raises(RecordingError, match="cannot be executed: pick: approach: it is too"):
            write_csv(invalid, path)
        assert not path.exists()

    def test_one_that_does_not_say_where_the_other_arm_stands(self, plan: Plan, path: Path) -> None:
        state = State(Scene.of(), {**state_at(plan.q_start).joints, "right_s0": 0.0})
        with pytest.raises(RecordingError, match="lacks right_s1"):
            write_csv(evolve(plan, start=state), path)
        assert not path.exists()

    @pytest.mark.parametrize("dwell_s", [-0.1, 60.1, float("nan"), "1", None, True])
    def test_a_dwell_that_is_none(self, path: Path, dwell_s: Any) -> None:
        with pytest.raises(RecordingError, match="dwell_s"):
            PlanCsvFile(path, dwell_s=dwell_s)
        assert not path.exists()

    def test_a_dwell_for_a_recording(self, picked: Recording, path: Path) -> None:
        with pytest.raises(RecordingError, match="dwell_s is for plans"):
            write_csv(picked, path, dwell_s=1.0)

    @pytest.mark.parametrize("what", [None, "plan", 5])
    def test_what_is_neither_plan_nor_recording(self, path: Path, what: Any) -> None:
        with pytest.raises(RecordingError, match="a plan, or else the recording must be of class"):
            write_csv(what, path)

    def test_a_path_that_leads_nowhere(self, plan: Plan, tmp_path: Path) -> None:
        with pytest.raises(RecordingError, match="cannot write"):
            write_csv(plan, tmp_path / "missing" / "plan.csv")

    @pytest.mark.usefixtures("full_disk")
    def test_a_full_disk(self, plan: Plan, path: Path) -> None:
        with pytest.raises(RecordingError, match="No space left"):
            write_csv(plan, path)


def test_it_is_at_both_doors() -> None:
    assert sim.recording.write_csv is write_csv


def test_a_plan_for_the_drawing_is_written_with_one_warning(
    plan: Plan, path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with PlanCsvFile(path) as file:
        file.add(plan)
        file.add(evolve(plan, steps=(), start=arm_at(plan, plan.moves[-1].trajectory.q[-1])))
    (warning,) = caplog.messages
    assert warning.startswith(f"{path} has set-points for Baxter as it is drawn")


def test_a_plan_for_a_real_robot_is_written_without_a_warning(
    plan: Plan, path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    own = Baxter.load(served_urdf(measured="one")).description.identity
    write_csv(evolve(plan, robot=own), path)
    assert caplog.messages == []


def test_a_camera_on_the_head_makes_no_arm_another_one(
    plan: Plan, path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    own = Baxter.load(variant("camera_on_the_head")).description.identity
    write_csv(evolve(plan, robot=own), path)
    assert len(caplog.messages) == 1
