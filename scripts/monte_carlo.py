"""How often a pick and place succeeds when the block is seen with noise, open and closed loop.

`python scripts/monte_carlo.py [--runs N] [--noise-mm MM ...] [--plot FILE] [--scheduler ADDRESS]`

Every run is the demo's first cycle with a seed of its own: a true block on the table, eyes that
see it displaced, and up to as many retries as allowed. Open loop is the same run without retries:
its first attempt. A run succeeds when the block really ends within 10 mm of its place. Runs are
spread over all cores, or over a Dask cluster; the same seeds give the same table.
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
from sim import Noise
from sim.demo.noisy_runs import NoisyResult, NoisyRun, result_of

Z_95 = 1.96
"""Of a normal distribution, for intervals of 95 %."""


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
    def of(cls, noise_mm: float, runs: Sequence[NoisyResult]) -> Level:
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


def _levels(options: StudyOptions, engine: Engine) -> list[Level]:
    """What came of all runs, noise by noise; each in the order of its seeds, whoever ran it."""
    noises = [Noise(mm / 1e3, math.radians(options.noise_deg)) for mm in options.noise_mm]
    seeds = range(options.seed, options.seed + options.runs)
    asked = [NoisyRun(seed, noise, options.retries) for noise in noises for seed in seeds]
    answers = dict(tqdm(engine.run(result_of, asked), total=len(asked), unit="run", disable=None))
    return [
        Level.of(mm, [answers[NoisyRun(seed, noise, options.retries)] for seed in seeds])
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


if __name__ == "__main__":
    sys.exit(main())
