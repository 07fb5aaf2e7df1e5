"""Certificates of plans: what the rows of each step are, and what leads the checker besides.

Nothing of it is trusted; the checker decides.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from baxter_kin.description import RobotDescription
from baxter_kin.json_text import Json
from baxter_kin.validation import expect
from planner.certificate.body import Body
from planner.certificate.checking import Witness, check
from planner.certificate.errors import NotCertifiedError
from planner.certificate.intervals import Pose
from planner.certificate.motion import Polynomials
from planner.certificate.robot import ARM_JOINTS, Robot
from planner.certificate.timeline import PRESS_M, Limits, StepWitness, Timeline
from planner.certificate.touching import DistanceBounds
from planner.errors import TaskError
from planner.plan import Plan
from planner.plan_file import check_size, plan_document
from planner.prover.kernel import SHARES, NotShownError, rows_kernel
from planner.prover.witness import witness_of

LIFTED_M = 1.2 * PRESS_M
"""A body that is lifted so far touches nothing any more, as deep as it may have pressed."""

INSTANTS = 1001
"""How many are looked at to find when."""

LESS_M = 1e-5
"""How much less than a step states is asked for, as fingers close a little otherwise here."""

CLOSED_M = 1e-6
"""How near a finger comes to a body that it closes on; the checker asks for ten times as much."""


def certificate_of(plan: Plan, description: RobotDescription | None = None) -> Mapping[str, Json]:
    """The certificate of a plan, as `save_plan` takes it and `planner.certificate` checks it.

    Each step is certified to keep 0.98 of the least distance that is met in it; less where that
    cannot be shown. Without a C compiler, the distances are those that the plan states.

    Args:
        plan: a plan.
        description: the robot that it is for; the stock robot when not given.

    Raises:
        TaskError: when the plan cannot be certified; says why.
    """
    known = RobotDescription.installed() if description is None else description
    expect(known, RobotDescription, "description", TaskError)
    check_size(expect(plan, Plan, "plan", TaskError), plan.start, TaskError)
    document = plan_document(plan)
    try:
        witness = SoughtTimeline(document, known.text).witness()
        check(document, known.text, body=body_of(known.text), certificate=witness)
    except NotCertifiedError as cause:
        raise TaskError(f"the plan cannot be certified: {cause}") from cause
    return witness.for_file()


@lru_cache(maxsize=2)
def body_of(urdf: str) -> Body:
    """The clusters of a robot, which are read once."""
    return Body(urdf)


def _attempts(
    proofs: Sequence[Mapping[str, Any] | None], less_m: float
) -> Iterator[tuple[list[float], float]]:
    """What is asked of the rows, the most first: margins of all steps, m, and a share.

    That which the plan states is asked for too, so that it is proven where it is true.
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
        found: what a certificate says of each step, but for its margin.
    """

    def __init__(
        self, document: Mapping[str, Any], urdf: str, limits: Limits | None = None
    ) -> None:
        """Follow a plan to its end.

        Args:
            document: what a plan file holds.
            urdf: text of the robot's URDF.
            limits: what accelerations and jerks are judged by; the presets when not given.
        """
        self.found: list[StepWitness] = []
        plan, states = document["plan"], document["states"]
        unknown = [StepWitness()] * len(plan["steps"])
        robot, self._body = Robot(urdf, plan["limb"]), body_of(urdf)
        super().__init__(plan, states, robot, self._body, unknown, limits=limits)

    def witness(self) -> Witness:
        """What leads the checker through the plan."""
        robot = self.robot
        less_m = LESS_M + 2.0 * robot.skew * robot.stroke_m  # by which the checker widens fingers

        def found(margins_m: Sequence[float], share: float) -> Witness:
            digest = self._body.digest
            return witness_of(self, digest, self.found, margins_m=margins_m, share=share)

        def shown(margins_m: Sequence[float], share: float) -> Witness | None:
            try:
                return found(margins_m, share)
            except NotShownError:
                return None

        proofs = [step["proof"] for step in self._plan_steps]
        first, *others, last = _attempts(proofs, less_m)
        best = shown(*first)
        if best is None:
            least = found(*last)  # where this cannot be shown, nothing can
            best = next(filter(None, (shown(*asked) for asked in others)), least)
        return best

    def _witness(
        self,
        number: int,
        now: Any,
        motion: Polynomials | None = None,
        puts_down: bool = False,
    ) -> StepWitness:
        step, closing = self._plan_steps[number], None
        contacts: dict[str, tuple[float, float]] = {}
        stated = {contact["other"] for contact in step["contacts"]}
        if motion is not None and now.held is not None:
            name, T_joint_body = now.held
            for is_meant, is_first in ((now.taken, True), (puts_down, False)):
                T = self._joint_pose(motion.start[0] if is_first else motion.end[0])
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
        """The checker judges tips and lines; no witness leads it there."""

    def _supports(
        self, name: str, T: Pose, at: Mapping[str, Pose], stated: set[str]
    ) -> Iterator[str]:
        """The bodies that one stands on, or is stated to."""
        for other, T_other in at.items():
            if other != name:
                within_m = (2.0 if other in stated else 1.0) * PRESS_M
                if self._distance_m(name, T, other, T_other, within_m) <= within_m:
                    yield other

    def _window(self, motion: Polynomials, *, is_first: bool) -> tuple[float, float]:
        """When the tip is less than `LIFTED_M` above where a move starts, or ends."""
        times_s = np.linspace(0.0, motion.duration_s, INSTANTS)
        heights = self.robot.tips(motion.at(times_s)).p.centred()[0][:, 2]
        away = np.flatnonzero(heights > heights[0 if is_first else -1] + LIFTED_M)
        if is_first:
            return 0.0, float(times_s[away[0]] if len(away) else times_s[-1])
        return float(times_s[away[-1]] if len(away) else 0.0), motion.duration_s

    def _closing(self, label: str, name: str, now: Any) -> tuple[float, float, float]:
        """How far the hand is open when a finger touches, and at the end, and how far it pushes.

        The finger that touches first pushes the body until the other one touches.
        """
        opening_m: float = now.opening_m
        T = self._joint_pose(now.arm[0]).inverse() * now.at[name]
        root = self._mover(name, T, ARM_JOINTS).root
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
        """Whether a finger touches a body even if it is drawn back a little."""
        shift = np.array([0.0, self.robot.fingers[finger] * opening_m, -PRESS_M])
        distances = DistanceBounds(self.clusters)
        return distances.bound_m(self._fingers[finger], root, shift, CLOSED_M) <= CLOSED_M

    def _way_m(self, finger: str, root: int, opening_m: float) -> float:
        """How far a finger closes until it is at a body, by conservative advancement.

        It begins farther open, as it may press in a little at first.
        """
        way_m, sign = -PRESS_M, self.robot.fingers[finger]
        distances = DistanceBounds(self.clusters)
        while way_m <= 2.0 * opening_m:
            shift = np.array([0.0, sign * (opening_m - way_m), 0.0])
            away_m = distances.bound_m(self._fingers[finger], root, shift, CLOSED_M)
            if away_m <= CLOSED_M:
                return way_m
            way_m += max(away_m - 0.5 * CLOSED_M, 0.5 * CLOSED_M)
        return float(np.inf)
