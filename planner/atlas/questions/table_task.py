"""TableTask: what shall be done at a table, with all poses as seen from the table.

Instead of the table any frame will do whose z axis points up. Each job is done by one arm; several
jobs may be done by either.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import pinocchio as pin

from baxter_kin.display import count, phrase, position
from baxter_kin.fields import FrozenMapping, field, frozen, sequence
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.validation import expect
from planner.errors import TaskError
from planner.grasping.hand import Hand
from planner.grasping.overhead import overhead_grasp
from planner.pick_place.task import (
    DEFAULT_CLEAR_M,
    DEFAULT_HOVER_M,
    Line,
    Lines,
    PickAndPlace,
    checked_lines,
)
from planner.scene.bodies import Body, Scene

NAMES: Mapping[str, str] = FrozenMapping(
    {
        "pick: approach": "before the pick",
        "pick: descend": "pick",
        "pick: retract": "after the pick",
        "place: approach": "before the place",
        "place: descend": "place",
        "place: retract": "end",
    }
)
"""Names of the poses at the ends of a transfer's motions; others are called as their moves are."""


@frozen(error=TaskError)
class TableTransfer:
    """One pick and one place of a body.

    Attributes:
        body: its name.
        T_table_pick: pose of the tip when the fingers close, seen from the table.
        T_table_place: pose of the tip when they open again.
        hover_m: as of `PickAndPlace`.
        clear_m: as of `PickAndPlace`.
        approach: as of `PickAndPlace`, seen from the table; likewise the next three.
        retreat: likewise.
        place_approach: likewise.
        place_retreat: likewise.

    Raises:
        TaskError: as `PickAndPlace`.
        PoseError: when a pose is invalid.
    """

    body: str
    T_table_pick: pin.SE3 = field(converter=checked_pose)
    T_table_place: pin.SE3 = field(converter=checked_pose)
    hover_m: float = DEFAULT_HOVER_M
    clear_m: float = DEFAULT_CLEAR_M
    approach: Lines = field(default=(), converter=checked_lines, kw_only=True)
    retreat: Lines = field(default=(), converter=checked_lines, kw_only=True)
    place_approach: Lines = field(default=(), converter=checked_lines, kw_only=True)
    place_retreat: Lines = field(default=(), converter=checked_lines, kw_only=True)

    def __attrs_post_init__(self) -> None:
        self.seen_from_base(pin.SE3.Identity())  # the checks of `PickAndPlace`

    @classmethod
    def from_above(
        cls,
        hand: Hand,
        body: Body,
        T_table_to: PoseLike,
        *,
        T_table_pick: PoseLike | None = None,
        hover_m: float = DEFAULT_HOVER_M,
        clear_m: float = DEFAULT_CLEAR_M,
    ) -> TableTransfer:
        """Grasp a body where it is and place it at another pose.

        Args:
            hand: the hand, of either arm.
            body: the body to carry; its pose is seen from the table.
            T_table_to: its pose afterwards, seen from the table.
            T_table_pick: the tip at the grasp; by `overhead_grasp` if not given.
            hover_m: as of the class.
            clear_m: as of the class.

        Raises:
            SceneError: as `overhead_grasp`.
        """
        expect(body, Body, "body", TaskError)
        is_given = T_table_pick is not None
        pick = checked_pose(T_table_pick) if is_given else overhead_grasp(hand, body)
        place = checked_pose(T_table_to) * body.T_base_body.actInv(pick)
        return cls(body.name, pick, place, hover_m, clear_m)

    def seen_from_base(self, T_base_table: pin.SE3) -> PickAndPlace:
        """The task for one place of the table."""
        pick, place = T_base_table * self.T_table_pick, T_base_table * self.T_table_place

        def turned(lines: Lines) -> tuple[Line, ...]:
            return tuple(line.turned(T_base_table.rotation) for line in checked_lines(lines))

        return PickAndPlace(
            self.body,
            pick,
            place,
            self.hover_m,
            self.clear_m,
            approach=turned(self.approach),
            retreat=turned(self.retreat),
            place_approach=turned(self.place_approach),
            place_retreat=turned(self.place_retreat),
        )

    def _facts(self) -> tuple[str, ...]:
        way = f"from {position(self.T_table_pick)} to {position(self.T_table_place)}"
        return phrase(self.body), way, "seen from the table"


@frozen(error=TaskError)
class Visit:
    """A pose for the tip to reach, such as to look at something or to press a button.

    Attributes:
        name: of the visit.
        T_table_tip: the pose, seen from the table.

    Raises:
        TaskError: when the name is not a text.
        PoseError: when the pose is invalid.
    """

    name: str
    T_table_tip: pin.SE3 = field(converter=checked_pose)

    def _facts(self) -> tuple[str, ...]:
        return phrase(self.name), position(self.T_table_tip), "seen from the table"


class Job(NamedTuple):
    """Poses that one arm has to reach.

    Attributes:
        of: the transfer or visit.
        poses: of the tip, seen from the table, each with its name.
    """

    of: TableTransfer | Visit
    poses: tuple[tuple[str, pin.SE3], ...]


@frozen(error=TaskError)
class TableTask:
    """Everything that shall be done at the table.

    Attributes:
        transfers: in this order.
        visits: after them.
        bodies: the table and what moves with it; their poses are seen from the table instead of
            from base.
        standing: bodies that stay where they are, seen from base.

    Raises:
        TaskError: when there is nothing to do, a body to carry is not movable, or a value has the
            wrong type.
        SceneError: when a body to carry is missing, or two bodies share a name.
    """

    transfers: tuple[TableTransfer, ...] = sequence(default=())
    visits: tuple[Visit, ...] = sequence(default=())
    bodies: tuple[Body, ...] = sequence(default=())
    standing: tuple[Body, ...] = sequence(default=())

    def __attrs_post_init__(self) -> None:
        if not self.transfers and not self.visits:
            raise TaskError("a task has a transfer or a visit; give one")
        scene = self.scene(pin.SE3.Identity())
        for transfer in self.transfers:
            if not scene[transfer.body].is_movable:
                raise TaskError(f"{transfer.body!r} is not movable, so it cannot be carried")

    @property
    def jobs(self) -> tuple[Job, ...]:
        """The poses that one arm has to reach for each transfer, then for each visit.

        Those of a transfer are all at which the tip stops or changes its direction. Up is the same
        seen from the table and from base, because the table's z axis points up.
        """
        jobs = []
        for transfer in self.transfers:
            task = transfer.seen_from_base(pin.SE3.Identity())
            named = tuple(
                (f"{transfer.body}: {NAMES.get(leg.label, leg.label)}", leg.T_base_goal)
                for leg in task.waypoints
            )
            jobs.append(Job(transfer, named))
        visits = (Job(visit, ((visit.name, visit.T_table_tip),)) for visit in self.visits)
        return (*jobs, *visits)

    def scene(self, T_base_table: pin.SE3) -> Scene:
        """All bodies, for one place of the table.

        Raises:
            SceneError: when two share a name.
        """
        moved = (body.at(T_base_table * body.T_base_body) for body in self.bodies)
        return Scene.of((*moved, *self.standing))

    def _facts(self) -> tuple[str, ...]:
        jobs = count(len(self.transfers), "transfer"), count(len(self.visits), "visit")
        return *jobs, count(len(self.bodies) + len(self.standing), "body")
