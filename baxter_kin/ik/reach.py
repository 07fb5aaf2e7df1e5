"""Proofs that a pose is out of an arm's reach: sound geometry, by how far, and from which bound.

A proof never errs: a pose that the arm reaches inside its limits has none. The converse does not
hold; `None` says nothing. Bounds, cheapest first (letters as in `baxter_kin.ik.linkage`):

- *span, fold*: the pose fixes the wrist W, and |W - S| lies between the lengths that upper arm and
  forearm span straight and fully bent, for S anywhere on its arc about the s0 axis.
- *shoulder, wrist*: no angle of s0 leaves s1, e1 and w1 inside their limits (`ShoulderSweep`).
- *limits*: no angles of s0 and w0 leave all joints inside their limits (`PoseSweep`).

For a position in any orientation, the tip takes the wrist's place and only the outer bounds remain.
For a pose that may be turned a little, the wrist keeps *span* and *fold*, less how far it can get.
Collisions play no part.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.arrays import Vector, finite_array
from baxter_kin.errors import PoseError
from baxter_kin.ik.linkage import FAR_M, Linkage
from baxter_kin.ik.pose_sweep import MANY_SURVIVORS, MOST_SURVIVORS, PoseSweep
from baxter_kin.ik.position_sweep import PositionSweep
from baxter_kin.ik.shoulder_sweep import MARGIN_M, ShoulderSweep
from baxter_kin.ik.uncertain import Flags
from baxter_kin.model import JOINTS, Arm

RADII_M = np.array([1e-5, 1e-4, 3e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1])
"""Distances that the sweeps can certify; the largest that holds is reported."""

DECISION_LEVELS, MEASURE_LEVELS = 5, 1
"""How often the sweep splits its cells: to decide, down to 0.1 mrad; to measure, sparingly."""


@dataclass(frozen=True, slots=True)
class ReachProof:
    """That a pose is out of reach, and why; `str()` of it is the clause in words.

    Attributes:
        excess_m: a lower bound, above zero, on how far the pose must be moved, keeping its
            orientation, before the arm reaches it. For a position: in any orientation.
        bound: what it follows from: "span", "fold", "shoulder", "wrist" or "limits".
        text: a clause with numbers, such as "12 mm beyond the 0.745 m that upper arm and forearm
            span from left_s1, with the wrist at (1.021, 0.305, 0.214) m".
    """

    excess_m: float
    bound: str
    text: str

    def __str__(self) -> str:
        return self.text

    def less(self, leeway_m: float) -> ReachProof | None:
        """What is left of it where the pose may give way by so much; None when nothing is."""
        if leeway_m == 0.0:
            return self
        if self.excess_m <= leeway_m:
            return None
        text = f"{self.text}, and no more than {_length_up(leeway_m)} can be made up"
        return ReachProof(self.excess_m - leeway_m, self.bound, text)


class ReachBound:
    """How far one arm reaches.

    Attributes:
        radius_m: the greatest distance of the tip from the joint below, in any orientation.
        T_last_tip: the tip seen from the last axis: z along it, origin the wrist.
        joint_name: the second joint, such as "left_s1".
    """

    def __init__(self, arm: Arm) -> None:
        """Read the arm's dimensions.

        Raises:
            DescriptionError: when the model is not built like Baxter's.
        """
        self._arm = Linkage.of(arm)
        self._sweep, self._pose_sweep = ShoulderSweep(self._arm), PoseSweep(self._arm)
        self._name = dict(zip(JOINTS, arm.joint_names, strict=True))
        self.joint_name = self._name["s1"]
        self._span_m = self._arm.wrist_distance_m(0.0)
        self._fold_m = self._arm.wrist_distance_m(self._arm.max_bend)
        self._position_sweep = PositionSweep(self._arm)
        self.T_last_tip = self._arm.T_last_tip
        self.radius_m = self._arm.upper_span_m + self._arm.tip_distance_m(0.0)
        self._wrist_margin_m = MARGIN_M + self._arm.deviation.wrist_m
        self._tip_margin_m = MARGIN_M + self._arm.deviation.tip_m
        low, high = self._arm.q_min[0], self._arm.q_max[0]
        self._s0_middle, self._s0_half = 0.5 * (low + high), 0.5 * (high - low)

    def proof(
        self, T_base_tip: pin.SE3, *, is_roll_free: bool = False, is_thorough: bool = False
    ) -> ReachProof | None:
        """Why the arm cannot reach a pose, or None when that is not proved.

        Args:
            T_base_tip: the tip seen from base, as `checked_pose` returns it.
            is_roll_free: whether the proof shall cover every rotation about the last joint's axis.
            is_thorough: whether it may take half a second.

        Raises:
            PoseError: when the pose is not finite.
        """
        target, where = self._target(T_base_tip)
        proof = self._shell_proof(target, where) or self._sweep_proof(target, where)
        if proof or is_roll_free:
            return proof
        return self._limits_proof(target, where, MANY_SURVIVORS if is_thorough else MOST_SURVIVORS)

    def are_proven(self, Ts: Vector, levels: int = DECISION_LEVELS) -> Flags:
        """Which poses are out of reach by any bound but "limits", proven for many at a time.

        Args:
            Ts: finite poses as matrices, shape (m, 4, 4).
            levels: how many sizes of cells to try; one takes 15 us for each pose and proves most,
                all of them take 300 us.

        Returns:
            Shape (m,).
        """
        targets = self._arm.targets(Ts)
        proven = self._are_outside(targets)
        left = targets[~proven]
        radii_m = np.full(len(left), RADII_M[0])
        proven[~proven] = self._sweep.exclusions(left, radii_m, levels).is_proven
        return proven

    def are_beyond_limits(self, Ts: Vector) -> Flags:
        """Which poses are out of reach by the bound "limits": some milliseconds for each.

        Args:
            Ts: finite poses as matrices, shape (m, 4, 4).

        Returns:
            Shape (m,).
        """
        targets, radius_m = self._arm.targets(Ts), float(RADII_M[0])
        return np.array([self._pose_sweep.excludes(T, radius_m) for T in targets], np.bool_)

    def proof_of_wrist(self, T_base_tip: pin.SE3) -> ReachProof | None:
        """Why the wrist cannot be where a pose puts it, by the bounds "span" and "fold" alone.

        They hold whatever the tool's orientation: `excess_m` is how far the wrist must be moved.

        Args:
            T_base_tip: the tip seen from base, as `checked_pose` returns it.

        Raises:
            PoseError: when the pose is not finite.
        """
        return self._shell_proof(*self._target(T_base_tip))

    def are_outside_shells(self, Ts: Vector) -> Flags:
        """Which poses the bounds "span" and "fold" alone prove out of reach, at a glance.

        Args:
            Ts: finite poses as matrices, shape (m, 4, 4).

        Returns:
            Shape (m,).
        """
        return self._are_outside(self._arm.targets(Ts))

    def _are_outside(self, targets: Vector) -> Flags:
        beyond_m, within_m = self._shell_excess_m(targets[:, :3, 3])
        outside: Flags = (beyond_m > 0.0) | (within_m > 0.0)
        return outside

    def proof_of_position(self, p_base_tip: ArrayLike) -> ReachProof | None:
        """Why the tip cannot get to a position in any orientation, or None when that is not proved.

        Args:
            p_base_tip: shape (3,), m, in base.

        Raises:
            PoseError: when the position has another shape or is not finite.
        """
        p = finite_array(p_base_tip, (3,), "p_base_tip", PoseError)
        point = self._arm.T_base_first.actInv(p)
        where = f"with the tip at {_words(p)}"
        nearest_m = float(self._shoulder_distances(point[None])[0][0])
        excess_m = nearest_m - self.radius_m - self._tip_margin_m
        if excess_m > 0.0:
            most_m = self.radius_m + self._arm.deviation.tip_m
            return self._span_proof(excess_m, most_m, "the straight arm spans", where)
        excess_m = self._position_sweep.excess_m(point) - self._tip_margin_m
        if excess_m <= 0.0:
            return None
        most_m = self._position_sweep.tip_reach_m + self._arm.deviation.tip_m
        text = (
            f"{_length(excess_m)} beyond the {most_m:.3f} m that "
            f"forearm and hand span from where {self._name['s0']} and {self._name['s1']} let the "
            f"elbow go, {where}"
        )
        return ReachProof(excess_m, "shoulder", text)

    def _target(self, T_base_tip: pin.SE3) -> tuple[Vector, str]:
        """Where a pose puts the last axis, shape (4, 4), and the wrist in words."""
        T = T_base_tip.homogeneous
        if not np.isfinite(T).all():
            raise PoseError("a pose must be finite to be judged in or out of reach")
        wrist_base = T_base_tip.act(self.T_last_tip.inverse().translation)
        return self._arm.targets(T[None])[0], f"with the wrist at {_words(wrist_base)}"

    def _shoulder_distances(self, points: Vector) -> tuple[Vector, Vector]:
        """The least and the greatest distance of points, (m, 3), to S over all angles of s0.

        The distance grows with the angle between `radial` and the point's azimuth, up to half a
        turn, so that each extreme lies at an end of the range or where that angle is 0 or pi.
        """
        (x, y, z), offset = points.T.clip(-FAR_M, FAR_M), self._arm.shoulder_offset_m
        radius = np.hypot(x, y)
        turn = np.arctan2(y, x) - self._s0_middle
        off = np.abs(np.arctan2(np.sin(turn), np.cos(turn)))
        least, most = (off - self._s0_half).clip(min=0.0), (off + self._s0_half).clip(max=np.pi)

        def distance(angle: Vector) -> Vector:
            radially, sideways = radius * np.cos(angle) - offset, radius * np.sin(angle)
            length: Vector = np.hypot(np.hypot(radially, sideways), z)
            return length

        return distance(least), distance(most)

    def _shell_excess_m(self, wrists: Vector) -> tuple[Vector, Vector]:
        """How far wrists, (m, 3), lie beyond the span, and how far inside the fold."""
        near, far = self._shoulder_distances(wrists)
        return near - self._span_m - self._wrist_margin_m, self._fold_m - far - self._wrist_margin_m

    def _shell_proof(self, target: Vector, where: str) -> ReachProof | None:
        beyond_m, within_m = (float(x[0]) for x in self._shell_excess_m(target[None, :3, 3]))
        if beyond_m > 0.0:
            most_m = self._span_m + self._arm.deviation.wrist_m
            return self._span_proof(beyond_m, most_m, "upper arm and forearm span", where)
        if within_m <= 0.0:
            return None
        least_m = self._fold_m - self._arm.deviation.wrist_m
        text = (
            f"{_length(within_m)} inside the {least_m:.3f} m that the wrist keeps from "
            f"{self.joint_name} with {self._name['e1']} fully bent, {where}"
        )
        return ReachProof(within_m, "fold", text)

    def _span_proof(self, excess_m: float, span_m: float, spanned: str, where: str) -> ReachProof:
        text = (
            f"{_length(excess_m)} beyond the {span_m:.3f} m that {spanned} from "
            f"{self.joint_name}, {where}"
        )
        return ReachProof(excess_m, "span", text)

    def _sweep_proof(self, target: Vector, where: str) -> ReachProof | None:
        found = self._sweep.exclusions(target[None], RADII_M[:1], DECISION_LEVELS)
        if not found.is_proven[0]:
            return None
        radius_m, needs_wrist = float(RADII_M[0]), bool(found.needs_wrist[0])
        targets = np.broadcast_to(target, (len(RADII_M) - 1, 4, 4))
        wider = self._sweep.exclusions(targets, RADII_M[1:], MEASURE_LEVELS)
        if wider.is_proven.any():
            last = int(np.flatnonzero(wider.is_proven)[-1])
            radius_m, needs_wrist = float(RADII_M[1 + last]), bool(wider.needs_wrist[last])
        s0, s1, e1, w1 = (self._name[joint] for joint in ("s0", "s1", "e1", "w1"))
        reachable = f"the limits of {s0}, {s1} and {e1} let the wrist go"
        if needs_wrist:
            reachable = (
                f"{w1} can hold the tool in this orientation with {s0}, {s1} and {e1} inside "
                "their limits"
            )
        text = f"at least {_length(radius_m)} from where {reachable}, {where}"
        return ReachProof(radius_m, "wrist" if needs_wrist else "shoulder", text)

    def _limits_proof(self, target: Vector, where: str, most_cells: int) -> ReachProof | None:
        radius_m, *wider = RADII_M.tolist()
        if not self._pose_sweep.excludes(target, radius_m, most_cells):
            return None
        for wider_m in wider:
            if not self._pose_sweep.excludes(target, wider_m):
                break
            radius_m = wider_m
        text = (
            f"at least {_length(radius_m)} from where the limits of all joints together let the "
            f"tool be in this orientation, {where}"
        )
        return ReachProof(radius_m, "limits", text)


def _words(p_base: Vector) -> str:
    return "({:.6g}, {:.6g}, {:.6g}) m".format(*(round(x, 3) + 0.0 for x in p_base.tolist()))


def _length_up(length_m: float) -> str:
    """The length, rounded up."""
    return f"{math.ceil(1e3 * length_m)} mm"


def _length(length_m: float) -> str:
    """The length, rounded down so that the words claim no more than the proof."""
    if length_m >= 10.0:
        return f"{length_m:.6g} m"
    digits = 0 if length_m >= 0.01 else 1 if length_m >= 1e-3 else 3
    scale = 10.0**digits
    return f"{math.floor(1e3 * length_m * scale) / scale:.{digits}f} mm"
