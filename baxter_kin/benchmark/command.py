"""The benchmark's command line: its options, and the run that prints and writes results."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path

from baxter_kin.benchmark.measurement import (
    BatchMeasurement,
    Measurement,
    Verifier,
    measure,
    measure_batch,
    measure_rates,
)
from baxter_kin.benchmark.poses import Scenario, draw_poses
from baxter_kin.benchmark.report import BenchmarkOutcome, Machine, markdown
from baxter_kin.benchmark.solvers import ENTRANTS, Absence, Contestant, enter
from baxter_kin.command_line import (
    UsageError,
    command,
    file_to_write,
    flag,
    log_shown,
    option,
    part,
    progress,
    urdf_option,
    whole_number,
)
from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.engine_options import EngineOptions, engine_of
from baxter_kin.kinematics.arm import LIMBS, Arm
from baxter_kin.kinematics.robot import Baxter
from baxter_kin.parallel import Engine

SCENARIOS = tuple(scenario.value for scenario in Scenario)
SOLVERS = tuple(entrant.key for entrant in ENTRANTS)

MEASURED, RATES, OUTPUT = "what is measured", "solve rates on many cores", "output"


@command(
    "python -m baxter_kin.benchmark",
    "Measures IK solvers on Baxter's arms: how often they find joint angles, and how fast. Every "
    "answer is verified by Pinocchio. Prints markdown.",
    examples=(
        "python -m baxter_kin.benchmark",
        "python -m baxter_kin.benchmark --limb both --scenario near at-limits --count 200",
        "python -m baxter_kin.benchmark --solvers baxter-kin kdl --json ik.json --plot ik.png",
        "python -m baxter_kin.benchmark --rates-only --count 100000 --jobs 2",
    ),
    end="Exit status: 0 measured; 2 wrong usage; 130 stopped by Ctrl-C. Solvers that are not "
    "installed are listed with the command that installs them.",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkOptions:
    """Options of the benchmark."""

    urdf: Path | None = urdf_option(MEASURED)
    limb: str = option(
        "--limb", choices=(*LIMBS, "both"), default="left", group=MEASURED, help="which arm"
    )
    count: int = option(
        "--count",
        type=whole_number(1),
        default=1000,
        metavar="N",
        group=MEASURED,
        help="poses in each set",
    )
    seed: int = option(
        "--seed",
        type=whole_number(0),
        default=0,
        metavar="N",
        group=MEASURED,
        help="seed of the random poses",
    )
    scenario_names: tuple[str, ...] = option(
        "--scenario",
        nargs="+",
        choices=SCENARIOS,
        default=SCENARIOS,
        metavar="NAME",
        group=MEASURED,
        help=f"pose sets: {', '.join(SCENARIOS)} (default: all)",
    )
    solvers: tuple[str, ...] = option(
        "--solvers",
        nargs="+",
        choices=SOLVERS,
        default=SOLVERS,
        metavar="NAME",
        group=MEASURED,
        help=f"solvers: {', '.join(SOLVERS)} (default: all that are installed)",
    )
    with_batch: bool = flag(
        "--batch",
        group=MEASURED,
        help="also time calls for many poses",
    )
    rates_only: bool = flag(
        "--rates-only",
        group=RATES,
        help="measure solve rates only, in parallel; a busy machine does not affect them",
    )
    engine: EngineOptions = part(EngineOptions, RATES)
    json: Path | None = option(
        "--json", type=file_to_write, metavar="FILE", group=OUTPUT, help="write every number"
    )
    plot: Path | None = option(
        "--plot",
        type=file_to_write,
        metavar="FILE",
        group=OUTPUT,
        help="draw time against solve rate (png, svg, pdf)",
    )
    is_quiet: bool = flag("-q", "--quiet", group=OUTPUT, help="show no progress")

    def __post_init__(self) -> None:
        if self.plot is not None:
            _check_plot(self.plot)
            if self.json is not None and self.json.absolute() == self.plot.absolute():
                raise UsageError("--json and --plot name the same file; give two")
        if not self.rates_only:
            if self.engine.is_given:
                raise UsageError(
                    "times are measured in one process; give --rates-only for more workers"
                )
            return
        for name, is_given in (("--plot", self.plot is not None), ("--batch", self.with_batch)):
            if is_given:
                raise UsageError(f"{name} needs times, which --rates-only does not measure")

    @property
    def limbs(self) -> tuple[str, ...]:
        """The arms to measure."""
        return LIMBS if self.limb == "both" else (self.limb,)

    @property
    def scenarios(self) -> tuple[Scenario, ...]:
        """The pose sets, in order."""
        return tuple(dict.fromkeys(map(Scenario, self.scenario_names)))


def _check_plot(path: Path) -> None:
    if importlib.util.find_spec("matplotlib") is None:
        raise UsageError(f"--plot needs matplotlib; {run_to_install_extra('plot')}")
    from baxter_kin.benchmark.plot import supported_formats  # noqa: PLC0415 - loads matplotlib

    formats = supported_formats()
    if path.suffix.lstrip(".").lower() not in formats:
        known = ", ".join(formats)
        raise UsageError(f"--plot cannot draw {path.name!r}; end its name in one of: {known}")


def run_benchmark(options: BenchmarkOptions) -> BenchmarkOutcome:
    """Measure, print the table, write what was asked for."""
    with log_shown((lambda _: None) if options.is_quiet else _note, _note):
        if options.rates_only:
            with engine_of(options.engine) as engine:
                outcome = _measured(options, engine)
        else:
            outcome = _measured(options, None)
    print(markdown(outcome), end="")
    if options.json is not None:
        outcome.write(options.json)
    if options.plot is not None:
        from baxter_kin.benchmark.plot import draw  # noqa: PLC0415 - loads matplotlib

        draw(outcome.rows, options.plot)
    return outcome


def _note(text: str) -> None:
    """Print one line that is not part of the table."""
    print(f"baxter_kin.benchmark: {text}", file=sys.stderr, flush=True)


def _measured(options: BenchmarkOptions, engine: Engine | None) -> BenchmarkOutcome:
    robot = Baxter.load(options.urdf)
    contestants: dict[str, Contestant] = {}
    absences: dict[Absence, None] = {}
    rows: list[Measurement] = []
    batches: list[BatchMeasurement] = []
    for limb in options.limbs:
        arm, present = robot.arm(limb), dict[str, Contestant]()
        for entrant in ENTRANTS:
            if entrant.key in options.solvers:
                found = enter(entrant, arm)
                if isinstance(found, Contestant):
                    present[entrant.key] = found
                else:
                    absences[found] = None
        contestants = present | contestants
        rows += _rows(options, robot, arm, present, engine)
        if options.with_batch:
            batches += _batches(options, arm, Verifier(robot, arm), present)
    return BenchmarkOutcome(options, Machine.this(), contestants, tuple(absences), rows, batches)


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
        total, is_quiet = len(poses) * len(contestants), options.is_quiet
        with progress(title, total, "pose", is_quiet=is_quiet) as tick:
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
