"""A map of the stock robot, transferred to a calibrated one: each cell is decided anew.

Every Baxter is measured at the factory; its joints are some millimetres from where its drawing has
them. At the same joint angles its tip deviates by a bounded amount (`TipDeviation`), so a stock
witness brings it near the pose of the cell, and no closer. A transferred cell is

- reachable, if a search of the robot's own inverse kinematics, started at the stock witness, ends
  within the robot's limits and meets the pose by the robot's own forward kinematics;
- unreachable, if that is proven for the robot's own links (`ReachBound`): a proof for the stock arm
  says nothing of another arm;
- undecided otherwise. A map built for the robot itself leaves nearly as many cells undecided.

It takes some microseconds a witness, about a fiftieth of building the robot's own map.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter, IKService
from baxter_kin.fields import frozen
from baxter_kin.ik.reach.bound import ReachBound
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, expect
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import (
    ENDS_RAD,
    NOT_COMPUTED,
    RAD_PER_STEP,
    UNDECIDED,
    UNREACHABLE,
    Codes,
    as_stored,
    is_coaxial,
)
from planner.errors import AtlasError

ROUNDING = 1e-12
"""Allowance for rounding, m and rad."""


@frozen(error=AtlasError, eq=True)
class TipDeviation:
    """A bound on the distance between two arms' tips at the same joint angles, whichever they are.

    Both arms are chains of fixed links and rotations about z in turn. Replacing a link `A` of the
    first arm by `B` of the second moves the tip by at most `|p_A - p_B|` plus `2 sin(angle / 2)`
    times the tip's distance from the link's end, which is at most the sum of the lengths after it;
    and it turns the tip by the angle between `A` and `B`. What precedes the link only carries the
    tip along. The bounds of all replacements add up. An axis other than z is rotated to z before
    its joint, and back after it.

    Attributes:
        position_m: between the positions.
        angle_rad: between the orientations.
    """

    position_m: float
    angle_rad: float

    @classmethod
    def of(cls, first: Arm, second: Arm) -> TipDeviation:
        """The bound for two arms; their limits do not matter."""
        links = list(zip(_links(first), _links(second), strict=True))
        shifts = np.array([np.linalg.norm(a.translation - b.translation) for a, b in links])
        angles = np.array([np.linalg.norm(pin.log3(a.actInv(b).rotation)) for a, b in links])
        lengths = np.array([np.linalg.norm(a.translation) for a, _ in links])
        after = lengths[::-1].cumsum()[::-1] - lengths
        position_m = float((shifts + 2.0 * np.sin(0.5 * angles) * after).sum())
        return cls(position_m + ROUNDING, float(angles.sum()) + ROUNDING)

    def __str__(self) -> str:
        return f"at most {1e3 * self.position_m:.1f} mm and {1e3 * self.angle_rad:.1f} mrad"


@frozen(error=AtlasError)
class CalibratedCells:
    """Cells of a map, decided for another robot than the map's.

    Attributes:
        side: of the arm.
        deviation: bound on the distance of its tip from that of the map's robot at the same joint
            angles.
        margins: of the robot's own witnesses, or codes, as of maps; shape (nx, ny, nz, rotations).
        witnesses: of the robot, rad, zero without one; shape (nx, ny, nz, rotations, 7).
        lost: number of cells that have a stock witness and none here.
    """

    side: str
    deviation: TipDeviation
    margins: Codes
    witnesses: FloatArray
    lost: int

    @property
    def shares(self) -> dict[str, float]:
        """Shares of reachable, unreachable and undecided cells among the computed ones."""
        computed = max(int((self.margins != NOT_COMPUTED).sum()), 1)
        counted = {
            "reachable": self.margins >= 0,
            "unreachable": self.margins == UNREACHABLE,
            "undecided": self.margins == UNDECIDED,
        }
        return {name: float(flags.sum()) / computed for name, flags in counted.items()}

    def __str__(self) -> str:
        """The result in a sentence."""
        shares = ", ".join(f"{100.0 * share:.1f} % {name}" for name, share in self.shares.items())
        return (
            f"at the same joint angles this robot's {self.side} tip is off by {self.deviation}; of "
            f"the cells, each decided for this robot itself, {shares}; {self.lost} with a stock "
            "witness have none that was found from it"
        )

    def _facts(self) -> tuple[str, ...]:
        return (str(self),)


def for_calibrated(
    atlas: ReachMap, robot: Baxter, side: str, part: tuple[slice, ...] = (slice(None),) * 3
) -> CalibratedCells:
    """Transfer a map to another robot, each cell decided for that robot.

    Args:
        atlas: a map, such as of the stock robot.
        robot: the calibrated robot.
        side: of the arm.
        part: slices of the positions; all of them, in memory, by default.

    Raises:
        UnknownNameError: when the map has no such arm.
        AtlasError: when a block is damaged.
    """
    expect(atlas, ReachMap, "atlas", AtlasError)
    expect(robot, Baxter, "robot", AtlasError)
    atlas.check_arm(side)
    arm, rotations = robot.arm(side), atlas.rotations
    stock = atlas.margins(side, part)
    points = atlas.positions.points(part).reshape(-1, 3)
    margins = np.where(stock == NOT_COMPUTED, stock, np.int16(UNDECIDED))
    witnesses = np.zeros((*stock.shape, 7))
    *position, rotation = np.nonzero(stock >= 0)
    at = np.ravel_multi_index(position, stock.shape[:3])
    starts = atlas.witnesses(side, part)[stock >= 0]
    witnesses[stock >= 0], margins[stock >= 0] = _transferred(
        arm, starts, _poses(points[at], rotations.matrices[rotation])
    )
    lost = int(((stock >= 0) & (margins < 0)).sum())
    bound = ReachBound(arm)
    # where the tool turns about the last axis, a proof for one roll is one for all
    rolls = len(rotations.rolls) if is_coaxial(bound.T_last_tip) else 1
    pairs = margins.reshape(len(points), -1, rolls)
    at, direction = np.nonzero((pairs == UNDECIDED).all(axis=2))
    proven = bound.are_proven(_poses(points[at], rotations.matrices[direction * rolls]))
    pairs[at[proven], direction[proven]] = UNREACHABLE
    deviation = TipDeviation.of(atlas.robot.arm(side), arm)
    return CalibratedCells(side, deviation, margins, witnesses, lost)


def _transferred(arm: Arm, starts: FloatArray, Ts: FloatArray) -> tuple[FloatArray, Codes]:
    """Witnesses found from stock ones, shape (m, 7), rad, and their margins; zero if undecided."""
    if not len(starts):
        return starts, np.zeros(0, np.int16)
    bounds = np.concatenate([arm.limits.q_min + ENDS_RAD, arm.limits.q_max - ENDS_RAD])
    starts = starts.clip(bounds[:7], bounds[7:])
    steps, codes = as_stored(arm, IKService(arm).search.search(starts, Ts, bounds).q, Ts)
    return np.where(codes[:, None] >= 0, steps * RAD_PER_STEP, 0.0), codes


def _poses(points: FloatArray, Rs: FloatArray) -> FloatArray:
    """Poses from positions, shape (m, 3), and rotations, shape (m, 3, 3): shape (m, 4, 4)."""
    Ts = np.zeros((len(points), 4, 4))
    Ts[:, :3, :3], Ts[:, :3, 3], Ts[:, 3, 3] = Rs, points, 1.0
    return Ts


def _links(arm: Arm) -> list[pin.SE3]:
    """The fixed links between rotations about z, and those before the first and after the last."""
    model = arm.model
    tip = model.frames[model.getFrameId(arm.tip_frame)].placement
    turns = [pin.SE3(_from_z(axis), np.zeros(3)) for axis in arm.chain.axes]
    before = [pin.SE3.Identity(), *turns]
    after = [*turns, pin.SE3.Identity()]
    fixed = [*list(model.jointPlacements)[1:], tip]
    return [b.inverse() * T * a for b, T, a in zip(before, fixed, after, strict=True)]


def _from_z(axis: FloatArray) -> FloatArray:
    """The smallest rotation that takes z to a unit vector not far from it."""
    across = np.cross([0.0, 0.0, 1.0], axis)
    sine = float(np.linalg.norm(across))
    angle = float(np.arctan2(sine, axis[2]))
    return np.array(pin.exp3(across / sine * angle)) if sine > 0.0 else np.eye(3)
