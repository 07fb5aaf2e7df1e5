"""`query` and `plot`: what a map says of poses, arms and places of a table, and pictures of it."""

from __future__ import annotations

import io
import math
import runpy
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import pinocchio as pin

from baxter_kin.command_line import (
    UsageError,
    command,
    file_of_format,
    file_to_write,
    number,
    option,
    subcommands,
    whole_number,
)
from baxter_kin.files import replace_file
from baxter_kin.frames import pose_from_quaternion, quaternion_xyzw
from baxter_kin.kinematics.arm import LIMBS
from planner.atlas.commands.console import asked_for, map_argument, say, write_report
from planner.atlas.pictures import plot_difference, plot_profile, plot_reach_map
from planner.atlas.pictures.figures import QUANTITIES, layers_at
from planner.atlas.pictures.summary import EITHER, check_arm, pointing
from planner.atlas.questions.arm_choice import which_arm
from planner.atlas.questions.nearest import M_PER_RAD, Keep, PoseMeasure, nearest_reachable
from planner.atlas.questions.placement import Placement, PlacementStatus
from planner.atlas.questions.placing import MAX_PLACEMENTS, where
from planner.atlas.questions.task_file import load_task
from planner.atlas.reach_map import ReachMap
from planner.manipulator import Manipulator

if TYPE_CHECKING:  # an extra
    from matplotlib.figure import Figure

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


# plot --------------------------------------------------------------------------------------------

SUFFIXES = (".svg", ".pdf", ".png")

PROFILE = "profile"

PNG_DPI = 200

PAGE_WRITER = "sim.view.atlas"
"""In a layer above the planner, with all that it needs."""

OUTPUT, FIGURE = "output, one at least", "figure"


@command(
    None,
    "Draw slices, a profile or a difference, or write a page to look at.",
    examples=(
        "python -m planner.atlas plot coarse.zarr --out reach.pdf --height -0.1 0.2 0.5",
        "python -m planner.atlas plot coarse.zarr --out down.svg --pointing 0 0 -1 --show margin",
        "python -m planner.atlas plot stock.zarr --out less.png --compare mine.zarr --arm left",
        "python -m planner.atlas plot coarse.zarr --html reach.html",
    ),
    end="Shares of rotations are the reachability index of Zacharias, Borst and Hirzinger (2007). "
    "The page needs no network. Exit status: 0 written; 1 the map failed, in one sentence on "
    "stderr; 2 wrong usage; 130 Ctrl-C.",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class Plot:
    """The sub-command `plot`."""

    path: Path = map_argument()
    out: Path | None = option(
        "--out",
        type=file_of_format(SUFFIXES),
        metavar="FILE",
        group=OUTPUT,
        help=f"a figure: {', '.join(SUFFIXES)}",
    )
    html: Path | None = option(
        "--html",
        type=file_to_write,
        metavar="FILE",
        group=OUTPUT,
        help="a page with the robot, to look at",
    )
    quantity: str = option(
        "--show",
        choices=(*QUANTITIES, PROFILE),
        default=QUANTITIES[0],
        group=FIGURE,
        help="share of rotations reached, greatest margin to the joint limits, or profile over "
        "height",
    )
    heights_m: tuple[float, ...] = option(
        "--height",
        type=number,
        nargs="+",
        default=(),
        metavar="M",
        group=FIGURE,
        help="heights of the slices above base, m (default: 0)",
    )
    arm: str | None = option(
        "--arm", metavar="ARM", group=FIGURE, help="left, right, either or both (default: either)"
    )
    direction: tuple[float, float, float] | None = option(
        "--pointing",
        type=number,
        nargs=3,
        metavar=("X", "Y", "Z"),
        group=FIGURE,
        help="where the tool points, in base; the nearest direction counts (default: any)",
    )
    compare: Path | None = option(
        "--compare",
        type=Path,
        metavar="PATH",
        group=FIGURE,
        help="another map: its share less this one's",
    )

    def __post_init__(self) -> None:
        if self.out is None and self.html is None:
            raise UsageError("say what to write: --out FILE for a figure, --html FILE for a page")
        if self.compare is not None and self.quantity != QUANTITIES[0]:
            raise UsageError(f"--compare is of shares; leave --show {self.quantity} away")
        if self.quantity == PROFILE and self.heights_m:
            raise UsageError("a profile is of all heights; leave --height away")
        of_figure = {
            "--show": self.quantity != QUANTITIES[0],
            "--height": self.heights_m,
            "--arm": self.arm,
            "--pointing": self.direction,
            "--compare": self.compare,
        }
        given = [name for name, value in of_figure.items() if value]
        if self.out is None and given:
            raise UsageError(f"{given[0]} is of a figure; say where to write one by --out FILE")

    def run(self) -> int:
        """Draw; returns the exit status."""
        found = ReachMap(self.path)
        if self.out is not None:
            _write_figure(self.out, _drawn(found, self))
            sys.stdout.write(f"{self.out}: {self.out.stat().st_size / 1e3:.0f} kB\n")
        return 0 if self.html is None else _write_page(self.path, self.html)


def _write_figure(path: Path, figure: Figure) -> None:
    """Write a figure, all of it or nothing; the same figure gives the same bytes."""
    from matplotlib import rc_context  # noqa: PLC0415 - an extra

    kind, content = path.suffix.lower().removeprefix("."), io.BytesIO()
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    with rc_context({"svg.hashsalt": "baxter-kin", "pdf.fonttype": 42}):
        figure.savefig(content, format=kind, dpi=PNG_DPI, metadata=undated)
    replace_file(path, content.getvalue())


def _drawn(found: ReachMap, options: Plot) -> Figure:
    arm = options.arm or (EITHER if len(found.arms) > 1 else found.arms[0])
    heights, direction = options.heights_m or (0.0,), options.direction
    other = None if options.compare is None else ReachMap(options.compare)
    with asked_for():
        for each in (found,) if other is None else (found, other):
            check_arm(each, arm)
        if options.quantity != PROFILE:
            layers_at(found, heights)
        if direction is not None:
            pointing(found.rotations, direction)
    if other is not None:
        return plot_difference(found, other, heights_m=heights, arm=arm, direction=direction)
    if options.quantity == PROFILE:
        return plot_profile(found, arm=arm, direction=direction)
    return plot_reach_map(
        found, heights_m=heights, arm=arm, quantity=options.quantity, direction=direction
    )


def _write_page(path: Path, page: Path) -> int:
    """What `python -m sim.view.atlas PATH PAGE` does, here."""
    given = sys.argv
    sys.argv = [PAGE_WRITER, str(path), str(page)]
    try:
        runpy.run_module(PAGE_WRITER, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        return int(end.code or 0)
    finally:
        sys.argv = given
    return 0
