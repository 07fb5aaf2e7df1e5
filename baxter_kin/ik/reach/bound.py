"""Proofs that a pose is out of an arm's reach: sound geometry, by how far, and from which bound.

A proof never errs: a pose that the arm reaches inside its limits has none. The converse does not
hold; `None` says nothing. Bounds, cheapest first (letters as in `baxter_kin.ik.reach.linkage`):

- *span, fold*: the pose fixes the wrist W, and |W - S| lies between the lengths that upper arm and
  forearm span straight and fully bent (`Shells`).
- *shoulder, wrist*: no angle of s0 leaves s1, e1 and w1 inside their limits (`ShoulderSweep`).
- *limits*: no angles of s0 and w0 leave all joints inside their limits (`PoseSweep`).

For a position in any orientation, the tip takes the wrist's place and only the outer bounds remain.
For a pose that may be turned a little, the wrist keeps *span* and *fold*, less how far it can get.
Collisions play no part.

*Span and fold* (`Shells`): |W - S| lies between the lengths that upper arm and forearm span
straight and fully bent, and the tip is at most a hand farther, for S anywhere on its arc about the
s0 axis.

*Positions* (`PositionSweep`): let v be the point seen from S. For one angle of s0, the elbow lies
on the sphere of radius |E - S| about S, within `elbow_angle` of the arc that s1 lets u sweep in the
vertical plane of s0. The tip is at most `tip_distance_m(0)` from the elbow. So v is out of reach by
its distance from that part of the sphere less that length. Turning s0 by an angle moves v, seen
from the arm, by no more than the angle times the point's distance from the s0 axis: evaluated at
the middles of cells, less that slack, the distance holds for all angles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.errors import PoseError
from baxter_kin.fields import evolve
from baxter_kin.ik.reach.linkage import FAR_M, Linkage
from baxter_kin.ik.reach.pose_sweep import MAX_SURVIVORS, MAX_SURVIVORS_IF_THOROUGH, PoseSweep
from baxter_kin.ik.reach.shoulder_sweep import SWEEP_MARGIN_M, Flags, ShoulderSweep
from baxter_kin.ik.tolerance import EXACT, Tolerance
from baxter_kin.kinematics.arm import JOINTS, Arm
from baxter_kin.validation import FloatArray, finite_array

CELLS, SPLIT, LEVELS = 32, 8, 3
"""The s0 range starts as 32 cells; those that could still hold the least distance are split in
eight, down to 1.7 mrad."""


class PositionSweep:
    """The sweep for one arm."""

    def __init__(self, linkage: Linkage) -> None:
        self._arm = linkage
        self._upper = linkage.upper_span_m
        self.tip_reach_m = linkage.tip_distance_m(0.0)
        self._s1_middle = 0.5 * (linkage.q_min[1] + linkage.q_max[1])
        self._s1_half = 0.5 * (linkage.q_max[1] - linkage.q_min[1])
        self._offsets = (2.0 * np.arange(SPLIT) + 1.0) / SPLIT - 1.0

    def excess_m(self, point: FloatArray) -> float:
        """A lower bound on how far the tip stays from a point; negative when nothing is proved.

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
    """The lengths of one arm, and what they leave out; excesses are lower bounds.

    Attributes:
        span_m: from S to W with the arm straight, the deviation from the linkage included.
        fold_m: the same fully bent, less the deviation.
        radius_m: from S to the tip with the arm straight, the deviation included.
        tip_reach_m: from E to the tip with forearm and hand straight, the deviation included.
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
        """How far wrists, (m, 3), lie beyond the span, and how far inside the fold, (m,) each."""
        near, far = self._distances(wrists)
        return near - self._span_m - self._wrist_margin_m, self._fold_m - far - self._wrist_margin_m

    def tip_excess_m(self, point: FloatArray) -> float:
        """How far a tip, (3,), lies beyond the straight arm."""
        nearest_m = float(self._distances(point[None])[0][0])
        return nearest_m - self._radius_m - self._tip_margin_m

    def elbow_excess_m(self, point: FloatArray) -> float:
        """How far a tip, (3,), lies beyond forearm and hand from where s0 and s1 let E go."""
        return self._position_sweep.excess_m(point) - self._tip_margin_m

    def _distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The least and the greatest distance of points, (m, 3), to S over all angles of s0.

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

    @classmethod
    def of(
        cls,
        bound: str,
        excess_m: float,
        wrist: FloatArray,
        names: Mapping[str, str],
        most_m: float = 0,
    ) -> ReachProof:
        """The proof that a bound gives for a pose.

        Args:
            bound: its name.
            excess_m: by how far.
            wrist: where the pose puts it, seen from base, shape (3,), m.
            names: the arm's joint names by their short ones, such as "s1".
            most_m: the length that spans and folds speak of.
        """
        clause = _OF_POSES[bound].format(length=_length(excess_m), most_m=most_m, **names)
        return cls(excess_m, bound, f"{clause}, with the wrist at {_words(wrist)}")

    @classmethod
    def of_position(
        cls, bound: str, excess_m: float, tip: FloatArray, names: Mapping[str, str], most_m: float
    ) -> ReachProof:
        """The same for a position of the tip, seen from base, shape (3,), m."""
        clause = _OF_POSITIONS[bound].format(length=_length(excess_m), most_m=most_m, **names)
        return cls(excess_m, bound, f"{clause}, with the tip at {_words(tip)}")


_OF_POSES = {
    "span": "{length} beyond the {most_m:.3f} m that upper arm and forearm span from {s1}",
    "fold": "{length} inside the {most_m:.3f} m that the wrist keeps from {s1} with {e1} fully "
    "bent",
    "shoulder": "at least {length} from where the limits of {s0}, {s1} and {e1} let the wrist go",
    "wrist": "at least {length} from where {w1} can hold the tool in this orientation with {s0}, "
    "{s1} and {e1} inside their limits",
    "limits": "at least {length} from where the limits of all joints together let the tool be in "
    "this orientation",
}

_OF_POSITIONS = {
    "span": "{length} beyond the {most_m:.3f} m that the straight arm spans from {s1}",
    "shoulder": "{length} beyond the {most_m:.3f} m that forearm and hand span from where {s0} and "
    "{s1} let the elbow go",
}


def _words(p_base: FloatArray) -> str:
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


RADII_M = np.array([1e-5, 1e-4, 3e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1])
"""Distances that the sweeps can certify; the largest that holds is reported."""

DECISION_LEVELS, MEASURE_LEVELS = 5, 1
"""How often the sweep splits its cells: to decide, down to 0.1 mrad; to measure, sparingly."""

_COAXIAL = 1e-9  # how far (m, and of a unit vector) an axis may be from the last joint's


class ReachBound:
    """How far one arm reaches, for poses of its tip that are met exactly or within a tolerance.

    Attributes:
        T_last_tip: the gripper seen from the last axis: z along it, origin the wrist.
    """

    def __init__(self, arm: Arm, tolerance: Tolerance = EXACT) -> None:
        """Read the arm's dimensions, half a millisecond."""
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
        """Why no pose that would do is within reach, or None when that is not proved.

        Args:
            T_base_tip: the requested pose of the tip, as `checked_pose` returns it.
            is_thorough: whether it may take a second.
        """
        T_base_gripper = T_base_tip * self._T_tip_gripper
        if self._is_posed:
            return _less(self._proof_of_gripper(T_base_gripper, is_thorough), self._leeway_m)
        proofs = self.proof_of_position(T_base_tip.translation), self.proof_of_wrist(T_base_tip)
        return max(filter(None, proofs), key=lambda proof: proof.excess_m, default=None)

    def proof_of_position(self, p_base_tip: ArrayLike) -> ReachProof | None:
        """Why the tip cannot get to a position in any orientation, or None when that is not proved.

        Args:
            p_base_tip: shape (3,), m, in base.
        """
        p = finite_array(p_base_tip, (3,), "p_base_tip", PoseError)
        point, bound = self._arm.T_base_first.actInv(p), "span"
        excess_m, most_m = self._shells.tip_excess_m(point), self._shells.radius_m
        if excess_m <= 0.0:
            bound, most_m = "shoulder", self._shells.tip_reach_m
            excess_m = self._shells.elbow_excess_m(point)
        if excess_m <= 0.0:
            return None
        tool_m = float(np.linalg.norm(self._T_tip_gripper.translation))
        proof = ReachProof.of_position(bound, excess_m, p, self._names, most_m)
        return proof.less(self._leeway_m + tool_m)

    def proof_of_wrist(self, T_base_tip: pin.SE3) -> ReachProof | None:
        """Why the wrist cannot be where a pose puts it, by the bounds "span" and "fold" alone.

        They hold whatever the tool's orientation: `excess_m` is how far the wrist must be moved.

        Args:
            T_base_tip: the tip seen from base, as `checked_pose` returns it.
        """
        proof = self._proof_by_shells(*self._target(T_base_tip * self._T_tip_gripper))
        return _less(proof, self._wrist_leeway_m)

    def are_outside_shells(self, Ts: FloatArray) -> Flags:
        """Which poses the bounds "span" and "fold" alone prove out of reach, at a glance.

        Args:
            Ts: finite poses as matrices, shape (m, 4, 4).

        Returns:
            Shape (m,).
        """
        return self._are_outside(self._targets(Ts)) if self._is_fixed else _nowhere(Ts)

    def are_proven(self, Ts: FloatArray, levels: int = DECISION_LEVELS) -> Flags:
        """Which poses are out of reach by any bound but "limits", proven for many at a time.

        Args:
            Ts: finite poses as matrices, shape (m, 4, 4).
            levels: how many sizes of cells to try; one takes 15 us for each pose and proves most,
                all of them take 300 us.

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
        """Which poses are out of reach by the bound "limits": some milliseconds for each.

        Args:
            Ts: finite poses as matrices, shape (m, 4, 4).
            any_roll: whether they are so however the gripper is turned about the last joint's axis.
            is_thorough: whether each may take half a second.

        Returns:
            Shape (m,).
        """
        if not self._is_fixed or self._is_roll_free:
            return _nowhere(Ts)
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
        """Whether the gripper's pose is given exactly, but perhaps for its roll."""
        return self._is_posed and self._leeway_m == 0.0

    def _targets(self, Ts: FloatArray) -> FloatArray:
        return self._arm.targets(Ts @ self._T_tip_gripper.homogeneous)

    def _target(self, T_base_gripper: pin.SE3) -> tuple[FloatArray, FloatArray]:
        """Where a pose puts the last axis, shape (4, 4), and the wrist seen from base, (3,)."""
        T = T_base_gripper.homogeneous
        if not np.isfinite(T).all():
            raise PoseError("a pose must be finite to be judged in or out of reach")
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


def _nowhere(Ts: FloatArray) -> Flags:
    return np.zeros(len(Ts), dtype=np.bool_)


def _less(proof: ReachProof | None, leeway_m: float) -> ReachProof | None:
    return None if proof is None else proof.less(leeway_m)


def _wrist_turns_m(T_last_tip: pin.SE3, tolerance: Tolerance) -> float:
    """How far the wrist can get from where the pose puts it by what the tip is turned.

    A rotation by an angle moves a point by its distance times the chord, 2 sin(angle / 2). Where
    the rotation about an axis is free, that holds for the part along the axis, and the part across
    goes anywhere: it moves by up to twice its length.
    """
    wrist = T_last_tip.inverse().translation
    along, across = float(np.linalg.norm(wrist)), 0.0
    if tolerance.free_axis is not None:
        axis = np.eye(3)[tolerance.free_axis]
        along, across = abs(float(axis @ wrist)), float(np.linalg.norm(np.cross(axis, wrist)))
    return 2.0 * along * math.sin(0.5 * tolerance.max_rotation_rad) + 2.0 * across


def _fixes_gripper(T_last_tip: pin.SE3, tolerance: Tolerance) -> bool:
    """Whether the tip's pose gives the gripper's, but for its roll about the last joint's axis."""
    oriented = evolve(tolerance, position_m=EXACT.position_m)
    if oriented == EXACT:
        return True
    p, z = T_last_tip.translation, T_last_tip.rotation[:, 2]
    is_coaxial = np.hypot(*p[:2]) + np.hypot(*z[:2]) <= _COAXIAL
    return bool(is_coaxial) and oriented == Tolerance.about("z")
