"""Certificates of plans: what the rows of each step are, and what leads the checker besides.

Nothing of it is trusted; the checker decides.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, TypedDict

import numpy as np

from baxter_kin.description import RobotDescription
from baxter_kin.json_text import Json
from planner.certificate.body import Body
from planner.certificate.checking import Witness
from planner.certificate.errors import NotCertifiedError
from planner.certificate.intervals import Interval
from planner.certificate.robot import Robot
from planner.certificate.timeline import StepWitness, Timeline
from planner.errors import TaskError
from planner.plan import Grip, GripperAction, Move, Plan, Step
from planner.plan_file import plan_document
from planner.prover.kernel import NotShownError, rows_kernel
from planner.prover.witness import witness_of
from planner.verification.body.robot_body import robot_body
from planner.verification.fingers import Fingers
from planner.verification.story import Story
from planner.verification.urdf_robot import UrdfRobot

SHARES = (0.98, 0.9, 0.5, 0.0)
"""How much of the least distance that is met is certified; the next where that cannot be shown."""

LIFTED_M = 1e-3
"""A body that is lifted so far touches nothing any more: it may be pressed in by half of that."""

INSTANTS = 1001
"""How many are looked at to find when."""

HAND_PARTS = (" hand", " pads")
"""How the names of contacts of a hand end."""


def certificate_of(plan: Plan, description: RobotDescription | None = None) -> Mapping[str, Json]:
    """The certificate of a plan, as `save_plan` takes it and `planner.certificate` checks it.

    Each step is certified to keep 0.98 of the least distance that is met in it; less where that
    cannot be shown. Without a C compiler, the distances are those that its proof met.

    Args:
        plan: a complete plan.
        description: the robot that it is for; the stock robot when not given.

    Raises:
        TaskError: when the plan cannot be certified; says why.
    """
    known = RobotDescription.installed() if description is None else description
    body = body_of(known.text)

    def shown(attempts: Sequence[_Asked]) -> Witness:
        try:
            return witness_of(timeline, body.digest, steps, **attempts[0])
        except NotShownError:
            if len(attempts) == 1:
                raise
        return shown(attempts[1:])

    try:
        timeline, steps = timeline_of(plan, known)
        return shown(tuple(_attempts(plan))).for_file()
    except NotCertifiedError as cause:
        raise TaskError(f"the plan cannot be certified: {cause}") from cause


def timeline_of(
    plan: Plan, description: RobotDescription
) -> tuple[Timeline, Sequence[StepWitness]]:
    """What must keep apart in each step of a plan, and the witnesses that it was derived with.

    Raises:
        NotCertifiedError: when the plan breaks a rule of the checker that is not about rows.
    """
    body, robot = body_of(description.text), Robot(description.text, plan.limb)
    steps, document = _witnesses(plan, robot, description), plan_document(plan)
    data: Any = document["plan"]
    states: Any = document["states"]
    return Timeline(data, states, robot, body, steps), steps


def _attempts(plan: Plan) -> Iterator[_Asked]:
    """What is asked of the rows, the most first."""
    if rows_kernel() is not None:
        yield from (_Asked(share=share) for share in SHARES)
        return
    proofs = [step.proof for step in plan]
    yield _Asked(margins_m=[SHARES[0] * p.nearest.distance_m if p else 0.0 for p in proofs])
    yield _Asked(margins_m=[max(0.0, p.proven_m) if p else 0.0 for p in proofs])


class _Asked(TypedDict, total=False):
    """Arguments of `witness_of`."""

    share: float
    margins_m: Sequence[float]


@lru_cache(maxsize=2)
def body_of(text: str) -> Body:
    """The clusters of a robot, which are read once."""
    return Body(text)


def _witnesses(plan: Plan, own: Robot, description: RobotDescription) -> list[StepWitness]:
    """How fingers close, and how long held bodies touch what they stand on."""
    robot = UrdfRobot(description, plan.limb)
    story = Story(plan, plan.start, robot, Fingers(robot, robot_body(description).solids))
    closings = {grasp.number: grasp.closing for grasp in story.grasps}
    found = []
    for number, step in enumerate(plan):
        contacts: dict[str, tuple[float, float]] = {}
        following = plan.steps[number + 1] if number + 1 < len(plan.steps) else None
        if isinstance(step, Move):
            supports = _supports(step)
            if supports:
                puts_down = isinstance(following, Grip) and following.action is GripperAction.OPEN
                window = _window(step, own, is_first=not puts_down)
                contacts = dict.fromkeys(supports, window)
            found.append(StepWitness(contacts=contacts))
            continue
        closing = closings.get(number)
        if closing is None:
            found.append(StepWitness())
            continue
        if closing.push_m and following is not None:
            contacts = dict.fromkeys(_supports(following), (0.0, 1.0))
        way = closing.touch_m, closing.finger_m, closing.push_m
        found.append(StepWitness(closing=way, contacts=contacts))
    return found


def _supports(step: Step) -> set[str]:
    """The bodies that a held body may touch in a step."""
    return {contact.other for contact in step.contacts if not contact.other.endswith(HAND_PARTS)}


def _window(move: Move, robot: Robot, *, is_first: bool) -> tuple[float, float]:
    """The time in which the tip is less than `LIFTED_M` above where the move starts, or ends."""
    times_s = np.linspace(0.0, move.trajectory.duration, INSTANTS)
    tips = robot.tips(Interval(move.trajectory.sample(times_s).q))
    heights = tips.p.centred()[0][:, 2]
    if is_first:
        away = np.flatnonzero(heights > heights[0] + LIFTED_M)
        return 0.0, float(times_s[away[0]] if len(away) else times_s[-1])
    away = np.flatnonzero(heights > heights[-1] + LIFTED_M)
    return float(times_s[away[-1]] if len(away) else 0.0), move.trajectory.duration
