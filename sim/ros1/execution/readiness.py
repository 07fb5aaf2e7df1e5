"""Readiness: whether a plan may be carried out on a robot as it stands, and what would be sent.

The plan is judged in the state that the robot reports: its own URDF, the other arm, the head
and the fingers where they are. Where the arm does not stand at the start of the plan, a move to it
is planned, proven and put before it. All conditions hold, or nothing is sent.
"""

from __future__ import annotations

import logging

import numpy as np

from baxter_kin import Arm, Baxter
from baxter_kin.display import clear, seconds
from baxter_kin.errors import BaxterError
from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import JOINTS, LIMBS
from baxter_kin.validation import FloatArray, expect
from planner import Grip, Manipulator, Plan, TrackingProof, plan_start_move, prove_tracking, verify
from planner.completion import complete
from planner.motion.joint_move import MAX_CLIP_RAD, ROUNDING_RAD
from planner.pick_place.tracking import START_RAD
from planner.state import State
from sim.errors import SimulationError
from sim.ros1.execution.guard.path_guard import KEPT_M
from sim.ros1.execution.guard.stages import MOST_OFF_RAD, GripStage, MoveStage, Room, guarded
from sim.ros1.execution.link.baxter_link import BaxterLink
from sim.ros1.execution.preflight import Finding, look_at_robot
from sim.ros1.execution.ready_plan import ExecutionOptions, Readiness, ReadyPlan
from sim.ros1.execution.stream.set_points import (
    FASTEST_RAD_S,
    SentMotion,
    motions_of,
    speed_ratio_for,
    too_fast,
)

BEYOND_RAD = 0.02
"""A joint that is farther off than its response allows by this does not follow as it is said to."""

CONNECTING = "move to start"

_LOG = logging.getLogger(__name__)
"""Told what takes seconds, before it begins."""


def look_at_plan(link: BaxterLink, plan: Plan, options: ExecutionOptions) -> Readiness:
    """Whether a plan may be carried out on the robot as it stands; nothing is sent."""
    if expect(plan, Plan, "plan", SimulationError).failure is not None:
        raise SimulationError(f"an invalid plan cannot be executed: {plan.failure}")
    grips = [plan.limb] if any(isinstance(step, Grip) for step in plan) else []
    findings = list(look_at_robot(link, [plan.limb], grips=grips))
    if not all(finding.is_ok for finding in findings):
        return Readiness(tuple(findings), None)
    ready = _Look(link, plan, options, findings).ready()
    return Readiness(tuple(findings), ready)


def check_still_there(link: BaxterLink, ready: ReadyPlan) -> None:
    """See that the arm stands where it did when a plan was prepared."""
    reading = link.joints.arm(ready.robot.arm(ready.plan.limb).joint_names)
    off = np.inf if reading is None else float(np.abs(reading.q - ready.plan.q_start).max())
    if off > START_RAD:
        raise SimulationError(
            f"the {ready.plan.limb} arm stands {off:.3f} rad from where it stood when the plan was "
            "prepared; prepare it again"
        )


class _RefusedError(Exception):
    """Ends a look; carries what does not hold."""

    def __init__(self, name: str, text: str) -> None:
        self.finding = Finding(name, False, text)
        super().__init__(text)


class _Look:
    """One look at a plan: each step adds what it found, and the first that fails ends it."""

    def __init__(
        self, link: BaxterLink, plan: Plan, options: ExecutionOptions, findings: list[Finding]
    ) -> None:
        self._link, self._plan, self._options, self._findings = link, plan, options, findings

    def ready(self) -> ReadyPlan | None:
        """What would be sent, or None."""
        try:
            return self._ready()
        except _RefusedError as stop:
            self._findings.append(stop.finding)
            return None

    def _ready(self) -> ReadyPlan:
        robot = self._robot()
        state = self._state(robot)
        q_others = robot.configuration(dict(state.joints))
        manipulator = Manipulator.of(robot, self._plan.limb, q_others=q_others)
        self._check_robot(robot)
        plan = self._from_here(manipulator, state)
        try:
            plan = complete(plan, manipulator=manipulator)
        except BaxterError as cause:
            raise _RefusedError("plan", str(cause)) from cause
        self._check_certificate(plan, robot)
        try:
            stages = guarded(plan, manipulator)
        except BaxterError as cause:
            raise _RefusedError("clearance", f"not clear as the robot stands: {cause}") from cause
        _check_rooms(stages)
        motions = self._motions(stages)
        peaks = np.max([motion.peak_speeds() for motion in motions], axis=0, initial=0.0)
        peaks = np.broadcast_to(peaks, (7,)).copy()
        self._check_speeds(peaks)
        proof, rates = self._check_tracking(plan, manipulator), peaks
        if proof is not None:
            rates, stages = np.maximum(peaks, proof.rate_rad_s), _as_tracked(stages, proof)
        duration_s = sum(motion.duration_s for motion in motions)
        return ReadyPlan(plan, robot, stages, duration_s, peaks, speed_ratio_for(rates))

    def _found(self, name: str, text: str) -> None:
        self._findings.append(Finding(name, True, text))

    def _robot(self) -> Baxter:
        text = self._link.description
        if text is None:
            raise _RefusedError("URDF", "the parameter /robot_description is missing")
        try:
            return Baxter.load(text)
        except BaxterError as cause:
            raise _RefusedError("URDF", f"/robot_description cannot be read: {cause}") from cause

    def _state(self, robot: Baxter) -> State:
        """The plan's, with all joints as they are measured."""
        known = self._plan.start
        told = self._link.joints.positions()
        joints = {name: told.get(name, known.joints.get(name, 0.0)) for name in robot.joint_names}
        for side in LIMBS:
            joints |= self._fingers(robot, side)
        return evolve(known, joints=joints)

    def _fingers(self, robot: Baxter, side: str) -> dict[str, float]:
        """Both fingers of a hand as its gripper reports them."""
        report = self._link.gripper(side)
        names = [n for n in robot.joint_names if n.startswith(f"{side[0]}_gripper_")]
        if report is None or len(names) != 2:
            return {}
        share = min(max(report.percent / 100.0, 0.0), 1.0)
        first, second = robot.indices(tuple(names))
        stroke = max(robot.model.upperPositionLimit[[first, second]])
        signs = np.sign(robot.model.upperPositionLimit[[first, second]] - 1e-9)
        return {name: float(s * share * stroke) for name, s in zip(names, signs, strict=True)}

    def _from_here(self, manipulator: Manipulator, state: State) -> Plan:
        """The plan from where the arm stands; a move to its start comes first where one must."""
        plan, arm = self._plan, manipulator.arm
        reading = self._link.joints.arm(arm.joint_names)
        if reading is None:
            raise _RefusedError("start", "where the arm stands is not known")
        self._check_limits(arm.limits.q_min, arm.limits.q_max, reading.q, arm.joint_names)
        off = float(np.abs(reading.q - plan.q_start).max())
        if off <= START_RAD:
            self._found("start", f"the arm stands {off:.4f} rad from it")
            here = _with_arm(state, arm, plan.q_start)
            return evolve(plan, start=here, robot=manipulator.identity)
        if any(held.side == plan.limb for held in state.attachments):
            raise _RefusedError("start", f"{off:.3f} rad away, and the hand is not empty")
        _LOG.info("planning a move to the plan's start")
        way = plan_start_move(
            manipulator, state.scene, reading.q, plan.q_start, held=state.attachments
        )
        if way.failure is not None:
            raise _RefusedError("start", f"{off:.3f} rad away, and no way there: {way.failure}")
        move = evolve(way.moves[0], label=CONNECTING)
        proven = "" if move.proof is None else f", {clear(move.proof.proven_m)}"
        duration_s = move.trajectory.duration / self._options.pace.speed
        self._found(
            "start", f"{off:.3f} rad away; a move to it takes {seconds(duration_s)}{proven}"
        )
        return Plan(
            _with_arm(state, arm, way.q_start),
            (move, *plan.steps),
            robot=manipulator.identity,
            line_tolerance=plan.line_tolerance,
        )

    def _check_limits(
        self, q_min: FloatArray, q_max: FloatArray, q: FloatArray, names: tuple[str, ...]
    ) -> None:
        beyond = np.maximum(q_min - q, q - q_max)
        worst = int(beyond.argmax())
        if beyond[worst] <= ROUNDING_RAD:
            return
        told = f"{names[worst]} stands {beyond[worst]:.3f} rad outside its limits"
        remedy = (
            "as tucked arms do; untuck it, or move it inside by hand"
            if beyond[worst] <= MAX_CLIP_RAD
            else "which no real arm does; look at the robot and its URDF"
        )
        raise _RefusedError("start", f"{told}, {remedy}")

    def _check_robot(self, robot: Baxter) -> None:
        given = self._plan.robot
        difference = "" if given is None else robot.description.identity.difference(given)
        if difference:
            raise _RefusedError("plan", f"it is for another robot: {difference}; plan for this one")

    def _check_certificate(self, plan: Plan, robot: Baxter) -> None:
        try:
            _LOG.info("verifying the plan in the state that the robot reports: some seconds")
            certificate = verify(plan, description=robot.description)
        except BaxterError as cause:
            raise _RefusedError("plan", str(cause)) from cause
        if not certificate.is_valid:
            raise _RefusedError("plan", certificate.verdict)
        self._found("plan", certificate.verdict)

    def _motions(self, stages: tuple[MoveStage | GripStage, ...]) -> list[SentMotion]:
        pace = self._options.pace
        return [
            motion
            for stage in stages
            if isinstance(stage, MoveStage)
            for motion in motions_of(stage.moves, pace)
        ]

    def _check_speeds(self, peaks: FloatArray) -> None:
        for joint in too_fast(peaks):
            raise _RefusedError(
                "speed",
                f"{JOINTS[joint]} would be sent at {peaks[joint]:.2f} rad/s, and a Baxter turns it "
                f"at {FASTEST_RAD_S[joint]:g} at most; take a lower speed or lead",
            )

    def _check_tracking(self, plan: Plan, manipulator: Manipulator) -> TrackingProof | None:
        """With a known response: that every path that the joints may take is clear."""
        response = self._options.sent_response
        if response is None:
            return None
        _LOG.info("proving that it is clear wherever the lag leads: some seconds")
        proof = prove_tracking(plan, response, manipulator=manipulator)
        if proof.is_valid:
            deviation = max((move.deviation_rad for move in proof.moves), default=0.0)
            text = f"clear wherever the lag leads, {deviation:.3f} rad off at most"
            self._found("tracking", text)
            return proof
        text = str(proof.failure)
        if not self._options.despite_lag:
            raise _RefusedError("tracking", text)
        if not self._link.is_simulated:
            raise _RefusedError(
                "tracking", f"{text}; only a simulated Baxter carries out a plan despite its lag"
            )
        self._found("tracking", f"carried out despite this: {text}")
        return None


def _with_arm(state: State, arm: Arm, q: FloatArray) -> State:
    return evolve(state, joints={**state.joints, **arm.joints(q)})


def _check_rooms(stages: tuple[MoveStage | GripStage, ...]) -> None:
    """That every move leaves the guard some room: else it would stop the arm at once."""
    for stage in stages:
        for room in stage.rooms if isinstance(stage, MoveStage) else ():
            if min(room.clear_m) <= KEPT_M:
                nearest = f" ({room.nearest.text})" if room.nearest is not None else ""
                raise _RefusedError(
                    "clearance",
                    f"{room.label}: {clear(min(room.clear_m))}{nearest}, and more than "
                    f"{1e3 * KEPT_M:g} mm are needed; if the arm stands so near, move it away by "
                    "hand, else plan with a greater margin",
                )


def _as_tracked(
    stages: tuple[MoveStage | GripStage, ...], proof: TrackingProof
) -> tuple[MoveStage | GripStage, ...]:
    """The same, each move with how far its joints may be off if they follow as they are said to."""
    offs = iter(move.deviation_rad for move in proof.moves)

    def tracked(room: Room) -> Room:
        return evolve(room, most_off_rad=min(MOST_OFF_RAD, next(offs) + BEYOND_RAD))

    return tuple(
        evolve(stage, rooms=tuple(tracked(room) for room in stage.rooms))
        if isinstance(stage, MoveStage)
        else stage
        for stage in stages
    )
