"""What cannot be done is refused with stage, names and numbers, and nothing is raised."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

import pytest

from baxter_kin import Baxter
from planner import Body, Box, Manipulator, Part, PickAndPlace, PlanFailure, Scene, make_block
from tests.conftest import at, overhead
from tests.planner.pick_place.conftest import ORIGIN, PICK, PLACE, TASK, box, labels, planned


class Case(NamedTuple):
    """A stage and the reason of its failure, for a task in a changed scene."""

    stage: str
    reason: str
    task: PickAndPlace = TASK
    change: Callable[[Scene], Scene] = lambda scene: scene


def placing(x: float, y: float, z: float = -0.129) -> PickAndPlace:
    return PickAndPlace("block", PICK, overhead(x, y, z))


def adding(*bodies: Body) -> Callable[[Scene], Scene]:
    def change(scene: Scene) -> Scene:
        for body in bodies:
            scene = scene.with_body(body)
        return scene

    return change


def shifted(dx: float, dy: float) -> Callable[[Scene], Scene]:
    return lambda scene: scene.moved("block", at(dx, dy, 0.0) * scene["block"].T_base_body)


def instead(size: tuple[float, float, float], z: float) -> Callable[[Scene], Scene]:
    body = Body("block", (Part(Box(size), ORIGIN),), at(0.7, 0.15, z), is_movable=True)
    return lambda scene: scene.without("block").with_body(body)


def cube(name: str, x: float, y: float) -> Body:
    return make_block(name, at(x, y, -0.13), edge_m=0.05)


def crate_at_start() -> Body:
    arm = Baxter.load().arm("left")
    return box("crate", (0.2, 0.2, 0.2), *arm.T_base_tip(arm.start).translation.tolist())


def top(x: float) -> Body:
    return make_block("top", at(x, 0.1515, -0.095), edge_m=(0.14, 0.04, 0.02))


CASES = [
    Case("place: approach", r"\(1\.500, 0\.000, 0\.550\) m .* out of reach", placing(1.5, 0, 0.5)),
    Case(
        *("pick: approach", "millimetres"),
        PickAndPlace("block", overhead(2000.0, 0.0, -0.129), PLACE),
    ),
    Case(
        *("place: descend", r"^all \d+ IK solutions collide: block with table, at best 20.0 mm"),
        placing(0.75, 0.0, -0.149),
    ),
    Case(
        *("pick: descend", "finger_tip with table, at best 3.9 mm deep"),
        PickAndPlace("block", overhead(0.70, 0.15, -0.155), PLACE),
        instead((0.05, 0.05, 0.01), -0.150),
    ),
    Case("pick: open", "a pad would come down 26.1 mm inside it", TASK, shifted(0.0, 0.03)),
    Case(
        *("place: descend", "with post, at best", TASK),
        adding(box("post", (0.03, 0.03, 0.3), 0.75, 0.05, 0.0)),
    ),
    Case(
        *("pick: approach", r"^the arm is blocked at its start: \w+ is [\d.]+ mm inside crate$"),
        TASK,
        lambda scene: scene.with_body(crate_at_start()),
    ),
    Case("pick: close", "block is 5[23] mm to the side of the tip", TASK, shifted(0.055, 0.0)),
    Case("pick: close", "block is 12[12] mm to the side of the tip", TASK, shifted(0.0, 0.12)),
    Case(
        *("pick: open", r"block measures (50|60)\.0 mm.* the left hand opens only 57.0 mm", TASK),
        instead((0.06, 0.06, 0.05), -0.13),
    ),
    Case(
        *("place: open", "would tip: its centre is 3.4 mm beyond the edge of table"),
        placing(0.5425, 0.15),
    ),
    *(
        Case(
            *("place: descend", rf"^{body.name} stands there: block would be [\d.]+ mm inside it$"),
            TASK,
            adding(body),
        )
        for body in (cube("blue", 0.78, 0.0), box("wall", (0.02, 0.2, 0.2), 0.75, 0.0, -0.055))
    ),
    Case("pick: retract", "^top stands on block; carry that away", TASK, adding(top(0.6975))),
    Case(
        *("pick: retract", "^top stands on block, too; carry that away first$", TASK),
        adding(top(0.7475), cube("other", 0.7975, 0.1515)),
    ),
    Case(
        *("pick: descend", "^for every IK solution, l_gripper_l_finger.*inside bead", TASK),
        adding(box("bead", (0.004, 0.004, 0.004), 0.70, 0.19, 0.020)),
    ),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.reason)
def test_what_cannot_be_done_is_refused_with_its_reason(
    manipulator: Manipulator, scene: Scene, case: Case
) -> None:
    plan = planned(case.task, manipulator, case.change(scene))
    failure = plan.failure
    assert isinstance(failure, PlanFailure)
    assert failure.stage == case.stage
    assert re.search(case.reason, failure.reason)
    assert failure.is_certain
    assert labels(plan) == []


def test_a_pose_out_of_reach_states_the_result_of_inverse_kinematics(
    manipulator: Manipulator, scene: Scene
) -> None:
    failure = planned(placing(1.5, 0.0, 0.5), manipulator, scene).failure
    assert failure is not None
    assert failure.ik is not None
    assert not failure.ik.is_valid


def test_collisions_of_all_solutions_are_counted(manipulator: Manipulator, scene: Scene) -> None:
    failure = planned(TASK, manipulator, scene.with_body(cube("blue", 0.75, 0.0))).failure
    assert failure is not None
    (tally,) = failure.tallies
    assert tally.colliding == tally.solutions
