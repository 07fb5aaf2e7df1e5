"""No simulated arm leaves its tube on the clock, whatever the clock waits for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from baxter_kin import Baxter
from planner import Grip, Manipulator, Response, TwoArmPlan
from planner.motion.tracking_tube import SETTLED_RAD
from planner.pick_place.tracking import START_RAD
from planner.two_arms.tracking.clocked_arm import ClockedArm, waits_of
from planner.verification.both_arms import _certified
from planner.verification.lag.both_arms import BothLagging
from tests.planner.two_arms.pairs import SIDES
from tests.planner.two_arms.tracking.conftest import TYPICAL
from tests.planner.two_arms.tracking.lagging import STEP_S, followed, slowing_s

RESPONSES = {
    "typical": TYPICAL,
    "of a Baxter, with a lead": Response((0.35, 0.45), 0.001, 0.3, 0.4),
    "without a lag at times": Response((0.0, 0.3), 0.0, 0.6),
}
SKEW_S = 0.005
EVERY = 4
"""One of so many instants is compared."""

ROUNDING_RAD = 1e-9


@pytest.fixture(scope="module")
def arms(plain_plan: TwoArmPlan, manipulators: Mapping[str, Manipulator]) -> dict[str, ClockedArm]:
    return {side: ClockedArm(plain_plan, side, manipulators[side]) for side in SIDES}


@pytest.mark.slow
@pytest.mark.parametrize("name", RESPONSES)
def test_no_arm_leaves_its_tube(
    plain_plan: TwoArmPlan, arms: Mapping[str, ClockedArm], robot: Baxter, name: str
) -> None:
    response = RESPONSES[name]
    responses = dict.fromkeys(SIDES, response)
    waits = waits_of(plain_plan, slowing_s(response))
    tubes = {side: arms[side].tube(response, START_RAD, waits).joints for side in SIDES}
    sought, _ = _certified(plain_plan, robot.description)
    checked = BothLagging(plain_plan, sought.timelines, responses, SKEW_S, slowing_s(response))
    others = {side: checked.tube_of(side) for side in SIDES}
    rng = np.random.default_rng(3)
    for number, now in enumerate(followed(plain_plan, responses, rng, skew_s=SKEW_S)):
        if number % EVERY:
            continue
        at_s = now.clock_s / response.speed
        for side in SIDES:
            own = tubes[side].between(at_s - SKEW_S - STEP_S, at_s + STEP_S)
            other, step_s = others[side], others[side].step_s
            last = len(other.low) - 1
            span = [min(max(int((at_s + k) / step_s), 0), last) for k in (-SKEW_S, STEP_S)]
            for low, high in (own.hull(0, own.cells), other.hull(span[0], span[1] + 1)):
                assert (now.q[side] >= low - ROUNDING_RAD).all()
                assert (now.q[side] <= high + ROUNDING_RAD).all()


def test_a_tube_converges_while_fingers_act(
    plain_plan: TwoArmPlan, arms: Mapping[str, ClockedArm]
) -> None:
    tube = arms["left"].tube(TYPICAL, START_RAD, waits_of(plain_plan, plain_plan.grip_s))
    errors = 2.0 * float(TYPICAL.settled_error_rad.max())
    for clip in arms["left"].clips.values():
        settled = tube.during(clip.begin_s, clip.end_s, clip)
        within = SETTLED_RAD + errors + 1e-9
        assert (settled.highest[1:-1] <= clip.q + within).all()
        assert (settled.lowest[1:-1] >= clip.q - within).all()
        assert float(settled.widths[-1].max()) < errors + 1e-4
    assert len(arms["left"].clips) == 3


def test_the_clock_may_wait_for_each_gripper_of_both_arms(plain_plan: TwoArmPlan) -> None:
    grips = [each for each in plain_plan.steps if isinstance(each.step, Grip)]
    waits = waits_of(plain_plan, 0.1)
    assert len(waits) == len(grips) == 6
    for (begin_s, end_s), grip in zip(waits, grips, strict=True):
        assert begin_s == pytest.approx(grip.end_s - 0.1)
        assert end_s == pytest.approx(grip.end_s + 0.1)
