"""The nearest pose that an arm reaches, for a pose out of its reach.

Descents in joint space start at the witnesses of the map's nearest cells, and at the configuration
with which inverse kinematics failed. Each ends at a pose with a witness: an upper bound on the
distance. A lower bound is proven: how far the pose, or the wrist that it requires, is from what
the arm can reach (`ReachBound`). The nearest reachable pose lies between the two bounds.

A descent is a bounded least-squares problem. The kept part of the pose has a weight so large that
it stays within the tolerances of inverse kinematics. Steps are damped (Levenberg and Marquardt),
and joints are fixed at limits that they are pushed against (projected Newton; Bertsekas 1982). It
finds a local minimum; every configuration on the way is within the limits.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from baxter_kin import IKService
from baxter_kin.display import position
from baxter_kin.fields import frozen, scalar
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.ik.reach.bound import ReachBound
from baxter_kin.ik.result import ORIENTATION_TOLERANCE_RAD, POSITION_TOLERANCE_M, IKResult
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, expect, member_of
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import UNREACHABLE, Codes
from planner.errors import AtlasError

M_PER_RAD = 0.3
"""Default weight of a radian: about how far the wrist moves when the hand turns by one."""

STARTS = 16
"""Number of cells that descents start from."""

STIFF = 1e4
"""Weight of the kept part, per m or rad: a distance of 0.1 shifts it by 1e-9."""

STEPS, STALLED_STEPS, GAIN = 400, 12, 1e-10
"""Maximum number of steps; a descent ends after so many steps that gain less than this share."""

ON_GRID = 1e-6
"""Tolerance for a pose to have the position or rotation of a cell, m and rad."""


class Keep(str, Enum):
    """The part of a pose that stays as it is."""

    ORIENTATION = "orientation"
    POSITION = "position"
    NOTHING = "nothing"

    @classmethod
    def of(cls, keep: str | Keep) -> Keep:
        """The member with a name.

        Raises:
            UnknownNameError: when there is none.
        """
        return member_of(cls, "part of a pose to keep", keep)


@frozen(error=AtlasError, eq=True)
class PoseMeasure:
    """A distance between poses: m when the orientation is kept, rad when the position is.

    When nothing is kept it is the root of the sum of squares of metres and of `m_per_rad` times
    radians, in m.

    Attributes:
        keep: the kept part.
        m_per_rad: weight of a radian, above zero.
    """

    keep: Keep
    m_per_rad: float = scalar(above=0.0, default=M_PER_RAD)

    @property
    def weights(self) -> tuple[float, float]:
        """Weights of metres and of radians."""
        if self.keep is Keep.ORIENTATION:
            return 1.0, 0.0
        return (0.0, 1.0) if self.keep is Keep.POSITION else (1.0, self.m_per_rad)

    @property
    def unit(self) -> str:
        """Unit of the distance."""
        return "rad" if self.keep is Keep.POSITION else "m"

    def distance(self, offset_m: FloatArray | float, angle_rad: FloatArray | float) -> FloatArray:
        """The distance for offsets of the position and angles of the rotation."""
        metres, radians = self.weights
        return np.hypot(metres * offset_m, radians * angle_rad)


class NearerCells(NamedTuple):
    """Numbers of cells of a map that are nearer than a distance and have the kept part of a pose.

    Attributes:
        proven: cells proven unreachable.
        unknown: cells that are undecided or not computed.
        reachable: cells with a witness.
    """

    proven: int
    unknown: int
    reachable: int


@frozen(error=AtlasError)
class NearestPose:
    """The nearest reachable pose that was found.

    Attributes:
        side: of the arm.
        measure: the distance that is minimised.
        T_base_asked: the requested pose.
        T_base_tip: the nearest pose found; None when there is none.
        q: its witness, shape (7,), rad; None without one.
        distance: from the requested pose, in the unit of `measure`; inf without one.
        proven: a lower bound on the distance of any reachable pose, in the same unit; inf when
            there is proven to be none.
        cells: cells of the map that are nearer; None when the map has no cell with the kept part.
    """

    side: str
    measure: PoseMeasure
    T_base_asked: pin.SE3
    T_base_tip: pin.SE3 | None
    q: FloatArray | None
    distance: float
    proven: float
    cells: NearerCells | None

    @property
    def offset_m(self) -> float:
        """Distance of the position from the requested one; NaN without a pose."""
        return math.nan if self.T_base_tip is None else _offset(self.T_base_asked, self.T_base_tip)

    @property
    def angle_rad(self) -> float:
        """Angle of the rotation from the requested one; NaN without a pose."""
        return math.nan if self.T_base_tip is None else _angle(self.T_base_asked, self.T_base_tip)

    def __str__(self) -> str:
        """What was found and proven, in sentences."""
        kept = {
            Keep.ORIENTATION: "in the same orientation",
            Keep.POSITION: "at the same position",
            Keep.NOTHING: f"with {self.measure.m_per_rad:g} m for a radian",
        }[self.measure.keep]
        if self.T_base_tip is None:
            none = f"no pose {kept} was found that the {self.side} arm reaches"
            return f"{none}; it is proven that there is none" if math.isinf(self.proven) else none
        if self.distance == 0.0:
            return f"the {self.side} arm reaches the pose itself"
        offset = f"{1e3 * self.offset_m:.1f} mm away"
        angle = f"turned by {math.degrees(self.angle_rad):.2f} deg"
        distance = {
            Keep.ORIENTATION: offset,
            Keep.POSITION: angle,
            Keep.NOTHING: f"{offset} and {angle}, {1e3 * self.distance:.1f} mm together",
        }[self.measure.keep]
        return (
            f"the nearest pose found {kept} that the {self.side} arm reaches is at "
            f"{position(self.T_base_tip)}, {distance}; {self._proofs()}"
        )

    def _proofs(self) -> str:
        known = "nothing is proven of what is nearer"
        if self.proven > 0.0:
            known = f"none is nearer than {_rounded_down(self.proven, self.measure.unit)}, proven"
        if self.cells is None:
            return f"{known}; the map has no cell to say more"
        total = sum(self.cells)
        if not total:
            return f"{known}; the map has no cell that is nearer"
        proven = f"of {total} nearer cells of the map {self.cells.proven} are proven out of reach"
        unknown = f" and {self.cells.unknown} undecided" if self.cells.unknown else ""
        return f"{known}; {proven}{unknown}; between cells the map says nothing"

    def _facts(self) -> tuple[str, ...]:
        return (str(self),)


def nearest_reachable(
    atlas: ReachMap,
    T_base_tip: PoseLike,
    side: str,
    *,
    keep: str | Keep = Keep.ORIENTATION,
    m_per_rad: float = M_PER_RAD,
) -> NearestPose:
    """The nearest pose that an arm reaches.

    Args:
        atlas: a map of the robot.
        T_base_tip: the requested pose, seen from base.
        side: of the arm.
        keep: "orientation": the same orientation, the nearest position. "position": the same
            position, the smallest rotation. "nothing": the smallest distance of both together.
        m_per_rad: with "nothing", the weight of a radian: the distance is the root of the sum of
            squares of metres and of so many metres per radian.

    Raises:
        PoseError: when the pose is invalid.
        UnknownNameError: when the map has no such arm, or `keep` is not one of the three.
        AtlasError: when `m_per_rad` is not a number above zero.
    """
    expect(atlas, ReachMap, "atlas", AtlasError)
    atlas.check_arm(side)
    measure = PoseMeasure(Keep.of(keep), m_per_rad)
    T, ik = checked_pose(T_base_tip), IKService(atlas.robot.arm(side))
    result = ik.solve(T)
    if result.is_valid:
        return NearestPose(side, measure, T, T, result.q, 0.0, 0.0, NearerCells(0, 0, 0))
    proven = _lower_bound(ik.arm, T, result, measure)
    cells = _CellsAround(atlas, side, T, measure)
    starts = [] if math.isinf(proven) else [*cells.nearest_witnesses(STARTS), result.q]
    found = [each for q in starts if (each := _descent(ik, T, q, measure)) is not None]
    if not found:
        return NearestPose(side, measure, T, None, None, math.inf, proven, None)
    distance, T_found, q = min(found, key=lambda each: each[0])
    nearer = cells.nearer(distance) if cells.are_on_grid else None
    return NearestPose(side, measure, T, T_found, q, distance, proven, nearer)


def _descent(
    ik: IKService, T_base_tip: pin.SE3, q_start: FloatArray, measure: PoseMeasure
) -> tuple[float, pin.SE3, FloatArray] | None:
    """Distance, pose and witness at the end of a descent; None when the kept part is missed."""
    q = _descended(ik.arm, T_base_tip, q_start, measure)
    T_found = ik.arm.T_base_tip(q)
    R = (T_base_tip if measure.keep is Keep.ORIENTATION else T_found).rotation
    p = (T_base_tip if measure.keep is Keep.POSITION else T_found).translation
    T = pin.SE3(R, p)
    if _offset(T, T_found) > POSITION_TOLERANCE_M or _angle(T, T_found) > ORIENTATION_TOLERANCE_RAD:
        exact = ik.solve(T, seed=q)
        if not exact.is_valid:
            return None
        q = exact.q
    distance = measure.distance(_offset(T_base_tip, T), _angle(T_base_tip, T))
    return float(distance), T, q


def _descended(
    arm: Arm, T_base_tip: pin.SE3, q_start: FloatArray, measure: PoseMeasure
) -> FloatArray:
    """The configuration at a local minimum of the distance, shape (7,), rad."""
    metres, radians = measure.weights
    metres = STIFF if measure.keep is Keep.POSITION else metres
    radians = STIFF if measure.keep is Keep.ORIENTATION else radians
    weights = np.repeat([metres, radians], 3)
    q = q_start.clip(arm.limits.q_min, arm.limits.q_max)
    error, J = _linearised(arm, T_base_tip, q, weights)
    damping, stalled = 1e-3, 0
    for _ in range(STEPS):
        tried = _stepped(arm, q, error, J, damping)
        new_error, new_J = _linearised(arm, T_base_tip, tried, weights)
        gained = error @ error - new_error @ new_error
        stalled = 0 if gained > GAIN * (error @ error) else stalled + 1
        if gained > 0.0:
            q, error, J, damping = tried, new_error, new_J, damping / 4.0
        else:
            damping *= 5.0
        if stalled == STALLED_STEPS:
            break
        damping = min(max(damping, 1e-14), 1e8)
    return q


def _stepped(
    arm: Arm, q: FloatArray, error: FloatArray, J: FloatArray, damping: float
) -> FloatArray:
    """A damped step within the limits; by orthogonal factors, as the weights differ widely."""
    low, high = arm.limits.q_min, arm.limits.q_max
    descent = J.T @ error
    free = ~(((q <= low) & (descent < 0.0)) | ((q >= high) & (descent > 0.0)))
    step = np.zeros(7)
    if free.any():
        damped = np.vstack([J[:, free], np.sqrt(damping) * np.eye(int(free.sum()))])
        wanted = np.concatenate([error, np.zeros(int(free.sum()))])
        step[free] = np.linalg.lstsq(damped, wanted, rcond=None)[0]
    moved: FloatArray = (q + step).clip(low, high)
    return moved


def _linearised(
    arm: Arm, T_base_tip: pin.SE3, q: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Weighted error, shape (6,), and Jacobian, shape (6, 7), linear first, base axes."""
    T = arm.T_base_tip(q)
    rotation = pin.log3(T_base_tip.rotation @ T.rotation.T)
    error = np.concatenate([T_base_tip.translation - T.translation, rotation])
    return weights * error, weights[:, None] * arm.jacobian(q)


def _lower_bound(arm: Arm, T_base_tip: pin.SE3, result: IKResult, measure: PoseMeasure) -> float:
    """A lower bound on the distance of any reachable pose, from proofs for the requested one.

    With the orientation kept it is the proof's own. Otherwise it follows from the wrist's distance
    to what it can reach: a rotation about the tip moves the wrist by `2 sin(angle / 2)` times its
    distance from the tip, less than the angle times that; a displacement moves it like the tip.
    """
    if measure.keep is Keep.ORIENTATION:
        return 0.0 if result.failure is None else result.failure.beyond_reach_m
    bound = ReachBound(arm)
    wrist, tip = bound.proof_of_wrist(T_base_tip), bound.proof_of_position(T_base_tip.translation)
    lever_m = float(np.linalg.norm(bound.T_last_tip.translation))
    excess_m = 0.0 if wrist is None else wrist.excess_m
    if measure.keep is Keep.POSITION:
        if tip is not None or excess_m > 2.0 * lever_m:
            return math.inf
        return 2.0 * math.asin(excess_m / (2.0 * lever_m)) if excess_m else 0.0
    by_wrist = excess_m / math.hypot(1.0, lever_m / measure.m_per_rad)
    return max(by_wrist, 0.0 if tip is None else tip.excess_m)


class _CellsAround:
    """Cells of one arm around a pose that have its kept part, or the nearest one of the grid."""

    def __init__(
        self, atlas: ReachMap, side: str, T_base_tip: pin.SE3, measure: PoseMeasure
    ) -> None:
        self._atlas, self._side, self._measure = atlas, side, measure
        self._p = T_base_tip.translation
        angles = atlas.rotations.angles_rad(T_base_tip.rotation)
        is_kept = measure.keep is Keep.ORIENTATION
        self._rotations = np.array([angles.argmin()]) if is_kept else np.arange(len(angles))
        self._angles = angles[self._rotations]
        self._parts = sorted(
            ((self._bound(part), part) for part in self._parts_of_grid()), key=lambda each: each[0]
        )

    def _parts_of_grid(self) -> list[tuple[slice, ...]]:
        """Slices of the positions: all blocks, or the one point when the position is kept."""
        grid = self._atlas.positions
        if self._measure.keep is Keep.POSITION:
            point = grid.nearest(self._p)
            return [] if point is None else [tuple(slice(i, i + 1) for i in point)]
        return [self._atlas.grid.slices(each) for each in self._atlas.blocks if each[0] == 0]

    def _bound(self, part: tuple[slice, ...]) -> float:
        """A lower bound on the distances of a part's cells."""
        grid = self._atlas.positions
        low, high = grid.point([s.start for s in part]), grid.point([s.stop - 1 for s in part])
        offset_m = float(np.linalg.norm(self._p - self._p.clip(low, high)))
        return float(self._measure.distance(offset_m, 0.0))

    def _cells(self, part: tuple[slice, ...]) -> tuple[FloatArray, Codes]:
        """Distances and codes of a part's cells, shape (nx, ny, nz, r)."""
        points = self._atlas.positions.points(part)
        offsets = np.linalg.norm(points - self._p, axis=-1)
        codes = self._atlas.margins(self._side, part)[..., self._rotations]
        return self._measure.distance(offsets[..., None], self._angles), codes

    @property
    def are_on_grid(self) -> bool:
        """Whether the map has cells with exactly the kept part of the pose."""
        if self._measure.keep is Keep.ORIENTATION:
            return bool(self._angles[0] <= ON_GRID)
        if self._measure.keep is Keep.POSITION:
            return bool(self._parts) and bool(
                np.linalg.norm(self._atlas.positions.points(self._parts[0][1]) - self._p) <= ON_GRID
            )
        return True

    def nearest_witnesses(self, count: int) -> list[FloatArray]:
        """Witnesses of the nearest reachable cells, nearest first, shape (7,) each, rad."""
        best: list[tuple[float, tuple[int, ...], int]] = []
        for bound, part in self._parts:
            if len(best) == count and bound >= best[-1][0]:
                break
            distances, codes = self._cells(part)
            reachable = np.where(codes >= 0, distances, np.inf)
            for flat in np.argsort(reachable, axis=None, kind="stable")[:count]:
                *index, rotation = np.unravel_index(flat, codes.shape)
                if codes[(*index, rotation)] >= 0:
                    point = tuple(s.start + int(i) for s, i in zip(part, index, strict=True))
                    distance = float(reachable[(*index, rotation)])
                    best.append((distance, point, int(self._rotations[rotation])))
            best = sorted(best, key=lambda each: each[0])[:count]
        cells = [self._atlas.cell(self._side, point, rotation) for _, point, rotation in best]
        return [cell.q for cell in cells if cell.q is not None]

    def nearer(self, distance: float) -> NearerCells:
        """Numbers of cells nearer than a distance."""
        cells = proven = reachable = 0
        for bound, part in self._parts:
            if bound >= distance:
                break
            distances, codes = self._cells(part)
            near = codes[distances < distance]
            cells += near.size
            proven += int((near == UNREACHABLE).sum())
            reachable += int((near >= 0).sum())
        return NearerCells(proven, cells - proven - reachable, reachable)


def _offset(T_a: pin.SE3, T_b: pin.SE3) -> float:
    """Distance of the positions of two poses, m."""
    return float(np.linalg.norm(T_a.translation - T_b.translation))


def _angle(T_a: pin.SE3, T_b: pin.SE3) -> float:
    """Angle between the rotations of two poses, rad."""
    return float(np.linalg.norm(pin.log3(T_a.rotation.T @ T_b.rotation)))


def _rounded_down(distance: float, unit: str) -> str:
    if unit == "m":
        return f"{math.floor(1e4 * distance) / 10:.1f} mm"
    return f"{math.floor(100.0 * math.degrees(distance)) / 100:.2f} deg"
