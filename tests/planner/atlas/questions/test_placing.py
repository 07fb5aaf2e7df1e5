"""Where to put the table."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, BaxterError
from planner import verify
from planner.atlas import (
    PlacementGrid,
    Placements,
    PlacementStatus,
    ReachMap,
    TableTask,
    Visit,
    where,
)
from planner.atlas.checking.pose_finder import PoseFinder
from planner.errors import AtlasError, TaskError

GRID = PlacementGrid.within((0.5, 1.7), (-0.6, 0.6), step_m=0.3, yaw_rad=(0.0, math.pi / 2))


@pytest.fixture(scope="module")
def found(table_map: ReachMap, task: TableTask) -> Placements:
    """One confirmed place of many that were tried."""
    return where(table_map, task, GRID, wanted=1, max_examined=6, max_planned=2)


def test_every_placement_is_counted_once(found: Placements) -> None:
    assert len(found) == len(GRID) == len(found.T_base_tables)
    counts = Counter(found.statuses)
    assert counts[PlacementStatus.CONFIRMED] == len(found.confirmed) == 1
    assert counts[PlacementStatus.REFUSED] == len(found.refused)
    assert counts[PlacementStatus.REACHABLE] == len(found.not_planned)
    assert counts[PlacementStatus.IMPOSSIBLE] > 10
    assert f"{counts[PlacementStatus.IMPOSSIBLE]} proven out of reach" in found.summary
    for place in (*found.confirmed, *found.not_planned):
        assert np.array_equal(place.T_base_table.homogeneous, found.T_base_tables[place.index])


def test_confirmed_placements_have_plans_that_verify(found: Placements, robot: Baxter) -> None:
    (place,) = found.confirmed
    (plan,) = place.plans
    assert place.is_confirmed
    assert plan.limb == place.arms[0]
    assert verify(plan, description=robot.description).is_valid
    at = plan.start.scene["table"].T_base_body
    assert at.isApprox(place.T_base_table)
    assert (place.T_table_base * place.T_base_table).isApprox(pin.SE3.Identity())


def test_an_independent_solver_reaches_every_pose_of_ranked_placements(
    found: Placements, task: TableTask, finders: dict[str, PoseFinder]
) -> None:
    places = (*found.confirmed, *found.not_planned)
    assert len(places) >= 3
    for place in places:
        assert len(place.answers) == len(task.jobs[0].poses)
        for (_, T_table_tip), answer in zip(task.jobs[0].poses, place.answers, strict=True):
            T = place.T_base_table * T_table_tip
            assert answer.side == place.arms[0]
            assert answer.q is not None
            assert finders[answer.side].holds(T, answer.q)
            assert finders[answer.side].find(T) is not None


def test_an_independent_solver_does_no_job_that_is_proven_impossible(
    found: Placements, task: TableTask, finders: dict[str, PoseFinder]
) -> None:
    impossible = np.flatnonzero([s is PlacementStatus.IMPOSSIBLE for s in found.statuses])
    for i in np.random.default_rng(7).permutation(impossible)[:8]:
        T_base_table = pin.SE3(found.T_base_tables[i])
        for finder in finders.values():
            poses = [T_base_table * T for _, T in task.jobs[0].poses]
            assert any(finder.find(T) is None for T in poses)


def test_placements_are_ranked_by_their_smallest_margin(found: Placements) -> None:
    margins = [place.margin_rad for place in (*found.confirmed, *found.not_planned)]
    assert margins == sorted(margins, reverse=True)
    worst = found.confirmed[0].worst
    assert worst is not None
    assert worst.margin_rad == found.confirmed[0].margin_rad
    assert f"worst margin {worst.margin_rad:.3f} rad" in str(found.confirmed[0])


def visits(*points: tuple[float, float, float]) -> tuple[Visit, ...]:
    """The tip at points seen from the table, pointing down."""
    down = np.diag([-1.0, 1.0, -1.0])
    return tuple(Visit(f"{p}", pin.SE3(down, np.array(p))) for p in points)


def test_a_table_in_the_robot_is_refused_before_it_is_planned(
    table_map: ReachMap, task: TableTask
) -> None:
    """Poses that both arms reach, at a table whose foot stands in the robot's."""
    lifted = TableTask(visits=visits((0.55, 0.1, 0.9)), bodies=task.bodies[:1])
    (place,) = where(table_map, lifted, PlacementGrid((0.1,), (0.0,))).refused
    assert not place.is_confirmed
    assert not place.plans
    assert place.refusal.startswith("table is in ")


def test_places_in_the_robot_do_not_count_as_examined(table_map: ReachMap, task: TableTask) -> None:
    """Of a row of tables that begins in the robot, one is examined."""
    near = TableTask(visits=visits((0.3, 0.1, 0.9)), bodies=task.bodies[:1])
    grid = PlacementGrid.within((0.3, 0.9), (0.0, 0.0), step_m=0.05)
    found = where(table_map, near, grid, wanted=1, max_examined=1)
    examined = [p for p in (*found.confirmed, *found.refused, *found.not_planned) if p.answers]
    assert len(examined) == 1
    assert any(not place.answers for place in found.refused)


def test_each_visit_is_planned_to_its_pose_for_the_better_arm(
    table_map: ReachMap, robot: Baxter
) -> None:
    task = TableTask(visits=visits((-0.3, 0.45, 0.9), (-0.3, -0.45, 0.9)))
    (place,) = where(table_map, task, PlacementGrid((1.0,), (0.0,))).confirmed
    assert place.arms == ("left", "right")
    for plan, visit in zip(place.plans, task.visits, strict=True):
        T_end = robot.arm(plan.limb).T_base_tip(plan.moves[-1].trajectory.q_goal)
        assert T_end.isApprox(place.T_base_table * visit.T_table_tip, 1e-6)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"task": None}, TaskError),
        ({"grid": 3}, AtlasError),
        ({"wanted": 0}, AtlasError),
        ({"max_planned": 1.5}, AtlasError),
        ({"task": TableTask(visits=visits((-0.3, 0.1, 1.6)))}, AtlasError),
    ],
)
def test_invalid_arguments_and_tasks_outside_the_map_are_refused(
    table_map: ReachMap, task: TableTask, arguments: dict[str, object], error: type[BaxterError]
) -> None:
    with pytest.raises(error):
        where(**({"atlas": table_map, "task": task} | arguments))  # type: ignore[arg-type]
