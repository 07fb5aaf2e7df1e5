"""A map of the stock robot, used for a robot that is calibrated: what of it holds, cell by cell.

Every Baxter is measured at the factory; its joints lie some millimetres elsewhere than drawn. At
the same joint angles its tip is off by a bounded amount (`TipDeviation`): a stock witness brings it
so near to the cell's pose, and no nearer for sure. So nothing is taken over unseen:

- reachable: a search of the robot's own inverse kinematics, begun at the stock witness, ended at a
  configuration inside its own limits that meets the pose, by its own forward kinematics.
- unreachable: proven for the robot itself (`ReachBound`). A proof for the stock arm says nothing of
  another arm, unless it leaves room for the deviation; this one is of the robot's own links.
- undecided: neither. A map of the robot's own decides few of these: what a calibration makes less
  sharp are the proofs, and both use the same ones but for those from all limits together.

It takes some microseconds a witness, and some fiftieth of a map of the robot's own.
"""

from __future__ import annotations

import numpy as np

from baxter_kin import Baxter, IKService
from baxter_kin.fields import frozen
from baxter_kin.ik.reach.bound import ReachBound
from baxter_kin.ik.result import ORIENTATION_TOLERANCE_RAD, POSITION_TOLERANCE_M
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, Indices, expect
from planner.atlas.questions.calibrated.deviation import TipDeviation
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import (
    ENDS_RAD,
    NOT_COMPUTED,
    RAD_PER_MARGIN,
    RAD_PER_STEP,
    UNDECIDED,
    UNREACHABLE,
    Codes,
    Flags,
    is_coaxial,
)
from planner.errors import AtlasError

EVERYWHERE = (slice(None),) * 3


@frozen(error=AtlasError)
class CalibratedCells:
    """What is known of cells for another robot than the map's.

    Attributes:
        side: of the arm.
        deviation: how far its tip may be from that of the map's robot at the same joint angles.
        margins: as of maps, of the robot's own witnesses, or codes; shape (nx, ny, nz, rotations).
        witnesses: of the robot, rad, zero where there is none; shape (nx, ny, nz, rotations, 7).
        lost: how many cells with a stock witness have none here.
    """

    side: str
    deviation: TipDeviation
    margins: Codes
    witnesses: FloatArray
    lost: int

    @property
    def shares(self) -> dict[str, float]:
        """Of the cells that are computed: reachable, unreachable and undecided."""
        computed = max(int((self.margins != NOT_COMPUTED).sum()), 1)
        counted = {
            "reachable": self.margins >= 0,
            "unreachable": self.margins == UNREACHABLE,
            "undecided": self.margins == UNDECIDED,
        }
        return {name: float(flags.sum()) / computed for name, flags in counted.items()}

    def __str__(self) -> str:
        """What holds, in a sentence."""
        shares = ", ".join(f"{100.0 * share:.1f} % {name}" for name, share in self.shares.items())
        return (
            f"at the same joint angles this robot's {self.side} tip is off by {self.deviation}; of "
            f"the cells, each settled for this robot itself, {shares}; {self.lost} with a stock "
            "witness have none that was found from it"
        )

    def _facts(self) -> tuple[str, ...]:
        return (str(self),)


def for_calibrated(
    atlas: ReachMap, robot: Baxter, side: str, part: tuple[slice, ...] = EVERYWHERE
) -> CalibratedCells:
    """What a map says of another robot, made sure of for each cell.

    Args:
        atlas: a map, such as of the stock robot.
        robot: the calibrated one.
        side: of the arm.
        part: of the positions, by their indices; all of them, in memory, when not given.

    Raises:
        UnknownNameError: when the map has no such arm.
        AtlasError: when a block is damaged.
    """
    expect(atlas, ReachMap, "atlas", AtlasError)
    expect(robot, Baxter, "robot", AtlasError)
    atlas.check_arm(side)
    arm = robot.arm(side)
    stock = atlas.margins(side, part)
    cells = _Cells(atlas, arm, part, stock)
    cells.carry_over(atlas.witnesses(side, part))
    lost = int(((stock >= 0) & (cells.margins.reshape(stock.shape) < 0)).sum())
    cells.rule_out()
    return CalibratedCells(
        side,
        TipDeviation.of(atlas.robot.arm(side), arm),
        cells.margins.reshape(stock.shape),
        cells.q.reshape(*stock.shape, 7),
        lost,
    )


class _Cells:
    """Cells of positions (n) and rotations (r), settled for one arm."""

    def __init__(self, atlas: ReachMap, arm: Arm, part: tuple[slice, ...], stock: Codes) -> None:
        self._arm, self._rotations = arm, atlas.rotations
        self._points = atlas.positions.points(part).reshape(-1, 3)
        self._stock = stock.reshape(len(self._points), -1)
        self.margins = np.full_like(self._stock, UNDECIDED)
        self.margins[self._stock == NOT_COMPUTED] = NOT_COMPUTED
        self.q = np.zeros((*self._stock.shape, 7))

    def carry_over(self, witnesses: FloatArray) -> None:
        """Begin at witnesses of the stock robot, rad, shape (..., r, 7)."""
        at, rotation = np.nonzero(self._stock >= 0)
        Ts, limits = self._poses(at, rotation), self._arm.limits
        low, high = limits.q_min + ENDS_RAD, limits.q_max - ENDS_RAD
        starts = witnesses.reshape(*self._stock.shape, 7)[at, rotation].clip(low, high)
        if not len(starts):
            return
        found = IKService(self._arm).search.search(starts, Ts, np.concatenate([low, high])).q
        q = np.rint(found / RAD_PER_STEP) * RAD_PER_STEP  # as a map would store it
        margins = np.minimum(q - limits.q_min, limits.q_max - q).min(axis=1)
        holds = (margins >= 0.0) & self._are_met(q, Ts)
        kept = at[holds], rotation[holds]
        self.margins[kept] = np.floor(margins[holds] / RAD_PER_MARGIN)
        self.q[kept] = q[holds]

    def rule_out(self) -> None:
        """Prove what can be proven of cells without a witness.

        Where the tool turns about the last axis, a proof for one roll is one for all.
        """
        bound, rolls = ReachBound(self._arm), len(self._rotations.rolls)
        if not is_coaxial(bound.T_last_tip):
            rolls = 1
        pairs = self.margins.reshape(len(self._points), -1, rolls)
        at, direction = np.nonzero((pairs == UNDECIDED).all(axis=2))
        proven = bound.are_proven(self._poses(at, direction * rolls))
        pairs[at[proven], direction[proven]] = UNREACHABLE

    def _poses(self, at: Indices, rotation: Indices) -> FloatArray:
        """Poses of the tip seen from base, shape (m, 4, 4)."""
        Ts = np.zeros((len(at), 4, 4))
        Ts[:, :3, :3], Ts[:, 3, 3] = self._rotations.matrices[rotation], 1.0
        Ts[:, :3, 3] = self._points[at]
        return Ts

    def _are_met(self, q: FloatArray, Ts: FloatArray) -> Flags:
        """Where configurations reach poses, by forward kinematics."""
        reached = self._arm.T_base_tips(q)
        offset = np.linalg.norm(reached[:, :3, 3] - Ts[:, :3, 3], axis=1)
        chord = np.linalg.norm(reached[:, :3, :3] - Ts[:, :3, :3], axis=(1, 2))
        is_turned = chord <= np.sqrt(2.0) * ORIENTATION_TOLERANCE_RAD
        return np.asarray((offset <= POSITION_TOLERANCE_M) & is_turned)
