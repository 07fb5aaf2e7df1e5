"""Proofs that a pose is out of an arm's reach, with a lower bound on the distance and its cause.

A proof is never wrong: a pose that the arm reaches inside its limits has none. The converse does
not hold; None has no meaning. The bounds are, cheapest first (letters as in
`baxter_kin.ik.reach.linkage`):

- *span, fold* (`Shells`): the pose determines the wrist W, and |W - S| lies between the lengths
  that upper arm and forearm span straight and fully bent, for S anywhere on its arc about the s0
  axis.
- *shoulder, wrist* (`ShoulderSweep`): no angle of s0 leaves s1, e1 and w1 inside their limits.
- *limits* (`PoseSweep`): no angles of s0 and w0 leave all joints inside their limits.

For a position in any orientation, the tip takes the place of the wrist, at most a hand farther, and
only the outer bounds remain. For a pose with a tolerance on its rotation, *span* and *fold* hold
for the wrist, less the distance by which the rotation can move it. Collisions are not considered.

*Positions* (`PositionSweep`): let v be the point seen from S. For one angle of s0, the elbow lies
on the sphere of radius |E - S| about S, within `elbow_angle` of the arc that u sweeps with s1 in
the vertical plane of s0. The tip is at most `tip_distance_m(0)` from the elbow. So the distance of
v from that part of the sphere, less that length, is a lower bound on its distance from the reach.
Turning s0 by an angle moves v, seen from the arm, by at most the angle times the point's distance
from the s0 axis: evaluated at the middles of cells, less that slack, the bound holds for all
angles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin.fields import evolve
from baxter_kin.ik.reach.linkage import FAR_M, Linkage
from baxter_kin.ik.reach.pose_sweep import MAX_SURVIVORS, MAX_SURVIVORS_IF_THOROUGH, PoseSweep
from baxter_kin.ik.reach.shoulder_sweep import SWEEP_MARGIN_M, Flags, ShoulderSweep
from baxter_kin.ik.tolerance import EXACT, Tolerance
from baxter_kin.kinematics.arm import JOINTS, Arm
from baxter_kin.validation import FloatArray

CELLS, SPLIT, LEVELS = 32, 8, 3
"""The range of s0 starts as 32 cells; those that may contain the smallest distance are split in
eight, down to 1.7 mrad."""

_OF_POSES = {
    "span": "{excess} beyond the {length_m:.3f} m that upper arm and forearm span from {s1}",
    "fold": "{excess} inside the {length_m:.3f} m that the wrist keeps from {s1} with {e1} fully "
    "bent",
    "shoulder": "at least {excess} from where the limits of {s0}, {s1} and {e1} let the wrist go",
    "wrist": "at least {excess} from where {w1} can hold the tool in this orientation with {s0}, "
    "{s1} and {e1} inside their limits",
    "limits": "at least {excess} from where the limits of all joints together let the tool be in "
    "this orientation",
}

_OF_POSITIONS = {
    "span": "{excess} beyond the {length_m:.3f} m that the straight arm spans from {s1}",
    "shoulder": "{excess} beyond the {length_m:.3f} m that forearm and hand span from where {s0} "
    "and {s1} let the elbow go",
}

RADII_M = np.array([1e-5, 1e-4, 3e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1])
"""Distances that the sweeps can prove; the largest that holds is reported."""

DECISION_LEVELS, MEASURE_LEVELS = 5, 1
"""Numbers of cell sizes in the sweep: to decide, down to 0.1 mrad; to measure, only one."""

_COAXIAL = 1e-9  # tolerance (m, and of a unit vector) of an axis that is the last joint's


class PositionSweep:
    """The sweep over s0 for positions of one arm's tip."""

    def __init__(self, linkage: Linkage) -> None:
        self._arm = linkage
        self._upper = linkage.upper_span_m
        self.tip_reach_m = linkage.tip_distance_m(0.0)
        self._s1_middle = 0.5 * (linkage.q_min[1] + linkage.q_max[1])
        self._s1_half = 0.5 * (linkage.q_max[1] - linkage.q_min[1])
        self._offsets = (2.0 * np.arange(SPLIT) + 1.0) / SPLIT - 1.0

    def excess_m(self, point: FloatArray) -> float:
        """A lower bound on the distance of the tip from a point; negative if nothing is proven.

        Args:
            point: seen from the first axis, shape (3,), m; finite.
        """
        low, high = self._arm.q_min[0], self._arm.q_max[0]
        half = (high - low) / (2 * CELLS)
        s0 = np.linspace(low + half, high - half, CELLS)
        radius, settled = math.hypot(point[0], point[1]), math.inf
        for _ in range(LEVELS):
            excess = self._excess_at(s0, point)
            bounds = excess - radius * half
            is_open = bounds < excess.min()
            if not is_open.any():
                break
            settled = min(settled, float(bounds[~is_open].min(initial=math.inf)))
            s0 = (s0[is_open, None] + half * self._offsets).ravel()
            half /= SPLIT
        return min(settled, float(bounds.min()))

    def _excess_at(self, s0: FloatArray, point: FloatArray) -> FloatArray:
        """The bound at single angles of s0, shape (n,)."""
        x, y, z = point.tolist()
        radially = x * np.cos(s0) + y * np.sin(s0) - self._arm.shoulder_offset_m
        sideways = y * np.cos(s0) - x * np.sin(s0)
        in_plane = np.hypot(radially, z)
        distance = np.hypot(in_plane, sideways)
        turn = -np.arctan2(z, radially) - self._s1_middle
        past = np.abs(np.remainder(turn + math.pi, 2.0 * math.pi) - math.pi) - self._s1_half
        along = in_plane * np.cos(np.maximum(past, 0.0))
        angle = np.arctan2(np.sqrt(np.maximum(distance**2 - along**2, 0.0)), along)
        off = np.maximum(angle - self._arm.elbow_angle, 0.0)
        to_elbow = np.hypot(distance - self._upper * np.cos(off), self._upper * np.sin(off))
        excess: FloatArray = to_elbow - self.tip_reach_m
        return excess


class Shells:
    """Bounds by the lengths of one arm; excesses are lower bounds.

    Attributes:
        span_m: |W - S| with the arm straight, plus the deviation from the linkage.
        fold_m: the same fully bent, minus the deviation.
        radius_m: |tip - S| with the arm straight, plus the deviation.
        tip_reach_m: |tip - E| with forearm and hand straight, plus the deviation.
    """

    def __init__(self, linkage: Linkage) -> None:
        self._arm, deviation = linkage, linkage.deviation
        self._span_m = linkage.wrist_distance_m(0.0)
        self._fold_m = linkage.wrist_distance_m(linkage.max_bend)
        self._radius_m = linkage.upper_span_m + linkage.tip_distance_m(0.0)
        self._position_sweep = PositionSweep(linkage)
        self.span_m = self._span_m + deviation.wrist_m
        self.fold_m = self._fold_m - deviation.wrist_m
        self.radius_m = self._radius_m + deviation.tip_m
        self.tip_reach_m = self._position_sweep.tip_reach_m + deviation.tip_m
        self._wrist_margin_m = SWEEP_MARGIN_M + deviation.wrist_m
        self._tip_margin_m = SWEEP_MARGIN_M + deviation.tip_m
        low, high = linkage.q_min[0], linkage.q_max[0]
        self._s0_middle, self._s0_half = 0.5 * (low + high), 0.5 * (high - low)

    def wrist_excess_m(self, wrists: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distances of wrists, (m, 3), beyond the span, and inside the fold, (m,) each."""
        near, far = self._distances(wrists)
        return near - self._span_m - self._wrist_margin_m, self._fold_m - far - self._wrist_margin_m

    def tip_excess_m(self, point: FloatArray) -> float:
        """Distance of a tip, (3,), beyond the straight arm."""
        nearest_m = float(self._distances(point[None])[0][0])
        return nearest_m - self._radius_m - self._tip_margin_m

    def elbow_excess_m(self, point: FloatArray) -> float:
        """Distance of a tip, (3,), beyond forearm and hand from the places that E can reach."""
        return self._position_sweep.excess_m(point) - self._tip_margin_m

    def _distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The smallest and the largest distance of points, (m, 3), from S over all angles of s0.

        The distance grows with the angle between `radial` and the point's azimuth, up to half a
        turn, so that each extreme lies at an end of the range or where that angle is 0 or pi.
        """
        (x, y, z), offset = points.T.clip(-FAR_M, FAR_M), self._arm.shoulder_offset_m
        radius = np.hypot(x, y)
        turn = np.arctan2(y, x) - self._s0_middle
        off = np.abs(np.arctan2(np.sin(turn), np.cos(turn)))
        least, most = (off - self._s0_half).clip(min=0.0), (off + self._s0_half).clip(max=np.pi)

        def distance(angle: FloatArray) -> FloatArray:
            radially, sideways = radius * np.cos(angle) - offset, radius * np.sin(angle)
            length: FloatArray = np.hypot(np.hypot(radially, sideways), z)
            return length

        return distance(least), distance(most)


@dataclass(frozen=True, slots=True)
class ReachProof:
    """A proof that a pose is out of reach; `str()` of it is a clause.

    Attributes:
        excess_m: a lower bound, above zero, on the distance by which the pose must be moved,
            keeping its orientation, before the arm reaches it. For a position: in any orientation.
        bound: the bound that it uses: "span", "fold", "shoulder", "wrist" or "limits".
        text: a clause with numbers, such as "12 mm beyond the 0.745 m that upper arm and forearm
            span from left_s1, with the wrist at (1.021, 0.305, 0.214) m".
    """

    excess_m: float
    bound: str
    text: str

    def __str__(self) -> str:
        return self.text

    def less(self, leeway_m: float) -> ReachProof | None:
        """The proof for a pose that may be moved by a distance; None if nothing is proven then."""
        if leeway_m == 0.0:
            return self
        if self.excess_m <= leeway_m:
            return None
        text = f"{self.text}, and no more than {_length_up(leeway_m)} can be made up"
        return ReachProof(self.excess_m - leeway_m, self.bound, text)

    @classmethod
    def of(
        cls,
        bound: str,
        excess_m: float,
        point: FloatArray,
        names: Mapping[str, str],
        length_m: float = 0.0,
        *,
        of_position: bool = False,
    ) -> ReachProof:
        """The proof by a bound for a pose, or for a position in any orientation.

        Args:
            bound: its name.
            excess_m: as of the proof.
            point: position of the wrist for a pose, or of the tip, seen from base, shape (3,), m.
            names: the arm's joint names by their short ones, such as "s1".
            length_m: the length of a span or fold.
            of_position: whether it is that of a position.
        """
        clauses, what = (_OF_POSITIONS, "tip") if of_position else (_OF_POSES, "wrist")
        clause = clauses[bound].format(excess=_length(excess_m), length_m=length_m, **names)
        return cls(excess_m, bound, f"{clause}, with the {what} at {_words(point)}")


def _words(p_base: FloatArray) -> str:
    return "({:.6g}, {:.6g}, {:.6g}) m".format(*(round(x, 3) + 0.0 for x in p_base.tolist()))


def _length_up(length_m: float) -> str:
    """A length in millimetres, rounded up."""
    return f"{math.ceil(1e3 * length_m)} mm"


def _length(length_m: float) -> str:
    """A length, rounded down so that the text claims no more than the proof."""
    if length_m >= 10.0:
        return f"{length_m:.6g} m"
    digits = 0 if length_m >= 0.01 else 1 if length_m >= 1e-3 else 3
    scale = 10.0**digits
    return f"{math.floor(1e3 * length_m * scale) / scale:.{digits}f} mm"


class ReachBound:
    """The reach of one arm, for poses of its tip that are met exactly or within a tolerance.

    Attributes:
        T_last_tip: the tip seen from the frame of the last axis: z along it, origin the wrist.
    """

    def __init__(self, arm: Arm, tolerance: Tolerance = EXACT) -> None:
        """Read the arm's dimensions, which takes half a millisecond."""
        self._arm = Linkage.of(arm.at_gripper)
        self._shells = Shells(self._arm)
        self._sweep, self._pose_sweep = ShoulderSweep(self._arm), PoseSweep(self._arm)
        self._names = dict(zip(JOINTS, arm.joint_names, strict=True))
        self.T_last_tip = self._arm.T_last_tip * arm.T_gripper_tip
        self._T_tip_gripper = arm.T_gripper_tip.inverse()
        self._leeway_m = float(np.linalg.norm(tolerance.position_m))
        self._wrist_leeway_m = self._leeway_m + _wrist_turns_m(self.T_last_tip, tolerance)
        self._is_posed = _fixes_gripper(self.T_last_tip, tolerance)
        self._is_roll_free = tolerance.free_axis is not None

    def proof(self, T_base_tip: pin.SE3, *, is_thorough: bool = False) -> ReachProof | None:
        """The proof that no allowed pose is within reach, or None.

        Args:
            T_base_tip: the requested pose of the tip, as `checked_pose` returns it.
            is_thorough: whether the proof may take a second.
        """
        T_base_gripper = T_base_tip * self._T_tip_gripper
        if self._is_posed:
            return _less(self._proof_of_gripper(T_base_gripper, is_thorough), self._leeway_m)
        proofs = self.proof_of_position(T_base_tip.translation), self.proof_of_wrist(T_base_tip)
        return max(filter(None, proofs), key=lambda proof: proof.excess_m, default=None)

    def proof_of_position(self, p_base_tip: FloatArray) -> ReachProof | None:
        """The proof that the tip cannot reach a position in any orientation, or None.

        Args:
            p_base_tip: shape (3,), m, in base.
        """
        point, bound = self._arm.T_base_first.actInv(p_base_tip), "span"
        excess_m, length_m = self._shells.tip_excess_m(point), self._shells.radius_m
        if excess_m <= 0.0:
            bound, length_m = "shoulder", self._shells.tip_reach_m
            excess_m = self._shells.elbow_excess_m(point)
        if excess_m <= 0.0:
            return None
        tool_m = float(np.linalg.norm(self._T_tip_gripper.translation))
        proof = ReachProof.of(bound, excess_m, p_base_tip, self._names, length_m, of_position=True)
        return proof.less(self._leeway_m + tool_m)

    def proof_of_wrist(self, T_base_tip: pin.SE3) -> ReachProof | None:
        """The proof by the bounds "span" and "fold" alone that the wrist is out of reach, or None.

        It holds for every orientation of the tool: `excess_m` is a distance of the wrist.

        Args:
            T_base_tip: the tip seen from base, as `checked_pose` returns it.
        """
        proof = self._proof_by_shells(*self._target(T_base_tip * self._T_tip_gripper))
        return _less(proof, self._wrist_leeway_m)

    def are_outside_shells(self, Ts: FloatArray) -> Flags:
        """Which poses are proven out of reach by the bounds "span" and "fold" alone.

        Args:
            Ts: finite poses as matrices, shape (m, 4, 4).

        Returns:
            Shape (m,).
        """
        return self._are_outside(self._targets(Ts)) if self._is_fixed else _none_of(Ts)

    def are_proven(self, Ts: FloatArray, levels: int = DECISION_LEVELS) -> Flags:
        """Which poses are proven out of reach by any bound except "limits".

        Args:
            Ts: finite poses as matrices, shape (m, 4, 4).
            levels: number of cell sizes to try; one takes 15 us for each pose and proves most, all
                of them take 300 us.

        Returns:
            Shape (m,).
        """
        if not self._is_fixed:
            return np.array([self.proof(pin.SE3(T)) is not None for T in Ts], dtype=np.bool_)
        targets = self._targets(Ts)
        proven = self._are_outside(targets)
        left = targets[~proven]
        radii_m = np.full(len(left), RADII_M[0])
        proven[~proven] = self._sweep.exclusions(left, radii_m, levels).is_proven
        return proven

    def are_beyond_limits(
        self, Ts: FloatArray, *, any_roll: bool = False, is_thorough: bool = False
    ) -> Flags:
        """Which poses are proven out of reach by the bound "limits"; some milliseconds for each.

        Args:
            Ts: finite poses as matrices, shape (m, 4, 4).
            any_roll: whether to prove it for every rotation of the gripper about the last joint's
                axis.
            is_thorough: whether each may take half a second.

        Returns:
            Shape (m,).
        """
        if not self._is_fixed or self._is_roll_free:
            return _none_of(Ts)
        radius_m, most = (
            float(RADII_M[0]),
            MAX_SURVIVORS_IF_THOROUGH if is_thorough else MAX_SURVIVORS,
        )
        excluded = [
            self._pose_sweep.excludes(T, radius_m, most, any_roll=any_roll)
            for T in self._targets(Ts)
        ]
        return np.array(excluded, np.bool_)

    @property
    def _is_fixed(self) -> bool:
        """Whether the gripper's pose is given exactly, except perhaps for its roll."""
        return self._is_posed and self._leeway_m == 0.0

    def _targets(self, Ts: FloatArray) -> FloatArray:
        return self._arm.targets(Ts @ self._T_tip_gripper.homogeneous)

    def _target(self, T_base_gripper: pin.SE3) -> tuple[FloatArray, FloatArray]:
        """The last axis for a pose, shape (4, 4), and the wrist seen from base, (3,)."""
        T = T_base_gripper.homogeneous
        wrist_base = T_base_gripper.act(self._arm.T_last_tip.inverse().translation)
        return self._arm.targets(T[None])[0], wrist_base

    def _are_outside(self, targets: FloatArray) -> Flags:
        beyond_m, within_m = self._shells.wrist_excess_m(targets[:, :3, 3])
        outside: Flags = (beyond_m > 0.0) | (within_m > 0.0)
        return outside

    def _proof_of_gripper(self, T_base_gripper: pin.SE3, is_thorough: bool) -> ReachProof | None:
        target, wrist = self._target(T_base_gripper)
        proof = self._proof_by_shells(target, wrist) or self._proof_by_sweep(target, wrist)
        if proof or self._is_roll_free:
            return proof
        return self._proof_by_limits(target, wrist, is_thorough)

    def _proof_by_shells(self, target: FloatArray, wrist: FloatArray) -> ReachProof | None:
        excesses = self._shells.wrist_excess_m(target[None, :3, 3])
        beyond_m, within_m = (float(excess_m[0]) for excess_m in excesses)
        names, shells = self._names, self._shells
        if beyond_m > 0.0:
            return ReachProof.of("span", beyond_m, wrist, names, shells.span_m)
        if within_m > 0.0:
            return ReachProof.of("fold", within_m, wrist, names, shells.fold_m)
        return None

    def _proof_by_sweep(self, target: FloatArray, wrist: FloatArray) -> ReachProof | None:
        found = self._sweep.exclusions(target[None], RADII_M[:1], DECISION_LEVELS)
        if not found.is_proven[0]:
            return None
        radius_m, needs_wrist = float(RADII_M[0]), bool(found.needs_wrist[0])
        targets = np.broadcast_to(target, (len(RADII_M) - 1, 4, 4))
        wider = self._sweep.exclusions(targets, RADII_M[1:], MEASURE_LEVELS)
        if wider.is_proven.any():
            last = int(np.flatnonzero(wider.is_proven)[-1])
            radius_m, needs_wrist = float(RADII_M[1 + last]), bool(wider.needs_wrist[last])
        bound = "wrist" if needs_wrist else "shoulder"
        return ReachProof.of(bound, radius_m, wrist, self._names)

    def _proof_by_limits(
        self, target: FloatArray, wrist: FloatArray, is_thorough: bool
    ) -> ReachProof | None:
        radius_m, *wider = RADII_M.tolist()
        most_cells = MAX_SURVIVORS_IF_THOROUGH if is_thorough else MAX_SURVIVORS
        if not self._pose_sweep.excludes(target, radius_m, most_cells):
            return None
        for wider_m in wider:
            if not self._pose_sweep.excludes(target, wider_m):
                break
            radius_m = wider_m
        return ReachProof.of("limits", radius_m, wrist, self._names)


def _none_of(Ts: FloatArray) -> Flags:
    return np.zeros(len(Ts), dtype=np.bool_)


def _less(proof: ReachProof | None, leeway_m: float) -> ReachProof | None:
    return None if proof is None else proof.less(leeway_m)


def _wrist_turns_m(T_last_tip: pin.SE3, tolerance: Tolerance) -> float:
    """The largest distance by which an allowed rotation of the tip moves the wrist, m.

    A rotation by an angle moves a point by its distance times the chord, 2 sin(angle / 2). If the
    rotation about an axis is free, this holds for the component along the axis; the component
    across moves by up to twice its length.
    """
    wrist = T_last_tip.inverse().translation
    along, across = float(np.linalg.norm(wrist)), 0.0
    if tolerance.free_axis is not None:
        axis = np.eye(3)[tolerance.free_axis]
        along, across = abs(float(axis @ wrist)), float(np.linalg.norm(np.cross(axis, wrist)))
    return 2.0 * along * math.sin(0.5 * tolerance.max_rotation_rad) + 2.0 * across


def _fixes_gripper(T_last_tip: pin.SE3, tolerance: Tolerance) -> bool:
    """Whether the tip's pose determines the gripper's, except for its roll about the last axis."""
    oriented = evolve(tolerance, position_m=EXACT.position_m)
    if oriented == EXACT:
        return True
    p, z = T_last_tip.translation, T_last_tip.rotation[:, 2]
    is_coaxial = np.hypot(*p[:2]) + np.hypot(*z[:2]) <= _COAXIAL
    return bool(is_coaxial) and oriented == Tolerance.about("z")
