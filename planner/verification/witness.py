"""Search for what a plan's certificate states: rows, how fingers close, and what bodies touch.

Nothing of it is trusted; the checker decides.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from baxter_kin.description import RobotDescription
from baxter_kin.files.json_text import Json
from baxter_kin.validation import expect
from planner.certificate.body import Body
from planner.certificate.checking import Witness, check
from planner.certificate.errors import NotCertifiedError
from planner.certificate.intervals import Pose
from planner.certificate.motion import Polynomials
from planner.certificate.robot import ARM_JOINTS, Robot
from planner.certificate.rows import Step, Trace
from planner.certificate.timeline import (
    PRESS_M,
    Limits,
    Situation,
    StepWitness,
    Timeline,
    distance_m,
)
from planner.certificate.timeline.both_arms import BothArms
from planner.certificate.timeline.touching import DistanceBounds
from planner.errors import TaskError
from planner.plan import Plan
from planner.plan_file import check_size, plan_document
from planner.prover.kernel import Trees, rows_kernel
from planner.prover.numpy_search import rows_of
from planner.prover.problem import SHARES, Chain, NotShownError, Rows

LIFTED_M = 1.2 * PRESS_M
"""Height above its support at which a body touches nothing, however deep it was pressed in."""

INSTANTS = 1001
"""Number of instants of a move at which this height is looked for."""

STATED_EXCESS_M = 1e-5
"""By how much a step's stated clearance may exceed the one found here, as fingers close a little
differently."""

CLOSED_M = 1e-6
"""Distance of a closed finger from its body; the checker allows ten times as much."""


def certificate_of(plan: Plan, description: RobotDescription | None = None) -> Mapping[str, Json]:
    """The certificate of a plan, for `save_plan`; `planner.certificate` checks it.

    The certified clearance of each step is 0.98 of the smallest distance found in it, or less where
    that cannot be proven. Without a C compiler, it is the clearance that the plan states.

    Args:
        plan: the plan.
        description: the robot that it is for; the stock robot when not given.

    Raises:
        TaskError: when an argument has the wrong type, or the plan cannot be certified; gives the
            reason.
    """
    known = RobotDescription.of() if description is None else description
    expect(known, RobotDescription, "description", TaskError)
    check_size(expect(plan, Plan, "plan", TaskError), plan.start, TaskError)
    document = plan_document(plan)
    try:
        witness = SoughtTimeline(document, known.text).witness()
        check(document, known.text, body=body_of(known.text), certificate=witness)
    except NotCertifiedError as cause:
        raise TaskError(f"the plan cannot be certified: {cause}") from cause
    return witness.for_file()


def witness_of(
    timeline: Timeline | BothArms,
    body: str,
    steps: Sequence[StepWitness],
    *,
    margins_m: Sequence[float] | None = None,
    share: float = 0.0,
) -> Witness:
    """Find the rows of all steps of a plan.

    Args:
        timeline: made with the same witnesses of steps; or both arms on their clock.
        body: digest of the file of clusters.
        steps: the witness of each step of the plan, but for its margin.
        margins_m: the clearance that each step must keep; 0 when not given.
        share: of the smallest distance found, what is to be proven as well; ignored without a C
            compiler.

    Raises:
        NotShownError: when no rows are found.
    """
    asked = [0.0] * len(steps) if margins_m is None else margins_m
    kernel = rows_kernel()
    trees = None if kernel is None else Trees.of(kernel, timeline.clusters)
    chain = Chain.of(timeline.robot)

    def rows(step: Step, margin_m: float) -> Rows:
        if kernel is None or trees is None:
            return rows_of(timeline.robot, timeline.clusters, step, margin_m)
        return kernel.rows(chain, trees, step, margin_m=margin_m, share=share)

    kept = [np.inf] * len(steps)
    traces = []
    for step, number in zip(timeline.steps, timeline.numbers, strict=True):
        found = rows(step, 0.0 if number is None else asked[number])
        traces.append(found.trace)
        if number is not None:
            kept[number] = min(kept[number], found.proven_m)
    proven = [max(0.0, margin) if np.isfinite(margin) else 0.0 for margin in kept]
    witnesses = tuple(replace(s, margin_m=m) for s, m in zip(steps, proven, strict=True))
    return Witness(body, witnesses, Trace.joined(traces))


@lru_cache(maxsize=2)
def body_of(urdf: str) -> Body:
    """The clusters of a robot, read once."""
    return Body(urdf)


def _attempts(
    proofs: Sequence[Mapping[str, Any] | None], less_m: float
) -> Iterator[tuple[list[float], float]]:
    """What the rows are asked to prove, the most first: margins of all steps, m, and a share.

    The stated clearances are asked for as well, so that they are proven where they are true.
    """
    stated = [max(0.0, proof["proven_m"] - less_m) if proof else 0.0 for proof in proofs]
    if rows_kernel() is None:
        yield [SHARES[0] * p["nearest"]["distance_m"] if p else 0.0 for p in proofs], 0.0
        yield stated, 0.0
    else:
        yield stated, SHARES[0]
        yield from (([0.0] * len(proofs), share) for share in SHARES[:-1])
    yield [0.0] * len(proofs), 0.0


class SoughtTimeline(Timeline):
    """A timeline that finds how fingers close and what held bodies touch, step by step.

    Attributes:
        found: the witness of each step, but for its margin.
    """

    def __init__(
        self,
        document: Mapping[str, Any],
        urdf: str,
        limits: Limits | None = None,
        *,
        is_alone: bool = False,
    ) -> None:
        """Follow a plan to its end.

        Args:
            document: the content of a plan file.
            urdf: text of the robot's URDF.
            limits: maximum accelerations and jerks; the presets when not given.
            is_alone: whether the other arm is left out.
        """
        self.found: list[StepWitness] = []
        plan, states = document["plan"], document["states"]
        unknown = [StepWitness()] * len(plan["steps"])
        robot, self._body = Robot(urdf, plan["limb"]), body_of(urdf)
        super().__init__(plan, states, robot, self._body, unknown, limits=limits, is_alone=is_alone)

    def witness(self) -> Witness:
        """The certificate with the greatest clearances that can be proven."""
        robot = self.robot
        wider_m = 2.0 * robot.skew * robot.stroke_m  # by which the checker widens fingers
        less_m = STATED_EXCESS_M + wider_m

        def found(margins_m: Sequence[float], share: float) -> Witness:
            digest = self._body.digest
            return witness_of(self, digest, self.found, margins_m=margins_m, share=share)

        def shown(margins_m: Sequence[float], share: float) -> Witness | None:
            try:
                return found(margins_m, share)
            except NotShownError:
                return None

        proofs = [step["proof"] for step in self.plan_steps]
        first, *others, last = _attempts(proofs, less_m)
        best = shown(*first)
        if best is None:
            least = found(*last)  # raises where not even this can be shown
            best = next(filter(None, (shown(*asked) for asked in others)), least)
        return best

    def _witness(
        self,
        number: int,
        now: Situation,
        motion: Polynomials | None = None,
        puts_down: bool = False,
    ) -> StepWitness:
        step, closing = self.plan_steps[number], None
        contacts: dict[str, tuple[float, float]] = {}
        stated = {contact["other"] for contact in step["contacts"]}
        if motion is not None and now.held is not None:
            name, T_joint_body = now.held
            for is_meant, is_first in ((now.taken, True), (puts_down, False)):
                T = self.bodies.joint_pose(motion.start[0] if is_first else motion.end[0])
                T = T * T_joint_body
                touched = list(self._supports(name, T, now.at, stated)) if is_meant else []
                if touched:
                    contacts |= dict.fromkeys(touched, self._window(motion, is_first=is_first))
        elif motion is None and step["action"] == "CLOSE" and step["body"] in now.at:
            name = step["body"]
            closing = self._closing(step["label"], name, now)
            contacts = dict.fromkeys(self._supports(name, now.at[name], now.at, stated), (0.0, 1.0))
        self.found.append(StepWitness(closing=closing, contacts=contacts))
        return self.found[-1]

    def _require_tip(self, step: Mapping[str, Any], motion: Polynomials) -> None:
        """Skipped: tips and lines need no witness, and the checker judges them."""

    def _supports(
        self, name: str, T: Pose, at: Mapping[str, Pose], stated: set[str]
    ) -> Iterator[str]:
        """The bodies that a body stands on, or is stated to stand on."""
        for other, T_other in at.items():
            if other != name:
                within_m = (2.0 if other in stated else 1.0) * PRESS_M
                if distance_m(self.bodies, name, T, other, T_other, enough_m=within_m) <= within_m:
                    yield other

    def _window(self, motion: Polynomials, *, is_first: bool) -> tuple[float, float]:
        """When the tip is less than `LIFTED_M` above the start or the end of a move."""
        times_s = np.linspace(0.0, motion.duration_s, INSTANTS)
        heights = self.robot.tips(motion.at(times_s)).p.centred()[0][:, 2]
        away = np.flatnonzero(heights > heights[0 if is_first else -1] + LIFTED_M)
        if is_first:
            return 0.0, float(times_s[away[0]] if len(away) else times_s[-1])
        return float(times_s[away[-1]] if len(away) else 0.0), motion.duration_s

    def _closing(self, label: str, name: str, now: Situation) -> tuple[float, float, float]:
        """The hand's opening when a finger touches a body and at the end, and how far it is pushed.

        The finger that touches first pushes the body until the other one touches.
        """
        opening_m: float = now.opening_m
        T = self.bodies.joint_pose(now.arm[0]).inverse() * now.at[name]
        root = self.bodies.mover(name, T, ARM_JOINTS).root
        ways = {f: self._way_m(f, root, opening_m) for f in self.robot.fingers}
        for finger, way_m in ways.items():
            if way_m <= -PRESS_M and self._is_over(finger, root, opening_m):
                raise NotCertifiedError(f"{label}: {finger} is inside {name}")
        if sum(ways.values()) > 2.0 * opening_m:
            raise NotCertifiedError(f"{label}: the fingers do not meet {name}")
        towards_y, other = (ways[f] for f in sorted(ways, key=lambda f: self.robot.fingers[f]))
        end_m, push_m = opening_m - 0.5 * (towards_y + other), 0.5 * (other - towards_y)
        if abs(push_m) <= CLOSED_M:
            return end_m, end_m, 0.0
        return min(opening_m, opening_m - min(towards_y, other)), end_m, push_m

    def _is_over(self, finger: str, root: int, opening_m: float) -> bool:
        """Whether a finger touches a body even when it is drawn back by `PRESS_M`."""
        shift = np.array([0.0, self.robot.fingers[finger] * opening_m, -PRESS_M])
        distances = DistanceBounds(self.clusters)
        return distances.bound_m(self.bodies.fingers[finger], root, shift, CLOSED_M) <= CLOSED_M

    def _way_m(self, finger: str, root: int, opening_m: float) -> float:
        """How far a finger closes until it touches a body, by conservative advancement.

        It starts farther open, as it may press in a little at first.
        """
        way_m, sign = -PRESS_M, self.robot.fingers[finger]
        distances = DistanceBounds(self.clusters)
        while way_m <= 2.0 * opening_m:
            shift = np.array([0.0, sign * (opening_m - way_m), 0.0])
            away_m = distances.bound_m(self.bodies.fingers[finger], root, shift, CLOSED_M)
            if away_m <= CLOSED_M:
                return way_m
            way_m += max(away_m - 0.5 * CLOSED_M, 0.5 * CLOSED_M)
        return float(np.inf)
