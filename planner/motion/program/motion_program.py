"""MotionProgram: the fastest motion through several phases, as one nonlinear program.

Each phase is a uniform cubic B-spline in joint space with a duration of its own, so that jerk is
constant in each interval, and the limits of velocity, acceleration and jerk hold everywhere if the
controls keep them (`planner.splines`). The sum of the durations is minimal. From phase to phase,
position, velocity and acceleration are continuous, or the arm rests. On a line the tip is within a
tolerance of it at every knot, and exactly on it where a phase begins and ends; elsewhere it stays
above a height at the knots. Any configuration of a pose is allowed.

The program has exact first and second derivatives, as sparse matrices (`planner.motion.program.
rows`), and is solved from a guess by the interior-point method of Waechter and Biegler ("On the
implementation of an interior-point filter line-search algorithm for large-scale nonlinear
programming", Mathematical Programming 106, 2006). It is built once for all robots: arm, limits and
task are parameters of each solution.

`led_around` avoids obstacles: it solves the program repeatedly, with the distances near the last
motions, as sequential convex optimization does (Schulman et al., Int. J. Robotics Research 33(9),
2014); but each iteration is a whole motion program in which only the distances are linear.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import casadi as ca
import numpy as np
import pinocchio as pin

from baxter_kin import Arm, JointLimits
from baxter_kin.validation import FloatArray
from planner.collision.obstacles import Obstacles, SampledDistances
from planner.motion.paths.straight_line import Turn
from planner.motion.program.rows import (
    ClearanceRows,
    Clearances,
    Rows,
    clearance_rows,
    constant,
    spline_rows,
)
from planner.motion.program.tip_rows import (
    height_rows,
    holding_rows,
    path_rows,
    speed_rows,
    tilt_rows,
    tip_speed_rows,
)
from planner.motion.program.unknowns import (
    MotionTask,
    Numbers,
    Phase,
    Unknowns,
    ends_of,
    numbers_of,
)
from planner.splines import DIFFERENCES, Sketch, trajectory_of
from planner.trajectory import Trajectory

MIN_DURATION, MAX_DURATION = 1e-3, 1e3
"""Bounds of a phase's duration, in units of the longest one of the guess, so that numbers are of
similar size whatever the limits are."""

SHORTFALL_PER_M, MAX_SHORTFALL_M = 20.0, 0.3
"""Cost of a metre of missing clearance in an interval, in the same units, and the maximum
shortfall."""

EXTRA_MARGIN_M, MARGIN_TOLERANCE_M = 0.005, 0.002
"""Distance to obstacles in addition to the required one, and how much of it may be missing in a
motion that is tried: distances are bounded at some times only, and those of hulls."""

MAX_ROUNDS, TRUST_RAD, TRUST_DECAY = 10, 0.4, 0.7
"""Maximum number of rounds; maximum change of a control since the bounds were computed, and the
factor of its reduction in each of the last half of the rounds."""

MAX_ROUNDS_TO_CLEAR, MAX_FAILURES, SETTLED = 5, 1, 3e-3
"""Maximum number of rounds without a clear motion, and maximum number of failures; and share of its
duration by which a clear motion must change for another round."""

MAX_SHORT_ROUNDS, SHORT_TRUST_RAD, MIN_TRUST_RAD, ACCEPTED, REJECTED = 24, 0.2, 0.01, 1.5, 0.4
"""Maximum number of rounds with short steps; initial and minimum change of a control in a round;
and factors of it after a round with a clear motion, and after one that is rejected."""

TOLERATED_M = 0.02
"""Depth in an obstacle up to which a motion is accepted in between."""

_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "calc_lam_p": False,
    "no_nlp_grad": True,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 100,
    "ipopt.tol": 1e-3,  # later iterations gain less than a thousandth
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.acceptable_iter": 0,  # nothing less is acceptable
    "show_eval_warnings": False,
    "ipopt.mu_init": 1e-3,
    "ipopt.bound_push": 1e-3,
    "ipopt.bound_frac": 1e-3,
    "ipopt.slack_bound_push": 0.1,  # with these four a quarter fewer iterations than without
    "ipopt.slack_bound_frac": 0.1,
    "ipopt.bound_mult_init_val": 0.1,
    "ipopt.mu_superlinear_decrease_power": 1.8,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.mumps_pivot_order": 0,  # approximate minimum degree
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_scaling": 0,
    "ipopt.fast_step_computation": "yes",
}


class MotionProgram:
    """The program of successive phases; the arm rests at the start and at the end, or is on a line.

    Attributes:
        phases: in order.
        unknowns: the indices of its unknowns.
        rows: all rows except those of clearance.
        smoothing: weight of the squared third differences of the controls.
        options: of the solver.
    """

    def __init__(
        self,
        phases: Sequence[Phase],
        joints: int,
        *,
        turn: Turn = Turn.FIXED,
        bounds_speed: bool = False,
        smoothing: float = 0.0,
        options: Mapping[str, float] | None = None,
    ) -> None:
        """Build the program and its derivatives, which takes a tenth of a second.

        Args:
            phases: in order; at the end of the last one the arm rests, or leaves its line at speed.
            joints: number of joints that move.
            turn: which rotations about a path are allowed.
            bounds_speed: whether the tip keeps below a speed.
            smoothing: weight of the squared third differences of the controls.
            options: of the solver, in place of the usual ones.
        """
        self.phases, self.smoothing = tuple(phases), smoothing
        self.options = _OPTIONS | dict(options or {})
        self.unknowns = Unknowns.of(self.phases, joints)
        x, numbers = ca.MX.sym("x", self.unknowns.count), Numbers(self.phases, joints)
        given = self.phases, self.unknowns, x, numbers
        parts = [
            spline_rows(*given),
            path_rows(*given, turn),
            speed_rows(*given),
            height_rows(*given),
            tilt_rows(*given),
            tip_speed_rows(*given) if bounds_speed else None,
            holding_rows(*given),
        ]
        rows = [each for each in parts if each is not None]
        self._low, self._high = (np.concatenate([each[i] for each in rows]) for i in (1, 2))
        self.rows = RowFunctions.of(rows, x, numbers.all)
        self._one_at_a_time = threading.Lock()  # the solver's status is that of its last call
        self._solver = solver_of([self], [None])

    def solve(
        self,
        guess: Sequence[Sketch],
        task: MotionTask,
        arm: Arm | None,
        limits: JointLimits,
        clearances: Clearances | None = None,
    ) -> tuple[Trajectory, ...] | None:
        """The fastest motions near a guess; None where no feasible ones are found.

        Args:
            guess: one for each phase, with as many intervals.
            task: the parameters of the problem.
            arm: whose tip is constrained; may be None without constraints on the tip.
            limits: of its joints.
            clearances: distances to keep.
        """
        unit_s = max(sketch.duration_s for sketch in guess)
        part = self.part(guess, Track(self, task, arm, limits), unit_s, clearances)
        if clearances is None:
            with self._one_at_a_time:
                x = answer(self._solver, part.inputs)
        else:
            x = answer(solver_of([self], [part.rows]), part.inputs)
        return None if x is None else self.motions(x, task, limits, unit_s)

    def part(
        self,
        guess: Sequence[Sketch],
        track: Track,
        unit_s: float,
        clearances: Clearances | None = None,
    ) -> Part:
        """What the solver gets of a track of this program.

        Args:
            guess: one sketch for each phase, with as many intervals.
            track: the task, the arm and its limits.
            unit_s: the unit of all times.
            clearances: distances to keep.
        """
        low, high = self._bounds(track.task, track.limits)
        numbers = numbers_of(track.task, track.arm, track.limits, unit_s)
        x0 = self._start(guess, track.task, track.arm, unit_s).clip(low, high)
        bounds = {"lbx": low, "ubx": high, "lbg": self._low, "ubg": self._high}
        inputs = {"x0": x0, "p": numbers, **bounds}
        if clearances is None:
            return Part(inputs, None)
        rows = clearance_rows(self.unknowns, clearances.bounds, np.concatenate(ends_of(track.task)))
        return Part(inputs | self._inputs_with(inputs, clearances.trust_rad, rows), rows)

    def third_differences(self) -> ca.DM:
        """Maps the unknowns to the third differences of their controls, where any is smoothed."""
        columns = np.zeros((0, 4), dtype=np.intp)
        for controls in self.unknowns.controls if self.smoothing else ():
            windows = np.lib.stride_tricks.sliding_window_view(controls, 4, axis=0).reshape(-1, 4)
            columns = np.concatenate([columns, windows])
        columns = columns[(columns < self.unknowns.count).all(axis=1)]
        rows = np.repeat(np.arange(len(columns)), 4)
        weights = np.tile(DIFFERENCES[2], len(columns))
        return constant(rows, columns.ravel(), weights, (len(columns), self.unknowns.count))

    def _inputs_with(
        self, inputs: Mapping[str, FloatArray], trust_rad: float, rows: ClearanceRows
    ) -> dict[str, FloatArray]:
        """Changed inputs of the solver with rows of clearance."""
        x0, low, high = inputs["x0"], inputs["lbx"].copy(), inputs["ubx"].copy()
        for controls in self.unknowns.controls:
            near = controls[controls < self.unknowns.count]
            low[near] = np.maximum(low[near], x0[near] - trust_rad)
            high[near] = np.minimum(high[near], x0[near] + trust_rad)
        none = np.zeros(rows.shortfalls)
        return {
            "x0": np.concatenate([x0, none]),
            "lbx": np.concatenate([low, none]),
            "ubx": np.concatenate([high, none + MAX_SHORTFALL_M]),
            "lbg": np.concatenate([inputs["lbg"], rows.low]),
            "ubg": np.concatenate([inputs["ubg"], np.full(len(rows.low), np.inf)]),
        }

    def _bounds(self, task: MotionTask, limits: JointLimits) -> tuple[FloatArray, FloatArray]:
        """Bounds of the unknowns: if the controls are within the limits, the motion is."""
        unknowns = self.unknowns
        low, high = np.zeros(unknowns.count), np.ones(unknowns.count)  # of fractions
        low[unknowns.durations], high[unknowns.durations] = MIN_DURATION, MAX_DURATION
        for controls in unknowns.controls:
            is_unknown = controls < unknowns.count
            for values, bounds in ((low, limits.q_min), (high, limits.q_max)):
                values[controls[is_unknown]] = np.broadcast_to(bounds, controls.shape)[is_unknown]
        begins_at_rest = not (self.phases[0].enters or self.phases[0].is_moving)
        for phase, fractions in zip(self.phases, unknowns.fractions, strict=True):
            if fractions is not None and phase.piece is not None:
                first, last = phase.ends
                kept = task.kept_from_ends(phase.piece)
                ends_at_rest = (first, begins_at_rest), (last, phase.rests)
                low[fractions] = kept if (0.0, True) in ends_at_rest else 0.0
                high[fractions] = 1.0 - kept if (1.0, True) in ends_at_rest else 1.0
                low[fractions[0]] = high[fractions[0]] = first
                given = fractions if phase.only_ends else fractions[-1]
                low[given] = high[given] = last
            begins_at_rest = phase.rests
        if task.near is not None:
            q, most_rad = task.near
            last = unknowns.controls[-1][-1]
            low[last] = np.maximum(low[last], q - most_rad)
            high[last] = np.minimum(high[last], q + most_rad)
        return low, high

    def _start(
        self, guess: Sequence[Sketch], task: MotionTask, arm: Arm | None, unit_s: float
    ) -> FloatArray:
        """The unknowns of a guess."""
        unknowns = self.unknowns
        x = np.zeros(unknowns.count)
        x[unknowns.durations] = [sketch.duration_s / unit_s for sketch in guess]
        for k, (phase, sketch) in enumerate(zip(self.phases, guess, strict=True)):
            controls = unknowns.controls[k]
            is_unknown = controls < unknowns.count
            x[controls[is_unknown]] = sketch.controls[is_unknown]
            fractions = unknowns.fractions[k]
            if fractions is not None and phase.piece is not None and arm is not None:
                joints = len(arm.joint_names)
                frame = pin.SE3.Identity() if task.T_tip_frame is None else task.T_tip_frame
                poses = [arm.T_base_tip(q[:joints]) * frame for q in sketch.q]
                x[fractions] = task.pieces[phase.piece].nearest_fractions(poses)
        return x

    def motions(
        self, x: FloatArray, task: MotionTask, limits: JointLimits, unit_s: float
    ) -> tuple[Trajectory, ...]:
        """The motions of a solution, slowed down by any violation of the limits due to rounding."""
        x = x[: self.unknowns.count].copy()
        x[self.unknowns.durations] *= unit_s
        angles = np.concatenate([x, *ends_of(task)])
        controls = [angles[where] for where in self.unknowns.controls]
        durations = x[self.unknowns.durations]
        splines = list(zip(controls, durations.tolist(), strict=True))
        peaks = np.max([trajectory_of(c, t, limits).peak_ratios() for c, t in splines], axis=0)
        slower = max(1.0, *(peaks ** np.array([1.0, 1 / 2, 1 / 3])).tolist())
        return tuple(trajectory_of(c, t * slower, limits) for c, t in splines)


class Track(NamedTuple):
    """A motion of an arm that a program describes.

    Attributes:
        program: of its phases.
        task: the parameters of the problem.
        arm: whose tip is constrained; may be None without constraints on the tip.
        limits: of its joints.
    """

    program: MotionProgram
    task: MotionTask
    arm: Arm | None
    limits: JointLimits


class Part(NamedTuple):
    """What the solver gets of one track.

    Attributes:
        inputs: of the solver: "x0", "p", and bounds "lbx", "ubx", "lbg", "ubg".
        rows: of its clearance, whose shortfalls follow the unknowns; None without.
    """

    inputs: Mapping[str, FloatArray]
    rows: ClearanceRows | None


class Coupling(NamedTuple):
    """What joins several tracks: further unknowns, linear rows, and the objective of all.

    Attributes:
        unknowns: number of the further unknowns, which follow those of all tracks.
        matrix: of the rows, constant and sparse, shape (rows, all unknowns).
        objective: weights of the further unknowns, shape (unknowns,).
        duration_weight: weight of each duration of a track.
    """

    unknowns: int
    matrix: ca.DM
    objective: FloatArray
    duration_weight: float


def solver_of(
    programs: Sequence[MotionProgram],
    clear: Sequence[ClearanceRows | None],
    coupling: Coupling | None = None,
) -> ca.Function:
    """The solver of one track or several, built in a hundredth of a second.

    The unknowns of each track are followed by the shortfalls of its clearance, and its rows by
    those of its clearance.

    Args:
        programs: of the tracks; the options are those of the first.
        clear: rows of clearance of each, or None.
        coupling: of several tracks; a single one minimises the sum of its durations.
    """
    counts = [program.unknowns.count for program in programs]
    more = [0 if rows is None else rows.shortfalls for rows in clear]
    sizes = [size for pair in zip(counts, more, strict=True) for size in pair]
    sizes.append(0 if coupling is None else coupling.unknowns)
    x = ca.MX.sym("x", sum(sizes))
    parts = ca.vertsplit(x, np.cumsum([0, *sizes]).tolist())
    functions = [program.rows for program in programs]
    p = ca.MX.sym("p", sum(each.numbers for each in functions))
    numbers = ca.vertsplit(p, np.cumsum([0, *(each.numbers for each in functions)]).tolist())
    weight, share = ca.MX.sym("weight"), 1.0 if coupling is None else coupling.duration_weight
    f = ca.MX(0)
    values: list[ca.MX] = []
    jacobian: list[ca.MX] = []
    hessian: list[ca.MX] = []
    lengths: list[int] = []
    for k, (program, rows) in enumerate(zip(programs, clear, strict=True)):
        motion, shortfalls = parts[2 * k : 2 * k + 2]
        matrix = ca.DM(0, counts[k]) if rows is None else rows.matrix
        f += share * ca.sum1(motion[program.unknowns.durations.tolist()])
        f += SHORTFALL_PER_M * ca.sum1(shortfalls)
        f += program.smoothing * ca.sumsqr(program.third_differences() @ motion)
        value = program.rows.value(motion, numbers[k])
        values += [value, matrix @ ca.vertcat(motion, shortfalls)]
        own = ca.horzcat(program.rows.jacobian(motion, numbers[k]), ca.MX(value.shape[0], more[k]))
        jacobian.append(ca.vertcat(own, matrix))
        lengths += [value.shape[0], matrix.shape[0]]
    further = parts[-1]
    jacobian_g = ca.diagcat(*jacobian)
    if coupling is not None:
        f += ca.dot(ca.DM(coupling.objective), further)
        values.append(coupling.matrix @ x)
        jacobian_g = ca.horzcat(jacobian_g, ca.MX(sum(lengths), coupling.unknowns))
        jacobian_g = ca.vertcat(jacobian_g, coupling.matrix)
        lengths.append(coupling.matrix.shape[0])
    multipliers = ca.MX.sym("multipliers", sum(lengths))
    split = ca.vertsplit(multipliers, np.cumsum([0, *lengths]).tolist())
    for k, program in enumerate(programs):
        differences = program.third_differences()
        second = program.rows.hessian(parts[2 * k], numbers[k], split[2 * k])
        second += weight * 2.0 * program.smoothing * ca.triu(differences.T @ differences)
        hessian += [second, ca.MX(more[k], more[k])]
    if coupling is not None:
        hessian.append(ca.MX(coupling.unknowns, coupling.unknowns))
    inputs, g = [x, p], ca.vertcat(*values)
    derivatives: dict[str, Any] = {
        "grad_f": ca.Function("grad_f", inputs, [f, ca.densify(ca.jacobian(f, x).T)]),
        "jac_g": ca.Function("jac_g", inputs, [g, jacobian_g]),
        "hess_lag": ca.Function("hess_lag", [*inputs, weight, multipliers], [ca.diagcat(*hessian)]),
    }
    nlp = {"x": x, "p": p, "f": f, "g": g}
    return ca.nlpsol("motion", "ipopt", nlp, programs[0].options | derivatives)


class RowFunctions(NamedTuple):
    """All rows of a program except those of clearance, as functions of unknowns and numbers."""

    value: ca.Function
    jacobian: ca.Function
    hessian: ca.Function
    numbers: int

    @classmethod
    def of(cls, rows: Sequence[Rows], x: ca.MX, numbers: ca.MX) -> RowFunctions:
        """Stack the rows."""
        sizes = [each.g.shape[0] for each in rows]
        multipliers = ca.MX.sym("multipliers", sum(sizes))
        parts = ca.vertsplit(multipliers, np.cumsum([0, *sizes]).tolist())
        each_part = zip(rows, parts, strict=True)
        start = ca.MX(x.shape[0], x.shape[0])
        hessian = sum((each.hessian(part) for each, part in each_part), start=start)
        inputs = [x, numbers]
        return cls(
            ca.Function("rows", inputs, [ca.vertcat(*(each.g for each in rows))]),
            ca.Function("jacobian", inputs, [ca.vertcat(*(each.jacobian for each in rows))]),
            ca.Function("hessian", [*inputs, multipliers], [hessian]),
            int(numbers.shape[0]),
        )


def answer(solver: ca.Function, inputs: Mapping[str, FloatArray]) -> FloatArray | None:
    """The solution of a solver; None where it fails."""
    answer = solver(**inputs)
    x: FloatArray = np.array(answer["x"]).ravel()
    return x if solver.stats()["success"] else None


Motions: TypeAlias = tuple[Trajectory, ...]
"""One for each phase of a program."""

Solve: TypeAlias = Callable[[Sequence[Sketch], Clearances], Motions | None]
"""A program: the fastest motions near sketches that keep clearances, or None."""


def led_around(
    solve: Solve,
    obstacles: Sequence[Obstacles],
    sketches: Sequence[Sketch],
    *,
    enough_s: float = 0.0,
) -> list[Motions]:
    """Motions near sketches that are clear at the sampled distances; the last found first.

    Each was found from the one after it and is usually faster. The caller proves whether they are
    clear.

    Args:
        solve: the program.
        obstacles: those of each phase.
        sketches: of each phase, clear or not.
        enough_s: no faster motion than this is sought.
    """
    clear_motions: list[Motions] = []
    failures, trust_rad, sampled = 0, TRUST_RAD, _sampled(obstacles, sketches)
    for number in range(1, MAX_ROUNDS + 1):
        led = solve(sketches, Clearances([each.linear for each in sampled], trust_rad))
        if led is None or number > MAX_ROUNDS // 2:
            trust_rad *= TRUST_DECAY
        if led is None:
            failures += 1
        else:
            sketches = Sketch.of_each(led, (sketch.intervals for sketch in sketches))
            sampled = _sampled(obstacles, sketches)
            if min(each.excess_m for each in sampled) > -MARGIN_TOLERANCE_M:
                clear_motions.insert(0, led)
        is_hopeless = failures > MAX_FAILURES or (
            number >= MAX_ROUNDS_TO_CLEAR and not clear_motions
        )
        if is_hopeless or (led is not None and _is_good(clear_motions, enough_s)):
            break
    return clear_motions


def led_along(
    solve: Solve,
    obstacles: Sequence[Obstacles],
    sketches: Sequence[Sketch],
    *,
    enough_s: float = 0.0,
) -> list[Motions]:
    """The same from sketches that are clear or nearly so, with steps that keep motions clear.

    A motion that is deeper in an obstacle than `TOLERATED_M`, and deeper than the one before, is
    rejected, and the trust region is reduced. Among narrow obstacles, bounds on distances hold for
    small changes only; this takes more rounds than `led_around`.
    """
    clear_motions: list[Motions] = []
    trust_rad, sampled = SHORT_TRUST_RAD, _sampled(obstacles, sketches)
    excess_m = min(each.excess_m for each in sampled)
    for _ in range(MAX_SHORT_ROUNDS):
        led = solve(sketches, Clearances([each.linear for each in sampled], trust_rad))
        is_accepted, is_clear = False, False
        if led is not None:
            nearer = Sketch.of_each(led, (sketch.intervals for sketch in sketches))
            sampled_there = _sampled(obstacles, nearer)
            excess_there_m = min(each.excess_m for each in sampled_there)
            is_clear = excess_there_m > -MARGIN_TOLERANCE_M
            is_accepted = excess_there_m > min(excess_m, -TOLERATED_M)
        if not is_accepted:
            trust_rad *= REJECTED
            if trust_rad < MIN_TRUST_RAD:
                break
            continue
        sketches, sampled, excess_m = nearer, sampled_there, excess_there_m
        if led is not None and is_clear:
            trust_rad = min(TRUST_RAD, trust_rad * ACCEPTED)
            clear_motions.insert(0, led)
            if _is_good(clear_motions, enough_s):
                break
    return clear_motions


def _sampled(obstacles: Sequence[Obstacles], sketches: Sequence[Sketch]) -> list[SampledDistances]:
    return [near.sampled(s.controls) for near, s in zip(obstacles, sketches, strict=True)]


def _is_good(clear_motions: Sequence[Motions], enough_s: float) -> bool:
    """Whether the last motions are fast enough, or hardly faster than the previous ones."""
    times = [sum(motion.duration for motion in motions) for motions in clear_motions[:2]]
    if times and times[0] <= enough_s:
        return True
    return len(times) == 2 and abs(times[1] - times[0]) < SETTLED * times[0]
