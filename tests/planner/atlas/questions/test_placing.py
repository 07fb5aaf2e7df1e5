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


def test_a_table_in_the_robot_is_refused_before_it_is_planned(
    table_map: ReachMap, task: TableTask
) -> None:
    """Poses that both arms reach, at a table whose foot stands in the robot's."""
    lifted = TableTask(
        visits=(Visit("look", pin.SE3(np.diag([-1.0, 1.0, -1.0]), np.array([0.55, 0.1, 0.9]))),),
        bodies=task.bodies[:1],
    )
    answer = where(table_map, lifted, PlacementGrid((0.1,), (0.0,)))
    (place,) = answer.refused
    assert not place.is_confirmed
    assert not place.plans
    assert place.refusal.startswith("table is in ")
    assert place.refusal.endswith(" while the arms rest")


def test_places_in_the_robot_do_not_count_as_examined(table_map: ReachMap, task: TableTask) -> None:
    """Of a row of tables that begins in the robot, one is examined."""
    tip = pin.SE3(np.diag([-1.0, 1.0, -1.0]), np.array([0.3, 0.1, 0.9]))
    visits = TableTask(visits=(Visit("look", tip),), bodies=task.bodies[:1])
    grid = PlacementGrid.within((0.3, 0.9), (0.0, 0.0), step_m=0.05)
    answer = where(table_map, visits, grid, wanted=1, max_examined=1)
    examined = [p for p in (*answer.confirmed, *answer.refused, *answer.not_planned) if p.answers]
    assert len(examined) == 1
    assert any(not place.answers for place in answer.refused)


def test_a_visit_is_confirmed_by_a_motion_to_its_pose(table_map: ReachMap, robot: Baxter) -> None:
    tip = pin.SE3(np.diag([-1.0, 1.0, -1.0]), np.array([-0.3, 0.1, 0.9]))
    answer = where(
        table_map, TableTask(visits=(Visit("look", tip),)), PlacementGrid((1.0,), (0.0,))
    )
    (place,) = answer.confirmed
    (plan,) = place.plans
    arm = robot.arm(plan.limb)
    assert arm.T_base_tip(plan.moves[-1].trajectory.q_goal).isApprox(place.T_base_table * tip, 1e-6)


def test_each_job_goes_to_the_arm_that_does_it_best(table_map: ReachMap) -> None:
    tips = [
        pin.SE3(np.diag([-1.0, 1.0, -1.0]), np.array([-0.3, y_m, 0.9])) for y_m in (0.45, -0.45)
    ]
    visits = tuple(Visit(name, tip) for name, tip in zip(("left", "right"), tips, strict=True))
    answer = where(table_map, TableTask(visits=visits), PlacementGrid((1.0,), (0.0,)))
    assert answer.confirmed[0].arms == ("left", "right")


ABOVE_THE_MAP = TableTask(
    visits=(Visit("up", pin.SE3(np.diag([-1.0, 1.0, -1.0]), np.array([-0.3, 0.1, 1.6]))),)
)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"task": None}, TaskError),
        ({"grid": 3}, AtlasError),
        ({"wanted": 0}, AtlasError),
        ({"max_planned": 1.5}, AtlasError),
        ({"task": ABOVE_THE_MAP, "grid": PlacementGrid((1.0,), (0.0,))}, AtlasError),
    ],
)
def test_invalid_arguments_and_tasks_outside_the_map_are_refused(
    table_map: ReachMap, task: TableTask, arguments: dict[str, object], error: type[BaxterError]
) -> None:
    with pytest.raises(error):
        where(**({"atlas": table_map, "task": task} | arguments))  # type: ignore[arg-type]
