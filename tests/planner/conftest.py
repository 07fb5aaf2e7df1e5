"""What several test modules of the planner use."""

from __future__ import annotations

from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import (
    Hand,
    Manipulator,
    Move,
    PickAndPlace,
    Plan,
    RobotBody,
    RobotShapes,
    Scene,
    plan_pick_and_place,
)
from planner.scene.mesh import Mesh
from tests.conftest import overhead


def distance(first: Any, T_first: pin.SE3, second: Any, T_second: pin.SE3) -> float:
    """Coal's distance between two placed shapes, with coal's own settings."""
    return float(
        coal.distance(
            first,
            coal.Transform3s(T_first.rotation, T_first.translation),
            second,
            coal.Transform3s(T_second.rotation, T_second.translation),
            coal.DistanceRequest(),
            coal.DistanceResult(),
        )
    )


def hands_of(robot: Baxter, body: RobotBody | None = None) -> dict[str, Hand]:
    """Both hands by side, of the robot's own body when none is given."""
    shapes = RobotShapes(robot, body)
    return {side: Hand.of(robot, arm, shapes) for side, arm in robot.arms.items()}


def without_statements(plan: Plan) -> Plan:
    """A plan that states nothing that follows, so that it can be changed and judged."""
    steps = (
        evolve(step, clearance=None, proof=None, state=None)
        if isinstance(step, Move)
        else evolve(step, proof=None, state=None)
        for step in plan
    )
    return evolve(plan, steps=tuple(steps))


@pytest.fixture(scope="session")
def tracked_plan(manipulator: Manipulator, scene: Scene) -> Plan:
    """The demo's block carried 15 cm aside."""
    task = PickAndPlace("block", overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129))
    plan = plan_pick_and_place(task, manipulator, scene, manipulator.arm.start)
    assert plan.failure is None
    return plan


def mesh_of(vertices: Any, triangles: Any) -> Mesh:
    """A mesh, from lists as well."""
    return Mesh(vertices, triangles)


def hull(points: NDArray[np.float64]) -> Mesh:
    """The convex hull as Qhull finds it, its triangles turned outwards."""
    given_points = coal.StdVec_Vec3s()
    for point in points:
        given_points.append(point)
    found = coal.Convex.convexHull(given_points, True, "Qt")
    vertices = np.array([found.point(i) for i in range(found.num_points)])
    triangles = np.array(
        [[found.polygons(i)[k] for k in range(3)] for i in range(found.num_polygons)]
    )
    a, b, c = vertices[triangles].swapaxes(0, 1)
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a - vertices.mean(axis=0)) < 0.0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return Mesh(vertices, triangles)
