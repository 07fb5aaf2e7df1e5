"""Inverse kinematics as a nonlinear program, and its reference solver: IPOPT through CasADi.

```
minimise    1/2 |q - q_seed|^2
subject to  p(q) - p_target = 0                        (3)
            2 vec(conj(h_target) h(q)) = 0             (3)
            q_min <= q <= q_max
```

`h` is the tip's unit quaternion, a product of joint quaternions and so smooth in `q`. The vector
part of the relative quaternion is `sin(angle / 2) axis`: it vanishes only if both rotations are
equal, unlike the skew part of the relative rotation matrix, which also vanishes at half a turn.
To first order, twice the vector part is the rotation vector.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from baxter_kin.display import count
from baxter_kin.errors import RequestError
from baxter_kin.fields import frozen
from baxter_kin.frames import quaternion_xyzw
from baxter_kin.ik.result import ORIENTATION_TOLERANCE_RAD
from baxter_kin.ik.search.search_function import CONVERGED_M, CONVERGED_RAD, INSET, task_coordinates
from baxter_kin.ik.search.searcher import Backend, Found, search_from_setpoints
from baxter_kin.ik.seeds import NullSpaceMap
from baxter_kin.ik.tolerance import EXACT, Task, Tolerance
from baxter_kin.kinematics.arm import Arm
from baxter_kin.kinematics.symbolic import SymbolicArm, quaternion_product
from baxter_kin.validation import FloatArray, expect

MAX_ITERATIONS = 100

NEAREST_STARTS = 2
"""Number of starts besides the best attempt. Of 145 poses up to 1 cm out of reach, that attempt led
to the nearest position of any of seven starts for 116, and the first other start for the rest."""

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


@frozen(error=RequestError)
class Program:
    """The nonlinear program of one arm.

    Attributes:
        q: decision variables, 7 x 1, rad.
        parameters: p_target (3), h_target in x, y, z, w order (4), q_seed (7).
        objective: half the squared distance to the seed.
        pose_error: the constrained quantities, n x 1, m and rad.
        widths: their allowed absolute values, shape (n,).
    """

    q: ca.SX
    parameters: ca.SX
    objective: ca.SX
    pose_error: ca.SX
    widths: FloatArray

    @classmethod
    def of(cls, arm: Arm, tolerance: Tolerance = EXACT, *, is_nearest: bool = False) -> Program:
        """The program of an arm.

        With a tolerance, the errors are the coordinates of the deviation that it bounds, along and
        about the axes of the requested tip frame. For a cone, the two coordinates of the tilt are
        replaced by the square of its length divided by the width, which equals the width where the
        length does.

        Args:
            arm: the arm whose tip is placed.
            tolerance: how far the tip may be from the pose.
            is_nearest: whether to search for the position nearest to the requested one in the
                requested orientation: the orientation alone is constrained, and the objective is
                half the squared distance in millimetres.
        """
        expect(arm, Arm, "arm", RequestError)
        expect(tolerance, Tolerance, "tolerance", RequestError)
        expect(is_nearest, bool, "is_nearest", RequestError)
        if is_nearest and tolerance != EXACT:
            raise RequestError("the nearest position is that of an exact pose; omit the tolerance")
        kinematics = SymbolicArm.of(arm)
        q, q_seed = kinematics.q, ca.SX.sym("q_seed", 7)
        p_target, h_target = ca.SX.sym("p_target", 3), ca.SX.sym("h_target", 4)
        if tolerance == EXACT:
            conjugate = ca.vertcat(-h_target[:3], h_target[3])
            rotation_error = 2 * quaternion_product(conjugate, kinematics.quat_xyzw)[:3]
            error = ca.vertcat(kinematics.p_base_tip - p_target, rotation_error)
            widths = np.zeros(6)
        else:
            T = ca.horzcat(_rotation(h_target), p_target)
            error, widths = _bounded_error(kinematics, T, Task.of(arm, tolerance))
        objective = ca.sumsqr(q - q_seed) / 2
        if is_nearest:
            objective = ca.sumsqr(1e3 * error[:3]) / 2
            error, widths = error[3:], widths[3:]
        return cls(q, ca.vertcat(p_target, h_target, q_seed), objective, error, widths)

    def _facts(self) -> tuple[str, ...]:
        return count(self.q.numel(), "joint"), count(self.parameters.numel(), "parameter")


def _bounded_error(kinematics: SymbolicArm, T: ca.SX, task: Task) -> tuple[ca.SX, FloatArray]:
    """The deviation of a tip from a pose, 3 x 4, and its allowed absolute values."""
    columns = list(task.order)
    T_turned = ca.horzcat(T[:, columns], T[:, 3])
    R_turned = kinematics.R_base_tip[:, columns]
    roll_is_free = ca.SX(float(task.roll_is_free))
    error = task_coordinates(T_turned, kinematics.p_base_tip, R_turned, roll_is_free)
    *widths, cone = (task.widths - INSET).clip(min=0.0)
    if cone > 0.0:
        return ca.vertcat(error[:3], ca.sumsqr(error[3:]) / cone), np.array([*widths[:3], cone])
    return error, np.array(widths)


def _rotation(quat_xyzw: ca.SX) -> ca.SX:
    """The matrix of a unit quaternion, 3 x 3."""
    x, y, z, w = ca.vertsplit(quat_xyzw)
    return ca.blockcat(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


class IpoptSearcher:
    """The interior-point method of Waechter and Biegler (2006) on the program.

    It is slow but reliable, and minimises the distance to the start. With `is_nearest`, it
    minimises the distance to the position: for a pose slightly out of reach, on which every other
    search fails, it ends at the nearest reachable position.

    Attributes:
        backend: `IPOPT`.
        fine_rounds: as of `Search`.
        scattered_starts: zero.
    """

    backend = Backend.IPOPT
    fine_rounds: tuple[int, ...] = (1,) * 8
    scattered_starts: int = 0

    def __init__(
        self,
        arm: Arm,
        starts: NullSpaceMap,
        tolerance: Tolerance = EXACT,
        *,
        is_nearest: bool = False,
    ) -> None:
        """Prepare the derivatives of the program.

        Args:
            arm: the arm whose tip is placed.
            starts: the starts without a seed, and for the nearest position.
            tolerance: of the tip.
            is_nearest: as of `Program.of`.
        """
        self._arm, self._starts, self._tolerance = arm, starts, tolerance
        self._more_starts = NEAREST_STARTS if is_nearest else 0
        program = Program.of(arm, tolerance, is_nearest=is_nearest)
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
        """Run searches one after the other; arguments and result as of `Searcher.search`.

        For the nearest position, each result is the best of the given start and of `NEAREST_STARTS`
        others.
        """
        limits = self._arm.limits
        low, high = (limits.q_min, limits.q_max) if bounds is None else np.split(bounds, 2)
        starts = q_starts[:, None]
        if self._more_starts:
            others = self._starts.fine(Ts, self._more_starts)
            starts = np.concatenate([starts, others], axis=1)
        rows = [
            self._best(each, pin.SE3(T[:3, :3], T[:3, 3]), low, high)
            for each, T in zip(starts, Ts, strict=True)
        ]
        q, offset, angle, iterations = (np.array(column) for column in zip(*rows, strict=True))
        is_valid = (offset <= CONVERGED_M) & (angle <= CONVERGED_RAD)
        return Found(q, is_valid, offset, angle, iterations)

    def search_from_map(self, Ts: FloatArray) -> Found:
        """Search for poses, shape (m, 4, 4), each from its nearest setpoints in turn."""
        return search_from_setpoints(self, self._starts, Ts)

    def _best(
        self, q_starts: FloatArray, T: pin.SE3, low: FloatArray, high: FloatArray
    ) -> tuple[FloatArray, float, float, int]:
        """The nearest of the results in the requested orientation, or else of all results."""
        found = [self._search(q_start, T, low, high) for q_start in q_starts]
        return min(found, key=lambda row: (row[2] > ORIENTATION_TOLERANCE_RAD, row[1] + row[2]))

    def _search(
        self, q_start: FloatArray, T: pin.SE3, low: FloatArray, high: FloatArray
    ) -> tuple[FloatArray, float, float, int]:
        solution = self._solve(
            x0=q_start,
            p=np.concatenate([T.translation, quaternion_xyzw(T), q_start]),
            lbx=low,
            ubx=high,
            lbg=-self._widths,
            ubg=self._widths,
        )
        q = np.clip(np.array(solution["x"]).ravel(), low, high)
        offset, angle = self._tolerance.excess(T, self._arm.T_base_tip(q))
        return q, offset, angle, int(self._solve.stats()["iter_count"])
