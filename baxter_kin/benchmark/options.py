"""The command line of the benchmark."""

from __future__ import annotations

import argparse
import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from baxter_kin.benchmark.entrants import ENTRANTS
from baxter_kin.benchmark.poses import Scenario
from baxter_kin.command_line import (
    OneSentenceParser,
    Options,
    add_urdf,
    examples,
    file_to_write,
    whole_number,
)
from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.parallel.engine_options import add_engine_options

DEFAULT_COUNT = 1000


@dataclass(frozen=True, slots=True)
class BenchmarkOptions:
    """What the user asked for.

    Attributes:
        limbs: the arms to measure, in order.
        scenarios: the pose sets, in order.
        solvers: keys of the solvers to run, in order.
        count: poses in each set.
        seed: of the random poses; the same seed gives the same poses.
        with_batch: measure `solve_batch` as well.
        json: where to write every number, or None.
        plot: where to draw the distribution of times, or None.
        is_quiet: show no progress.
        urdf: the robot's own description, or None for the stock robot.
        engine: where solve rates alone are measured, as `engine_of` reads it; None to measure
            times, too, which is done in this process.
    """

    limbs: tuple[str, ...]
    scenarios: tuple[Scenario, ...]
    solvers: tuple[str, ...]
    count: int
    seed: int
    with_batch: bool = False
    json: Path | None = None
    plot: Path | None = None
    is_quiet: bool = False
    urdf: Path | None = None
    engine: argparse.Namespace | None = None


def parse_options(argv: Sequence[str] | None = None) -> BenchmarkOptions:
    """Read the command line; exits with status 2 and one sentence when it makes no sense."""
    parser = _parser()
    raw = parser.parse_args(argv)
    if raw.plot is not None:
        _check_plot(parser, raw.plot)
        if raw.json is not None and raw.json.absolute() == raw.plot.absolute():
            parser.error("--json and --plot name the same file; give two")
    _check_rates(parser, raw)
    return BenchmarkOptions(
        limbs=LIMBS if raw.limb == "both" else (raw.limb,),
        scenarios=tuple(dict.fromkeys(Scenario(name) for name in raw.scenario)),
        solvers=tuple(entrant.key for entrant in ENTRANTS if entrant.key in raw.solvers),
        count=raw.count,
        seed=raw.seed,
        with_batch=raw.batch,
        json=raw.json,
        plot=raw.plot,
        is_quiet=raw.quiet,
        urdf=raw.urdf,
        engine=raw if raw.rates_only else None,
    )


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(
        prog="python -m baxter_kin.benchmark",
        description="Measures IK solvers on Baxter's arms: how often they find joint angles, and "
        "how fast. Every answer is verified by Pinocchio. Prints markdown.",
        epilog=examples(
            "python -m baxter_kin.benchmark",
            "python -m baxter_kin.benchmark --limb both --scenario near at-limits --count 200",
            "python -m baxter_kin.benchmark --solvers baxter-kin kdl --json ik.json --plot ik.png",
            "python -m baxter_kin.benchmark --rates-only --count 100000 --jobs 2",
            end="Exit status: 0 measured; 2 wrong usage; 130 stopped by Ctrl-C. Solvers that are "
            "not installed are listed with the command that installs them.",
        ),
    )
    _add_what_to_measure(parser.add_argument_group("what is measured"))
    rates = parser.add_argument_group("solve rates on many cores")
    rates.add_argument(
        "--rates-only",
        action="store_true",
        help="measure no times, which a machine at work would spoil; poses are spread over workers",
    )
    add_engine_options(rates, needs="its machines need this toolkit and the solvers")
    _add_outputs(parser.add_argument_group("output"))
    return parser


def _add_what_to_measure(parser: Options) -> None:
    scenarios = [scenario.value for scenario in Scenario]
    solvers = [entrant.key for entrant in ENTRANTS]
    add_urdf(parser)
    parser.add_argument(
        "--limb", choices=(*LIMBS, "both"), default="left", help="which arm (default %(default)s)"
    )
    parser.add_argument(
        "--count",
        type=whole_number(1),
        default=DEFAULT_COUNT,
        metavar="N",
        help="poses in each set (default %(default)s)",
    )
    parser.add_argument(
        "--seed",
        type=whole_number(0),
        default=0,
        metavar="N",
        help="of the random poses (default %(default)s)",
    )
    parser.add_argument(
        "--scenario",
        nargs="+",
        choices=scenarios,
        default=scenarios,
        metavar="NAME",
        help=f"pose sets: {', '.join(scenarios)} (default: all)",
    )
    parser.add_argument(
        "--solvers",
        nargs="+",
        choices=solvers,
        default=solvers,
        metavar="NAME",
        help=f"solvers: {', '.join(solvers)} (default: all that are installed)",
    )
    parser.add_argument("--batch", action="store_true", help="measure solve_batch as well")


def _add_outputs(parser: Options) -> None:
    parser.add_argument("--json", type=file_to_write, metavar="FILE", help="write every number")
    parser.add_argument(
        "--plot",
        type=file_to_write,
        metavar="FILE",
        help="draw time against solve rate (png, svg, pdf)",
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="show no progress")


def _check_rates(parser: argparse.ArgumentParser, raw: argparse.Namespace) -> None:
    if raw.rates_only:
        for option, is_given in (("--plot", raw.plot is not None), ("--batch", raw.batch)):
            if is_given:
                parser.error(f"{option} needs times, which --rates-only does not measure")
    elif (raw.jobs, raw.scheduler, raw.local_cluster) != (None, None, None):
        parser.error("times are measured in one process; give --rates-only for more workers")


def _check_plot(parser: argparse.ArgumentParser, path: Path) -> None:
    if importlib.util.find_spec("matplotlib") is None:
        parser.error(f"--plot needs matplotlib; {run_to_install_extra('plot')}")
    from baxter_kin.benchmark.plot import supported_formats  # noqa: PLC0415 - loads matplotlib

    formats = supported_formats()
    if path.suffix.lstrip(".").lower() not in formats:
        parser.error(
            f"--plot cannot draw {path.name!r}; end its name in one of: {', '.join(formats)}"
        )
