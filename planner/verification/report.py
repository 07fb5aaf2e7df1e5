"""The table of a certificate: the worst value of every property, its bound, and where it occurs.

Only the checker's results (`Certified`) are trusted. Limits, jumps and tips are computed here once
more, in doubles, so that a refused plan shows by how much it fails.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from baxter_kin import JointLimits
from baxter_kin.frames import angle_between
from baxter_kin.kinematics.limits import (
    DEFAULT_ACCELERATION_RAD_S2,
    DEFAULT_JERK_RAD_S3,
    DEFAULT_ORIGINS,
)
from baxter_kin.validation import FloatArray
from planner.certificate.checking import Certified
from planner.certificate.intervals import Interval
from planner.certificate.motion import LIMIT_RATIO, MAX_JUMP
from planner.certificate.robot import Robot
from planner.certificate.timeline import (
    DROP_M,
    PRESS_M,
    SLIDE_M,
    STATE_TOLERANCE,
    TIP_TOLERANCE,
    TOUCH_M,
)
from planner.plan import Move, Plan
from planner.state import State
from planner.trajectory import Trajectory
from planner.verification.certificate import Check, Worst, greatest, least

STATED_M = 2e-5
"""Accuracy of a stated distance."""

QUANTITIES = (("position", "rad"), ("velocity", "rad/s"), ("acceleration", "rad/s^2"))
RATES = {"v_max": "rad/s", "a_max": "rad/s^2", "j_max": "rad/s^3"}

NO_MOVES, NO_PROOFS = "no moves", "no proofs are stated"
NOT_CERTIFIED = "the plan is not certified"


def robot_limits(
    robot: Robot, acceleration: float | None = None, jerk: float | None = None
) -> JointLimits:
    """Limits of an arm: positions and velocities of the URDF.

    The robot states no acceleration or jerk, so these are the toolkit's named defaults
    (`baxter_kin.kinematics.limits`), or the given ones for all joints.
    """
    given = {"acceleration": acceleration, "jerk": jerk}
    said = {name: "the caller" for name, value in given.items() if value is not None}
    a = DEFAULT_ACCELERATION_RAD_S2 if acceleration is None else acceleration
    j = DEFAULT_JERK_RAD_S3 if jerk is None else jerk
    a_max, j_max = (np.full(len(robot.names), value, np.float64) for value in (a, j))
    origins = {**DEFAULT_ORIGINS, **said}
    return JointLimits(robot.names, robot.q_min, robot.q_max, robot.v_max, a_max, j_max, origins)


def table_of(
    plan: Plan, robot: Robot, judge: JointLimits, certified: Certified | None
) -> Iterator[Check]:
    """All checks, in order.

    Args:
        plan: the plan; its start is the state that it was judged in.
        robot: the robot whose arm moves.
        judge: the limits to judge by.
        certified: the checker's result; None for a plan that it refuses.
    """
    failure = plan.failure
    where = f"{len(plan.steps)} steps" if failure is None else str(failure)
    yield Worst(float(failure is not None), where).at_most(0.0, "failed steps")
    foreign = [m.label for m in plan.moves if m.trajectory.limits.names != robot.names]
    where = ", ".join(foreign) if foreign else f"{robot.names[0]} .. {robot.names[-1]}"
    yield Worst(len(foreign), where).at_most(0.0, "foreign joints", "moves")
    moves = [move for move in plan.moves if move.label not in foreign]
    yield from _limits(moves, judge)
    yield from _jumps(moves, plan)
    yield from _tips(moves, robot)
    yield from _fingers(plan, robot)
    yield from _certified(plan, certified)
    yield from _stated(plan, certified, STATED_M + 2.0 * robot.skew * robot.stroke_m)


def _limits(moves: Sequence[Move], judge: JointLimits) -> Iterator[Check]:
    """The moves against the stricter of the judge's limits and those that the plan states."""
    claims, margins = [], []
    peaks: dict[str, list[Worst]] = {name: [] for name in ("velocity", "acceleration", "jerk")}
    for move in moves:
        own = move.trajectory.limits
        claims += [_claim(move, name, judge) for name in RATES]
        low, high = move.trajectory.position_extrema()
        margin = np.minimum(
            low - np.maximum(judge.q_min, own.q_min), np.minimum(judge.q_max, own.q_max) - high
        )
        i = int(margin.argmin())
        margins.append(Worst(float(margin[i]), f"{move.label}, {own.names[i]}"))
        by_plan, by_judge = (move.trajectory.peak_ratios(limits) for limits in (own, judge))
        for name, ratio in zip(peaks, np.maximum(by_plan, by_judge).tolist(), strict=True):
            peaks[name].append(Worst(ratio, move.label))
    ratio = 1.0 + LIMIT_RATIO
    yield greatest(claims, NO_MOVES).at_most(ratio, "stated limits of those judged by")
    yield least(margins, NO_MOVES).at_least(-MAX_JUMP, "position margin", "rad")
    for name, found in peaks.items():
        yield greatest(found, NO_MOVES).at_most(ratio, f"{name} of limit")


def _claim(move: Move, name: str, judge: JointLimits) -> Worst:
    limits, unit = move.trajectory.limits, RATES[name]
    stated, bounds = np.asarray(getattr(limits, name)), np.asarray(getattr(judge, name))
    i = int(np.argmax(stated / bounds))
    where = f"{limits.names[i]}: {stated[i]:g} {unit} stated, judged by {bounds[i]:g} {unit}"
    return Worst(float(stated[i] / bounds[i]), f"{move.label}, {where}")


def _jumps(moves: Sequence[Move], plan: Plan) -> Iterator[Check]:
    """Jumps at knots and between moves, and the remaining motion where the arm must rest."""
    stops, last = [], None
    for step in (*plan.steps, None):
        if isinstance(step, Move):
            last = step
        elif last is not None:
            stops.append((last, "end" if step is None else step.label))
    before: tuple[FloatArray, ...] = (plan.q_start, *np.zeros((2, 7)))
    at_knots: list[list[Worst]] = [[], [], []]
    between: list[list[Worst]] = [[], [], []]
    for move in moves:
        t = move.trajectory
        knots = t.q, t.v, t.a
        for number, (end, now, then) in enumerate(zip(_ends(t), knots, before, strict=True)):
            jump, after = np.abs(end - now[1:]), np.abs(now[0] - then)
            if jump.size:
                row, joint = np.unravel_index(int(jump.argmax()), jump.shape)
                where = f"{move.label}, {t.knots_s[row + 1]:.4f} s, {t.limits.names[joint]}"
                at_knots[number].append(Worst(float(jump[row, joint]), where))
            where = f"{move.label}, start, {t.limits.names[int(after.argmax())]}"
            between[number].append(Worst(float(after.max()), where))
        before = tuple(x[-1] for x in knots)
    for found, what in ((at_knots, "at knots"), (between, "between moves")):
        for each, (name, unit) in zip(found, QUANTITIES, strict=True):
            yield greatest(each, NO_MOVES).at_most(STATE_TOLERANCE, f"{name} jump {what}", unit)
    for (name, unit), key in zip(QUANTITIES[1:], "va", strict=True):
        rates = (
            Worst(float(np.abs(getattr(move.trajectory, key)[-1]).max()), label)
            for move, label in stops
        )
        yield greatest(rates, NO_MOVES).at_most(STATE_TOLERANCE, f"{name} at stops", unit)


def _ends(t: Trajectory) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions, velocities and accelerations at the ends of the pieces of a motion."""
    dt, q, v, a = np.diff(t.knots_s)[:, None], t.q[:-1], t.v[:-1], t.a[:-1]
    return (
        q + dt * (v + dt * (a / 2 + dt * t.j / 6)),
        v + dt * (a + dt * t.j / 2),
        a + dt * t.j,
    )


def _tips(moves: Sequence[Move], robot: Robot) -> Iterator[Check]:
    """The end of each move against its target pose."""
    off, turned = [], []
    for move in moves:
        if move.T_base_tip is not None:
            tip = robot.tips(Interval(move.trajectory.q[-1:]))
            p, R = tip.p.centred()[0][0], tip.R.centred()[0][0]
            off.append(Worst(float(np.linalg.norm(p - move.T_base_tip.translation)), move.label))
            turned.append(Worst(angle_between(R, move.T_base_tip.rotation), move.label))
    nothing = "no target poses"
    yield greatest(off, nothing).at_most(TIP_TOLERANCE, "tip position", "m")
    yield greatest(turned, nothing).at_most(TIP_TOLERANCE, "tip orientation", "rad")


def _fingers(plan: Plan, robot: Robot) -> Iterator[Check]:
    """The positions of the fingers at the start."""
    openings = [s * plan.start.joints[robot.finger_joints[f]] for f, s in robot.fingers.items()]
    outside = (
        Worst(max(-at_m, at_m - robot.stroke_m), f"{finger} at {1e3 * at_m:.3f} mm")
        for finger, at_m in zip(robot.fingers, openings, strict=True)
    )
    found = greatest(outside, "no fingers", -math.inf)
    yield found.at_most(STATE_TOLERANCE, "finger start outside the stroke", "m")
    skew = Worst(float(np.ptp(openings)) if openings else 0.0, f"{robot.limb} hand")
    yield skew.at_most(STATE_TOLERANCE, "fingers unequally open", "m")


def _certified(plan: Plan, certified: Certified | None) -> Iterator[Check]:
    """The checker's results: upper bounds on errors, and clearances of all steps."""
    line = plan.line_tolerance
    paths = {move.label: move.path.tolerance for move in plan.moves if move.path is not None}
    worst = {} if certified is None else certified.worst
    on_path, turn_on_path = (
        paths.get(worst[name][1], line) if name in worst else line
        for name in ("distance from path", "turn from path")
    )
    bounds = {
        "distance from line": (line.position_m, "m", "no straight moves"),
        "turn from line": (line.rotation_rad, "rad", "no straight moves"),
        "distance from path": (on_path.position_m, "m", "no paths"),
        "turn from path": (turn_on_path.rotation_rad, "rad", "no paths"),
        "held bodies off their hands": (PRESS_M, "m", "nothing is held at first"),
        "gap of closed pads": (TOUCH_M, "m", "no grasp"),
        "drop at release": (DROP_M, "m", "no release"),
        "slide in contact": (SLIDE_M, "m", "no held body touches anything"),
    }
    for name, (bound, unit, nothing) in bounds.items():
        found = Worst(*worst.get(name, (0.0, nothing)))
        if certified is None:
            found = Worst(math.nan, NOT_CERTIFIED)
        yield found.at_most(bound, name, unit)
    kinds = {
        "clearance": "no moves",
        "clearance of fingers": "no gripper action",
        "clearance of the rest": "nothing stands still",
    }
    kept: dict[str, list[Worst]] = {name: [] for name in kinds}
    if certified is not None:
        for number, (label, clear_m) in zip(certified.numbers, certified.clearances_m, strict=True):
            is_move = number is not None and isinstance(plan.steps[number], Move)
            kind = "" if is_move else " of the rest" if number is None else " of fingers"
            kept[f"clearance{kind}"].append(Worst(clear_m, label))
    for name, nothing in kinds.items():
        unknown = Worst(math.nan, NOT_CERTIFIED)
        clear = unknown if certified is None else least(kept[name], nothing)
        yield clear.at_least(0.0, name, "m")


def _stated(plan: Plan, certified: Certified | None, within_m: float) -> Iterator[Check]:
    """The proofs and bodies that each step states, against the start and what is certified.

    A plan file cannot state that bodies appear, vanish or change, so the checker does not read
    them.
    """
    other = [step.label for step in plan if step.state and not _has_its_bodies(step.state, plan)]
    where = other[0] if other else "the same in each step"
    yield Worst(len(other), where).at_most(0.0, "steps that state other bodies")
    beyond, order = [], []
    for number, step in enumerate(plan.steps):
        if step.proof is None:
            continue
        proven_m, near_m = step.proof.proven_m, step.proof.nearest.distance_m
        order.append(Worst(step.proof.margin_m - proven_m, f"{step.label}: margin above proof"))
        order.append(Worst(proven_m - near_m, f"{step.label}: proof above nearest"))
        if certified is not None:
            kept_m = _kept_m(number, certified)
            text = f"{1e3 * proven_m:.3f} mm stated, {1e3 * kept_m:.3f} mm certified"
            beyond.append(Worst(proven_m - kept_m, f"{step.label}: {text}"))
    found = greatest(beyond, NO_PROOFS, -math.inf)
    if certified is None:
        found = Worst(math.nan, NOT_CERTIFIED)
    yield found.at_most(within_m, "stated proofs beyond what is certified", "m")
    contradiction = greatest(order, NO_PROOFS, -math.inf)
    yield contradiction.at_most(STATED_M, "stated proofs that contradict themselves", "m")


def _has_its_bodies(state: State, plan: Plan) -> bool:
    """Whether a state has the bodies of a plan's start, at any poses."""
    bodies = plan.start.scene.bodies
    return state.scene.bodies.keys() == bodies.keys() and all(
        body.is_movable == bodies[body.name].is_movable
        and [part.shape for part in body.parts] == [p.shape for p in bodies[body.name].parts]
        and [part.T_body_part for part in body.parts]
        == [p.T_body_part for p in bodies[body.name].parts]
        for body in state.scene
        if body is not bodies[body.name]
    )


def _kept_m(number: int, certified: Certified) -> float:
    numbered = zip(certified.numbers, certified.clearances_m, strict=True)
    return min((m for n, (_, m) in numbered if n == number), default=math.inf)


def described(limits: JointLimits) -> str:
    """Acceleration and jerk limits as a phrase, with minimum and maximum where joints differ."""
    return f"{_span(limits.a_max)} rad/s^2 and {_span(limits.j_max)} rad/s^3"


def _span(values: FloatArray) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{low:g}" if low == high else f"{low:g} .. {high:g}"
