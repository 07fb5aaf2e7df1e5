"""States and contacts that steps state: those that follow pass, any other is refused by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin.description import RobotDescription
from planner import Attachment, Plan, State, verify
from planner.plan import Step
from planner.scene.contact import Contact
from planner.verification.body.robot_body import robot_body
from planner.verification.fingers import Fingers
from planner.verification.statements import statement_checks
from planner.verification.story import Story
from planner.verification.tolerances import Tolerances
from planner.verification.urdf_robot import UrdfRobot
from tests.planner.verification.conftest import forged

MUTATIONS = 1000

Change = Callable[[np.random.Generator, State], State]
Otherwise = Callable[[np.random.Generator, Step], dict[str, object]]


@pytest.fixture(scope="module")
def story(tracked_plan: Plan, urdf: UrdfRobot) -> Story:
    solids = robot_body(RobotDescription.installed()).solids
    return Story(tracked_plan, tracked_plan.start, urdf, Fingers(urdf, solids))


def differences(plan: Plan, story: Story, urdf: UrdfRobot) -> list[str]:
    checks = statement_checks(plan, story, urdf, Tolerances.of(plan))
    return [check.where for check in checks if not check.is_passed]


def mutated(plan: Plan, number: int, **changes: object) -> Plan:
    """A plan of which one step states something else, past every check of its class."""
    steps = list(plan.steps)
    steps[number] = forged(steps[number], **changes)
    return forged(plan, steps=tuple(steps))


def shift(rng: np.random.Generator) -> pin.SE3:
    """By 0.6 mm to 0.1 m, or turned by 0.1 to 60 deg; no symmetry hides either."""
    T = pin.SE3.Identity()
    along = rng.normal(size=3)
    along /= np.linalg.norm(along)
    if rng.random() < 0.5:
        T.translation = along * 10 ** rng.uniform(-3.2, -1)
    else:
        T.rotation = pin.exp3(along * np.radians(10 ** rng.uniform(0.2, 1.8)))
    return T


def elsewhere(rng: np.random.Generator, state: State) -> State:
    name = str(rng.choice(list(state.scene.bodies)))
    return replace(state, scene=state.scene.moved(name, state.scene[name].T_base_body * shift(rng)))


def another_joint(rng: np.random.Generator, state: State) -> State:
    name = str(rng.choice(list(state.joints)))
    by = 10 ** rng.uniform(-3.2, -1) * rng.choice([-1, 1])
    return replace(state, joints={**state.joints, name: state.joints[name] + by})


def without_a_body(rng: np.random.Generator, state: State) -> State:
    held = {each.body for each in state.attachments}
    name = str(rng.choice(sorted(set(state.scene.bodies) - held)))
    return replace(state, scene=state.scene.without(name))


def held_otherwise(rng: np.random.Generator, state: State) -> State:
    """Lost, taken by the other hand, taken when it is not, or off in the hand."""
    if not state.attachments:
        side = str(rng.choice(["left", "right"]))
        return state.held_by(f"{side}_gripper", "block", shift(rng))
    (held,) = state.attachments
    lost: tuple[Attachment, ...] = ()
    other = (replace(held, link="right_gripper"),)
    off = (replace(held, T_link_body=held.T_link_body * shift(rng)),)
    return replace(state, attachments=[lost, other, off][rng.integers(3)])


STATES: list[Change] = [elsewhere, another_joint, without_a_body, held_otherwise]


def other_contacts(rng: np.random.Generator, contacts: tuple[Contact, ...]) -> tuple[Contact, ...]:
    """One more, or one that is longer, deeper or of another pair."""
    which = rng.integers(4 if contacts else 1)
    if which == 0:
        return (*contacts, Contact("block", str(rng.choice(["torso", "pole", "right hand"]))))
    number = int(rng.integers(len(contacts)))
    chosen = contacts[number]
    changed = {
        1: replace(chosen, end_s=chosen.end_s + 10 ** rng.uniform(-2, 0)),
        2: replace(chosen, least_m=chosen.least_m - 10 ** rng.uniform(-5, -2)),
        3: replace(chosen, begin_s=-(10 ** rng.uniform(-3, 0))),
    }[int(which)]
    return (*contacts[:number], changed, *contacts[number + 1 :])


def test_what_the_planner_states_follows(tracked_plan: Plan) -> None:
    found = verify(tracked_plan)
    assert found.is_valid, found.verdict
    assert found["stated states that differ"].is_passed
    assert found["stated contacts that differ"].is_passed


def other_state(rng: np.random.Generator, step: Step) -> dict[str, object]:
    change = STATES[rng.integers(len(STATES))]
    assert step.state is not None
    return {"state": change(rng, step.state)}


def other_contact(rng: np.random.Generator, step: Step) -> dict[str, object]:
    return {"contacts": other_contacts(rng, step.contacts)}


@pytest.mark.parametrize(("otherwise", "seed"), [(other_state, 34), (other_contact, 35)])
def test_any_other_statement_is_refused_with_the_difference(
    tracked_plan: Plan, story: Story, urdf: UrdfRobot, otherwise: Otherwise, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(MUTATIONS):
        number = int(rng.integers(len(tracked_plan.steps)))
        step = tracked_plan.steps[number]
        changes = otherwise(rng, step)
        found = differences(mutated(tracked_plan, number, **changes), story, urdf)
        assert [where.startswith(f"{step.label}: ") for where in found] == [True], changes


@pytest.mark.parametrize("label", ["pick: descend", "pick: retract", "place: descend"])
def test_a_contact_that_is_meant_must_be_stated(
    tracked_plan: Plan, story: Story, urdf: UrdfRobot, label: str
) -> None:
    number = [step.label for step in tracked_plan].index(label)
    (found,) = differences(mutated(tracked_plan, number, contacts=()), story, urdf)
    assert found.startswith(f"{label}: contact of block")
    assert found.endswith("is not stated")


def test_a_wider_opening_is_refused(tracked_plan: Plan, story: Story, urdf: UrdfRobot) -> None:
    for number, step in enumerate(tracked_plan):
        assert step.state is not None
        name = "l_gripper_l_finger_joint"
        wider = {**step.state.joints, name: step.state.joints[name] + 6e-4}
        state = replace(step.state, joints=wider)
        (found,) = differences(mutated(tracked_plan, number, state=state), story, urdf)
        assert name in found
