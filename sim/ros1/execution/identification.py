"""Identification: how much each joint of an arm lags, measured by a small move and back.

The moves are a plan like any other, checked and guarded alike, but what stands around the robot is
not known: only that the arm keeps clear of the robot itself is proven.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from itertools import groupby

import numpy as np

from baxter_kin.kinematics.arm import JOINTS
from baxter_kin.validation import FloatArray
from planner import Manipulator, Move, Plan, Response, Scene, fit_response, plan_joint_move
from planner.clearance import ContinuousProof
from planner.state import State
from sim.errors import RosError, SimulationError
from sim.events import Event, EventKind, Sample, SampleObserver
from sim.ros1.execution.execution import RosExecutor
from sim.ros1.execution.link import BaxterLink
from sim.ros1.execution.readiness.ready import ExecutionOptions
from sim.ros1.execution.readiness.robot import described_robot, measured_joints
from sim.ros1.execution.set_points import Pace
from sim.ros1.execution.stops import StopCause

STEP_RAD = 0.2
"""How far each joint moves: less does not tell a lag from noise, more comes too far around."""

PACE = Pace(1.0)

THERE, BACK = "there", "back"
"""The two moves of a joint."""

_LOG = logging.getLogger(__name__)
"""Announces which joint moves."""


class Identification(SampleObserver):
    """Moves an arm joint by joint, and fits a response to what is measured.

    Attributes:
        warning: what will happen, as one sentence.
    """

    def __init__(self, link: BaxterLink, limb: str) -> None:
        """Plan the moves from where the arm stands."""
        robot = described_robot(link.description)
        arm = robot.arm(limb)
        reading = link.joints.arm(arm.joint_names)
        if reading is None:
            raise RosError(f"it is not known where the {limb} arm stands")
        joints = dict.fromkeys(robot.joint_names, 0.0) | measured_joints(link, robot)
        manipulator = Manipulator.of(robot, limb, q_others=robot.configuration(joints))
        moves = [move for joint in range(7) for move in _moves(manipulator, reading.q, joint)]
        start = State(Scene({}), joints | arm.joints(reading.q))
        self._plan = Plan(start, tuple(moves), robot=manipulator.identity, limb=limb)
        self._samples: list[Sample] = []
        self._executor = RosExecutor(link, [self], options=ExecutionOptions(PACE))
        trajectories = [move.trajectory for move in moves]
        fastest = max(float(np.abs(each.v).max()) for each in trajectories)
        self.warning = (
            f"each joint of the {limb} arm ({', '.join(JOINTS)}) will move by {STEP_RAD:g} rad and "
            f"back, one after the other, at up to {fastest:.1f} rad/s, {len(moves)} moves of "
            f"{max(each.duration for each in trajectories):.1f} s at most; nobody knows what "
            "stands around the robot: keep the space around the arm free, and a hand on the "
            "emergency stop"
        )

    def on_sample(self, sample: Sample) -> None:
        """Store it."""
        self._samples.append(sample)

    def on_event(self, event: Event) -> None:
        """Log which joint begins to move."""
        if event.kind is EventKind.MOVE_STARTED and event.move is not None:
            joint, _, direction = event.move.label.partition(" ")
            if direction == THERE:
                _LOG.info("moving %s, joint %d of %d", joint, JOINTS.index(joint) + 1, len(JOINTS))

    def stop(self, cause: StopCause) -> None:
        """Request a stop."""
        self._executor.stop(cause)

    def run(self) -> Response:
        """Move the arm, and return how it follows."""
        outcome = self._executor.execute(self._plan)
        if outcome.failure is not None:
            raise SimulationError(f"nothing was identified: {outcome.failure}")
        times = np.array([sample.time_s for sample in self._samples])
        sent = np.array([sample.q_sent for sample in self._samples])
        measured = np.array([sample.q_measured for sample in self._samples])
        _LOG.info("fitting the lag of each joint to %d samples", len(times))
        return fit_response(times, sent, measured)


def lines_of(response: Response) -> Iterator[str]:
    """A response in words; joints that follow alike share a line."""
    rows = [
        (f"{low:.3f} .. {high:.3f} s", f"{error:.4f} rad")
        for (low, high), error in zip(
            response.lag_s.tolist(), response.settled_error_rad.tolist(), strict=True
        )
    ]
    for (lag, error), group in groupby(zip(JOINTS, rows, strict=True), key=lambda row: row[1]):
        yield f"{' '.join(joint for joint, _ in group)}: lag {lag}, off by {error} once settled"


def _moves(manipulator: Manipulator, q: FloatArray, joint: int) -> tuple[Move, Move]:
    """A joint goes and comes back, to the side where the arm stays clearer."""
    context, limits = manipulator.context(Scene({})), manipulator.limits
    found: list[tuple[float, tuple[Move, Move]]] = []
    for step in (STEP_RAD, -STEP_RAD):
        goal = np.array(q)
        goal[joint] += step
        if limits.violations(goal):
            continue
        there = plan_joint_move(q, goal, limits)
        back = there.reversed()
        proof, proof_back = context.prove(there), context.prove(back)
        if isinstance(proof, ContinuousProof) and isinstance(proof_back, ContinuousProof):
            moves = (
                Move(f"{JOINTS[joint]} {THERE}", there, proof=proof),
                Move(f"{JOINTS[joint]} {BACK}", back, proof=proof_back),
            )
            found.append((min(proof.proven_m, proof_back.proven_m), moves))
    if not found:
        raise SimulationError(
            f"{JOINTS[joint]} cannot move by {STEP_RAD:g} rad either way from there"
        )
    return max(found, key=lambda both: both[0])[1]
