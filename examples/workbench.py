"""What the examples share: their options, where blocks are scattered, and what they print.

Each is a story on a `sim.Workbench`: every task is planned, verified by other code, executed, and
measured. What cannot be done is noted with its reason, and the next task goes on.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from baxter_kin import Baxter, BaxterError
from baxter_kin.command_line import (
    command,
    file_to_write,
    hands_option,
    option,
    parse,
    urdf_option,
    whole_number,
)
from baxter_kin.description import HandMount
from sim import TaskResult, Workbench, save_recording, write_replay

CELLS_M = tuple((x, y) for x in (-0.065, 0.065) for y in (-0.13, 0.0, 0.13))
"""Where blocks are scattered, seen from the middle of them: one near each x and y."""
JITTER_M = 0.015
"""How far from there; so two blocks are at least 0.10 m apart, centre to centre."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StoryOptions:
    """The options of every example."""

    urdf: Path | None = urdf_option()
    hands: Mapping[str, HandMount] = hands_option()
    html: Path | None = option(
        "--html", type=file_to_write, metavar="FILE", help="write a replay to open and send"
    )
    record: Path | None = option(
        "--record", type=file_to_write, metavar="FILE", help="write all that happens, .mcap"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomStoryOptions(StoryOptions):
    """The options of an example that scatters blocks."""

    seed: int = option(
        "--seed", type=whole_number(0), default=0, metavar="N", help="another arrangement"
    )


def scattered(
    rng: np.random.Generator, count: int, middle_m: tuple[float, float]
) -> list[tuple[float, float, float]]:
    """Places for at most six blocks around a point of the table: x and y in base, m, yaw in rad."""
    cells = rng.permutation(CELLS_M)[:count] + middle_m
    cells += rng.uniform(-JITTER_M, JITTER_M, cells.shape)
    return [(x, y, rng.uniform(-np.pi / 4, np.pi / 4)) for x, y in cells.tolist()]


def play(
    argv: Sequence[str] | None,
    about: str,
    story: Callable[[Workbench, np.random.Generator], None],
    *,
    is_random: bool = False,
    hands: Mapping[str, HandMount] | None = None,
) -> int:
    """Run an example as a program; returns its exit status, 0 when every task was done.

    `hands` are those of the story, where the command line does not say others.
    """
    options = _options(argv, about, is_random=is_random)
    try:
        hands = {**(hands or {}), **options.hands}
        bench = Workbench(Baxter.load(options.urdf, hands=hands))
        seed = options.seed if isinstance(options, RandomStoryOptions) else 0
        story(bench, np.random.default_rng(seed))
        recording = bench.recording()
        _tell(bench)
        if options.html is not None:
            write_replay(options.html, recording, bench.robot, title=about.splitlines()[0])
        if options.record is not None:
            save_recording(recording, options.record)
    except BaxterError as error:
        print(error, file=sys.stderr)
        return 1
    return 0 if all(task.is_done for task in bench.tasks) else 1


def _tell(bench: Workbench) -> None:
    print("block    arm      motion   planning      off by   outcome")
    print(*map(_row, bench.tasks), sep="\n")
    print(f"{bench.motion_s:.2f} s of motion in {bench.simulation.time_s:.2f} s of simulated time")


def _row(task: TaskResult) -> str:
    off = "-" if task.off_m is None else f"{1e3 * task.off_m:.3f} mm"
    numbers = f"{task.motion_s:6.2f} s {task.planning_s:8.2f} s {off:>10}"
    return f"{task.block or '-':8} {task.arm or '-':6} {numbers}   {task.verdict}"


def _options(argv: Sequence[str] | None, about: str, *, is_random: bool) -> StoryOptions:
    story = f"python -m examples.{Path(sys.argv[0]).stem}"
    texts = command(
        story,
        about.splitlines()[0],
        examples=(story, f"{story} --html replay.html", *([f"{story} --seed 1"] * is_random)),
        end="Exit status: 0 every task was done; 1 one was not; 2 wrong usage.",
    )
    return parse(texts(RandomStoryOptions if is_random else StoryOptions), argv)
