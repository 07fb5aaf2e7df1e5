"""How often a pick and place succeeds with noisy poses of the block, open and closed loop.

`python scripts/monte_carlo.py [--runs N] [--noise-mm MM ...] [--plot FILE] [--scheduler ADDRESS]`

Every run is the demo's first cycle with a seed of its own: a block on the table, which is perceived
off its true place, and up to as many retries as allowed. Open loop is the same run without retries:
its first attempt. A run succeeds when the block truly ends within `PLACED_WITHIN_M` of its place.
Runs are spread over all cores, or over a Dask cluster; the same seeds give the same table.
"""

from __future__ import annotations

import io
import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from baxter_kin import Baxter
from baxter_kin.command_line import (
    command,
    file_to_write,
    number_within,
    option,
    parse,
    part,
    whole_number,
)
from baxter_kin.display import count
from baxter_kin.engine_options import EngineOptions, engine_of
from baxter_kin.errors import MissingLibraryError
from baxter_kin.files import replace_file
from baxter_kin.parallel import Engine, EngineError
from planner import Manipulator
from sim import ClosedLoop, Noise, NoisyPoses, Simulation, Transfer, TruePoses, World
from sim.demo.options import DEFAULT_POSES_M
from sim.demo.scene import BLOCK, centred_below, demo_bodies, overhead

PLACED_WITHIN_M = 0.010
"""Maximum distance of the block from its place; the pads do not correct errors along them."""

RUNS_OF_A_TASK = 10
"""Number of runs that share one loaded robot."""

Z_95 = 1.96
"""Quantile of a normal distribution, for intervals of 95 %."""


@command(None, "Success against noise, open and closed loop.")
@dataclass(frozen=True, slots=True, kw_only=True)
class StudyOptions:
    """What to run, and what to write."""

    runs: int = option("--runs", type=whole_number(1), default=100, help="at each noise")
    noise_mm: tuple[float, ...] = option(
        "--noise-mm",
        type=number_within(0.0, 100.0, "mm"),
        nargs="+",
        default=(1.0, 2.0, 3.0, 4.0, 5.0),
        metavar="MM",
        help="standard deviations of the position, along each axis (default: 1 2 3 4 5)",
    )
    noise_deg: float = option(
        "--noise-deg",
        type=number_within(0.0, 180.0, "deg"),
        default=0.0,
        metavar="DEG",
        help="of the yaw",
    )
    retries: int = option("--retries", type=whole_number(0), default=3, help="after a miss")
    seed: int = option("--seed", type=whole_number(0), default=0, help="of the first run")
    engine: EngineOptions = part(EngineOptions)
    plot: Path | None = option(
        "--plot", type=file_to_write, metavar="FILE", help="draw the success rates"
    )
    json: Path | None = option(
        "--json", type=file_to_write, metavar="FILE", help="write all counts"
    )


@dataclass(frozen=True, slots=True)
class Runs:
    """Some runs at one noise.

    Attributes:
        seeds: of the noise, one for each run.
        noise: of the perceived poses.
        retries: maximum number of attempts after the first.
    """

    seeds: tuple[int, ...]
    noise: Noise
    retries: int


@dataclass(frozen=True, slots=True)
class Result:
    """The result of one run.

    Attributes:
        attempts: their number.
        is_placed: whether the block truly ends at its place.
        off_m: its true distance from there.
    """

    attempts: int
    is_placed: bool
    off_m: float


@dataclass(frozen=True, slots=True)
class Level:
    """The results at one noise.

    Attributes:
        noise_mm: standard deviation of the position, along each axis.
        runs: number of runs.
        open_loop: number of runs that succeed without retries.
        closed_loop: number of runs that succeed with them.
        attempts: their mean number, with retries.
        worst_mm: maximum distance of the block from its place, of the runs that succeed.
    """

    noise_mm: float
    runs: int
    open_loop: int
    closed_loop: int
    attempts: float
    worst_mm: float

    @classmethod
    def of(cls, noise_mm: float, runs: Sequence[Result]) -> Level:
        """Count results."""
        return cls(
            noise_mm,
            len(runs),
            sum(run.is_placed and run.attempts == 1 for run in runs),
            sum(run.is_placed for run in runs),
            float(np.mean([run.attempts for run in runs])),
            1e3 * max((run.off_m for run in runs if run.is_placed), default=math.nan),
        )


def main(argv: Sequence[str] | None = None) -> int:
    """Run, count, print, plot."""
    options = parse(StudyOptions, argv)
    started = time.perf_counter()
    try:
        with engine_of(options.engine) as engine:
            levels, workers = _levels(options, engine), engine.workers
    except (EngineError, MissingLibraryError) as cause:
        print(f"monte_carlo: {cause}", file=sys.stderr)
        return 1
    _print(levels, options.retries)
    total, took_s = sum(level.runs for level in levels), time.perf_counter() - started
    print(f"{total} runs in {took_s:.0f} s on {count(workers, 'worker')}")
    if options.json is not None:
        text = json.dumps([asdict(level) for level in levels], indent=1) + "\n"
        replace_file(options.json, text.encode())
    if options.plot is not None:
        _plot(levels, options.plot, options.retries)
    return 0


def results_of(runs: Runs) -> tuple[Result, ...]:
    """Run the demo's first cycle once for each seed; depends on nothing but its argument."""
    manipulator = Manipulator.of(Baxter.load(), "left")
    return tuple(_result(manipulator, runs, seed) for seed in runs.seeds)


def _result(manipulator: Manipulator, runs: Runs, seed: int) -> Result:
    world = World(manipulator.robot)
    world.move_arm("left", manipulator.arm.start)
    truth = TruePoses(world)
    simulation = Simulation(world, [truth])
    for body in demo_bodies("left"):
        simulation.spawn(body)
    block, (pick, place) = world.body(BLOCK), map(overhead, DEFAULT_POSES_M)
    goal = centred_below(block, place)
    transfer = Transfer(BLOCK, centred_below(block, pick).inverse() * pick, goal)
    perceived = NoisyPoses(truth, runs.noise, np.random.default_rng(seed))
    loop = ClosedLoop(simulation, manipulator, perceived, retries=runs.retries)
    result = loop.pick_and_place(transfer)
    off_m = float(np.linalg.norm(world.body(BLOCK).centre_base - block.at(goal).centre_base))
    return Result(len(result.attempts), result.is_success and off_m <= PLACED_WITHIN_M, off_m)


def _levels(options: StudyOptions, engine: Engine) -> list[Level]:
    """The results of all runs, noise by noise; each in the order of its seeds."""
    noises = [Noise(mm / 1e3, math.radians(options.noise_deg)) for mm in options.noise_mm]
    seeds = range(options.seed, options.seed + options.runs)
    parts = [tuple(seeds[at : at + RUNS_OF_A_TASK]) for at in range(0, len(seeds), RUNS_OF_A_TASK)]
    tasks = [Runs(part, noise, options.retries) for noise in noises for part in parts]
    found: dict[Runs, tuple[Result, ...]] = {}
    with tqdm(total=len(noises) * len(seeds), unit="run", disable=None) as progress:
        for task, results in engine.run(results_of, tasks):
            found[task] = results
            progress.update(len(results))
    return [
        Level.of(mm, [each for task in tasks if task.noise == noise for each in found[task]])
        for mm, noise in zip(options.noise_mm, noises, strict=True)
    ]


def _print(levels: Sequence[Level], retries: int) -> None:
    print(f"noise  runs  open loop             {retries} retries             attempts  worst place")
    for level in levels:
        rates = [_rate(number, level.runs) for number in (level.open_loop, level.closed_loop)]
        print(
            f"{level.noise_mm:g} mm  {level.runs:5}  {rates[0]}  {rates[1]}  "
            f"{level.attempts:8.2f}  {level.worst_mm:.1f} mm"
        )


def _rate(number: int, runs: int) -> str:
    low, high = wilson(number, runs)
    return f"{100 * number / runs:5.1f} % ({100 * low:4.1f} .. {100 * high:5.1f})"


def wilson(number: int, runs: int) -> tuple[float, float]:
    """The 95 % interval of a probability (Wilson, JASA 22(158), 1927)."""
    share, z2 = number / runs, Z_95**2 / runs
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
        xlabel="standard deviation of the perceived position, mm along each axis",
        ylabel="picked and placed, %",
        ylim=(0, 103),
        title=f"{levels[0].runs} seeded runs a point; bands: 95 % intervals",
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="lower left")
    picture = io.BytesIO()
    figure.savefig(picture, format=path.suffix[1:] or None, dpi=150)
    replace_file(path, picture.getvalue())


if __name__ == "__main__":
    sys.exit(main())
