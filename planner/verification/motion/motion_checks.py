"""Checks of the joints' motion: limits at exact extrema, states against jerks, joins, rest."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from baxter_kin import JointLimits
from baxter_kin.validation import FloatArray
from planner.plan import Move, Plan
from planner.verification.certificate import Check, Worst, greatest, least
from planner.verification.motion.cubics import Cubics, States
from planner.verification.motion.judged_limits import UNITS
from planner.verification.tolerances import Tolerances
from planner.verification.urdf_robot import UrdfRobot

QUANTITIES = (("position", "rad"), ("velocity", "rad/s"), ("acceleration", "rad/s^2"))
NO_MOVES = "no moves"


@dataclass(frozen=True, slots=True, eq=False)
class _JudgedMotion:
    """A move and its polynomials."""

    move: Move
    cubics: Cubics


def motion_checks(
    plan: Plan, robot: UrdfRobot, judge: JointLimits, allowed: Tolerances
) -> Iterator[Check]:
    """Every check that needs no shapes and no tip; limits are those of the judge."""
    motions = [_JudgedMotion(move, Cubics(move.trajectory)) for move in plan.moves]
    yield _joints(motions, robot)
    yield _knot_order(motions)
    yield _stated(motions, judge, allowed)
    yield from _limits(motions, judge, allowed)
    yield from _knots(motions, allowed)
    yield from _joins(plan, motions, allowed)
    yield from _rests(plan, allowed)
    yield from _claims(plan)


def _claims(plan: Plan) -> Iterator[Check]:
    """No claim can be certified that this version does not know; it knows none."""
    unknown = [f"{move.label}: {claim.kind}" for move in plan.moves for claim in move.claims]
    if unknown:
        yield Worst(len(unknown), unknown[0]).at_most(0.0, "claims that are not known")


def _joints(motions: list[_JudgedMotion], robot: UrdfRobot) -> Check:
    names = robot.arm_names
    foreign = [m.move.label for m in motions if m.move.trajectory.limits.names != names]
    where = ", ".join(foreign) if foreign else f"{names[0]} .. {names[-1]}"
    return Worst(len(foreign), where).at_most(0.0, "foreign joints", "moves")


def _knot_order(motions: list[_JudgedMotion]) -> Check:
    steps = (Worst(float(m.cubics.lengths_s.min(initial=np.inf)), m.move.label) for m in motions)
    return least(steps, NO_MOVES).above(0.0, "time between knots", "s")


def _stated(motions: list[_JudgedMotion], judge: JointLimits, allowed: Tolerances) -> Check:
    """Whether a plan claims limits above those it is judged by."""
    claims = [
        _claim(motion, name, np.asarray(getattr(judge, name)))
        for motion in motions
        for name in UNITS
    ]
    claimed = greatest(claims, NO_MOVES)
    return claimed.at_most(1.0 + allowed.ratio, "stated limits of those judged by")


def _claim(motion: _JudgedMotion, name: str, bounds: FloatArray) -> Worst:
    stated = np.asarray(getattr(motion.move.trajectory.limits, name))
    joint = int(np.argmax(stated / bounds))
    where = (
        f"{motion.move.label}, {_joint_name(motion, joint)}: {stated[joint]:g} {UNITS[name]} "
        f"stated, judged by {bounds[joint]:g} {UNITS[name]}"
    )
    return Worst(_number(stated[joint] / bounds[joint]), where)


def _limits(
    motions: list[_JudgedMotion], judge: JointLimits, allowed: Tolerances
) -> Iterator[Check]:
    """The judge's limits or those that the plan states, whichever are stricter."""

    def excess(state: States, limits: JointLimits) -> FloatArray:
        below = np.maximum(judge.q_min, limits.q_min) - state.q
        return np.maximum(below, state.q - np.minimum(judge.q_max, limits.q_max))

    def velocity(state: States, limits: JointLimits) -> FloatArray:
        return np.abs(state.v) / np.minimum(judge.v_max, limits.v_max)

    def acceleration(state: States, limits: JointLimits) -> FloatArray:
        return np.abs(state.a) / np.minimum(judge.a_max, limits.a_max)

    ratio = 1.0 + allowed.ratio
    least_margin = greatest((_extreme(m, excess) for m in motions), NO_MOVES, -np.inf).negated
    yield least_margin.at_least(-allowed.position_rad, "position margin", "rad")
    for name, share in (("velocity", velocity), ("acceleration", acceleration)):
        worst = greatest((_extreme(motion, share) for motion in motions), NO_MOVES)
        yield worst.at_most(ratio, f"{name} of limit")
    jerk = greatest((_jerk(motion, judge) for motion in motions), NO_MOVES)
    yield jerk.at_most(ratio, "jerk of limit")


def _extreme(motion: _JudgedMotion, measure: Callable[[States, JointLimits], FloatArray]) -> Worst:
    """The greatest of a measure over a move."""
    states = motion.cubics.critical_states()
    return _of_joint(motion, states.time_s, measure(states, motion.move.trajectory.limits))


def _jerk(motion: _JudgedMotion, judge: JointLimits) -> Worst:
    cubics = motion.cubics
    share = abs(cubics.jerks) / np.minimum(judge.j_max, motion.move.trajectory.limits.j_max)
    if not share.size:
        return Worst(0.0, motion.move.label)
    starts = np.broadcast_to(cubics.knots_s[:-1, None], share.shape)
    return _of_joint(motion, starts, share)


def _knots(motions: list[_JudgedMotion], allowed: Tolerances) -> Iterator[Check]:
    for number, (name, unit) in enumerate(QUANTITIES):
        found = greatest(
            (
                _of_joint(m, np.broadcast_to(m.cubics.knots_s[1:, None], jump.shape), jump)
                for m in motions
                if (jump := m.cubics.jumps()[number]).size
            ),
            "no segments",
        )
        yield found.at_most(allowed.state, f"{name} jump at knots", unit)


def _joins(plan: Plan, motions: list[_JudgedMotion], allowed: Tolerances) -> Iterator[Check]:
    still = np.zeros_like(plan.q_start)
    for number, (name, unit) in enumerate(QUANTITIES):
        before, found = (plan.q_start if number == 0 else still), []
        for motion in motions:
            states = motion.cubics.knots[number]
            jump = abs(states[0] - before)
            joint = int(np.argmax(jump))
            where = f"{motion.move.label}, start, {_joint_name(motion, joint)}"
            found.append(Worst(_number(jump[joint]), where))
            before = states[-1]
        jumps = greatest(found, NO_MOVES)
        yield jumps.at_most(allowed.state, f"{name} jump between moves", unit)


def _rests(plan: Plan, allowed: Tolerances) -> Iterator[Check]:
    """At every gripper action and at the end the arm must stand still."""
    stops = list(_stops(plan))
    for number, (name, unit) in enumerate(QUANTITIES[1:], start=1):
        rates = greatest((_of_state(label, move, number) for label, move in stops), NO_MOVES)
        yield rates.at_most(allowed.state, f"{name} at stops", unit)


def _stops(plan: Plan) -> Iterator[tuple[str, Move]]:
    last: Move | None = None
    for step in plan.steps:
        if isinstance(step, Move):
            last = step
        elif last is not None:
            yield step.label, last
    if last is not None:
        yield "end", last


def _of_state(label: str, move: Move, number: int) -> Worst:
    state = abs(np.array((move.trajectory.v, move.trajectory.a)[number - 1][-1]))
    joint = int(np.argmax(state))
    return Worst(_number(state[joint]), f"{label}, {move.trajectory.limits.names[joint]}")


def _of_joint(motion: _JudgedMotion, times_s: FloatArray, values: FloatArray) -> Worst:
    """The greatest of values, shape (k, n), with its move, time and joint."""
    row, joint = np.unravel_index(int(np.argmax(values)), values.shape)
    where = f"{motion.move.label}, {times_s[row, joint]:.4f} s, {_joint_name(motion, int(joint))}"
    return Worst(_number(values[row, joint]), where)


def _joint_name(motion: _JudgedMotion, joint: int) -> str:
    return motion.move.trajectory.limits.names[joint]


def _number(value: float) -> float:
    """As a float; what is no number counts as infinitely bad."""
    return float(value) if np.isfinite(value) else float("inf")
