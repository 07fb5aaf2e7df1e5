"""Which arm: what each arm of a map reaches of some poses, by what margin, and which is better."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pinocchio as pin

from baxter_kin import IKService
from baxter_kin.display import quoted
from baxter_kin.errors import PoseError
from baxter_kin.fields import frozen, mapping
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.validation import expect
from planner.atlas.questions.pose_answer import PoseAnswer, answer_pose
from planner.atlas.reach_map import ReachMap
from planner.errors import AtlasError

EQUAL_RAD = 1e-3
"""Margins that differ by less are the same."""


@frozen(error=AtlasError)
class ArmChoice:
    """What each arm reaches.

    Attributes:
        answers: side of the arm -> its exact answer for each pose, in their order.
    """

    answers: Mapping[str, tuple[PoseAnswer, ...]] = mapping()

    @property
    def margins_rad(self) -> dict[str, float]:
        """The worst margin of each arm; -inf where it does not reach a pose."""
        return {side: _margin(_worst_of(answers)) for side, answers in self.answers.items()}

    @property
    def best(self) -> str | None:
        """The arm that reaches all poses with the widest worst margin; None where none does.

        Of two that are equal within `EQUAL_RAD` the first arm of the map.
        """
        margins = self.margins_rad
        widest = max(margins.values())
        if widest == -math.inf:
            return None
        return next(side for side, margin in margins.items() if margin >= widest - EQUAL_RAD)

    @property
    def arms_by_pose(self) -> tuple[tuple[str, ...], ...]:
        """Which arms reach each pose."""
        columns = zip(*self.answers.values(), strict=True)
        return tuple(tuple(a.side for a in each if a.is_reachable) for each in columns)

    @property
    def reason(self) -> str:
        """Why it is that arm, or none, in a sentence."""
        best = self.best
        others = [side for side in self.answers if side != best]
        first = "no arm does it all" if best is None else f"the {best} arm: it {self._told(best)}"
        return "; ".join([first, *(f"the {side} arm {self._told(side)}" for side in others)])

    def _told(self, side: str) -> str:
        """What an arm does."""
        answers = self.answers[side]
        missed = [answer for answer in answers if not answer.is_reachable]
        if missed:
            reached = f"{len(answers) - len(missed)} of {len(answers)}"
            return f"reaches {reached}, not {missed[0].label!r}: {missed[0].reason}"
        worst = _worst_of(answers)
        every = f"all {len(answers)} poses" if len(answers) > 1 else "the pose"
        at = f" at {worst.label!r}" if len(answers) > 1 else ""
        return f"reaches {every}, {worst.margin_rad:.3f} rad from {worst.nearest_limit}'s limit{at}"

    def _facts(self) -> tuple[str, ...]:
        return (self.reason,)


def which_arm(
    atlas: ReachMap, poses: Sequence[PoseLike] | Mapping[str, PoseLike] | PoseLike
) -> ArmChoice:
    """Which arms of a map reach poses, each solved exactly, and which is better for all of them.

    Args:
        atlas: a map of the robot; its arms are asked. Its cells play no part: the poses need not be
            on its grid.
        poses: of the tip seen from base: one, several, or several by name.

    Raises:
        PoseError: when one is not valid, or there is none.
    """
    expect(atlas, ReachMap, "atlas", AtlasError)
    named = _named(poses)
    iks = {side: IKService(atlas.robot.arm(side)) for side in atlas.arms}
    return ArmChoice(
        {
            side: tuple(answer_pose(ik, T, name) for name, T in named.items())
            for side, ik in iks.items()
        }
    )


def _worst_of(answers: Sequence[PoseAnswer]) -> PoseAnswer:
    """The one that is not reachable, or has the least margin."""
    return min(answers, key=_margin)


def _margin(answer: PoseAnswer) -> float:
    return -math.inf if answer.margin_rad is None else answer.margin_rad


def _named(poses: Any) -> dict[str, pin.SE3]:
    if isinstance(poses, Mapping):
        given = {str(name): checked_pose(pose) for name, pose in poses.items()}
    elif isinstance(poses, (list, tuple)) and not _is_matrix(poses):
        given = {f"pose {i}": checked_pose(pose) for i, pose in enumerate(poses, start=1)}
    else:
        given = {"pose 1": checked_pose(poses)}
    if not given:
        raise PoseError(f"there must be a pose, one or more, got {quoted(poses)}")
    return given


def _is_matrix(rows: Sequence[object]) -> bool:
    """Whether it is one 4 x 4 matrix written as lists of numbers."""
    return len(rows) == 4 and all(isinstance(r, (list, tuple)) and len(r) == 4 for r in rows)
