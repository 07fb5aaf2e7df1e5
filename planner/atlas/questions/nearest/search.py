"""The nearest pose that an arm reaches, for one that it does not.

The witnesses of the map's nearest cells lead there, and the attempt that inverse kinematics ends
with; from each, joint angles descend to the nearest pose around (`descended`). What comes of it is
a pose with a witness: an upper bound. A lower bound is proven beside: how far the pose, or the
wrist that it asks for, is from where the arm can be (`ReachBound`). What lies between both is not
known; the nearest pose may be there.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from baxter_kin import IKService
from baxter_kin.display import position
from baxter_kin.fields import frozen
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.ik.reach.bound import ReachBound
from baxter_kin.ik.result import ORIENTATION_TOLERANCE_RAD, POSITION_TOLERANCE_M, IKResult
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, expect
from planner.atlas.questions.nearest.cells_around import CellsAround, NearerCells
from planner.atlas.questions.nearest.descent import descended
from planner.atlas.questions.nearest.measure import M_PER_RAD, Keep, PoseMeasure
from planner.atlas.reach_map import ReachMap
from planner.errors import AtlasError

STARTS = 16
"""Cells that are descended from."""


@frozen(error=AtlasError)
class NearestPose:
    """What was found nearest to a pose.

    Attributes:
        side: of the arm.
        measure: what was kept, and what counts.
        T_base_asked: the pose that was asked for.
        T_base_tip: the nearest that was found; None when none was.
        q: its witness, shape (7,), rad; None without one.
        distance: from the pose that was asked for, in the unit of `measure`; inf without one.
        proven: a lower bound on that distance, in the same unit; inf where it is proven that there
            is none.
        cells: what the map has that is nearer, with the kept part as it is; None where the map has
            no cell with that part.
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
        """How far the position is from the one that was asked for; NaN without one."""
        if self.T_base_tip is None:
            return math.nan
        return float(np.linalg.norm(self.T_base_tip.translation - self.T_base_asked.translation))

    @property
    def angle_rad(self) -> float:
        """How much it is turned; NaN without one."""
        if self.T_base_tip is None:
            return math.nan
        turned = self.T_base_asked.rotation.T @ self.T_base_tip.rotation
        return float(np.linalg.norm(pin.log3(turned)))

    def __str__(self) -> str:
        """What is known, in sentences."""
        same = {
            Keep.ORIENTATION: "in the same orientation",
            Keep.POSITION: "at the same position",
            Keep.NOTHING: f"with {self.measure.m_per_rad:g} m for a radian",
        }[self.measure.keep]
        if self.T_base_tip is None:
            none = f"no pose {same} was found that the {self.side} arm reaches"
            return f"{none}; it is proven that there is none" if math.isinf(self.proven) else none
        if self.distance == 0.0:
            return f"the {self.side} arm reaches the pose itself"
        away, turned = (
            f"{1e3 * self.offset_m:.1f} mm away",
            f"turned by {math.degrees(self.angle_rad):.2f} deg",
        )
        how_far = {
            Keep.ORIENTATION: away,
            Keep.POSITION: turned,
            Keep.NOTHING: f"{away} and {turned}, {1e3 * self.distance:.1f} mm together",
        }[self.measure.keep]
        found = (
            f"the nearest pose found {same} that the {self.side} arm reaches is at "
            f"{position(self.T_base_tip)}, {how_far}"
        )
        return f"{found}; {self._bounds()}"

    def _bounds(self) -> str:
        """What is proven, what the map says, and what is not known."""
        known = "nothing is proven of what is nearer"
        if self.proven > 0.0:
            known = f"none is nearer than {_shown_down(self.proven, self.measure.unit)}, proven"
        if self.cells is None:
            return f"{known}; the map has no cell to say more"
        total = sum(self.cells)
        if not total:
            return f"{known}; the map has no cell that is nearer"
        said = f"of {total} nearer cells of the map {self.cells.proven} are proven out of reach"
        unknown = f" and {self.cells.unknown} undecided" if self.cells.unknown else ""
        return f"{known}; {said}{unknown}; between cells the map says nothing"

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
        T_base_tip: the pose that is asked for, seen from base.
        side: of the arm.
        keep: "orientation": the same orientation, the nearest position. "position": the same
            position, the least rotation. "nothing": the least of both together.
        m_per_rad: with "nothing", what a radian counts for: the distance is the root of the squares
            of metres and of so many metres a radian.

    Raises:
        PoseError: when the pose is not a valid one.
        UnknownNameError: when the map has no such arm, or nothing is called as `keep` says.
        AtlasError: when `m_per_rad` is not a number above zero.
    """
    expect(atlas, ReachMap, "atlas", AtlasError)
    atlas.check_arm(side)
    measure = PoseMeasure(Keep.of(keep), m_per_rad)
    T, arm = checked_pose(T_base_tip), atlas.robot.arm(side)
    ik = IKService(arm)
    result = ik.solve(T)
    if result.is_valid:
        return NearestPose(side, measure, T, T, result.q, 0.0, 0.0, NearerCells(0, 0, 0))
    proven = _proven(arm, T, result, measure)
    cells = CellsAround(atlas, side, T, measure)
    starts = [] if math.isinf(proven) else [*cells.starts(STARTS), result.q]
    found = _candidates(ik, T, starts, measure)
    if not found:
        return NearestPose(side, measure, T, None, None, math.inf, proven, None)
    distance, T_found, q = min(found, key=lambda each: each[0])
    nearer = cells.nearer(distance) if cells.is_on_grid else None
    return NearestPose(side, measure, T, T_found, q, distance, proven, nearer)


def _candidates(
    ik: IKService, T_base_tip: pin.SE3, starts: list[FloatArray], measure: PoseMeasure
) -> list[tuple[float, pin.SE3, FloatArray]]:
    """Poses that descents from some configurations end at, with their distances and witnesses."""
    found = []
    for start in starts:
        q = descended(ik.arm, T_base_tip, start, measure)
        T = _with_kept(T_base_tip, ik.arm.T_base_tip(q), measure.keep)
        if not _is_witness(ik.arm, T, q):
            exact = ik.solve(T, seed=q)
            if not exact.is_valid:
                continue
            q = exact.q
        found.append((measure.between(T_base_tip, T), T, q))
    return found


def _with_kept(T_asked: pin.SE3, T_found: pin.SE3, keep: Keep) -> pin.SE3:
    """A pose with what is kept exactly as it was asked for."""
    R = T_asked.rotation if keep is Keep.ORIENTATION else T_found.rotation
    p = T_asked.translation if keep is Keep.POSITION else T_found.translation
    return pin.SE3(R, p)


def _is_witness(arm: Arm, T_base_tip: pin.SE3, q: FloatArray) -> bool:
    """Whether a configuration inside the limits reaches a pose."""
    off = T_base_tip.actInv(arm.T_base_tip(q))
    turned = float(np.linalg.norm(pin.log3(off.rotation)))
    offset = float(np.linalg.norm(off.translation))
    return offset <= POSITION_TOLERANCE_M and turned <= ORIENTATION_TOLERANCE_RAD


def _proven(arm: Arm, T_base_tip: pin.SE3, result: IKResult, measure: PoseMeasure) -> float:
    """A lower bound on the distance of the nearest pose, from proofs that this one is out of reach.

    In the same orientation the proof's own. Otherwise from how far the wrist is out of reach: a
    rotation about the tip moves it by `2 sin(angle / 2)` times its distance from there, less than
    the angle times that; a displacement of the tip, as far as the tip.
    """
    if measure.keep is Keep.ORIENTATION:
        return 0.0 if result.failure is None else result.failure.beyond_reach_m
    bound = ReachBound(arm)
    wrist, tip = bound.proof_of_wrist(T_base_tip), bound.proof_of_position(T_base_tip.translation)
    lever_m = float(np.linalg.norm(bound.T_last_tip.translation))
    away_m = 0.0 if wrist is None else wrist.excess_m
    if measure.keep is Keep.POSITION:
        if tip is not None or away_m > 2.0 * lever_m:
            return math.inf
        return 2.0 * math.asin(away_m / (2.0 * lever_m)) if away_m else 0.0
    by_wrist = away_m / math.hypot(1.0, lever_m / measure.m_per_rad)
    return max(by_wrist, 0.0 if tip is None else tip.excess_m)


def _shown_down(distance: float, unit: str) -> str:
    """A distance, rounded down."""
    if unit == "m":
        return f"{math.floor(1e4 * distance) / 10:.1f} mm"
    return f"{math.floor(100.0 * math.degrees(distance)) / 100:.2f} deg"
