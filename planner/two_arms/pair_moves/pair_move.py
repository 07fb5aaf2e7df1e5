"""Motions of a body that both hands hold: a tray, a board, a pole.

The program has the 14 joints of both arms, one duration, and as rows the pose of the right tip seen
from the body, as the left hand carries it: within a tolerance at the knots, and exact at the end.
The body goes any way from its pose to the goal, or along a straight line with an even turn. What
the hands do between the knots is bounded afterwards (`relative_pose`); where that is more than
allowed, the program is solved with twice as many knots.

Guesses, and what they may prove of the task: `pair_guesses`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin

from baxter_kin import Arm, JointLimits
from baxter_kin.display import seconds
from baxter_kin.fields import array, frozen
from baxter_kin.frames import PoseLike
from baxter_kin.validation import FloatArray, expect
from planner.clearance import ContinuousProof
from planner.collision.context import SCREENING_STEP_RAD, looks_clear
from planner.collision.mover import Mover
from planner.errors import FreeMoveError, MotionError, TaskError
from planner.manipulator import Manipulator, both_of, context_of_both, limits_of_both
from planner.motion.joint_move import checked_start, rest_to_rest_s
from planner.motion.paths.straight_line import (
    DEFAULT_TOLERANCE,
    SAMPLED_SHARE,
    SAMPLES_PER_INTERVAL,
    LineTolerance,
    StraightLine,
    checked_line_tolerance,
    intervals_of,
    knot_tolerance,
)
from planner.motion.program.motion_program import EXTRA_MARGIN_M, MotionProgram, Motions, led_around
from planner.motion.program.rows import Clearances
from planner.motion.program.unknowns import Holding, MotionTask, Phase
from planner.motion.upright import KNOT_SHARES, Upright, max_tilt_rad
from planner.scene.contact import PartContact
from planner.splines import Sketch
from planner.state import State
from planner.trajectory import Trajectory
from planner.two_arms.pair_moves.pair_guesses import PairGuesses, PairTask, goal_solutions
from planner.two_arms.pair_moves.relative_pose import (
    RelativeDeviation,
    relative_deviation,
)

INTERVALS, MAX_DOUBLINGS = 24, 2
"""Minimum number of intervals, and how often it is doubled where the hands leave their relative
pose between knots."""

MIN_LENGTH = 1e-9
"""Maximum difference of any entry of two equal poses of the body, at its start and its goal."""

HELD_POSE = 1e-6
"""Maximum difference of any entry of the poses in which both hands hold a body at the start."""


@frozen(error=MotionError)
class PairMove:
    """A motion of a body that both hands hold.

    Attributes:
        body: its name.
        trajectory: of 14 joints, the left arm's first.
        T_base_bodies: poses of the body at the knots of the trajectory, as the left hand carries
            it, shape (m, 4, 4).
        deviation: upper bounds on the deviation of the right hand from its pose in the body.
        proof: the proof that both arms and the body keep clear at every instant.
    """

    body: str
    trajectory: Trajectory
    T_base_bodies: FloatArray = array(None, 4, 4)
    deviation: RelativeDeviation
    proof: ContinuousProof

    @property
    def duration_s(self) -> float:
        """The duration of the motion."""
        return self.trajectory.duration

    def _facts(self) -> tuple[str, ...]:
        return self.body, seconds(self.duration_s), repr(self.deviation)


def plan_pair_move(
    manipulators: Mapping[str, Manipulator],
    state: State,
    T_base_goal: PoseLike,
    *,
    is_straight: bool = False,
    upright: Upright | None = None,
    tolerance: LineTolerance = DEFAULT_TOLERANCE,
    supports: Iterable[PartContact | str] = (),
    margin_m: float = 0.0,
) -> PairMove:
    """The fastest motion found that takes a body in both hands to a pose, from rest to rest.

    During the whole motion, the right hand stays within the tolerance of its pose in the body, as
    the left hand carries that.

    Args:
        manipulators: "left" and "right"; their limits count.
        state: all joints, the bodies, and the body attached to both hands.
        T_base_goal: final pose of the body in base.
        is_straight: whether the body moves on a straight line, with an even turn, within the
            tolerance; it is checked at samples. Otherwise it goes any way.
        upright: an axis of the body that stays within a cone; samples of a motion are checked. The
            cone is required, whatever its `is_required` says.
        tolerance: maximum deviation of the right hand, seen from the body.
        supports: what the body stood on or will stand on, and may touch, as of
            `Manipulator.context`.
        margin_m: distance to keep from everything else, not negative.

    Raises:
        TaskError: when an arm is missing, or both hands do not hold one body.
        SceneError: when the state or the supports do not match the scene.
        ConfigurationError: when the start is outside the limits.
        PoseError: when `T_base_goal` is an invalid pose.
        StraightMoveError: when an arm cannot follow the straight line.
        FreeMoveError: when the start collides or leans, the goal is out of reach, or no clear
            motion is found.
        MotionError: when the tolerance leaves a rotation free, no motion inside the tolerance is
            found, or the margin is negative.
    """
    left, right = both_of(manipulators)
    body, held = _held_by_both(expect(state, State, "state", TaskError))
    context = context_of_both(manipulators, state, supports, margin_m=margin_m)
    limits = limits_of_both(manipulators)
    arms = tuple(
        each.arm if each.arm.tip_frame == link else each.arm.with_tip(link)
        for each, (link, _) in zip((left, right), held, strict=True)
    )
    q_start = checked_start(state.q(limits.names), limits)
    if upright is not None:
        expect(upright, Upright, "upright", MotionError)
    carry = _Carry(
        context=context,
        limits=limits,
        mover=Mover(arms),
        q_start=q_start,
        T_tips_body=tuple(T for _, T in held),
        goal=StraightLine(T_base_goal, T_base_goal).T_base_goal,
        is_straight=bool(is_straight),
        upright=upright,
        tolerance=checked_line_tolerance(tolerance),
    )
    carry.check_start(body)
    trajectory, deviation, proof = carry.motion()
    poses = arms[0].T_base_tips(trajectory.q[:, : len(arms[0].joint_names)])
    T_base_bodies = poses @ held[0][1].homogeneous
    return PairMove(body, trajectory, T_base_bodies, deviation, proof)


def _held_by_both(state: State) -> tuple[str, tuple[tuple[str, pin.SE3], tuple[str, pin.SE3]]]:
    """The body in both hands, and the link and the body's pose there, of the left and the right."""
    each = [state.holding(side) for side in ("left", "right")]
    names = [None if held is None else held.body for held in each]
    left, right = each
    if left is None or right is None or left.body != right.body:
        raise TaskError(f"both hands must hold one body; they hold {names[0]!r} and {names[1]!r}")
    return left.body, ((left.link, left.T_link_body), (right.link, right.T_link_body))


@dataclass(frozen=True, slots=True, eq=False)
class _Carry(PairTask):
    """The problem of one motion.

    Attributes:
        is_straight: whether the body moves on a straight line.
        upright: the axis of the body that stays upright, or None.
        tolerance: of the relative pose, and of the line.
    """

    is_straight: bool
    upright: Upright | None
    tolerance: LineTolerance

    @property
    def left(self) -> Arm:
        """The arm that carries the body's frame."""
        return self.mover.arms[0]

    def check_start(self, body: str) -> None:
        """Refuse a start in which the hands hold the body elsewhere, that collides, or leans."""
        held = self.T_tips_body[0] * self.T_tips_body[1].inverse()
        if not held.isApprox(self.T_left_right, HELD_POSE):
            raise TaskError(f"the hands are not where their attachments of {body!r} say")
        if not self.context.is_free(self.q_start):
            near = self.context.clearance(self.q_start).too_near(self.context.margin_m)
            raise FreeMoveError(f"start in collision: {near}")
        if self.upright is not None:
            stay = Trajectory.stay(self.q_start[:7], self.limits.part(slice(7)))
            refusal = self.seen_from_tip(self.upright).refusal(self.tilt_rad(stay))
            if refusal:
                raise FreeMoveError(f"start {refusal}")

    def motion(self) -> tuple[Trajectory, RelativeDeviation, ContinuousProof]:
        """The first motion found that keeps everything that is required."""
        reasons: list[str] = []
        if np.allclose(self.start.homogeneous, self.goal.homogeneous, atol=MIN_LENGTH):
            stay = Trajectory.stay(self.q_start, self.limits)
            proof = self.proof(stay, reasons)
            if proof is not None:
                return stay, self.deviation(stay), proof
        goals = goal_solutions(self.mover, self.T_tips_body, self.goal)
        guesses = PairGuesses(self, self.tolerance if self.is_straight else None, goals)
        line = StraightLine(self.start, self.goal) if self.is_straight else None
        intervals = INTERVALS
        if line is not None:
            intervals = intervals_of(line, self.tolerance, INTERVALS)
        for _ in range(1 + MAX_DOUBLINGS):
            is_too_coarse = False
            for qs in guesses.at(intervals, reasons):
                for trajectory in self.solved(qs, line):
                    deviation = self.deviation(trajectory)
                    is_too_coarse = not (
                        deviation.is_within(self.tolerance.position_m, self.tolerance.rotation_rad)
                        and (line is None or self.is_on_line(line, trajectory))
                    )
                    if is_too_coarse:
                        break
                    proof = self.proof(trajectory, reasons)
                    if proof is not None:
                        return trajectory, deviation, proof
                if is_too_coarse:
                    break
            if not is_too_coarse:
                break
            intervals *= 2
        if is_too_coarse:
            reasons.append("between the knots, the hands or the body leave the tolerance")
        elif not reasons:
            reasons.append("no motion inside the limits keeps the relative pose of the hands")
        raise FreeMoveError("no motion was found: " + "; ".join(dict.fromkeys(reasons)))

    def deviation(self, trajectory: Trajectory) -> RelativeDeviation:
        """Bounds on the deviation of the relative pose."""
        allowed = self.tolerance.position_m, self.tolerance.rotation_rad
        return relative_deviation(self.mover, trajectory, self.T_left_right, *allowed)

    def solved(self, qs: FloatArray, line: StraightLine | None) -> Iterator[Trajectory]:
        """Motions near a guess: of the program, and of the program that is led around obstacles."""
        phase = Phase(
            len(qs) - 1,
            0,
            ends=(1.0, 1.0) if line is None else (0.0, 1.0),
            rests=True,
            only_ends=line is None,
            holds=True,
            keeps_upright=self.upright is not None,
        )
        program, knots = (
            _program(phase),
            knot_tolerance(self.tolerance, () if line is None else (line,)),
        )
        T_body_right = self.T_tips_body[0].inverse() * self.T_left_right
        holding = Holding(self.mover.arms[1], T_body_right, knots)
        piece = StraightLine(self.goal, self.goal) if line is None else line
        sketch = Sketch(qs, np.zeros((2, qs.shape[1])), self.guessed_s(qs))
        obstacles = None
        for share in KNOT_SHARES if self.upright is not None else (1.0,):
            tilt = (0.0, 0.0, 1.0, 1.0) if self.upright is None else self.upright.at_knots(share)
            task = MotionTask(
                self.q_start,
                (piece,),
                knots,
                tilt=tilt,
                T_tip_frame=self.T_tips_body[0],
                holding=holding,
            )

            def solve(
                sketches: Sequence[Sketch], near: Clearances | None, task: MotionTask = task
            ) -> Motions | None:
                return program.solve(sketches, task, self.left, self.limits, near)

            found = solve([sketch], None)
            if found is None:
                continue
            yield found[0]
            if looks_clear(found[0], self.context.is_free, SCREENING_STEP_RAD):
                continue
            if obstacles is None:
                margin_m = self.context.margin_m + EXTRA_MARGIN_M
                obstacles = self.context.obstacles(margin_m, self.q_start)
            sketches = Sketch.of_each(found, [sketch.intervals])
            for (motion,) in led_around(solve, [obstacles], sketches):
                yield motion

    def guessed_s(self, qs: FloatArray) -> float:
        """A duration that is about right for a guess; longer rather than too short."""
        longest = np.abs(np.diff(qs, axis=0)).sum(axis=0)
        return 1.5 * float(rest_to_rest_s(longest, self.limits))

    def proof(self, trajectory: Trajectory, reasons: list[str]) -> ContinuousProof | None:
        """The proof that a motion is clear; None, with a reason, where it is not, or leans."""
        if self.upright is not None:
            own = _part(trajectory, self.limits.part(slice(7)))
            refusal = self.seen_from_tip(self.upright).refusal(self.tilt_rad(own))
            if refusal:
                reasons.append(f"the body {refusal}")
                return None
        proof = None
        if looks_clear(trajectory, self.context.is_free, SCREENING_STEP_RAD):
            proof = self.context.prove(trajectory)
        if isinstance(proof, ContinuousProof):
            return proof
        reasons.append("the arms or the body touch something on every way that was found")
        return None

    def is_on_line(self, line: StraightLine, trajectory: Trajectory) -> bool:
        """Whether the body stays within the tolerance of its line, at samples."""
        count = SAMPLES_PER_INTERVAL * (len(trajectory.knots_s) - 1) + 1
        qs = trajectory.sample(np.linspace(0.0, trajectory.duration, count)).q[:, :7]
        bodies = self.left.T_base_tips(qs) @ self.T_tips_body[0].homogeneous
        off_m, off_rad = line.deviations(bodies)
        is_near = off_m <= SAMPLED_SHARE * self.tolerance.position_m
        is_near &= off_rad <= SAMPLED_SHARE * self.tolerance.rotation_rad
        return bool(is_near.all())

    def seen_from_tip(self, upright: Upright) -> Upright:
        """The axis that stays upright, seen from the left tip."""
        return upright.seen_from_tip(self.T_tips_body[0].rotation)

    def tilt_rad(self, own: Trajectory) -> float:
        """Maximum tilt of the axis that stays upright, by the motion of the left arm."""
        axis = (0.0, 0.0, 1.0) if self.upright is None else self.seen_from_tip(self.upright).axis
        return max_tilt_rad(self.left, own, axis)


def _part(trajectory: Trajectory, limits: JointLimits) -> Trajectory:
    """The motion of the first joints."""
    n = len(limits.names)
    arrays = (x[:, :n] for x in (trajectory.q, trajectory.v, trajectory.a, trajectory.j))
    return Trajectory(limits, trajectory.knots_s, *arrays)


@lru_cache(maxsize=16)
def _program(phase: Phase) -> MotionProgram:
    return MotionProgram((phase,), 14)
