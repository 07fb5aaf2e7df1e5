"""Freedom: the self-motion of one pose in numbers, and the search for it.

What each number is worth:

- Pieces are those that were found: each of them reaches the pose along its whole length and ends on
  a joint limit, closes, or ends at a singularity, but that there are no others is not proven. They
  come from a sweep over s0, from random starts and from a witness (`baxter_kin.ik.solutions`).
- Lengths are of what was found. Chords of fixed steps differ from them by their own error alone:
  6e-5 rad or less in 99 of 100 cells, where the Jacobian is weak 4e-4 rad a piece.
- The margin is the greatest on these pieces to `MARGIN_TOLERANCE_RAD`, by branch and bound.
- The manipulability is the greatest of samples, denser where a peak may be; a lower bound.
- The free share is sampled (`planner.atlas.redundancy.self_collision`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import Baxter, IKService, JointLimits
from baxter_kin.display import OneLine, count
from baxter_kin.fields import frozen, number_or_nan
from baxter_kin.frames import PoseLike
from baxter_kin.ik import SelfMotion, solutions
from baxter_kin.ik.self_motion.continuation import LONGER_ARC
from baxter_kin.ik.self_motion.curve_cubics import arc_lengths, cubics
from baxter_kin.ik.self_motion.curve_kernel import RESIDUAL_TOLERANCE
from baxter_kin.ik.self_motion.solution_curve import SolutionCurve
from baxter_kin.validation import FloatArray, Indices
from planner.atlas.redundancy.rolls import STEP_RAD, pieces_of_rolls, turned, with_witness
from planner.atlas.redundancy.self_collision import SelfCollision
from planner.errors import AtlasError

MEASURES = {
    "pieces": 1.0,
    "length_rad": 1e-4,
    "longest_rad": 1e-4,
    "margin_rad": 1e-4,
    "manipulability": 1e-6,
    "free_share": 1e-4,
}
"""What maps store of a `Freedom`, and in which steps: rounded down, lengths to the nearest."""

MARGIN_TOLERANCE_RAD = 5e-5
"""How much greater than what is returned a margin on the pieces may be."""

PARTS = 16
"""Number of parts that intervals of a curve are cut into, again and again."""

_ROUNDED_DOWN = ("margin_rad", "manipulability")


@frozen(error=AtlasError, eq=True)
class Freedom:
    """The self-motion of one pose, inside the joint limits.

    Attributes:
        pieces: how many connected pieces were found; none where the pose is not reached.
        length_rad: of all together, in joint space: the root of the sum of the squares of what the
            joints move.
        longest_rad: of the longest.
        margin_rad: the greatest distance that the joint nearest to a limit can have from it.
        manipulability: the greatest sqrt(det(J J')), of the tip's Jacobian in m and rad (Yoshikawa,
            "Manipulability of robotic mechanisms", 1985).
        free_share: of the length, what is free of self-collision, 0 .. 1.

    The last three are not numbers where there is no piece.
    """

    pieces: int
    length_rad: float
    longest_rad: float
    margin_rad: float = number_or_nan()
    manipulability: float = number_or_nan()
    free_share: float = number_or_nan()

    def in_steps(self) -> list[int]:
        """The same in steps of `MEASURES`."""
        steps = []
        for name, size in MEASURES.items():
            value = getattr(self, name) / size
            steps.append(int(np.floor(value) if name in _ROUNDED_DOWN else np.rint(value)))
        return steps

    @classmethod
    def from_steps(cls, steps: Sequence[int]) -> Freedom:
        """The freedom of so many steps of `MEASURES`."""
        pieces, *others = steps
        sizes = list(MEASURES.values())[1:]
        return cls(pieces, *(n * size for n, size in zip(others, sizes, strict=True)))

    def _facts(self) -> tuple[str, ...]:
        if not self.pieces:
            return ("not reached",)
        return (
            count(self.pieces, "piece"),
            f"{self.length_rad:.3g} rad, the longest {self.longest_rad:.3g}",
            f"up to {self.margin_rad:.3g} rad off the limits",
            f"manipulability up to {self.manipulability:.3g}",
            f"{100.0 * self.free_share:.3g} % free",
        )


class RedundancySearch(OneLine):
    """Finds the freedom of one arm at poses.

    Attributes:
        side: of the arm.
    """

    def __init__(self, robot: Baxter, side: str, q_others: ArrayLike | None = None) -> None:
        """Prepare it.

        Args:
            robot: the robot.
            side: of the arm.
            q_others: where all other joints stand, shape (19,); the other arm in neutral and all
                hands closed when not given.
        """
        self.side, self._arm = side, robot.arm(side)
        self._ik, self._collision = IKService(self._arm), SelfCollision(robot, side, q_others)

    def at(self, T_base_tip: PoseLike) -> Freedom:
        """At one pose of the tip."""
        return self._freedom(solutions(self._ik, T_base_tip, step_rad=STEP_RAD))

    def at_rolls(
        self, T_base_tip: pin.SE3, rolls: FloatArray, witnesses: FloatArray, known: FloatArray
    ) -> list[Freedom]:
        """At poses that differ by a roll about the tool's axis, which is that of w2.

        Args:
            T_base_tip: the pose at roll zero; of a tool with another axis, the only one.
            rolls: shape (k,), rad.
            witnesses: a configuration inside the limits for each roll, shape (k, 7), rad.
            known: configurations that reach roll zero, w2 inside its limits or not, shape (n, 7).
        """
        found = pieces_of_rolls(self._ik, T_base_tip, rolls, known)
        freedoms = []
        for curves, T, q in zip(found, turned(T_base_tip, rolls), witnesses, strict=True):
            freedoms.append(self._freedom(with_witness(curves, self._arm, T, q)))
        return freedoms

    def _freedom(self, curves: Sequence[SelfMotion]) -> Freedom:
        if not curves:
            return Freedom(0, 0.0, 0.0, math.nan, math.nan, math.nan)
        lengths = [curve.length_rad for curve in curves]
        return Freedom(
            len(curves),
            sum(lengths),
            max(lengths),
            greatest_margin_rad(curves, self._arm.limits),
            greatest_manipulability(curves),
            self._collision.free_share(curves),
        )

    def _facts(self) -> tuple[str, ...]:
        return (repr(self._arm),)


def freedom_at(
    robot: Baxter, side: str, T_base_tip: PoseLike, *, q_others: ArrayLike | None = None
) -> Freedom:
    """The freedom at one pose; for many, keep a `RedundancySearch`.

    Args:
        robot: the robot.
        side: of the arm.
        T_base_tip: the pose of its tip, seen from base.
        q_others: where all other joints stand, shape (19,); the other arm in neutral and all hands
            closed when not given.
    """
    return RedundancySearch(robot, side, q_others).at(T_base_tip)


def greatest_margin_rad(curves: Sequence[SelfMotion], limits: JointLimits) -> float:
    """How far the joint nearest to a limit can be from it, on one or more pieces of one pose.

    Branch and bound: along a curve no joint moves farther than its length in joint space, so
    between two points nothing is farther from limits than half of what both are, and the length
    between, add up to. Intervals that may have more than the best are cut until none is left.
    """
    q, tangent, segment = _together(curves)
    known = np.concatenate([curve.limit_distance_rad for curve in curves])
    best = float(known.max())
    lengths = LONGER_ARC * arc_lengths(
        q[segment + 1] - q[segment], tangent[segment], tangent[segment + 1]
    )
    may = 0.5 * (known[segment] + known[segment + 1] + lengths) > best + MARGIN_TOLERANCE_RAD
    segment, lengths, begin, share = segment[may], lengths[may], np.zeros(may.sum()), 1.0
    while segment.size:
        u = begin[:, None] + share * np.linspace(0.0, 1.0, PARTS + 1)
        on, _ = cubics(q, tangent, np.repeat(segment, PARTS + 1), u.ravel())
        room = np.minimum(on - limits.q_min, limits.q_max - on).min(axis=1).reshape(u.shape)
        best, share, lengths = max(best, float(room.max())), share / PARTS, lengths / PARTS
        bound = 0.5 * (room[:, :-1] + room[:, 1:] + lengths[:, None])
        row, part = np.nonzero(bound > best + MARGIN_TOLERANCE_RAD)
        segment, lengths, begin = segment[row], lengths[row], u[row, part]
    return best


def greatest_manipulability(curves: Sequence[SelfMotion]) -> float:
    """The greatest sqrt(det(J J')) that was found on one or more pieces of one pose.

    At their points, and at more of them where a peak between points may be higher: what it can gain
    over a point is an eighth of how much it changes from point to point there, for a parabola.
    """
    q, tangent, segment = _together(curves)
    known = np.concatenate([curve.manipulability for curve in curves])
    if not segment.size:
        return float(known.max())
    change = np.abs(known[segment + 1] - known[segment])
    near = np.maximum(change, np.maximum(np.roll(change, 1), np.roll(change, -1)))
    may = np.maximum(known[segment], known[segment + 1]) + 0.5 * near >= known.max()
    u = np.tile(np.linspace(0.0, 1.0, PARTS + 1)[1:-1], may.sum())
    on, way = cubics(q, tangent, np.repeat(segment[may], PARTS - 1), u)
    found = SolutionCurve(curves[0].arm, curves[0].T_base_tip).corrected_many(on, way)
    between = np.abs(found.determinant[found.residual <= RESIDUAL_TOLERANCE])
    return float(max(known.max(), between.max(initial=0.0)))


def _together(curves: Sequence[SelfMotion]) -> tuple[FloatArray, FloatArray, Indices]:
    """Points and tangents of all curves in a row, and after which of them a curve goes on."""
    q = np.concatenate([curve.q for curve in curves])
    tangent = np.concatenate([curve.tangent for curve in curves])
    ends = np.cumsum([len(curve.q) for curve in curves]) - 1
    return q, tangent, np.setdiff1d(np.arange(len(q)), ends)
