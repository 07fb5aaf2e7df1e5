"""`python -m sim.ros1.execute FILE`: carry out a saved plan, or a recording, on a Baxter.

The plan is one of one arm or of both. Of a recording, the arm repeats what it did
(`sim.recording.motion_from`); as before every plan, slow moves that are proven clear take the arms
to the start, one after the other.

Exit status: 0 done; 1 a condition does not hold or it ended early, and why is on stderr; 2 wrong
usage, or a file that holds no plan, recording or response; 130 and 143 stopped by Ctrl-C and by
SIGTERM, after which the arms hold where they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from baxter_kin.command_line import (
    UsageError,
    command,
    flag,
    number_within,
    option,
    parse,
    part,
    run_process,
)
from baxter_kin.kinematics.arm import LIMBS
from sim.recording.record_file import READ_SUFFIXES
from sim.ros1.terminal import (
    EXIT_FAILED,
    EXIT_STATUS,
    EXIT_USAGE,
    FileOptions,
    Signals,
    Terminal,
    file_observers,
)

if TYPE_CHECKING:  # --help needs none of them
    from planner import Plan, Response, TwoArmPlan
    from sim.recording.recording import Recording
    from sim.ros1.execution.execution import MeasuredOutcome, RosExecutor
    from sim.ros1.execution.link import BaxterLink
    from sim.ros1.execution.readiness.ready import ExecutionOptions, ReadyPlan, ReadyTwoArmPlan

TERMINAL = Terminal("baxter-execute")
PACE, LAG = "pace", "how the arm follows (see docs/concepts/proofs.md)"
RECORDING, TOLERANCE_RAD = "a recording", 0.01


def _lag(text: str) -> float:
    from planner.motion.response import MAX_LAG_S  # noqa: PLC0415 - loads NumPy

    return number_within(0.0, MAX_LAG_S, "s")(text)


@command(
    TERMINAL.name,
    "Carry out a plan or a recording on the Baxter of ROS_MASTER_URI. Nothing is sent before all "
    "conditions hold; tested against Debian's ROS 1 and the original clients, never on hardware.",
    examples=(
        "python -m sim.ros1.execute plan.json --dry-run",
        "python -m sim.ros1.execute plan.json --speed 0.3 --record run.mcap",
        "python -m sim.ros1.execute plan.json --response left.json",
        "python -m sim.ros1.execute taught.csv --limb left --speed 1",
    ),
    end=EXIT_STATUS.format(done="0 done; 1 not").replace("usage", "usage, or no plan"),
)
@dataclass(frozen=True, slots=True, kw_only=True)
class ExecuteOptions:
    """Which plan to carry out, and how."""

    plan: str = option(
        metavar="FILE",
        help="a plan of one arm or both that was saved (.json), or a recording (.bag, .csv, .mcap)",
    )
    is_confirmed: bool = flag("--yes", help="move without asking")
    is_dry_run: bool = flag("--dry-run", help="check everything, send nothing")
    speed: float = option(
        "--speed",
        type=number_within(0.01, 1.0, ""),
        default=0.3,
        metavar="RATIO",
        group=PACE,
        help="of the plan's own",
    )
    lead_s: float = option(
        "--lead-s",
        type=number_within(0.0, 1.0, "s"),
        default=0.0,
        metavar="T",
        group=PACE,
        help="send q(t) + T v(t), for an arm that lags by T",
    )
    dwell_s: float = option(
        "--dwell-s",
        type=number_within(0.0, 60.0, "s"),
        default=1.0,
        metavar="S",
        group=PACE,
        help="what closing and opening take at least",
    )
    timeout_s: float | None = option(
        "--timeout-s",
        type=number_within(0.1, 86_400.0, "s"),
        metavar="S",
        group=PACE,
        help="stop after that time",
    )
    lag_s: tuple[float, float] | None = option(
        "--lag-s",
        type=_lag,
        nargs=2,
        metavar=("MIN", "MAX"),
        group=LAG,
        exclusive="response",
        help="how much each joint may lag; the plan is then proven clear wherever that leads",
    )
    response: tuple[str, ...] = option(
        "--response",
        metavar="FILE",
        repeats=True,
        group=LAG,
        exclusive="response",
        help="the same as baxter-check --identify has measured it; for a plan of both arms, one of "
        "each",
    )
    settled_error_rad: float | None = option(
        "--settled-error-rad",
        type=number_within(0.0, 0.2, "rad"),
        metavar="E",
        group=LAG,
        help="with --lag-s: how far off a joint stays once it has settled (default: 0.001)",
    )
    ignores_lag: bool = flag(
        "--despite-lag",
        group=LAG,
        help="carry out what that proof refuses; by a simulated Baxter only",
    )
    limb: str | None = option(
        "--limb",
        choices=LIMBS,
        group=RECORDING,
        help="which arm repeats what it did; needed where both were recorded",
    )
    tolerance_rad: float | None = option(
        "--tolerance-rad",
        type=number_within(1e-4, 0.5, "rad"),
        metavar="E",
        group=RECORDING,
        help=f"how far each joint may be from what was recorded (default: {TOLERANCE_RAD:g})",
    )
    is_fastest: bool = flag(
        "--fastest",
        group=RECORDING,
        help="make it as fast as the limits allow, before --speed slows it; pauses are left out",
    )
    files: FileOptions = part(FileOptions)

    @property
    def is_of_recording(self) -> bool:
        """Whether the file is a recording."""
        return Path(self.plan).suffix.lower() in READ_SUFFIXES

    def __post_init__(self) -> None:
        given = self.limb is not None or self.tolerance_rad is not None or self.is_fastest
        if given and not self.is_of_recording:
            raise UsageError(
                "--limb, --tolerance-rad and --fastest are for recordings, which end in "
                f"{', '.join(READ_SUFFIXES)}; {self.plan} is a plan"
            )
        if self.lag_s is not None and self.lag_s[0] > self.lag_s[1]:
            least, most = self.lag_s
            raise UsageError(
                f"argument --lag-s: MIN is above MAX, {least:g} s above {most:g} s; swap them"
            )
        if self.settled_error_rad is not None and self.lag_s is None:
            raise UsageError(
                "--settled-error-rad goes with --lag-s; give both, or --response alone"
            )
        if self.ignores_lag and self.lag_s is None and not self.response:
            raise UsageError("--despite-lag is for a known lag; give --lag-s or --response, too")
        if self.is_dry_run and (self.files.record or self.files.csv is not None):
            raise UsageError(
                "--dry-run moves nothing, so there is nothing for --record and --csv to write"
            )


def main(argv: Sequence[str] | None = None) -> int:
    """Carry out the plan that the arguments name; returns the exit status."""
    options = parse(ExecuteOptions, argv)
    return TERMINAL.ended(lambda signals: _loaded(options, signals))


def run() -> NoReturn:
    """Run it as a program of its own."""
    run_process(main, TERMINAL.name, failed=EXIT_FAILED)


def _loaded(options: ExecuteOptions, signals: Signals) -> int:
    from planner import TwoArmPlan  # noqa: PLC0415
    from planner.errors import PlanFileError, ResponseError  # noqa: PLC0415
    from planner.two_arms.plan_file import load_any_plan  # noqa: PLC0415
    from sim.errors import RecordingError  # noqa: PLC0415

    try:
        if options.is_of_recording:
            recording = _recording(options)
            limb = options.limb or recording.limbs[0]
            how = _settings(options, _response(options, [limb]))
            return _connected(options, recording, how, signals)
        plan = load_any_plan(options.plan)
        limbs = LIMBS if isinstance(plan, TwoArmPlan) else [plan.limb]
        response = _response(options, limbs)
    except (PlanFileError, RecordingError, ResponseError) as error:
        return TERMINAL.complain(str(error), EXIT_USAGE)
    if plan.failure is not None:
        return TERMINAL.complain(f"{options.plan} is not valid: {plan.failure}")
    return _connected(options, plan, _settings(options, response), signals)


def _recording(options: ExecuteOptions) -> Recording:
    """The recording in the file; the limb is known."""
    from sim.errors import RecordingError  # noqa: PLC0415
    from sim.recording.record_file import read_recording  # noqa: PLC0415

    recording, notes = read_recording(options.plan)
    for note in notes:
        TERMINAL.say(f"note: {note}")
    if options.limb is None and len(recording.limbs) > 1:
        raise RecordingError(f"{options.plan} has both arms; give --limb {' or '.join(LIMBS)}")
    return recording


def _repeated(recording: Recording, options: ExecuteOptions, link: BaxterLink) -> Plan:
    """The plan of a recording for the robot on the network."""
    from planner import Manipulator  # noqa: PLC0415
    from sim.recording.recorded_plan import motion_from  # noqa: PLC0415
    from sim.ros1.execution.readiness.robot import described_robot  # noqa: PLC0415

    limb, tolerance_rad = options.limb or recording.limbs[0], options.tolerance_rad or TOLERANCE_RAD
    made = motion_from(
        recording,
        limb,
        tolerance_rad=tolerance_rad,
        speed="fastest" if options.is_fastest else "recorded",
        manipulator=Manipulator.of(described_robot(link.description), limb),
    )
    TERMINAL.say(
        f"a motion of {made.duration_s:.1f} s, at most {1e3 * made.deviation_rad:.1f} mrad off the "
        f"recording ({made.joint} at {made.time_s:.2f} s)"
    )
    return made.plan


def _connected(
    options: ExecuteOptions,
    given: Plan | TwoArmPlan | Recording,
    how: ExecutionOptions,
    signals: Signals,
) -> int:
    from sim.errors import RecordingError, RosError  # noqa: PLC0415
    from sim.recording.recording import Recording  # noqa: PLC0415
    from sim.ros1.execution.execution import RosExecutor  # noqa: PLC0415
    from sim.ros1.execution.link import BaxterLink  # noqa: PLC0415
    from sim.ros1.execution.readiness.ready import ReadyTwoArmPlan  # noqa: PLC0415
    from sim.ros1.node import Node  # noqa: PLC0415

    with ExitStack() as stack:
        node = stack.enter_context(Node("/baxter_kin", takes_over=False))
        link = stack.enter_context(BaxterLink(node))
        try:
            plan = _repeated(given, options, link) if isinstance(given, Recording) else given
        except (RecordingError, RosError) as error:
            return TERMINAL.complain(f"nothing was moved: {error}")
        if plan.failure is not None:
            return TERMINAL.complain(f"nothing was moved: {plan.failure.reason}")
        readiness = RosExecutor(link, options=how).prepare(plan)
        failures = TERMINAL.report(readiness.findings)
        ready = readiness.ready
        if ready is None:
            return TERMINAL.not_ready("nothing was moved", failures)
        for text in ready.guarded():
            TERMINAL.say(f"     {text}")
        if options.is_dry_run:
            if how.response is None:
                whose = "the arms lag" if isinstance(ready, ReadyTwoArmPlan) else "the arm lags"
                TERMINAL.say(f"not proven: how {whose} (--response)")
            TERMINAL.say(f"would move: {ready.summary}")
            return 0
        observers = file_observers(options.files, ready.robot, stack)
        executor = RosExecutor(link, observers, options=how)
        return _moved(executor, ready, options, signals)


def _moved(
    executor: RosExecutor,
    ready: ReadyPlan | ReadyTwoArmPlan,
    options: ExecuteOptions,
    signals: Signals,
) -> int:
    """Enable, ask, and execute the plan."""
    from sim.ros1.execution.readiness.ready import ReadyTwoArmPlan  # noqa: PLC0415
    from sim.ros1.execution.stops import StopCause  # noqa: PLC0415

    executor.enable()
    TERMINAL.say(ready.summary)
    if not options.is_confirmed and not TERMINAL.is_confirmed():
        return TERMINAL.complain("not confirmed; nothing was moved, and the robot stays enabled")
    is_of_both = isinstance(ready, ReadyTwoArmPlan)
    holding = "both arms hold where they are" if is_of_both else "the arm holds where it is"
    with signals.stopping(lambda name: executor.stop(StopCause(name))):
        outcome = executor.execute(ready)
    return _ended(outcome, signals, holding)


def _ended(outcome: MeasuredOutcome, signals: Signals, holding: str) -> int:
    median, late, latest = (f"{1e3 * each:.1f}" for each in outcome.lateness_s)
    TERMINAL.say(
        f"{outcome.duration_s:.1f} s; at most {outcome.joint_deviation_rad:.4f} rad off a "
        f"set-point, the tip {1e3 * outcome.tip_deviation_m:.1f} mm off its path"
    )
    TERMINAL.say(
        f"set-points were sent {median} ms late in the middle, 99 % of them within {late} ms, the "
        f"latest {latest} ms"
    )
    if outcome.failure is None:
        TERMINAL.say("done")
        return 0
    holds = outcome.stop is not None and outcome.stop.cause.holds
    status = signals.status(EXIT_FAILED)
    return TERMINAL.complain(outcome.failure + (f"; {holding}" if holds else ""), status)


def _settings(
    options: ExecuteOptions, response: Response | Mapping[str, Response] | None
) -> ExecutionOptions:
    from sim.ros1.execution.readiness.ready import ExecutionOptions  # noqa: PLC0415
    from sim.ros1.execution.set_points import Pace  # noqa: PLC0415
    from sim.simulation import Dwell  # noqa: PLC0415

    return ExecutionOptions(
        Pace(options.speed, options.lead_s),
        Dwell(options.dwell_s, options.dwell_s),
        options.timeout_s,
        response,
        options.ignores_lag,
    )


def _response(
    options: ExecuteOptions, limbs: Sequence[str]
) -> Response | Mapping[str, Response] | None:
    """How the arms that move follow; None where it is not known."""
    from planner import Response  # noqa: PLC0415
    from planner.motion.response import load_responses  # noqa: PLC0415

    if options.response:
        return load_responses(options.response, limbs)
    if options.lag_s is None:
        return None
    if options.settled_error_rad is None:
        return Response(options.lag_s)
    return Response(options.lag_s, options.settled_error_rad)


if __name__ == "__main__":
    run()
