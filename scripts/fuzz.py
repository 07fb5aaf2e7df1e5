"""Call every public function and method with hostile arguments, and report the faults.

`python scripts/fuzz.py [--count N] [--seed N] [--jobs N] [--only TEXT]`

Hypothesis draws the calls: all arguments are valid except one or more, which are wrong on purpose
(`fuzzing.values`). A call may return, or raise a `BaxterError` with a message of readable length,
or, where an argument is missing or superfluous, Python's own `TypeError`. Anything else is a fault:
another exception, more than 5 s of computation, the end of the process. Faults are listed with
their calls; the exit status is then 1. The calls are spread evenly over all targets; a target
without parameters is called once or twice only. The same seed makes the same calls.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import multiprocessing
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from fuzzing.targets import OURS, Target, all_targets, properties_of
from fuzzing.values import FILLER, HOSTILE, forget, hostile, receivers, valid
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from tqdm import tqdm

from baxter_kin import BaxterError
from baxter_kin.command_line import OneSentenceParser, whole_number

LIMIT_S = 5.0
"""Maximum processor time of one call; other work on the machine does not count."""

STANDSTILL_S = 60.0
"""Additional wall time allowed: a call that waits for ever uses no processor time."""

PREPARATION_S = 120.0
"""Maximum processor time for loading the libraries and building the arguments of a call."""

MAX_MEMORY = 8 << 30
"""Bytes; a process that needs more gets a MemoryError."""

SHARE = 20
"""Targets per process; a new process starts with fresh memory."""

HOSTILE_COUNTS = (1, 1, 1, 1, 1, 1, 1, 2, 2, 100)
"""Number of hostile arguments of a call, drawn uniformly from these; 100 means all."""

WRONG_CALLS = 50
"""One call in so many lacks an argument or has an unknown one."""

MAX_MESSAGE, QUOTED = 3_000, 200
"""Maximum length of a message in characters, and of what it quotes of an argument."""

ITEMS = 3
"""Number of results taken from a returned iterator."""

HANGS = {signal.SIGXCPU: "hang", signal.SIGALRM: "standstill"}
"""Signals by which the kernel ends a process, and what they mean."""

REFUSED, RETURNED, NOT_CALLED = "refused", "returned", "TypeError at the call"


class Call(NamedTuple):
    """A call before it is made.

    Attributes:
        function: called with the arguments below.
        several: positional arguments.
        named: keyword arguments.
        text: the call as a report shows it.
    """

    function: Callable[..., Any]
    several: tuple[Any, ...]
    named: dict[str, Any]
    text: str


class Report(NamedTuple):
    """The result of a call.

    Attributes:
        kind: a row of the table.
        call: as text.
        duration_s: of processor time.
        fault: description of the fault; empty for none.
    """

    kind: str
    call: str
    duration_s: float = 0.0
    fault: str = ""


Work = Callable[[Connection, Sequence[str], int, int, Path], None]
"""The main function of a process: it announces targets and calls, and reports on each call."""


def main(argv: Sequence[str] | None = None) -> int:
    """Make the calls, print a table and the faults."""
    options = _parser().parse_args(argv)
    started, names = time.perf_counter(), [target.name for target in all_targets(options.only)]
    each = -(-options.count // len(names))
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    shares = [names[at : at + SHARE] for at in range(0, len(names), SHARE)]
    with (
        tempfile.TemporaryDirectory() as folder,
        ThreadPoolExecutor(options.jobs) as pool,
        tqdm(total=len(names), unit="target", disable=None) as bar,
    ):
        os.environ["XDG_CACHE_HOME"] = folder

        def made(share: Sequence[str]) -> list[Report]:
            found = list(run(share, each, options.seed, Path(folder)))
            bar.update(len(share))
            return found

        reports = [report for found in pool.map(made, shares) for report in found]
    print("| result | calls |\n| --- | ---: |")
    for kind, count in sorted(Counter(report.kind for report in reports).items()):
        print(f"| {kind} | {count} |")
    faults = sorted(f"{report.fault}: {report.call}" for report in reports if report.fault)
    print(*faults, sep="\n", end="\n" if faults else "")
    longest, took_s = max(reports, key=lambda each: each.duration_s), time.perf_counter() - started
    print(f"{len(reports)} calls of {len(names)} targets in {took_s:.0f} s; ", end="")
    print(f"the longest took {longest.duration_s:.1f} s: {longest.call}")
    return int(bool(faults))


# Processes that make the calls, supervised from outside


def run(
    names: Sequence[str], each: int, number: int, folder: Path, work: Work | None = None
) -> Iterator[Report]:
    """Make `each` calls of every target in a separate process.

    When a call crashes or hangs the process, another process continues with the next target.
    """
    context, left = multiprocessing.get_context("spawn"), list(names)
    while left:
        here, there = context.Pipe(duplex=False)
        words = (there, left, each, number, folder)
        worker = context.Process(target=work or make_calls, args=words, daemon=True)
        worker.start()
        there.close()
        target = call = ""
        try:
            while True:
                kind, value = here.recv()
                target, call = (value, "") if kind == "target" else (target, value)
                if kind == "report":
                    yield value
                    call = ""
        except (EOFError, ConnectionResetError):
            worker.join()
        finally:
            worker.kill()
            here.close()
        if worker.exitcode == 0:
            return
        kind = HANGS.get(-(worker.exitcode or 0), "crash")
        yield Report(kind, call or target or left[0], fault=kind)
        left = left[left.index(target) + 1 :] if target else left[1:]


def make_calls(
    there: Connection, names: Sequence[str], each: int, number: int, folder: Path
) -> None:
    """Make calls, announce each of them, and send its report."""
    os.chdir(folder)
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))
    targets = {target.name: target for target in all_targets()}

    def judge(call: Call) -> None:
        there.send(("call", call.text))
        limit(LIMIT_S)
        begun_s = time.process_time()
        kind, fault = judged(call)
        spent_s = time.process_time() - begun_s
        limit(PREPARATION_S)
        there.send(("report", Report(kind, call.text, spent_s, fault)))

    for name in names:
        there.send(("target", name))
        limit(PREPARATION_S)
        drawn(targets[name], each, number, judge)


def limit(seconds: float) -> None:
    """Have the kernel end this process after more processor time, or a longer standstill."""
    ends_s = math.ceil(time.process_time() + seconds)
    resource.setrlimit(resource.RLIMIT_CPU, (ends_s, resource.getrlimit(resource.RLIMIT_CPU)[1]))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.alarm(math.ceil(seconds + STANDSTILL_S))


# Calls


def drawn(target: Target, count: int, number: int, use: Callable[[Call], None]) -> None:
    """Draw up to `count` calls of a target and use each; the same seed draws the same calls."""
    forget()

    @seed(number)
    @settings(
        max_examples=count,
        phases=[Phase.generate],
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(calls(target))
    def each(call: Call) -> None:
        use(call)

    each()


@st.composite
def calls(draw: st.DrawFn, target: Target, counts: Sequence[int] = HOSTILE_COUNTS) -> Call:
    """Calls of a target whose number of hostile arguments is drawn from `counts`."""
    names = [parameter.name for parameter in target.parameters]
    count = draw(st.sampled_from(counts)) if names else 0
    spoilt = set(draw(st.permutations(names))[:count])
    is_wrong = bool(names and count) and draw(st.integers(1, WRONG_CALLS)) == WRONG_CALLS
    left_out = names[0] if is_wrong and draw(st.booleans()) else None
    several, named, words = (), dict[str, Any](), []
    for parameter in target.parameters:
        name, is_needed = parameter.name, parameter.default is parameter.empty
        if name == left_out or not (name in spoilt or is_needed or draw(st.integers(0, 4)) > 2):
            continue
        if name in spoilt:
            label = draw(st.sampled_from(HOSTILE))
            value = hostile(label)
        else:
            label, value = "<valid>", draw(valid(target.name, parameter))
        words.append(f"{name}={label}")
        if parameter.kind is parameter.VAR_POSITIONAL:
            several = (value,)
        else:
            named[name] = value
    if is_wrong and left_out is None:
        named["surprise"] = 5
        words.append("surprise=5")
    receiver = draw(receivers(target))
    function = target.function
    if target.function is None:
        function = lambda: getattr(receiver, target.attribute)  # noqa: E731
    elif target.owner is not None:
        function = getattr(receiver, target.attribute)
    return Call(function, several, named, f"{target.name}({', '.join(words)})")


def judged(call: Call) -> tuple[str, str]:
    """Make a call and read its result; returns the row of the table and the fault, or ""."""
    try:
        _read(call.function(*call.several, **call.named))
    except BaxterError as error:
        return _refused(error)
    except Exception as error:  # any exception is a finding
        return _unexpected(error)
    return RETURNED, ""


def _read(found: Any) -> None:
    """Read all properties of a returned object, which must be valid."""
    if isinstance(found, Iterator):
        list(islice(found, ITEMS))
    elif type(found).__module__.startswith(OURS):
        for name in properties_of(type(found)):
            getattr(found, name)
        repr(found)
        str(found)


def _refused(error: BaxterError) -> tuple[str, str]:
    name, message = type(error).__name__, str(error)
    with contextlib.suppress(UnicodeEncodeError):
        message.encode()
        if len(message) <= MAX_MESSAGE and FILLER * (QUOTED + 1) not in message:
            return f"{REFUSED}: {name}", ""
    text = f"a message of {len(message)} characters, or one that cannot be printed"
    return f"other: {name}", f"{name}: {text}: {_place(error, message)}"


def _unexpected(error: Exception) -> tuple[str, str]:
    name = type(error).__name__
    if isinstance(error, TypeError) and len(traceback.extract_tb(error.__traceback__)) == 1:
        return NOT_CALLED, ""
    return f"other: {name}", f"{name}: {_place(error, str(error))}"


def _place(error: Exception, message: str) -> str:
    """The beginning of a message, and where in the toolkit it was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    last = [f for f in frames if "site-packages" not in f.filename and f.filename != __file__]
    at = (last or frames)[-1]
    shown = message[:QUOTED].encode("unicode_escape").decode()
    return f"{shown} ({'/'.join(at.filename.split('/')[-2:])}:{at.lineno}, {at.name})"


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(description="Hostile arguments for everything public.")
    some = whole_number(1)
    parser.add_argument("--count", type=some, default=50_000, help="calls (default 50000)")
    parser.add_argument("--seed", type=whole_number(0), default=0, help="of all calls (default 0)")
    parser.add_argument(
        "--only", default="", metavar="TEXT", help="only targets with this in their names"
    )
    parser.add_argument("--jobs", type=some, default=os.cpu_count() or 1, help="processes")
    return parser


if __name__ == "__main__":
    sys.exit(main())
