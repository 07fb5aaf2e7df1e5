"""MotionProgram: the fastest motion through several phases, as one nonlinear program.

Each phase is a uniform cubic B-spline in joint space over a duration of its own, so that jerk is
constant in each interval, and the limits of velocity, acceleration and jerk hold everywhere where
the controls keep them (`planner.splines`). The sum of the durations is least. From
phase to phase position, velocity and acceleration go on without a jump, or the arm rests. On a line
the tip is within a tolerance of it at every knot, and exactly on it where a phase begins and ends;
elsewhere it stays above a height at the knots. Of all configurations of a pose any will do.

The program has exact first and second derivatives, sparse matrices whose entries are sums of few
computed numbers, and is solved by the interior-point method of Waechter and Biegler ("On the
implementation of an interior-point filter line-search algorithm for large-scale nonlinear
programming", Mathematical Programming 106, 2006) from a guess. It is built once for all robots:
what belongs to an arm, its limits or a task is given with each solution.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from baxter_kin import Arm, JointLimits
from baxter_kin.validation import FloatArray
from planner.collision.obstacles import LinearBounds
from planner.motion.program.clearance_rows import clearance_rows
from planner.motion.program.phases import MotionTask, Phase
from planner.motion.program.sparse import Rows
from planner.motion.program.spline_rows import spline_rows
from planner.motion.program.tip_rows import height_rows, line_rows, speed_rows
from planner.motion.program.unknowns import Numbers, Unknowns, ends_of, numbers_of
from planner.splines import Sketch, trajectory_of
from planner.trajectory import Trajectory

SHORTEST, LONGEST = 1e-3, 1e3
"""Of a phase, in units of the longest one of the guess: so numbers are of the same size whatever
the limits are."""

SHORTFALL_PER_M, MOST_SHORTFALL_M = 20.0, 0.3
"""What a metre of clearance that is missing in an interval costs, in the same units, and how much
may be."""

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


class Clearances(NamedTuple):
    """Linear bounds on distances, as `Obstacles.bounds` has them, and how far they are trusted.

    Attributes:
        weights: of the four controls where each interval is bounded, shape (intervals, 4).
        numbers: slopes and offsets there, shape (intervals, PAIRS, 8).
        trust_rad: how far a control may be from where the bounds were taken.
    """

    weights: FloatArray
    numbers: FloatArray
    trust_rad: float

    @classmethod
    def of(cls, bounds: Sequence[LinearBounds], trust_rad: float) -> Clearances:
        """Those of the phases, in order."""
        weights, numbers = (np.concatenate([each[i] for each in bounds]) for i in (0, 1))
        return cls(weights, numbers, trust_rad)


class MotionProgram:
    """The program of some phases in a row; the arm rests at first and at last, or is on a line.

    Attributes:
        phases: in order.
    """

    def __init__(self, phases: Sequence[Phase], *, keeps_clear: bool = False) -> None:
        """State it and its derivatives, which takes a tenth of a second.

        Args:
            phases: in order; at the end of the last one the arm rests, or leaves its line at speed.
            keeps_clear: whether clearances are given with each solution.
        """
        self.phases = tuple(phases)
        self._unknowns = Unknowns.of(self.phases, keeps_clear=keeps_clear)
        x = ca.MX.sym("x", self._unknowns.count)
        numbers = Numbers(self.phases, len(self._unknowns.shortfalls))
        made = (
            make(self.phases, self._unknowns, x, numbers)
            for make in (spline_rows, line_rows, speed_rows, height_rows, clearance_rows)
        )
        rows = [each for each in made if each is not None]
        f = ca.sum1(x[self._unknowns.durations.tolist()])
        if keeps_clear:
            f += SHORTFALL_PER_M * ca.sum1(x[self._unknowns.shortfalls.tolist()])
        g = ca.vertcat(*(each.g for each in rows))
        nlp = {"x": x, "p": numbers.all, "f": f, "g": g}
        self._low, self._high = (np.concatenate([each[i] for each in rows]) for i in (1, 2))
        self._one_at_a_time = threading.Lock()  # the solver says of its last call how it went
        self._solver = ca.nlpsol("motion", "ipopt", nlp, _OPTIONS | _derivatives(nlp, rows))

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
            guess: one for each phase, over as many intervals.
            task: what is asked for.
            arm: whose tip; may be None where nothing is asked of it.
            limits: of its joints.
            clearances: what to keep, for a program that keeps clear.
        """
        unit_s = max(sketch.duration_s for sketch in guess)
        low, high = self._bounds(limits)
        numbers = numbers_of(task, arm, limits, unit_s)
        x0 = self._start(guess, task, arm, unit_s).clip(low, high)
        if clearances is not None:
            bounds = clearances.weights.ravel(), clearances.numbers.ravel()
            numbers = np.concatenate([numbers, *bounds])
            for controls in self._unknowns.controls:
                near = controls[controls < self._unknowns.count]
                low[near] = np.maximum(low[near], x0[near] - clearances.trust_rad)
                high[near] = np.minimum(high[near], x0[near] + clearances.trust_rad)
        given = {"x0": x0, "p": numbers, "lbx": low, "ubx": high}
        with self._one_at_a_time:
            answer = self._solver(**given, lbg=self._low, ubg=self._high)
            if not self._solver.stats()["success"]:
                return None
        x = np.array(answer["x"]).ravel()
        x[self._unknowns.durations] *= unit_s
        return self._motions(x, task, limits)

    def _bounds(self, limits: JointLimits) -> tuple[FloatArray, FloatArray]:
        """Of the unknowns: controls within the limits, as then the motion is."""
        unknowns = self._unknowns
        low, high = np.zeros(unknowns.count), np.ones(unknowns.count)  # of fractions
        low[unknowns.durations], high[unknowns.durations] = SHORTEST, LONGEST
        high[unknowns.shortfalls] = MOST_SHORTFALL_M
        for controls in unknowns.controls:
            is_unknown = controls < unknowns.count
            for values, bounds in ((low, limits.q_min), (high, limits.q_max)):
                values[controls[is_unknown]] = np.broadcast_to(bounds, controls.shape)[is_unknown]
        for phase, fractions in zip(self.phases, unknowns.fractions, strict=True):
            if fractions is not None:
                low[fractions[[0, -1]]] = high[fractions[[0, -1]]] = phase.ends
        return low, high

    def _start(
        self, guess: Sequence[Sketch], task: MotionTask, arm: Arm | None, unit_s: float
    ) -> FloatArray:
        """The unknowns of a guess."""
        unknowns = self._unknowns
        x = np.zeros(unknowns.count)
        x[unknowns.durations] = [sketch.duration_s / unit_s for sketch in guess]
        for k, (phase, sketch) in enumerate(zip(self.phases, guess, strict=True)):
            controls = unknowns.controls[k]
            is_unknown = controls < unknowns.count
            x[controls[is_unknown]] = sketch.controls[is_unknown]
            fractions = unknowns.fractions[k]
            if fractions is not None and phase.line is not None and arm is not None:
                line = task.lines[phase.line]
                x[fractions] = [line.nearest(arm.T_base_tip(q)) for q in sketch.q]
        return x

    def _motions(
        self, x: FloatArray, task: MotionTask, limits: JointLimits
    ) -> tuple[Trajectory, ...]:
        """What the unknowns say, slowed down by what rounding leaves outside the limits."""
        known = np.concatenate([x, *ends_of(task)])
        controls = [known[where] for where in self._unknowns.controls]
        durations = x[self._unknowns.durations]
        splines = list(zip(controls, durations.tolist(), strict=True))
        peaks = np.max([trajectory_of(c, t, limits).peak_ratios() for c, t in splines], axis=0)
        slower = max(1.0, *(peaks ** np.array([1.0, 1 / 2, 1 / 3])).tolist())
        return tuple(trajectory_of(c, t * slower, limits) for c, t in splines)


def _derivatives(nlp: dict[str, ca.MX], rows: Sequence[Rows]) -> dict[str, ca.Function]:
    """Those that IPOPT asks for."""
    x, f, g = nlp["x"], nlp["f"], nlp["g"]
    given = [x, nlp["p"]]
    multipliers, weight = ca.MX.sym("multipliers", g.shape[0]), ca.MX.sym("weight")
    sizes = np.cumsum([0, *(each.g.shape[0] for each in rows)]).tolist()
    parts = ca.vertsplit(multipliers, sizes)
    hessian = sum(
        (each.hessian(part) for each, part in zip(rows, parts, strict=True)),
        start=ca.MX(*x.shape[:1] * 2),
    )
    jacobian = ca.vertcat(*(each.jacobian for each in rows))
    gradient = ca.densify(ca.jacobian(f, x).T)
    return {
        "grad_f": ca.Function("grad_f", given, [f, gradient]),
        "jac_g": ca.Function("jac_g", given, [g, jacobian]),
        "hess_lag": ca.Function("hess_lag", [*given, weight, multipliers], [hessian]),
    }
