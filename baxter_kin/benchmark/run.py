"""One run of the benchmark, from options to table, JSON and plot."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from baxter_kin.benchmark.entrants import ENTRANTS, Absence, Contestant, enter
from baxter_kin.benchmark.measurement import BatchMeasurement, Measurement, measure, measure_batch
from baxter_kin.benchmark.options import BenchmarkOptions
from baxter_kin.benchmark.poses import draw_poses
from baxter_kin.benchmark.report import BenchmarkOutcome, Machine, markdown
from baxter_kin.benchmark.solve_rates import measure_rates
from baxter_kin.benchmark.verification import Verifier
from baxter_kin.command_line import log_shown
from baxter_kin.engine_options import engine_of
from baxter_kin.kinematics.arm import Arm
from baxter_kin.model import Baxter
from baxter_kin.parallel import Engine


def run_benchmark(options: BenchmarkOptions) -> BenchmarkOutcome:
    """Measure, print the table, write what was asked for."""
    with log_shown((lambda _: None) if options.is_quiet else _tell, _tell):
        outcome = _measure(options)
    print(markdown(outcome), end="")
    if options.json is not None:
        outcome.write(options.json)
    if options.plot is not None:
        from baxter_kin.benchmark.plot import draw  # noqa: PLC0415 - loads matplotlib

        draw(outcome.rows, options.plot)
    return outcome


def _tell(text: str) -> None:
    """One line that is no part of the table."""
    print(f"baxter_kin.benchmark: {text}", file=sys.stderr, flush=True)


def _measure(options: BenchmarkOptions) -> BenchmarkOutcome:
    if not options.rates_only:
        return _measured(options, None)
    with engine_of(options.engine) as engine:
        return _measured(options, engine)


def _measured(options: BenchmarkOptions, engine: Engine | None) -> BenchmarkOutcome:
    robot = Baxter.load(options.urdf)
    contestants: dict[str, Contestant] = {}
    absences: dict[Absence, None] = {}
    rows: list[Measurement] = []
    batches: list[BatchMeasurement] = []
    for limb in options.limbs:
        arm = robot.arm(limb)
        present, absent = _enter(options, arm)
        contestants = present | contestants
        absences.update(dict.fromkeys(absent))
        rows += _rows(options, robot, arm, present, engine)
        if options.with_batch:
            batches += _batches(options, arm, Verifier(robot, arm), present)
    return BenchmarkOutcome(options, Machine.this(), contestants, tuple(absences), rows, batches)


def _enter(options: BenchmarkOptions, arm: Arm) -> tuple[dict[str, Contestant], list[Absence]]:
    entered = {e.key: enter(e, arm) for e in ENTRANTS if e.key in options.solvers}
    present = {key: who for key, who in entered.items() if isinstance(who, Contestant)}
    return present, [who for who in entered.values() if isinstance(who, Absence)]


def _rows(
    options: BenchmarkOptions,
    robot: Baxter,
    arm: Arm,
    contestants: dict[str, Contestant],
    engine: Engine | None,
) -> list[Measurement]:
    rows, verifier = [], Verifier(robot, arm)
    for scenario in options.scenarios:
        poses = draw_poses(arm, scenario, count=options.count, seed=options.seed)
        title = f"{arm.side}, {scenario.value}"
        with _progress(title, len(poses) * len(contestants), options) as tick:
            if engine is None:
                rows += measure(contestants, poses, verifier, tick)
            else:
                rows += measure_rates(robot, contestants, poses, engine, tick)
    return rows


def _batches(
    options: BenchmarkOptions, arm: Arm, verifier: Verifier, contestants: dict[str, Contestant]
) -> list[BatchMeasurement]:
    poses = draw_poses(arm, options.scenarios[0], count=options.count, seed=options.seed)
    found = [measure_batch(key, who, poses, verifier) for key, who in contestants.items()]
    return [batch for batch in found if batch is not None]


@contextmanager
def _progress(
    title: str, total: int, options: BenchmarkOptions
) -> Iterator[Callable[[int], object]]:
    """A bar on stderr, for those who watch."""
    is_watched = sys.stderr.isatty() and importlib.util.find_spec("tqdm") is not None
    if options.is_quiet or not is_watched:
        yield lambda _: None
        return
    from tqdm import tqdm  # noqa: PLC0415 - only when shown

    with tqdm(total=total, desc=title, unit="pose", leave=False, file=sys.stderr) as bar:
        yield bar.update
