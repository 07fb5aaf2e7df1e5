"""Inverse kinematics as a nonlinear program, and its reference solver: IPOPT through CasADi.

```
minimise    1/2 |q - q_seed|^2
subject to  p(q) - p_target = 0                        (3)
            2 vec(conj(h_target) h(q)) = 0             (3)
            q_min <= q <= q_max
```

`h` is the tip's unit quaternion, a product of joint quaternions and so smooth in `q`. The vector
part of the relative quaternion is `sin(angle / 2) axis`: it vanishes only when both rotations are
equal, unlike the skew part of the relative rotation matrix, which also vanishes at half a turn.
Twice it is the rotation vector, to first order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from baxter_kin.errors import RequestError, expect
from baxter_kin.frames import quaternion_xyzw
from baxter_kin.ik.result import ORIENTATION_TOLERANCE_RAD
from baxter_kin.ik.search.buffered_search import Found
from baxter_kin.ik.search.exact_search import CONVERGED_M, CONVERGED_RAD
from baxter_kin.ik.search.searcher import Backend, search_from_setpoints
from baxter_kin.ik.search.task_search import INSET as TASK_INSET
from baxter_kin.ik.search.task_search import task_coordinates
from baxter_kin.ik.seeds import NullSpaceMap
from baxter_kin.ik.task import Task
from baxter_kin.ik.tolerance import EXACT, Tolerance
from baxter_kin.kinematics.arm import Arm
from baxter_kin.kinematics.symbolic import SymbolicArm, quaternion_product
from baxter_kin.validation import Checked, FloatArray
from baxter_kin.value_objects import OneLine, count

MAX_ITERATIONS = 100

NEAREST_STARTS = 2
"""Beside the best attempt. Of 145 poses up to 1 cm out of reach, that attempt led to the nearest
position that any of seven starts found for 116, and the first of the others for the rest."""

_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt": {
        "print_level": 0,
        "sb": "yes",  # no banner
        "tol": 1e-10,
        "constr_viol_tol": 1e-12,
        "acceptable_iter": 0,  # never stop at a merely acceptable point
        "bound_relax_factor": 0.0,  # the joint limits are hard
        "max_iter": MAX_ITERATIONS,
    },
}


@dataclass(frozen=True, slots=True, repr=False)
class Program(Checked, OneLine, error=RequestError):
    """The nonlinear program of one arm.

    Attributes:
        q: decision variables, 7 x 1, rad.
        parameters: p_target (3), h_target in x, y, z, w order (4), q_seed (7).
        objective: half the squared distance to the seed.
        pose_error: what is constrained, n x 1, m and rad.
        widths: how far it may be from zero, either way, shape (n,).
    """

    q: ca.SX
    parameters: ca.SX
    objective: ca.SX
    pose_error: ca.SX
    widths: FloatArray

    @classmethod
    def of(cls, arm: Arm) -> Program:
        """State the program of that arm.

        Raises:
            RequestError: when it is no arm.
        """
        expect(arm, Arm, "arm", RequestError)
        kinematics = SymbolicArm.of(arm)
        p_target, h_target = ca.SX.sym("p_target", 3), ca.SX.sym("h_target", 4)
        q_seed = ca.SX.sym("q_seed", 7)
        conjugate = ca.vertcat(-h_target[:3], h_target[3])
        rotation_error = 2 * quaternion_product(conjugate, kinematics.quat_xyzw)[:3]
        return cls(
            q=kinematics.q,
            parameters=ca.vertcat(p_target, h_target, q_seed),
            objective=ca.sumsqr(kinematics.q - q_seed) / 2,
            pose_error=ca.vertcat(kinematics.p_base_tip - p_target, rotation_error),
            widths=np.zeros(6),
        )

    @classmethod
    def of_nearest(cls, arm: Arm) -> Program:
        """State the program of coming as near to a position as an orientation allows.

        The orientation is constrained, the objective half the squared distance in millimetres.

        Raises:
            RequestError: when it is no arm.
        """
        program = cls.of(arm)
        return cls(
            q=program.q,
            parameters=program.parameters,
            objective=ca.sumsqr(1e3 * program.pose_error[:3]) / 2,
            pose_error=program.pose_error[3:],
            widths=np.zeros(3),
        )

    @classmethod
    def of_task(cls, arm: Arm, task: Task) -> Program:
        """State the program of that arm for a task: the error may be as large as its widths.

        The parameters are then the pose's matrix (16, column by column) and q_seed (7). Within a
        cone the two numbers of the tilt are replaced by the square of its length over the width,
        which is as large as the width where the length is.

        Raises:
            RequestError: when it is no arm, or no task.
        """
        expect(arm, Arm, "arm", RequestError)
        expect(task, Task, "task", RequestError)
        kinematics, T = SymbolicArm.of(arm), ca.SX.sym("T", 4, 4)
        q_seed, columns = ca.SX.sym("q_seed", 7), list(task.order)
        T_turned = ca.horzcat(T[:, columns], T[:, 3])
        R_turned = kinematics.R_base_tip[:, columns]
        roll_is_free = ca.SX(float(task.roll_is_free))
        error = task_coordinates(T_turned, kinematics.p_base_tip, R_turned, roll_is_free)
        *widths, cone = (task.widths - TASK_INSET).clip(min=0.0)
        if cone > 0.0:
            error = ca.vertcat(error[:3], ca.sumsqr(error[3:]) / cone)
            widths = [*widths[:3], cone]
        return cls(
            q=kinematics.q,
            parameters=ca.vertcat(ca.vec(T), q_seed),
            objective=ca.sumsqr(kinematics.q - q_seed) / 2,
            pose_error=error,
            widths=np.array(widths),
        )

    def _facts(self) -> tuple[str, ...]:
        return count(self.q.numel(), "joint"), count(self.parameters.numel(), "parameter")


class IpoptSearcher:
    """The interior-point method of Waechter and Biegler (2006) on the program.

    Slow and sure: it minimises the distance to the start, where the fast search only begins there.

    Attributes:
        backend: `IPOPT`.
        fine_rounds: how many starts computed with care it is given at once, round by round.
        scattered_starts: none.
    """

    backend = Backend.IPOPT
    fine_rounds: tuple[int, ...] = (1,) * 8
    scattered_starts: int = 0

    def __init__(self, arm: Arm, starts: NullSpaceMap, tolerance: Tolerance) -> None:
        """Prepare the program's derivatives.

        Args:
            arm: with the tip that is placed.
            starts: where to start when there is no seed.
            tolerance: how exactly.
        """
        self._arm, self._starts, self._tolerance = arm, starts, tolerance
        self._is_exact = tolerance == EXACT
        program = Program.of(arm) if self._is_exact else Program.of_task(arm, Task(tolerance))
        nlp = {
            "x": program.q,
            "p": program.parameters,
            "f": program.objective,
            "g": program.pose_error,
        }
        self._widths = program.widths
        self._solve = ca.nlpsol("ik", "ipopt", nlp, _OPTIONS)

    def search(
        self, q_starts: FloatArray, Ts: FloatArray, bounds: FloatArray | None = None
    ) -> Found:
        """Searches, one after the other; arguments and result as of `Searcher.search`."""
        limits = self._arm.limits
        low, high = (limits.q_min, limits.q_max) if bounds is None else np.split(bounds, 2)
        rows = [
            self._search(q_start, pin.SE3(T[:3, :3], T[:3, 3]), low, high)
            for q_start, T in zip(q_starts, Ts, strict=True)
        ]
        q, offset, angle, iterations = (np.array(column) for column in zip(*rows, strict=True))
        is_valid = (offset <= CONVERGED_M) & (angle <= CONVERGED_RAD)
        return Found(q, is_valid, offset, angle, iterations)

    def search_from_map(self, Ts: FloatArray) -> Found:
        """Searches for poses, shape (m, 4, 4), each from its nearest setpoints in turn."""
        return search_from_setpoints(self, self._starts, Ts)

    def _search(
        self, q_start: FloatArray, T: pin.SE3, low: FloatArray, high: FloatArray
    ) -> tuple[FloatArray, float, float, int]:
        pose = [T.translation, quaternion_xyzw(T)] if self._is_exact else [T.homogeneous.T.ravel()]
        solution = self._solve(
            x0=q_start,
            p=np.concatenate([*pose, q_start]),
            lbx=low,
            ubx=high,
            lbg=-self._widths,
            ubg=self._widths,
        )
        q = np.clip(np.array(solution["x"]).ravel(), low, high)
        offset, angle = self._tolerance.excess(T, self._arm.T_base_tip(q))
        return q, offset, angle, int(self._solve.stats()["iter_count"])


class NearestSearcher:
    """The interior-point method on the nearest position that an orientation allows.

    Where a pose is a little out of reach, no search for it ends well, and this one ends next to it.

    Attributes:
        backend: `IPOPT`.
        fine_rounds: none; it is given starts by itself.
        scattered_starts: none.
    """

    backend = Backend.IPOPT
    fine_rounds: tuple[int, ...] = ()
    scattered_starts: int = 0

    def __init__(self, arm: Arm, starts: NullSpaceMap) -> None:
        """Prepare the program's derivatives.

        Args:
            arm: with the tip that is placed.
            starts: where to start beside what is given.
        """
        self._arm, self._starts = arm, starts
        program = Program.of_nearest(arm)
        nlp = {"x": program.q, "p": program.parameters, "f": program.objective}
        self._solve = ca.nlpsol("nearest", "ipopt", {**nlp, "g": program.pose_error}, _OPTIONS)

    def search(
        self, q_starts: FloatArray, Ts: FloatArray, bounds: FloatArray | None = None
    ) -> Found:
        """The nearest that was found from each start and from `NEAREST_STARTS` others.

        Arguments and result as of `Searcher.search`; valid is what reaches the pose.
        """
        limits = self._arm.limits
        low, high = (limits.q_min, limits.q_max) if bounds is None else np.split(bounds, 2)
        others = self._starts.fine.starts(Ts, NEAREST_STARTS)
        rows = [
            self._nearest([q_start, *more], pin.SE3(T[:3, :3], T[:3, 3]), low, high)
            for q_start, more, T in zip(q_starts, others, Ts, strict=True)
        ]
        q, offset, angle, iterations = (np.array(column) for column in zip(*rows, strict=True))
        is_valid = (offset <= CONVERGED_M) & (angle <= CONVERGED_RAD)
        return Found(q, is_valid, offset, angle, iterations)

    def search_from_map(self, Ts: FloatArray) -> Found:
        """The same from the setpoint nearest to each pose."""
        return self.search(self._starts.setpoints[self._starts.nearest(Ts)[:, 0]], Ts)

    def _nearest(
        self, q_starts: list[FloatArray], T: pin.SE3, low: FloatArray, high: FloatArray
    ) -> tuple[FloatArray, float, float, int]:
        """Of those that have the orientation the nearest, else the best."""
        found = [self._search(q_start, T, low, high) for q_start in q_starts]
        return min(found, key=lambda row: (row[2] > ORIENTATION_TOLERANCE_RAD, row[1] + row[2]))

    def _search(
        self, q_start: FloatArray, T: pin.SE3, low: FloatArray, high: FloatArray
    ) -> tuple[FloatArray, float, float, int]:
        pose = T.translation, quaternion_xyzw(T), q_start
        solution = self._solve(
            x0=q_start, p=np.concatenate(pose), lbx=low, ubx=high, lbg=0.0, ubg=0.0
        )
        q = np.clip(np.array(solution["x"]).ravel(), low, high)
        offset, angle = EXACT.excess(T, self._arm.T_base_tip(q))
        return q, offset, angle, int(self._solve.stats()["iter_count"])
