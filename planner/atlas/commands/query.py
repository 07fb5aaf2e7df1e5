"""`python -m planner.atlas query PATH`: what a map says of poses, arms and places of a table."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any

import pinocchio as pin

from baxter_kin.command_line import examples, file_to_write, number, whole_number
from baxter_kin.frames import pose_from_quaternion, quaternion_xyzw
from baxter_kin.kinematics.arm import LIMBS
from planner.atlas.commands.exit_status import asked_for
from planner.atlas.commands.reports import say, write_report
from planner.atlas.questions.arm_choice import which_arm
from planner.atlas.questions.nearest.measure import M_PER_RAD, Keep, PoseMeasure
from planner.atlas.questions.nearest.search import nearest_reachable
from planner.atlas.questions.placing.placement import Placement, PlacementStatus
from planner.atlas.questions.placing.search import MOST_PLACEMENTS, where
from planner.atlas.questions.placing.task_file import load_task
from planner.atlas.reach_map import ReachMap
from planner.manipulator import Manipulator

HELP = "Ask a map: about a pose, the nearest reachable one, which arm, where to put the table."

_ASKED = {
    "pose": "python -m planner.atlas query map.zarr pose 0.7 0.15 -0.129 0 1 0 0",
    "nearest": "python -m planner.atlas query map.zarr nearest 1.2 0.4 0.1 0 1 0 0 --arm left "
    "--keep position",
    "arm": "python -m planner.atlas query map.zarr arm 0.7 0.15 -0.129 0 1 0 0",
    "where": "python -m planner.atlas query map.zarr where --tasks table.json --json places.json",
}
"""An example of each question."""

_POSE_TOLD = "A pose is x, y, z of the tip in m and its quaternion x, y, z, w, seen from base."
_TASK_TOLD = "What a task's file holds: docs/how_to/where_to_put_the_table.md."
_STATUS_TOLD = (
    "Exit status: 0 a yes; 1 a no, such as a pose that is not reachable or no confirmed place, or "
    "a map or file that cannot be read; 2 wrong usage; 130 Ctrl-C."
)

EXAMPLES = examples(*_ASKED.values(), end=f"{_POSE_TOLD} {_TASK_TOLD} {_STATUS_TOLD}")

EXIT_YES, EXIT_NO = 0, 1

KEEPS = [keep.value for keep in Keep]

MOST_REFUSED = 10
"""Refused places that are told one by one."""

POSE = {
    "x": "of the tip in base, m",
    "y": "likewise",
    "z": "likewise",
    "qx": "of its quaternion, x y z w",
    "qy": "likewise",
    "qz": "likewise",
    "qw": "likewise; a hand pointing down is 0 1 0 0",
}
"""The numbers of a pose, and what each is."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What is asked of which map."""
    parser.add_argument("path", metavar="PATH", help="a reach map")
    questions = parser.add_subparsers(dest="question", required=True, metavar="QUESTION")
    for kind, told in (
        ("pose", "Whether each arm reaches a pose, how far off its joint limits, or why not."),
        ("arm", "Which arm is better for a pose, and why."),
        ("nearest", "The nearest pose that an arm reaches."),
    ):
        question = _question(questions, kind, told, f"{_POSE_TOLD} {_STATUS_TOLD}")
        for name, what in POSE.items():
            question.add_argument(name, type=number, metavar=name.upper(), help=what)
        _add_json(question)
    _add_nearest(question)
    told = "Places of a table at which a task can be done, confirmed by verified plans."
    _add_where(_question(questions, "where", told, f"{_TASK_TOLD} {_STATUS_TOLD}"))


def run(arguments: argparse.Namespace) -> int:
    """Print the answer; 0 for a yes, 1 for a no.

    Raises:
        UsageError: when the pose is not a valid one, or the map has no such arm.
        BaxterError: when the map or the task's file is not valid.
    """
    atlas = ReachMap(arguments.path)
    status, sentences, data = _QUESTIONS[arguments.question](atlas, arguments)
    write_report(arguments.json, data)
    say("\n".join(sentences))
    return status


_Answer = tuple[int, list[str], dict[str, Any]]


def _pose(atlas: ReachMap, arguments: argparse.Namespace) -> _Answer:
    T = _given(arguments)
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


def _arm(atlas: ReachMap, arguments: argparse.Namespace) -> _Answer:
    choice = which_arm(atlas, _given(arguments))
    margins = {side: answers[0].margin_rad for side, answers in choice.answers.items()}
    data = {"best": choice.best, "margins_rad": margins, "reason": choice.reason}
    return EXIT_NO if choice.best is None else EXIT_YES, [choice.reason], data


def _nearest(atlas: ReachMap, arguments: argparse.Namespace) -> _Answer:
    T, sentences, data = _given(arguments), list[str](), dict[str, Any]()
    keeps = KEEPS if arguments.keep is None else [arguments.keep]
    sides = atlas.arms if arguments.arm is None else (arguments.arm,)
    with asked_for():
        PoseMeasure(Keep.NOTHING, arguments.m_per_rad)
        for side in sides:
            atlas.check_arm(side)
    is_found = False
    for side in sides:
        for keep in keeps:
            found = nearest_reachable(atlas, T, side, keep=keep, m_per_rad=arguments.m_per_rad)
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


def _where(atlas: ReachMap, arguments: argparse.Namespace) -> _Answer:
    hand = Manipulator.of(atlas.robot, atlas.arms[0]).hand
    task, grid = load_task(arguments.tasks, hand)
    found = where(
        atlas,
        task,
        grid,
        wanted=arguments.wanted,
        most_looked_at=arguments.looked_at,
        most_planned=arguments.planned,
    )
    kinds = {
        "confirmed": found.confirmed,
        "refused": found.refused,
        "not_planned": found.not_planned,
    }
    data: dict[str, Any] = {name: [_told(p) for p in places] for name, places in kinds.items()}
    data["counts"] = {status.name.lower(): found.number(status) for status in PlacementStatus}
    sentences = [str(place) for place in (*found.confirmed, *found.refused[:MOST_REFUSED])]
    if len(found.refused) > MOST_REFUSED:
        sentences.append(f"and {len(found.refused) - MOST_REFUSED} more that are refused")
    return EXIT_YES if found.confirmed else EXIT_NO, [*sentences, found.summary], data


def _told(place: Placement) -> dict[str, Any]:
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


_QUESTIONS: dict[str, Callable[[ReachMap, argparse.Namespace], _Answer]] = {
    "pose": _pose,
    "arm": _arm,
    "nearest": _nearest,
    "where": _where,
}


def _given(arguments: argparse.Namespace) -> pin.SE3:
    given = [getattr(arguments, name) for name in POSE]
    with asked_for():
        return pose_from_quaternion(given[:3], given[3:], normalise=True)


def _seven(T: pin.SE3) -> list[float]:
    numbers: list[float] = [*T.translation.tolist(), *quaternion_xyzw(T).tolist()]
    return numbers


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _question(questions: Any, kind: str, told: str, end: str) -> argparse.ArgumentParser:
    """The parser of one question, with an example."""
    epilog = examples(_ASKED[kind], end=end)
    parser: argparse.ArgumentParser = questions.add_parser(
        kind, help=told, description=told, epilog=epilog, allow_abbrev=False
    )
    return parser


def _add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--json", type=file_to_write, metavar="FILE", help="write the answer as JSON, too"
    )


def _add_nearest(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--arm", choices=LIMBS, help="which (default: the map's)")
    parser.add_argument(
        "--keep",
        choices=KEEPS,
        help="what of the pose stays as it is (default: each in turn)",
    )
    parser.add_argument(
        "--m-per-rad",
        type=number,
        default=M_PER_RAD,
        metavar="M",
        help=f"what a radian counts for where nothing is kept (default: {M_PER_RAD:g} m)",
    )


def _add_where(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--tasks", metavar="FILE", required=True, help="the task, in JSON")
    for name, default, told in (
        ("wanted", 3, "confirmed places that are enough"),
        ("looked-at", 24, "candidates of the map that are asked exactly, at most"),
        ("planned", 8, "of those, places that are planned at most"),
    ):
        parser.add_argument(
            f"--{name}",
            type=whole_number(1, MOST_PLACEMENTS),
            default=default,
            metavar="N",
            help=f"{told} (default: {default})",
        )
    _add_json(parser)
