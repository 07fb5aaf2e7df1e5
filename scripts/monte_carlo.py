"""How often a pick and place succeeds when the block is seen with noise, open and closed loop.

`python scripts/monte_carlo.py [--runs N] [--noise-mm MM ...] [--plot FILE]`

Every run is the demo's first cycle with a seed of its own: a true block on the table, eyes that
see it displaced, and up to as many retries as allowed. Open loop is the same run without retries:
its first attempt. A run succeeds when the block really ends within 10 mm of its place. Runs are
spread over all cores; the same seeds give the same table.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
from tqdm import tqdm

from baxter_kin import Baxter
from baxter_kin.command_line import (
    OneSentenceParser,
    file_to_write,
    number_within,
    whole_number,
)
from baxter_kin.files import replace_file
from planner import Manipulator
from sim import ClosedLoop, Noise, NoisyPoses, Simulation, Transfer, TruePoses, World
from sim.demo.options import DEFAULT_POSES_M
from sim.demo.scene import BLOCK, centred_below, demo_bodies, overhead

PLACED_WITHIN_M = 0.010
"""How far from its place the block may end; errors along the pads, which push nothing, remain."""

Z_95 = 1.96
"""Of a normal distribution, for intervals of 95 %."""


@dataclass(frozen=True, slots=True)
class Run:
    """What came of one run.

    Attributes:
        attempts: how many there were.
        is_placed: whether the block really ends where it should.
        off_m: how far from there it really ends.
        failure: why the loop gave up, or None.
    """

    attempts: int
    is_placed: bool
    off_m: float
    failure: str | None

    @property
    def is_open_success(self) -> bool:
        """Whether the first attempt was enough."""
        return self.is_placed and self.attempts == 1


@dataclass(frozen=True, slots=True)
class Level:
    """What came of all runs at one noise.

    Attributes:
        noise_mm: standard deviation of the position, along each axis.
        runs: how many.
        open_loop: how many succeed without retries.
        closed_loop: how many succeed with them.
        attempts: their mean number, with retries.
        worst_mm: how far from its place the block ends at most, of the successful.
    """

    noise_mm: float
    runs: int
    open_loop: int
    closed_loop: int
    attempts: float
    worst_mm: float

    @classmethod
    def of(cls, noise_mm: float, runs: Sequence[Run]) -> Level:
        """Counted."""
        return cls(
            noise_mm,
            len(runs),
            sum(run.is_open_success for run in runs),
            sum(run.is_placed for run in runs),
            float(np.mean([run.attempts for run in runs])),
            1e3 * max((run.off_m for run in runs if run.is_placed), default=math.nan),
        )


def main(argv: Sequence[str] | None = None) -> int:
    """Run, count, print, plot."""
    options = _parser().parse_args(argv)
    started = time.perf_counter()
    levels = []
    with ProcessPoolExecutor(options.processes) as pool:
        total = options.runs * len(options.noise_mm)
        with tqdm(total=total, unit="run", disable=None) as bar:
            for noise_mm in options.noise_mm:
                noise = Noise(noise_mm / 1e3, math.radians(options.noise_deg))
                one = partial(run_once, noise=noise, retries=options.retries)
                seeds = range(options.seed, options.seed + options.runs)
                runs = []
                for run in pool.map(one, seeds):
                    runs.append(run)
                    bar.update()
                levels.append(Level.of(noise_mm, runs))
    _print(levels, options.retries)
    print(f"{total} runs in {time.perf_counter() - started:.0f} s on {options.processes} processes")
    if options.json is not None:
        text = json.dumps([asdict(level) for level in levels], indent=1) + "\n"
        replace_file(options.json, text.encode())
    if options.plot is not None:
        _plot(levels, options.plot, options.retries)
    return 0


def run_once(seed: int, noise: Noise, retries: int) -> Run:
    """The demo's first cycle with noisy eyes."""
    manipulator = _manipulator()
    world = World(manipulator.robot)
    world.move_arm("left", manipulator.arm.start)
    truth = TruePoses(world)
    simulation = Simulation(world, [truth])
    for body in demo_bodies("left"):
        simulation.spawn(body)
    block, (pick, place) = world.body(BLOCK), map(overhead, DEFAULT_POSES_M)
    goal = centred_below(block, place)
    transfer = Transfer(BLOCK, centred_below(block, pick).inverse() * pick, goal)
    eyes = NoisyPoses(truth, noise, np.random.default_rng(seed))
    loop = ClosedLoop(simulation, manipulator, eyes, retries=retries)
    result = loop.pick_and_place(transfer)
    off = world.body(BLOCK).centre_base - block.at(goal).centre_base
    off_m = float(np.linalg.norm(off))
    is_placed = result.is_success and off_m <= PLACED_WITHIN_M
    return Run(len(result.attempts), is_placed, off_m, result.failure)


@cache
def _manipulator() -> Manipulator:
    """Loaded once in each process."""
    return Manipulator.of(Baxter.load(), "left")


def _print(levels: Sequence[Level], retries: int) -> None:
    print(f"noise  runs  open loop             {retries} retries             attempts  worst place")
    for level in levels:
        rates = [_rate(count, level.runs) for count in (level.open_loop, level.closed_loop)]
        print(
            f"{level.noise_mm:g} mm  {level.runs:5}  {rates[0]}  {rates[1]}  "
            f"{level.attempts:8.2f}  {level.worst_mm:.1f} mm"
        )


def _rate(count: int, runs: int) -> str:
    low, high = wilson(count, runs)
    return f"{100 * count / runs:5.1f} % ({100 * low:4.1f} .. {100 * high:5.1f})"


def wilson(count: int, runs: int) -> tuple[float, float]:
    """The 95 % interval of a probability (Wilson, JASA 22(158), 1927)."""
    share, z2 = count / runs, Z_95**2 / runs
    middle = share + z2 / 2
    half = Z_95 * math.sqrt(share * (1.0 - share) / runs + z2 / (4 * runs))
    low, high = (middle - half) / (1.0 + z2), (middle + half) / (1.0 + z2)
    return max(0.0, min(low, share)), min(1.0, max(high, share))  # against rounding at both ends


def _plot(levels: Sequence[Level], path: Path, retries: int) -> None:
    from matplotlib.figure import Figure  # noqa: PLC0415 - only for --plot

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    noise = [level.noise_mm for level in levels]
    series = (
        ("open loop: one look, one attempt", "open_loop", "#c44e52"),
        (f"closed loop: up to {retries} retries", "closed_loop", "#4c72b0"),
    )
    for label, name, colour in series:
        counts = [getattr(level, name) for level in levels]
        rates = np.array([c / level.runs for c, level in zip(counts, levels, strict=True)])
        bounds = np.array([wilson(c, level.runs) for c, level in zip(counts, levels, strict=True)])
        axes.fill_between(noise, *(100 * bounds.T), color=colour, alpha=0.2, linewidth=0)
        axes.plot(noise, 100 * rates, "o-", color=colour, label=label)
    axes.set(
        xlabel="standard deviation of the seen position, mm along each axis",
        ylabel="picked and placed, %",
        ylim=(0, 103),
        title=f"{levels[0].runs} seeded runs a point; bands: 95 % intervals",
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="lower left")
    picture = io.BytesIO()
    figure.savefig(picture, format=path.suffix[1:] or None, dpi=150)
    replace_file(path, picture.getvalue())


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(description="Success against noise, open and closed loop.")
    some, any_number = whole_number(1), whole_number(0)
    millimetres, degrees = number_within(0.0, 100.0, "mm"), number_within(0.0, 180.0, "deg")
    parser.add_argument("--runs", type=some, default=100, help="at each noise (default 100)")
    parser.add_argument(
        "--noise-mm",
        type=millimetres,
        nargs="+",
        default=[1.0, 2.0, 3.0, 4.0, 5.0],
        metavar="MM",
        help="standard deviations of the position, along each axis (default 1 2 3 4 5)",
    )
    parser.add_argument("--noise-deg", type=degrees, default=0.0, metavar="DEG", help="of the yaw")
    parser.add_argument("--retries", type=any_number, default=3, help="(default 3)")
    parser.add_argument("--seed", type=any_number, default=0, help="of the first run (default 0)")
    parser.add_argument("--processes", type=some, default=os.cpu_count() or 1)
    parser.add_argument("--plot", type=file_to_write, metavar="FILE", help="draw the success rates")
    parser.add_argument("--json", type=file_to_write, metavar="FILE", help="write all counts")
    return parser


if __name__ == "__main__":
    sys.exit(main())
