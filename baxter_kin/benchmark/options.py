"""The options of the benchmark's command line."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path

from baxter_kin.benchmark.entrants import ENTRANTS
from baxter_kin.benchmark.poses import Scenario
from baxter_kin.command_line import (
    UsageError,
    command,
    file_to_write,
    flag,
    option,
    part,
    urdf_option,
    whole_number,
)
from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.engine_options import EngineOptions
from baxter_kin.kinematics.arm import LIMBS

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
    allow_abbrev=True,
)
@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkOptions:
    """What to measure, where, and what to write."""

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
        help="of the random poses",
    )
    given_scenarios: tuple[str, ...] = option(
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
    with_batch: bool = flag("--batch", group=MEASURED, help="measure solve_batch as well")
    rates_only: bool = flag(
        "--rates-only",
        group=RATES,
        help="measure no times, which a machine at work would spoil; poses are spread over workers",
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
        return tuple(dict.fromkeys(map(Scenario, self.given_scenarios)))


def _check_plot(path: Path) -> None:
    if importlib.util.find_spec("matplotlib") is None:
        raise UsageError(f"--plot needs matplotlib; {run_to_install_extra('plot')}")
    from baxter_kin.benchmark.plot import supported_formats  # noqa: PLC0415 - loads matplotlib

    formats = supported_formats()
    if path.suffix.lstrip(".").lower() not in formats:
        known = ", ".join(formats)
        raise UsageError(f"--plot cannot draw {path.name!r}; end its name in one of: {known}")
