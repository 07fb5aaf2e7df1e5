"""Identification: how much each joint of an arm lags, measured by a small move and back.

The moves are a plan like any other, judged and guarded alike, but nobody knows what stands around
the robot: only that the arm keeps clear of the robot itself is proven.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from itertools import groupby

import numpy as np

from baxter_kin import Baxter
from baxter_kin.kinematics.arm import JOINTS
from baxter_kin.validation import FloatArray
from planner import Manipulator, Move, Plan, Response, Scene, fit_response, plan_joint_move
from planner.clearance import ContinuousProof
from planner.state import State
from sim.errors import RosError, SimulationError
from sim.events import Event, EventKind
from sim.ros1.execution.executor import RosExecutor
from sim.ros1.execution.link.baxter_link import BaxterLink
from sim.ros1.execution.ready_plan import ExecutionOptions
from sim.ros1.execution.stops import StopCause
from sim.ros1.execution.stream.set_points import Pace
from sim.samples import Sample, SampleObserver

STEP_RAD = 0.2
"""How far each joint moves: less does not tell a lag from noise, more comes too far around."""

PACE = Pace(1.0)

THERE, BACK = "there", "back"
"""The two moves of a joint."""

_LOG = logging.getLogger(__name__)
"""Progress: which joint moves."""


class Identification(SampleObserver):
    """Moves an arm joint by joint, and fits a response to what is measured.

    Attributes:
        warning: what will happen, as one sentence.
    """

    def __init__(self, link: BaxterLink, limb: str) -> None:
        """Plan the moves from where the arm stands."""
        self._link, self._limb = link, limb
        text = link.description
        if text is None:
            raise RosError("the robot serves no /robot_description; nothing can be planned")
        self._robot = Baxter.load(text)
        arm = self._robot.arm(limb)
        reading = link.joints.arm(arm.joint_names)
        if reading is None:
            raise RosError(f"it is not known where the {limb} arm stands")
        self._plan = self._planned(reading.q)
        self._samples: list[Sample] = []
        self._executor = RosExecutor(link, [self], options=ExecutionOptions(PACE))
        moves = [move.trajectory for move in self._plan.moves]
        fastest = max(float(np.abs(each.v).max()) for each in moves)
        self.warning = (
            f"each joint of the {limb} arm ({', '.join(JOINTS)}) will move by {STEP_RAD:g} rad and "
            f"back, one after the other, at up to {fastest:.1f} rad/s, {len(moves)} moves of "
            f"{max(each.duration for each in moves):.1f} s at most; nobody knows what stands "
            "around the robot: keep the space around the arm free, and a hand on the emergency stop"
        )

    def on_sample(self, sample: Sample) -> None:
        """Keep it."""
        self._samples.append(sample)

    def on_event(self, event: Event) -> None:
        """Log which joint begins to move."""
        if event.kind is EventKind.MOVE_STARTED and event.move is not None:
            joint, _, direction = event.move.label.partition(" ")
            if direction == THERE:
                _LOG.info("moving %s, joint %d of %d", joint, JOINTS.index(joint) + 1, len(JOINTS))

    def stop(self, cause: StopCause) -> None:
        """Ask for a stop."""
        self._executor.stop(cause)

    def run(self) -> Response:
        """Move, and tell how the arm follows."""
        outcome = self._executor.execute(self._plan)
        if outcome.failure is not None:
            raise SimulationError(f"nothing was identified: {outcome.failure}")
        times = np.array([sample.time_s for sample in self._samples])
        sent = np.array([sample.q_sent for sample in self._samples])
        measured = np.array([sample.q_measured for sample in self._samples])
        _LOG.info("fitting the lag of each joint to %d samples", len(times))
        return fit_response(times, sent, measured)

    def lines(self, response: Response) -> Iterator[str]:
        """What was found, joints alike in one line."""
        rows = [
            (f"{least:.3f} .. {most:.3f} s", f"{error:.4f} rad")
            for (least, most), error in zip(
                response.lag_s.tolist(), response.settled_error_rad.tolist(), strict=True
            )
        ]
        named = list(zip(JOINTS, rows, strict=True))
        for (lag, error), each in groupby(named, key=lambda entry: entry[1]):
            yield f"{' '.join(joint for joint, _ in each)}: lag {lag}, off by {error} once settled"

    def _planned(self, q: FloatArray) -> Plan:
        joints = {**dict.fromkeys(self._robot.joint_names, 0.0), **self._link.joints.positions()}
        known = {name: joints[name] for name in self._robot.joint_names}
        others = self._robot.configuration(known)
        manipulator = Manipulator.of(self._robot, self._limb, q_others=others)
        moves = [move for joint in range(len(JOINTS)) for move in _moves(manipulator, q, joint)]
        start = State(Scene({}), {**known, **manipulator.arm.joints(q)})
        return Plan(start, tuple(moves), robot=manipulator.identity, limb=self._limb)


def _moves(manipulator: Manipulator, q: FloatArray, joint: int) -> tuple[Move, Move]:
    """A joint goes and comes back, to the side where the arm stays clearer."""
    context, limits = manipulator.context(Scene({})), manipulator.limits
    found: list[tuple[Move, Move]] = []
    for step in (STEP_RAD, -STEP_RAD):
        goal = np.array(q)
        goal[joint] += step
        if limits.violations(goal):
            continue
        there = plan_joint_move(q, goal, limits)
        motions = {THERE: there, BACK: there.reversed()}
        proofs = {label: context.prove(motion) for label, motion in motions.items()}
        moves = [
            Move(f"{JOINTS[joint]} {label}", motions[label], proof=proof)
            for label, proof in proofs.items()
            if isinstance(proof, ContinuousProof)
        ]
        if len(moves) == len(motions):
            found.append((moves[0], moves[1]))
    if not found:
        raise SimulationError(
            f"{JOINTS[joint]} cannot move by {STEP_RAD:g} rad either way from there"
        )
    return max(found, key=lambda both: min(m.proof.proven_m for m in both if m.proof))
