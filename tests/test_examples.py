"""The examples, each run as its command would; what they say is checked in what was recorded."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter, IKService, pose_from_quaternion
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from examples import right_arm, sorting, three_poses, tower, where_to_put_the_table
from examples.workbench import play, scattered
from planner import make_block, verify
from sim import EventKind, Recording, Workbench, read_recording
from sim.workbench.tabletop import TABLE_Z_M, on_table
from tests.closeness import Closeness

EXAMPLES = {
    module.__name__.rpartition(".")[2]: module
    for module in (three_poses, tower, sorting, right_arm)
}
BLOCKS = {"three_poses": 3, "tower": 3, "sorting": 6, "right_arm": 2}
"""Blocks that each example carries, counted as often as they are."""

PLACED_WITHIN_M = 0.003
PRESSING_M = 1e-6
"""What touches on purpose may press in by that; contacts are found to 1e-8 m."""

LARGER_M = 0.9e-3
"""By how much the URDF's boxes for paddles, which `Closeness` looks at, are larger than Rethink's
meshes, which hold the blocks: 21.0 mm - 20.1 mm along x."""

LARGEST_PAGE = 5e6
WAY_OF_LEFT_M = (0.804, 0.063, 0.04)
"""Here the right hand stands between two places of the left arm's."""
BESIDE_M = (0.78, -0.12, 0.10)
ON_THE_PLACE_M = (0.70, 0.00, -0.05)


@dataclass(frozen=True)
class Run:
    """What an example left behind."""

    status: int
    said: str
    folder: Path

    @cached_property
    def recording(self) -> Recording:
        return read_recording(self.folder / "run.mcap").recording

    def centre(self, block: str) -> FloatArray:
        """Where a block ended: the centre of a cube is its origin."""
        return self.recording.body_poses[block][-1, :3]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Run]:
    """Runs an example with both outputs, the first time that it is asked for."""
    known: dict[str, Run] = {}

    def run(name: str) -> Run:
        if name not in known:
            known[name] = run_of(EXAMPLES[name], tmp_path_factory.mktemp(name))
        return known[name]

    return run


def run_of(module: ModuleType, folder: Path) -> Run:
    """With a page of one whose tests are slow: its clearance takes as long as the rest."""
    said, files = io.StringIO(), ["--record", str(folder / "run.mcap")]
    if module is right_arm:
        files += ["--html", str(folder / "run.html")]
    with contextlib.redirect_stdout(said):
        status = module.main(files)
    return Run(status, said.getvalue(), folder)


SORTING = pytest.param("sorting", marks=pytest.mark.campaign)
"""It takes as long as all the others; what it shows of two arms is tested with a workbench, too."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["three_poses", "tower", "right_arm", SORTING])
def test_all_tasks_are_done_and_verified_and_nothing_is_hit_pushed_or_missed(
    runs: Callable[[str], Run], name: str
) -> None:
    run = runs(name)
    assert run.status == 0, run.said
    assert run.said.count("verified, ") == BLOCKS[name]
    kinds = {event.kind for event in run.recording.events}
    assert kinds.isdisjoint({EventKind.HIT, EventKind.PUSHED, EventKind.MISSED})


@pytest.mark.slow
def test_the_replay_is_one_whole_page(runs: Callable[[str], Run]) -> None:
    folder = runs("right_arm").folder
    assert sorted(path.name for path in folder.iterdir()) == ["run.html", "run.mcap"]
    page = folder / "run.html"
    assert page.stat().st_size <= LARGEST_PAGE
    assert page.read_text().rstrip().endswith("</html>")


@pytest.mark.slow
def test_the_block_visits_the_three_poses(runs: Callable[[str], Run]) -> None:
    recording = runs("three_poses").recording
    path = recording.body_poses["block"][:, :3]
    released = [e.time_s for e in recording.events if e.kind is EventKind.SETTLED]
    stops = path[np.searchsorted(recording.times_s, released)]
    wanted = [(0.75, 0.00, -0.13), (0.72, 0.075, -0.13), (0.70, 0.15, -0.13)]
    np.testing.assert_allclose(stops, wanted, atol=PLACED_WITHIN_M)
    np.testing.assert_allclose(path[-1], path[0], atol=PLACED_WITHIN_M)


@pytest.mark.slow
def test_the_tower_stands_straight(runs: Callable[[str], Run]) -> None:
    run, height_m = runs("tower"), 0.0
    for name, edge_m, _ in tower.BLOCKS:
        wanted = [*tower.TOWER_M, TABLE_Z_M + height_m + edge_m / 2]
        np.testing.assert_allclose(run.centre(name), wanted, atol=PLACED_WITHIN_M)
        height_m += edge_m
        quat_xyzw = run.recording.body_poses[name][-1, 3:]
        np.testing.assert_allclose(np.abs(quat_xyzw), [0.0, 0.0, 0.0, 1.0], atol=1e-6)


@pytest.mark.campaign
def test_blocks_are_sorted_into_rows(runs: Callable[[str], Run]) -> None:
    run = runs("sorting")
    for number, (x, edge_m) in enumerate(zip(sorting.ROW_X_M, sorting.EDGES_M, strict=True), 1):
        for colour, y in sorting.ROW_Y_M.items():
            centre = run.centre(f"{colour} {number}")
            np.testing.assert_allclose(centre, [x, y, TABLE_Z_M + edge_m / 2], atol=PLACED_WITHIN_M)


@pytest.mark.campaign
def test_both_arms_sort_at_the_same_time(runs: Callable[[str], Run], robot: Baxter) -> None:
    recording = runs("sorting").recording
    grasped = [e for e in recording.events if e.kind is EventKind.GRASPED]
    assert len(grasped) == 6
    descents = {move.limb for move in recording.moves if "pick: descend" in move.label}
    assert descents == {"left", "right"}
    moving = []
    for arm in robot.arms.values():
        q = recording.q[:, list(robot.indices(arm.joint_names))]
        moving.append(np.abs(np.diff(q, axis=0)).max(axis=1) > 1e-6)
    shared = np.logical_and(*moving).sum() / np.logical_or(*moving).sum()
    assert shared > 0.4  # of the time in which an arm moves


@pytest.mark.slow
def test_the_right_hand_refuses_the_wide_block(runs: Callable[[str], Run]) -> None:
    run = runs("right_arm")
    assert "wide measures 54.0 mm, 55.3 mm between the pads as it lies" in run.said
    assert "the right hand opens only 52.7 mm" in run.said
    assert {move.limb for move in run.recording.moves} == {"right"}
    np.testing.assert_allclose(run.centre("block")[:2], right_arm.HERE_M, atol=PLACED_WITHIN_M)


@pytest.fixture(scope="module", params=["tower", SORTING])
def closeness(
    request: pytest.FixtureRequest, runs: Callable[[str], Run], robot: Baxter
) -> Mapping[tuple[str, str], float]:
    """The least distance of every pair in an example, measured 25 times a second."""
    recording = runs(request.param).recording
    assert np.diff(recording.times_s).max() <= 0.01 + 1e-9
    fewer = evolve(
        recording,
        times_s=recording.times_s[::4],
        q=recording.q[::4],
        gripper_percent=recording.gripper_percent[::4],
        body_poses={name: poses[::4] for name, poses in recording.body_poses.items()},
    )
    return Closeness(robot, recording.bodies.values()).along(fewer)


@pytest.mark.slow
def test_the_arms_never_touch_each_other(closeness: Mapping[tuple[str, str], float]) -> None:
    between = {
        pair: distance
        for pair, distance in closeness.items()
        if {side_of(link) for link in pair} == {"left", "right"}
    }
    assert len(between) > 160  # 13 links of each arm, less what the SRDF rules out
    assert min(between.values()) > 0.0


def test_arms_that_touch_would_be_noticed(bench: Workbench) -> None:
    stand(bench, ON_THE_PLACE_M)
    left = IKService(bench.robot.arm("left"))
    at_the_same_place = pose_from_quaternion(ON_THE_PLACE_M, (0, 1, 0, 0))
    bench.world.move_arm("left", left.solve(at_the_same_place).q)
    bench.simulation.wait(0.02)
    recording = bench.recorder.recording()
    found = Closeness(bench.robot, recording.bodies.values()).along(recording)
    assert found["left_wrist", "right_wrist"] < 0.0


@pytest.mark.slow
def test_the_robot_touches_blocks_with_its_pads_only(
    closeness: Mapping[tuple[str, str], float],
) -> None:
    touching = {pair for pair, distance in closeness.items() if distance <= PRESSING_M}
    of_robot = {pair for pair in touching if not all(map(is_body, pair))}
    assert of_robot
    assert all("finger_tip" in link and is_body(other) for link, other in of_robot)
    assert not any("table" in pair for pair in of_robot)


@pytest.mark.slow
def test_nothing_is_ever_inside_another(closeness: Mapping[tuple[str, str], float]) -> None:
    for pair, distance in closeness.items():
        is_of_tip = any(link.endswith("_finger_tip") for link in pair)
        assert distance > -PRESSING_M - (LARGER_M if is_of_tip else 0.0), pair


def is_body(name: str) -> bool:
    return name.startswith(("table", "red", "blue", "large", "medium", "small"))


def side_of(link: str) -> str:
    if is_body(link):
        return ""
    return {"l": "left", "r": "right"}.get(link.partition("_")[0][0], "") if "_" in link else ""


@pytest.fixture
def bench() -> Workbench:
    """A block that the left arm can bring across."""
    bench = Workbench()
    bench.add_block("block", 0.62, 0.22, edge_m=0.04, colour="red")
    return bench


def stand(bench: Workbench, tip_m: tuple[float, float, float]) -> None:
    """Put the right arm somewhere, pointing down."""
    ik = IKService(bench.robot.arm("right"))
    bench.world.move_arm("right", ik.solve(pose_from_quaternion(tip_m, (0, 1, 0, 0))).q)


@pytest.mark.slow
def test_another_arm_in_the_way_is_named_and_one_beside_it_is_passed(
    bench: Workbench,
) -> None:
    """Its wrist's mesh is 36 mm larger than the shapes of the URDF, which left a way around it."""
    goal = on_table(0.70, 0.0, 0.04)
    direct = bench.plan("left", "block", goal)
    assert direct.is_valid
    stand(bench, WAY_OF_LEFT_M)
    refused = bench.plan("left", "block", goal)
    assert not refused.is_valid
    assert "right_" in str(refused.failure)
    stand(bench, BESIDE_M)
    beside = bench.plan("left", "block", goal)
    assert beside.is_valid
    assert verify(beside).is_valid
    stand(bench, ON_THE_PLACE_M)
    on_the_place = bench.plan("left", "block", goal)
    assert "with r_gripper_" in str(on_the_place.failure)
    stand(bench, WAY_OF_LEFT_M)
    outcome, is_done = bench.execute(direct, "")  # which did not know of the other arm
    assert not is_done
    assert "right_" in outcome


@pytest.mark.slow
def test_what_is_refused_is_told_with_its_reason(capsys: pytest.CaptureFixture[str]) -> None:
    def story(bench: Workbench, _rng: np.random.Generator) -> None:
        bench.add_block("far", 1.30, 0.0, edge_m=0.04, colour="red")
        bench.add_block("near", 0.65, 0.2, edge_m=0.04, colour="blue")
        bench.carry("far", to=(0.65, 0.0))
        bench.carry("near", to=(0.65, 0.0))

    assert play([], "Two blocks.", story) == 1
    said = capsys.readouterr().out
    assert "far      -" in said
    assert "refused: left arm, pick: approach: the pose" in said
    assert "right arm, pick: approach: the pose" in said
    assert said.count("verified") == 1


def test_a_replay_that_cannot_be_written_is_one_sentence_before_anything_is_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "no" / "run.html"
    with pytest.raises(SystemExit) as stopped:
        play(["--html", str(page)], "Nothing.", lambda *_: pytest.fail("it was done"))
    assert stopped.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_seed_is_for_what_is_random(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        three_poses.main(["--seed", "1"])
    assert stopped.value.code == 2
    assert "unrecognized arguments: --seed" in capsys.readouterr().err


@given(seed=st.integers(0, 2**32))
def test_scattered_blocks_leave_room_for_a_hand(seed: int) -> None:
    places = [(x, y) for x, y, _ in scattered(np.random.default_rng(seed), 6, (0.65, 0.0))]
    apart = [np.hypot(x - u, y - v) for (x, y), (u, v) in combinations(places, 2)]
    assert min(apart) >= 0.10


def test_the_readme_names_every_example() -> None:
    text = (Path(__file__).parents[1] / "README.md").read_text("utf-8")
    for name in EXAMPLES:
        assert f"-m examples.{name}" in text


def test_an_arm_that_cannot_go_back_is_told(bench: Workbench) -> None:
    left = bench.robot.arm("left")
    beside = left.T_base_tip(left.neutral)
    bench.world.move_arm("left", left.start)
    bench.simulation.spawn(make_block("post", beside, edge_m=0.1, is_movable=False))
    assert not bench.withdraw("left").is_done
    assert "post" in bench.tasks[-1].verdict
    assert not bench.tasks[-1].is_done


def test_an_arm_that_stands_beside_the_table_stays_there(bench: Workbench) -> None:
    assert bench.withdraw("left").is_done
    assert bench.motion_s == 0.0


@pytest.mark.slow
def test_a_place_for_the_table_is_found_and_confirmed(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("zarr", reason="maps need zarr, and it Python 3.11", exc_type=ImportError)
    assert where_to_put_the_table.main([]) == 0
    said = capsys.readouterr().out
    assert "worst margin" in said
    assert "confirmed by 1 verified plan, " in said
    assert "108 placements: 1 confirmed by verified plans; " in said
