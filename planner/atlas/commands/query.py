"""`python -m planner.atlas query PATH`: what a map says of poses, arms and places of a table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import pinocchio as pin

from baxter_kin.command_line import (
    command,
    file_to_write,
    number,
    option,
    subcommands,
    whole_number,
)
from baxter_kin.frames import pose_from_quaternion, quaternion_xyzw
from baxter_kin.kinematics.arm import LIMBS
from planner.atlas.commands.console import asked_for, say, write_report
from planner.atlas.questions.arm_choice import which_arm
from planner.atlas.questions.nearest import M_PER_RAD, Keep, PoseMeasure, nearest_reachable
from planner.atlas.questions.placement import Placement, PlacementStatus
from planner.atlas.questions.placing import MAX_PLACEMENTS, where
from planner.atlas.questions.task_file import load_task
from planner.atlas.reach_map import ReachMap
from planner.manipulator import Manipulator

EXIT_YES, EXIT_NO = 0, 1

KEEPS = tuple(keep.value for keep in Keep)

MAX_REFUSED = 10
"""Refused places that are listed one by one."""

_POSE = "A pose is x, y, z of the tip in m and its quaternion x, y, z, w, seen from base."
_TASK = "What a task's file holds: docs/how_to/where_to_put_the_table.md."
_STATUS = (
    "Exit status: 0 a yes; 1 a no, such as a pose that is not reachable or no confirmed place, or "
    "a map or file that cannot be read; 2 wrong usage; 130 Ctrl-C."
)

EXAMPLES = {
    "pose": "python -m planner.atlas query map.zarr pose 0.7 0.15 -0.129 0 1 0 0",
    "nearest": "python -m planner.atlas query map.zarr nearest 1.2 0.4 0.1 0 1 0 0 --arm left "
    "--keep position",
    "arm": "python -m planner.atlas query map.zarr arm 0.7 0.15 -0.129 0 1 0 0",
    "where": "python -m planner.atlas query map.zarr where --tasks table.json --json places.json",
}
"""One of each question."""

Answer: TypeAlias = tuple[int, list[str], dict[str, Any]]
"""Exit status, sentences, and the same as JSON."""


def _number(name: str, text: str) -> Any:
    return option(type=number, metavar=name, help=text)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Question:
    json: Path | None = option(
        "--json", type=file_to_write, metavar="FILE", help="write the answer as JSON, too"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _PoseQuestion(_Question):
    """A question about a pose."""

    x: float = _number("X", "of the tip in base, m")
    y: float = _number("Y", "likewise")
    z: float = _number("Z", "likewise")
    qx: float = _number("QX", "of its quaternion, x y z w")
    qy: float = _number("QY", "likewise")
    qz: float = _number("QZ", "likewise")
    qw: float = _number("QW", "likewise; a hand pointing down is 0 1 0 0")

    @property
    def T_base_tip(self) -> pin.SE3:
        """The pose."""
        with asked_for():
            return pose_from_quaternion(
                (self.x, self.y, self.z), (self.qx, self.qy, self.qz, self.qw), normalise=True
            )


@command(
    None,
    "Whether each arm reaches a pose, how far off its joint limits, or why not.",
    examples=(EXAMPLES["pose"],),
    end=f"{_POSE} {_STATUS}",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class PoseQuestion(_PoseQuestion):
    """The question `pose`."""

    def answer(self, atlas: ReachMap) -> Answer:
        """Whether each arm reaches it."""
        T = self.T_base_tip
        sentences, data = list[str](), dict[str, Any]()
        is_reached = False
        for side, (answer,) in which_arm(atlas, T).answers.items():
            cell = _cell(atlas, side, T)
            sentences.append(f"{answer}; {cell}")
            is_reached |= answer.is_reachable
            data[side] = {
                "status": answer.status,
                "margin_rad": answer.margin_rad,
                "q_rad": None if answer.q is None else answer.q.tolist(),
                "reason": answer.reason,
                "nearest_cell": cell,
            }
        return EXIT_YES if is_reached else EXIT_NO, sentences, data


@command(
    None,
    "Which arm is better for a pose, and why.",
    examples=(EXAMPLES["arm"],),
    end=f"{_POSE} {_STATUS}",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class ArmQuestion(_PoseQuestion):
    """The question `arm`."""

    def answer(self, atlas: ReachMap) -> Answer:
        """The better arm."""
        choice = which_arm(atlas, self.T_base_tip)
        margins = {side: answers[0].margin_rad for side, answers in choice.answers.items()}
        data = {"best": choice.best, "margins_rad": margins, "reason": choice.reason}
        return EXIT_NO if choice.best is None else EXIT_YES, [choice.reason], data


@command(
    None,
    "The nearest pose that an arm reaches.",
    examples=(EXAMPLES["nearest"],),
    end=f"{_POSE} {_STATUS}",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class NearestQuestion(_PoseQuestion):
    """The question `nearest`."""

    arm: str | None = option("--arm", choices=LIMBS, help="which (default: the map's)")
    keep: str | None = option(
        "--keep", choices=KEEPS, help="what of the pose stays as it is (default: each in turn)"
    )
    m_per_rad: float = option(
        "--m-per-rad",
        type=number,
        default=M_PER_RAD,
        metavar="M",
        help="what a radian counts for where nothing is kept, in m",
    )

    def answer(self, atlas: ReachMap) -> Answer:
        """The nearest pose of each arm, in each way."""
        T, sentences, data = self.T_base_tip, list[str](), dict[str, Any]()
        keeps = KEEPS if self.keep is None else (self.keep,)
        sides = atlas.arms if self.arm is None else (self.arm,)
        with asked_for():
            PoseMeasure(Keep.NOTHING, self.m_per_rad)
            for side in sides:
                atlas.check_arm(side)
        is_found = False
        for side in sides:
            for keep in keeps:
                found = nearest_reachable(atlas, T, side, keep=keep, m_per_rad=self.m_per_rad)
                sentences.append(str(found))
                is_found |= found.q is not None
                data.setdefault(side, {})[keep] = {
                    "unit": found.measure.unit,
                    "distance": _or_none(found.distance),
                    "proven": _or_none(found.proven),
                    "pose": None if found.T_base_tip is None else _seven(found.T_base_tip),
                    "q_rad": None if found.q is None else found.q.tolist(),
                }
        return EXIT_YES if is_found else EXIT_NO, sentences, data


@command(
    None,
    "Places of a table at which a task can be done, confirmed by verified plans.",
    examples=(EXAMPLES["where"],),
    end=f"{_TASK} {_STATUS}",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class WhereQuestion(_Question):
    """The question `where`."""

    tasks: str = option("--tasks", metavar="FILE", required=True, help="the task, in JSON")
    wanted: int = option(
        "--wanted",
        type=whole_number(1, MAX_PLACEMENTS),
        default=3,
        metavar="N",
        help="confirmed places that are enough",
    )
    max_examined: int = option(
        "--looked-at",
        type=whole_number(1, MAX_PLACEMENTS),
        default=24,
        metavar="N",
        help="candidates of the map that are examined exactly, at most",
    )
    max_planned: int = option(
        "--planned",
        type=whole_number(1, MAX_PLACEMENTS),
        default=8,
        metavar="N",
        help="of those, places that are planned at most",
    )

    def answer(self, atlas: ReachMap) -> Answer:
        """The places."""
        hand = Manipulator.of(atlas.robot, atlas.arms[0]).hand
        task, grid = load_task(self.tasks, hand)
        found = where(
            atlas,
            task,
            grid,
            wanted=self.wanted,
            max_examined=self.max_examined,
            max_planned=self.max_planned,
        )
        kinds = {
            "confirmed": found.confirmed,
            "refused": found.refused,
            "not_planned": found.not_planned,
        }
        data: dict[str, Any] = {name: [_place(p) for p in places] for name, places in kinds.items()}
        data["counts"] = {status.name.lower(): found.number(status) for status in PlacementStatus}
        sentences = [str(place) for place in (*found.confirmed, *found.refused[:MAX_REFUSED])]
        if len(found.refused) > MAX_REFUSED:
            sentences.append(f"and {len(found.refused) - MAX_REFUSED} more that are refused")
        return EXIT_YES if found.confirmed else EXIT_NO, [*sentences, found.summary], data


@command(
    None,
    "Ask a map: about a pose, the nearest reachable one, which arm, where to put the table.",
    examples=tuple(EXAMPLES.values()),
    end=f"{_POSE} {_TASK} {_STATUS}",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class Query:
    """The sub-command `query`."""

    path: str = option(metavar="PATH", help="a reach map")
    question: PoseQuestion | ArmQuestion | NearestQuestion | WhereQuestion = subcommands(
        {
            "pose": PoseQuestion,
            "arm": ArmQuestion,
            "nearest": NearestQuestion,
            "where": WhereQuestion,
        },
        metavar="QUESTION",
    )

    def run(self) -> int:
        """Print the answer; returns 0 for a yes, 1 for a no."""
        status, sentences, data = self.question.answer(ReachMap(self.path))
        write_report(self.question.json, data)
        say("\n".join(sentences))
        return status


def _cell(atlas: ReachMap, side: str, T: pin.SE3) -> str:
    """What the map's nearest cell says."""
    if atlas.positions.nearest(T.translation) is None:
        return "the map's grid does not go there"
    cell = atlas.nearest_cell(side, T)
    off = T.actInv(cell.T_base_tip)
    trace = (off.rotation.trace() - 1.0) / 2.0
    turned = math.degrees(math.acos(min(max(trace, -1.0), 1.0)))
    offset_mm = 1e3 * math.hypot(*off.translation.tolist())
    return f"the map's nearest cell, {offset_mm:.0f} mm and {turned:.0f} deg off, is {cell.status}"


def _place(place: Placement) -> dict[str, Any]:
    return {
        "table": _seven(place.T_base_table),
        "yaw_rad": place.yaw_rad,
        "margin_rad": _or_none(place.margin_rad),
        "map_margin_rad": place.map_margin_rad,
        "arms": list(place.arms),
        "refusal": place.refusal,
        "poses": [
            {
                "name": answer.label,
                "arm": answer.side,
                "status": answer.status,
                "margin_rad": answer.margin_rad,
                "q_rad": None if answer.q is None else answer.q.tolist(),
            }
            for answer in place.answers
        ],
    }


def _seven(T: pin.SE3) -> list[float]:
    numbers: list[float] = [*T.translation.tolist(), *quaternion_xyzw(T).tolist()]
    return numbers


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
