"""Checks of plans on the robot as it stands.

`check_plan` checks a plan in the state that the robot reports: with its own URDF, and the other
arm, the head and the fingers at their measured positions. If the arm is not at the start of the
plan, a move to the start is planned, proven and prepended. Nothing is sent unless all conditions
hold.

A `TwoArmPlan` is checked with both arms at their measured positions. Moves to its start are made
one after the other, while the other arm stands still, and become the first steps on its clock. The
plan is proven again by `verify_both`. The guard of each arm uses the clearances in a world without
the other arm, as each arm's own plan is proven there; the distance between the arms is that of the
certificate.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from itertools import permutations
from typing import Generic, TypeVar

import numpy as np

from baxter_kin import Arm, Baxter
from baxter_kin.display import clear, seconds
from baxter_kin.errors import BaxterError
from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import JOINTS, LIMBS, MAX_SPEED_RAD_S
from baxter_kin.validation import FloatArray, expect
from planner import (
    Grip,
    Manipulator,
    Move,
    Plan,
    TrackingProof,
    TwoArmCertificate,
    TwoArmPlan,
    TwoArmTrackingProof,
    plan_start_move,
    prove_tracking,
    prove_tracking_of_both,
    verify,
    verify_both,
)
from planner.completion import complete
from planner.motion.joint_move import MAX_CLIP_RAD, ROUNDING_RAD
from planner.pick_place.tracking import START_RAD
from planner.state import State
from sim.errors import RosError, SimulationError
from sim.ros1.execution.guard import KEPT_M, MAX_OFF_RAD, MoveClearance, clearances_of
from sim.ros1.execution.link import JOINT_STATES, BaxterLink
from sim.ros1.execution.readiness.ready import (
    ExecutionOptions,
    Finding,
    Readiness,
    ReadyPlan,
    ReadyTwoArmPlan,
)
from sim.ros1.execution.readiness.robot import check_robot, described_robot, measured_joints
from sim.ros1.execution.set_points import (
    SentMotion,
    parts_of,
    ramp_s_for,
    slowing_s_for,
    speed_ratio_for,
    too_fast,
)

HEAD = "head_pan"

TRACKING_MARGIN_RAD = 0.02
"""Added to the proven deviation to give the guard's bound on a joint."""

START_MOVE_LABEL = "move to start"

PROVING = "proving clearance for every path within the tracking error; this takes a few seconds"

SOFT_SPEED = 0.3
"""Maximum speed of the move to a plan's start, relative to the limits, however fast the plan itself
is executed, because the user did not request that move."""

_LOG = logging.getLogger(__name__)
"""Announces operations that take seconds."""


def check_plan(link: BaxterLink, plan: Plan, options: ExecutionOptions) -> Readiness[ReadyPlan]:
    """Whether a plan may be executed on the robot as it stands; nothing is sent."""
    if expect(plan, Plan, "plan", SimulationError).failure is not None:
        raise SimulationError(f"an invalid plan cannot be executed: {plan.failure}")
    grips = [plan.limb] if any(isinstance(step, Grip) for step in plan) else []
    findings = list(check_robot(link, [plan.limb], grips=grips))
    ready = None
    if all(finding.is_ok for finding in findings):
        try:
            ready = _PlanCheck(link, plan, options, findings).ready()
        except _RefusedError as refusal:
            findings.append(refusal.finding)
    return Readiness(tuple(findings), ready)


def check_two_arm_plan(
    link: BaxterLink, plan: TwoArmPlan, options: ExecutionOptions
) -> Readiness[ReadyTwoArmPlan]:
    """Whether a plan of both arms may be executed on the robot as it stands; nothing is sent."""
    if expect(plan, TwoArmPlan, "plan", SimulationError).failure is not None:
        raise SimulationError(f"an invalid plan cannot be executed: {plan.failure}")
    grips = [side for side in LIMBS if any(isinstance(each, Grip) for each in plan.plans[side])]
    findings = list(check_robot(link, LIMBS, grips=grips))
    ready = None
    if all(finding.is_ok for finding in findings):
        try:
            ready = _TwoArmCheck(link, plan, options, findings).ready()
        except _RefusedError as refusal:
            findings.append(refusal.finding)
    return Readiness(tuple(findings), ready)


def check_unmoved(link: BaxterLink, ready: ReadyPlan) -> None:
    """Check that the arm stands where it did when a plan was prepared."""
    reading = link.joints.arm(ready.manipulator.arm.joint_names)
    off = np.inf if reading is None else float(np.abs(reading.q - ready.plan.q_start).max())
    if off > START_RAD:
        raise SimulationError(
            f"the {ready.plan.limb} arm stands {off:.3f} rad from where it stood when the plan was "
            "prepared; prepare it again"
        )


class _RefusedError(Exception):
    """Ends a check; carries the condition that does not hold."""

    def __init__(self, name: str, text: str) -> None:
        self.finding = Finding(name, False, text)
        super().__init__(text)


PlanT = TypeVar("PlanT", Plan, TwoArmPlan)


class _Check(Generic[PlanT]):
    """What the checks of a plan of one arm and of both have in common.

    Each condition adds a finding, and the first that fails ends the check.
    """

    def __init__(
        self, link: BaxterLink, plan: PlanT, options: ExecutionOptions, findings: list[Finding]
    ) -> None:
        self._link, self._options, self._findings = link, options, findings
        self._plan: PlanT = plan

    def _found(self, name: str, text: str) -> None:
        self._findings.append(Finding(name, True, text))

    def _robot_as_it_is(self, start: State) -> tuple[Baxter, State]:
        """The robot as it describes itself, and the state of a plan with what is measured."""
        text = self._link.description
        try:
            robot = described_robot(text)
        except RosError as cause:
            raise _RefusedError("URDF", str(cause)) from cause
        self._check_known(robot, start)
        joints = {name: start.joints.get(name, 0.0) for name in robot.joint_names}
        return robot, evolve(start, joints=joints | measured_joints(self._link, robot))

    def _completed(self, plan: Plan, manipulator: Manipulator) -> Plan:
        try:
            return complete(plan, manipulator=manipulator)
        except BaxterError as cause:
            raise _RefusedError("plan", str(cause)) from cause

    def _sent(self, plan: Plan, manipulator: Manipulator) -> ReadyPlan:
        """The plan ready to be sent, without bounds from a tracking proof."""
        clearances = self._clearances(plan, manipulator)
        parts = parts_of(plan, self._options.pace)
        motions = [part for part in parts if isinstance(part, SentMotion)]
        peaks = np.max([motion.peak_speeds() for motion in motions] or [np.zeros(7)], axis=0)
        self._check_speeds(peaks)
        duration_s, ratio = sum(motion.duration_s for motion in motions), speed_ratio_for(peaks)
        return ReadyPlan(plan, self._options, manipulator, clearances, duration_s, peaks, ratio)

    def _check_known(self, robot: Baxter, start: State) -> None:
        """Refuse arms that are not measured; a head that is not is assumed to be as planned."""
        arms = {side: arm.joint_names for side, arm in robot.arms.items()}
        missing = self._link.joints.missing(name for names in arms.values() for name in names)
        if missing:
            raise _RefusedError(
                "joint states",
                f"nothing was received of {', '.join(missing)} on {JOINT_STATES}: collisions with "
                "that arm cannot be excluded",
            )
        if HEAD in self._link.joints.missing([HEAD]):
            pan_rad = start.joints.get(HEAD, 0.0)
            self._found("head", f"its pan is not reported; assumed to be {pan_rad:.3f} rad")

    def _check_identity(self, robot: Baxter, plan: Plan) -> None:
        given = plan.robot
        difference = "" if given is None else robot.description.identity.difference(given)
        if difference:
            raise _RefusedError("plan", f"it is for another robot: {difference}; plan for this one")

    def _check_limits(self, arm: Arm, q: FloatArray) -> None:
        beyond = np.maximum(arm.limits.q_min - q, q - arm.limits.q_max)
        worst = int(beyond.argmax())
        if beyond[worst] <= ROUNDING_RAD:
            return
        remedy = (
            "as tucked arms do; untuck it, or move it inside by hand"
            if beyond[worst] <= MAX_CLIP_RAD
            else "which no real arm does; look at the robot and its URDF"
        )
        joint = arm.joint_names[worst]
        raise _RefusedError(
            "start", f"{joint} stands {beyond[worst]:.3f} rad outside its limits, {remedy}"
        )

    def _off_start(self, arm: Arm, q_start: FloatArray) -> float:
        """How far an arm stands from where it starts, rad."""
        reading = self._link.joints.arm(arm.joint_names)
        if reading is None:
            raise _RefusedError("start", f"where the {arm.side} arm stands is not known")
        self._check_limits(arm, reading.q)
        return float(np.abs(reading.q - q_start).max())

    def _start_move(
        self, manipulator: Manipulator, state: State, q_start: FloatArray
    ) -> Move | str:
        """A slow move of the arm from a state to the plan's start, or the reason for none."""
        arm = manipulator.arm
        if state.holding(arm.side) is not None:
            return "and the hand is not empty"
        _LOG.info("planning a move to the plan's start")
        soft = manipulator.limits.scaled(min(1.0, SOFT_SPEED / self._options.pace.speed))
        way = plan_start_move(
            evolve(manipulator, limits=soft),
            state.scene,
            state.q(arm.joint_names),
            q_start,
            held=state.attachments,
        )
        if way.failure is not None:
            return f"and no way there: {way.failure}"
        return evolve(way.moves[0], label=START_MOVE_LABEL)

    def _shown(self, move: Move) -> str:
        """Duration and clearance of a move to a start."""
        proven = "" if move.proof is None else f", {clear(move.proof.proven_m)}"
        duration_s = move.trajectory.duration / self._options.pace.speed
        return f"a move to it takes {seconds(duration_s)}{proven}"

    def _clearances(self, plan: Plan, manipulator: Manipulator) -> tuple[MoveClearance, ...]:
        """The clearances; refused if one is so small that the guard would stop the arm at once."""
        try:
            clearances = clearances_of(plan, manipulator)
        except BaxterError as cause:
            raise _RefusedError("clearance", f"not clear as the robot stands: {cause}") from cause
        for each in clearances:
            if min(each.clear_m) <= KEPT_M:
                nearest = "" if each.nearest is None else f" ({each.nearest.text})"
                raise _RefusedError(
                    "clearance",
                    f"{each.label}: {clear(min(each.clear_m))}{nearest}, and more than "
                    f"{1e3 * KEPT_M:g} mm are needed; if the arm stands so near, move it away by "
                    "hand, else plan with a greater margin",
                )
        return clearances

    def _despite(self, text: str) -> None:
        """Refuse a plan whose tracking is not proven, unless it is to be carried out all the same.

        Args:
            text: why it is not proven.
        """
        if not self._options.despite_lag:
            raise _RefusedError("tracking", text)
        if not self._link.is_simulated:
            raise _RefusedError(
                "tracking", f"{text}; only a simulated Baxter carries out a plan despite its lag"
            )
        self._found("tracking", f"carried out despite this: {text}")

    def _check_speeds(self, peaks: FloatArray) -> None:
        for joint in too_fast(peaks):
            raise _RefusedError(
                "speed",
                f"{JOINTS[joint]} would be sent at {peaks[joint]:.2f} rad/s, and a Baxter turns it "
                f"at {MAX_SPEED_RAD_S[joint]:g} at most; take a lower speed or lead",
            )


class _PlanCheck(_Check[Plan]):
    """The check of a plan of one arm."""

    def ready(self) -> ReadyPlan:
        """What would be sent."""
        robot, state = self._robot_as_it_is(self._plan.start)
        q_others = robot.configuration(dict(state.joints))
        manipulator = Manipulator.of(robot, self._plan.limb, q_others=q_others)
        self._check_identity(robot, self._plan)
        plan = self._completed(self._from_here(manipulator, state), manipulator)
        self._check_certificate(plan, robot)
        ready = self._sent(plan, manipulator)
        proof = self._tracking(plan, manipulator)
        if proof is None:
            return ready
        return _with_tracking(ready, proof)

    def _from_here(self, manipulator: Manipulator, state: State) -> Plan:
        """The plan from where the arm stands, with a move to its start first if one is needed."""
        plan, arm = self._plan, manipulator.arm
        off = self._off_start(arm, plan.q_start)
        if off <= START_RAD:
            self._found("start", f"the arm stands {off:.4f} rad from it")
            here = evolve(state, joints={**state.joints, **arm.joints(plan.q_start)})
            return evolve(plan, start=here, robot=manipulator.identity)
        move = self._start_move(manipulator, state, plan.q_start)
        if isinstance(move, str):
            raise _RefusedError("start", f"{off:.3f} rad away, {move}")
        self._found("start", f"{off:.3f} rad away; {self._shown(move)}")
        return Plan(
            evolve(state, joints={**state.joints, **arm.joints(move.trajectory.q_start)}),
            (move, *plan.steps),
            robot=manipulator.identity,
            line_tolerance=plan.line_tolerance,
        )

    def _check_certificate(self, plan: Plan, robot: Baxter) -> None:
        _LOG.info("verifying the plan in the state that the robot reports: some seconds")
        try:
            certificate = verify(plan, description=robot.description)
        except BaxterError as cause:
            raise _RefusedError("plan", str(cause)) from cause
        if not certificate.is_valid:
            raise _RefusedError("plan", certificate.verdict)
        self._found("plan", certificate.verdict)

    def _tracking(self, plan: Plan, manipulator: Manipulator) -> TrackingProof | None:
        """The proof that every path that the joints may take is clear, if a response is known."""
        response = self._options.response_of(plan.limb)
        if response is None:
            return None
        _LOG.info(PROVING)
        proof = prove_tracking(plan, response, manipulator=manipulator)
        if proof.is_valid:
            self._found("tracking", _tracked(proof))
            return proof
        self._despite(str(proof.failure))
        return None


class _TwoArmCheck(_Check[TwoArmPlan]):
    """The check of a plan of both arms."""

    def ready(self) -> ReadyTwoArmPlan:
        """What would be sent."""
        for side in LIMBS:
            if not self._plan.plans[side].moves:
                raise _RefusedError("plan", f"the {side} arm has no moves; plan for one arm")
        robot, state = self._robot_as_it_is(self._plan.start)
        for side in LIMBS:
            self._check_identity(robot, self._plan.plans[side])
        started = self._from_here(robot, state)
        ramp_s = self._ramp_s(started)
        joints = dict(started.start.joints)
        manipulators = {side: _alone(robot, side, joints) for side in LIMBS}
        plans = {
            side: self._completed(own, manipulators[side]) for side, own in started.plans.items()
        }
        plan = evolve(started, plans=plans)
        certificate = self._certificate(plan, robot)
        arms = {side: self._sent(plans[side], manipulators[side]) for side in LIMBS}
        proof = self._tracking(plan, robot, ramp_s, holds_together=bool(certificate.checks))
        if proof is not None:
            arms = {side: _with_tracking(arms[side], proof.arms[side]) for side in LIMBS}
        late_s = [arm.response.late_s for arm in proof.arms.values()] if proof else []
        max_late_s = min(late_s, default=math.inf)
        return ReadyTwoArmPlan(plan, arms, certificate.clearance_m, ramp_s, max_late_s)

    def _tracking(
        self, plan: TwoArmPlan, robot: Baxter, ramp_s: float, *, holds_together: bool
    ) -> TwoArmTrackingProof | None:
        """The proof that all paths that both arms may take are clear, if responses are known.

        Args:
            plan: the plan, complete.
            robot: the robot as it stands.
            ramp_s: how long the clock takes to slow to rest.
            holds_together: whether both hands hold one body; such a plan needs known responses,
                except on a simulated robot.
        """
        known = {side: self._options.response_of(side) for side in LIMBS}
        responses = {side: of for side, of in known.items() if of is not None}
        if len(responses) == len(LIMBS):
            _LOG.info(PROVING)
            arms = {side: Manipulator.of(robot, side) for side in LIMBS}
            slowing_s = slowing_s_for(ramp_s, self._options.pace.speed)
            proof = prove_tracking_of_both(plan, responses, manipulators=arms, slowing_s=slowing_s)
            if proof.is_valid:
                deviations = "; ".join(_tracked(proof.arms[side], side) for side in LIMBS)
                self._found("tracking", f"{deviations}; {clear(proof.apart_m)} of each other")
                return proof
            self._despite(str(proof.failure))
        elif responses:
            raise _RefusedError(
                "tracking", f"the response of the {next(iter(responses))} arm alone is given"
            )
        elif holds_together:
            text = "both hands hold one body, and how the arms lag is not known"
            if not self._link.is_simulated:
                raise _RefusedError(
                    "tracking", f"{text}; only a simulated Baxter carries out such a plan"
                )
            self._found("tracking", f"carried out despite this: {text}")
        return None

    def _ramp_s(self, plan: TwoArmPlan) -> float:
        """How long the clock takes to slow to rest, which a gripper action must leave time for."""
        speed, grip_s = self._options.pace.speed, plan.grip_s
        moves = [move for side in LIMBS for move in plan.plans[side].moves]
        ramp_s = ramp_s_for([move.trajectory for move in moves], speed)
        if slowing_s_for(ramp_s, speed) >= grip_s:
            raise _RefusedError(
                "speed",
                f"at speed {speed:g} the arms cannot be slowed to rest along their paths while a "
                f"gripper acts, {grip_s:g} s on the clock, within their acceleration limits; take "
                "a lower speed",
            )
        self._found("clock", f"slows both arms to rest within {seconds(ramp_s)}")
        return ramp_s

    def _from_here(self, robot: Baxter, state: State) -> TwoArmPlan:
        """The plan from where both arms stand, with moves to its start first if some are needed."""
        plan, joints, far = self._plan, dict(state.joints), dict[str, float]()
        for side in LIMBS:
            arm, q_start = robot.arm(side), plan.plans[side].q_start
            off = self._off_start(arm, q_start)
            if off > START_RAD:
                far[side] = off
            else:
                self._found("start", f"the {side} arm stands {off:.4f} rad from it")
                joints |= arm.joints(q_start)
        here = evolve(state, joints=joints)
        moves = self._start_moves(robot, here, far)
        added_s = 0.0
        begins_s = {}
        for side, move in moves.items():
            begins_s[side] = added_s
            added_s += move.trajectory.duration
        proofs = [plan.proof, *(move.proof for move in moves.values())]
        return evolve(
            plan,
            start=here,
            plans={side: self._started(side, joints, moves.get(side), robot) for side in LIMBS},
            begins_s={
                side: (
                    *([begins_s[side]] if side in moves else []),
                    *(added_s + begin_s for begin_s in plan.begins_s[side]),
                )
                for side in LIMBS
            },
            proof=min(filter(None, proofs), key=lambda proof: proof.proven_m),
        )

    def _start_moves(self, robot: Baxter, here: State, far: Mapping[str, float]) -> dict[str, Move]:
        """Moves to the start of arms that are far from it, in the order in which they are made.

        While one arm moves, the other one stands. Where the first order is blocked, the other one
        is tried.
        """
        reasons = []
        for order in permutations(far):
            moves, state = dict[str, Move](), here
            for side in order:
                q_start = self._plan.plans[side].q_start
                q_others = robot.configuration(dict(state.joints))
                manipulator = Manipulator.of(robot, side, q_others=q_others)
                move = self._start_move(manipulator, state, q_start)
                if isinstance(move, str):
                    reasons.append(f"the {side} arm stands {far[side]:.3f} rad away, {move}")
                    break
                moves[side] = move
                state = evolve(state, joints={**state.joints, **manipulator.arm.joints(q_start)})
            else:
                for side, move in moves.items():
                    text = f"the {side} arm stands {far[side]:.3f} rad away; {self._shown(move)}"
                    self._found("start", text)
                return moves
        raise _RefusedError("start", "; ".join(dict.fromkeys(reasons)))

    def _started(
        self, side: str, joints: Mapping[str, float], move: Move | None, robot: Baxter
    ) -> Plan:
        """An arm's own plan from where the robot's joints are; states are not known yet."""
        plan = self._plan.plans[side]
        steps = (*(() if move is None else (move,)), *plan.steps)
        bare = tuple(evolve(step, state=None, contacts=()) for step in steps)
        start = evolve(plan.start, joints=joints)
        return evolve(plan, start=start, steps=bare, robot=Manipulator.of(robot, side).identity)

    def _certificate(self, plan: TwoArmPlan, robot: Baxter) -> TwoArmCertificate:
        """The certificate of the plan, as the robot stands."""
        _LOG.info("verifying the plan in the state that the robot reports: some seconds")
        try:
            certificate = verify_both(plan, description=robot.description)
        except BaxterError as cause:
            raise _RefusedError("plan", str(cause)) from cause
        if not certificate.is_valid:
            raise _RefusedError("plan", certificate.verdict)
        self._found("plan", certificate.verdict)
        if certificate.clearance_m <= KEPT_M:
            raise _RefusedError(
                "clearance",
                f"the arms are {clear(certificate.clearance_m)} of each other, and more than "
                f"{1e3 * KEPT_M:g} mm are needed; plan with a greater margin",
            )
        return certificate


def _tracked(proof: TrackingProof, side: str = "") -> str:
    """What was proven of an arm that lags."""
    deviation = max((move.deviation_rad for move in proof.moves), default=0.0)
    whose = f"{side} arm " if side else ""
    return f"{whose}clear wherever the lag leads, {deviation:.3f} rad off at most"


def _with_tracking(ready: ReadyPlan, proof: TrackingProof) -> ReadyPlan:
    """What would be sent to an arm whose tracking is proven."""
    clearances = tuple(
        evolve(each, max_off_rad=min(MAX_OFF_RAD, move.deviation_rad + TRACKING_MARGIN_RAD))
        for each, move in zip(ready.clearances, proof.moves, strict=True)
    )
    ratio = speed_ratio_for(np.maximum(ready.peaks, proof.rate_rad_s))
    return evolve(ready, clearances=clearances, ratio=ratio)


def _alone(robot: Baxter, side: str, joints: Mapping[str, float]) -> Manipulator:
    """An arm in a world without the other one."""
    manipulator = Manipulator.of(robot, side, q_others=robot.configuration(dict(joints)))
    other = next(each for each in LIMBS if each != side)
    return evolve(manipulator, shapes=manipulator.shapes.without(other))
