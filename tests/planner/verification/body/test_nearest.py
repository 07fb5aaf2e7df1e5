"""The nearest of all pairs, and a bound on what lies between the samples."""

from __future__ import annotations

import pytest

from baxter_kin.description import RobotDescription
from planner import Plan
from planner.verification.body.distances import SolidDistances
from planner.verification.body.nearest import nearest
from planner.verification.body.robot_body import robot_body
from planner.verification.body.stretches import Stretches
from planner.verification.fingers import Fingers
from planner.verification.story import Run, Story
from planner.verification.urdf_robot import UrdfRobot


def test_the_nearest_is_that_of_all_pairs_at_all_samples(cube_plan: Plan) -> None:
    files = RobotDescription.installed()
    robot, solids = UrdfRobot(files, cube_plan.limb), robot_body(files).solids
    standing = robot.standing(cube_plan.start.joints)
    story = Story(cube_plan, cube_plan.start, robot, Fingers(robot, solids))
    stretches = Stretches(robot, solids, standing, [], ())
    runs = [stage for stage in story.stages if isinstance(stage, Run) and stage.moves]
    assert runs[1].carried is not None
    for run in runs:
        stretch = stretches.of_run(run, 0.03)
        pairs = stretches.pairs_of_run(run, stretch)
        distances, numbers = SolidDistances(robot, stretch, pairs), [*range(len(pairs))]
        numbers = [i for i in numbers if pairs[i].body is None]
        found, _ = nearest(distances, numbers, 0, len(stretch.q) - 1)
        least = 1.0
        for sample in range(len(stretch.q)):
            for number in numbers:
                least = min(least, distances.shapes_apart(number, sample, least))
        assert found.least_m == pytest.approx(least, abs=1e-6)
        assert found.proven_m < least
