"""Clearances compared with distances computed pair by pair."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Arm, Baxter
from baxter_kin.errors import ConfigurationError
from planner import Body, Box, Manipulator, Part, RobotShapes, Scene
from planner.collision import Clearance, ClearanceChecker
from planner.collision.robot.robot_body import LinkBody, RobotBody
from planner.errors import SceneError
from planner.scene.bodies import Attachment
from planner.scene.coal_shapes import coal_shape, convex, surface
from planner.scene.mesh import Mesh
from tests.bodies import CORNERS, SIDES
from tests.conftest import at, overhead
from tests.planner.collision.conftest import ORIGIN, ball, full
from tests.planner.conftest import distance, mesh_of

DISTANCE_TOLERANCE_M = 2e-6
"""Difference of two runs of GJK on one pair; its default tolerance is 1e-6."""

X, Y, Z = np.eye(3)
PIECES_OUTSIDE_M = 3e-5
"""Maximum distance of a finger's pieces outside its mesh, where the mesh is convex."""

CUBE = Box((0.05, 0.05, 0.05))
FloatArray = NDArray[np.float64]

seeds = st.integers(0, 2**32 - 1)


@cache
def coal_shapes(link: LinkBody) -> list[Any]:
    if len(link.surface.triangles):
        return [surface(*link.surface)]
    return [convex(*piece) for piece in link.pieces]


class Independent:
    """Distances of one arm's links, pair by pair, from the arrays of the stored body."""

    def __init__(self, robot: Baxter, arm: Arm, q: FloatArray) -> None:
        body, data = RobotBody.load(), robot.model.createData()
        pin.framesForwardKinematics(robot.model, data, q)
        self._skipped = body.skipped_pairs
        self._links = {name: link for name, link in body.links.items() if ":" not in name}
        for finger in "lr":  # the stock robot has paddles on both sides
            paddle = self._links[f"l_gripper_{finger}_finger_tip"]
            self._links[f"r_gripper_{finger}_finger_tip"] = paddle
        self._shapes = {name: coal_shapes(link) for name, link in self._links.items()}
        self._margins = {name: link.margin_m for name, link in self._links.items()}
        self._poses = {link: data.oMf[robot.model.getFrameId(link)] for link in self._shapes}
        self._joints = {
            link: robot.model.frames[robot.model.getFrameId(link)].parentJoint
            for link in self._shapes
        }
        urdf = robot.description.stock.urdf
        self._arm = _links_below(urdf, f"{arm.side}_s0") & self._shapes.keys()
        self._hand = _links_below(urdf, f"{arm.side}_w2") & self._shapes.keys()

    def least(self, scene: Scene) -> float:
        return min(*self.to_itself(), *(self._to(body) for body in scene))

    def lowest_m(self, part: str) -> float:
        """The lowest point, in base, of the arm's links whose names contain a text."""
        return min(
            float(self._poses[link].act(vertex)[2]) - self._margins[link]
            for link in self._arm
            if part in link
            for vertex in self._links[link].surface.vertices
        )

    def to_itself(self) -> Iterator[float]:
        for one in self._arm:
            for other in self._shapes:
                is_rigid = self._joints[one] == self._joints[other]
                is_skipped = frozenset((one, other)) in self._skipped
                if not (is_rigid or is_skipped or {one, other} <= self._hand):
                    yield from (
                        distance(first, self._poses[one], second, self._poses[other])
                        - self._margins[one]
                        - self._margins[other]
                        for first in self._shapes[one]
                        for second in self._shapes[other]
                    )

    def _to(self, body: Body) -> float:
        return min(
            distance(
                shape,
                self._poses[link],
                coal_shape(part.shape),
                body.T_base_body * part.T_body_part,
            )
            - self._margins[link]
            for link in self._arm
            for shape in self._shapes[link]
            for part in body.parts
        )


def _links_below(urdf: Any, joint_name: str) -> set[str]:
    joints = [
        (joint.get("name"), joint.find("parent"), joint.find("child"))
        for joint in ET.parse(urdf).getroot().findall("joint")
    ]
    children: dict[str | None, list[str]] = {}
    found: list[str] = []
    for name, parent, child in joints:
        assert parent is not None
        assert child is not None
        children.setdefault(parent.get("link"), []).append(str(child.get("link")))
        if name == joint_name:
            found.append(str(child.get("link")))
    for link in found:
        found.extend(children.get(link, []))
    return set(found)


@pytest.mark.slow
@settings(max_examples=2)
@given(seeds)
@example(0)  # the neutral configuration, in which nothing touches
def test_clearance_is_the_smallest_distance_of_all_pairs(
    robot: Baxter, arm: Arm, shapes: RobotShapes, scene: Scene, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    q = full(robot, arm, arm.random_configuration(rng) if seed else arm.neutral)
    found = ClearanceChecker(shapes, arm, scene).clearance(q)
    expected = Independent(robot, arm, q).least(scene)
    if expected > 0.0:
        assert found.distance_m == pytest.approx(expected, abs=DISTANCE_TOLERANCE_M)
    else:
        assert found.distance_m <= 0.0


@pytest.mark.parametrize("gap", [0.001, 0.01, -0.003])
def test_clearance_to_a_slab_under_the_lowest_finger_point_is_known_by_hand(
    robot: Baxter, manipulator: Manipulator, shapes: RobotShapes, gap: float
) -> None:
    arm = manipulator.arm
    q = manipulator.ik.solve(overhead(0.70, 0.15, 0.1)).q
    lowest = Independent(robot, arm, full(robot, arm, q)).lowest_m("finger")
    slab = Body("slab", (Part(Box((1.0, 1.0, 0.02)), ORIGIN),), at(0.9, 0.0, lowest - gap - 0.01))
    found = ClearanceChecker(shapes, arm, Scene.of([slab])).clearance(full(robot, arm, q))
    deeper_m = 0.0 if gap > 0.0 else PIECES_OUTSIDE_M  # how deep is known of the pieces alone
    assert gap - deeper_m - DISTANCE_TOLERANCE_M <= found.distance_m <= gap + DISTANCE_TOLERANCE_M
    assert "slab" in (found.first, found.second)
    assert "finger" in found.first + found.second


def test_a_body_inside_a_link_gives_a_negative_clearance_that_names_both(
    robot: Baxter, left: Arm, shapes: RobotShapes
) -> None:
    tip = left.T_base_tip(left.neutral).act(np.array([0.0, 0.0, -0.13]))
    scene = Scene.of([ball("intruder", *tip)])
    found = ClearanceChecker(shapes, left, scene).clearance(full(robot, left, left.neutral))
    assert found.distance_m < 0.0
    assert found.second == "intruder"
    assert found.first.startswith(("left_", "l_"))


@pytest.mark.parametrize(
    "q",
    [
        *(None, "q", [], [0.0] * 7, [0.0] * 18, [np.nan] * 19, [np.inf] * 19, ["0"] * 19, 1.0),
        *([0.0] * k + [x] + [0.0] * (18 - k) for k in (0, 8, 18) for x in (-1001.0, 1e9, 1e300)),
    ],
)
def test_refuses_an_invalid_configuration(
    left: Arm, shapes: RobotShapes, scene: Scene, q: Any
) -> None:
    with pytest.raises(ConfigurationError):
        ClearanceChecker(shapes, left, scene).clearance(q)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        *(({name: bad}, None) for name in ("shapes", "arm", "scene") for bad in (None, "left", 5)),
        ({"may_press": "yes"}, None),
        *(({"supports": bad}, "supports") for bad in (None, 5, "table", [None])),
        ({"touchable": "brick"}, "no body 'brick' in the scene"),
        ({"held": "block"}, "held"),
        ({"held": Attachment("brick", "left_gripper", ORIGIN)}, "no body 'brick' in the scene"),
        (
            {"held": Attachment("block", "right_gripper", ORIGIN)},
            "in the right hand; the left arm cannot carry it",
        ),
        (
            {"held": Attachment("block", "left_gripper", ORIGIN), "touchable": "block"},
            "'block' is in the hand",
        ),
    ],
)
def test_refuses_an_invalid_situation(
    left: Arm, shapes: RobotShapes, scene: Scene, changes: dict[str, Any], text: str | None
) -> None:
    arguments: dict[str, Any] = {"shapes": shapes, "arm": left, "scene": scene}
    with pytest.raises(SceneError, match=text):
        ClearanceChecker(**{**arguments, **changes})


class TestMeshes:
    """Meshes of boxes in place of these boxes."""

    @pytest.fixture
    def q(self, robot: Baxter, left: Arm) -> FloatArray:
        return full(robot, left, left.neutral)

    @pytest.fixture(params=["solid", "open"])
    def slab(self, request: pytest.FixtureRequest) -> Mesh:
        """A mesh of 200 x 200 x 20 mm; when open, it lacks one triangle at its side."""
        corners = CORNERS * [0.1, 0.1, 0.01]
        return mesh_of(corners, SIDES if request.param == "solid" else SIDES[1:])

    @pytest.mark.parametrize("gap", [0.2, 0.02, 0.001])
    def test_a_mesh_is_as_far_away_as_the_same_box(
        self, left: Arm, shapes: RobotShapes, q: FloatArray, slab: Mesh, gap: float
    ) -> None:
        place = left.T_base_tip(left.neutral) * at(0.0, 0.0, 0.05 + gap)
        found = [
            ClearanceChecker(shapes, left, Scene.of([Body("slab", (part,), place)])).clearance(q)
            for part in (Part(slab, ORIGIN), Part(Box((0.2, 0.2, 0.02)), ORIGIN))
        ]
        assert found[0].distance_m == pytest.approx(found[1].distance_m, abs=DISTANCE_TOLERANCE_M)

    @pytest.mark.parametrize(("gap", "is_allowed"), [(0.0, True), (-1e-4, True), (-1e-3, False)])
    def test_a_held_body_may_stand_on_a_mesh_but_not_in_it(
        self, manipulator: Manipulator, q: FloatArray, slab: Mesh, gap: float, is_allowed: bool
    ) -> None:
        cube = Body("cube", (Part(CUBE, at(0.025, 0.025, 0.025)),), ORIGIN)
        found = self.clearance_on(manipulator, cube, q, slab, gap)
        assert (found.distance_m > 0.0) is is_allowed

    def test_a_held_mesh_may_stand_on_its_support(
        self, manipulator: Manipulator, q: FloatArray, slab: Mesh
    ) -> None:
        cube = mesh_of(0.025 * CORNERS, slab.triangles)
        held = Body("held", (Part(cube, at(0.025, 0.025, 0.025)),), ORIGIN)
        assert self.clearance_on(manipulator, held, q, slab, 0.0).distance_m > 0.0
        assert self.clearance_on(manipulator, held, q, slab, -0.001).distance_m < 0.0

    def clearance_on(
        self, manipulator: Manipulator, body: Body, q: FloatArray, slab: Mesh, gap: float
    ) -> Clearance:
        """The clearance of a held body at the neutral configuration, `gap` above a slab."""
        left = manipulator.arm
        held = Attachment(body.name, "left_gripper", at(-0.025, -0.025, -0.025))
        T_base_tip = left.T_base_tip(left.neutral)
        low = body.at(T_base_tip * held.T_link_body).extent_m(Z)[0]
        x, y, _ = T_base_tip.translation
        support = Body("slab", (Part(slab, ORIGIN),), at(x, y, low - gap - 0.01))
        scene = Scene.of([support, body])
        checker = ClearanceChecker(manipulator.shapes, left, scene, held=held, supports=["slab"])
        return checker.clearance(q)


def test_clearance_is_the_smallest_of_the_distances_of_pairs(
    robot: Baxter, left: Arm, shapes: RobotShapes
) -> None:
    checker, q = ClearanceChecker(shapes, left, Scene.of()), full(robot, left, left.neutral)
    found = checker.distances_m(q, range(len(checker.pairs)))
    near = checker.clearance(q)
    assert min(found) == pytest.approx(near.distance_m, abs=DISTANCE_TOLERANCE_M)
    assert near.time_s is None
