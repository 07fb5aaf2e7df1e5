"""Build maps of what Baxter can reach: kill the builds at random, or measure them.

    python scripts/atlas_campaign.py [kills] [--kills N] [--job-kills N] [--step-m M]
    python scripts/atlas_campaign.py memory [--seconds 60] [--cells 2000]
    python scripts/atlas_campaign.py efficiency [--repeats 3]

All modes run the commands of `python -m planner.atlas`.

`kills`: a reach map of 10 cm x 72 rotations, both arms, is built by one process, by two, and by a
cluster of two workers; then while workers are killed (SIGKILL, at random times, half of them of
each engine), and while the whole job is killed, client and workers, and begun again. All
maps must be identical to the first, byte for byte. The same is done with a redundancy map of one
plane of it, the tool pointing down. The exit status is 1 when a file differs or a build fails.

`memory`: the peak of the resident memory of the client and of its workers (`VmHWM`, Linux): a whole
map of 10 cm and 72 rotations (build, info, verify); part of one of 2.5 cm and 576 rotations, where
most of it is reachable, as far as a build gets in the given time; one position with 294,912
rotations, the most that a Hopf grid has here; the estimated cost of grids of 10^10 and 10^12 cells,
and of 2.5 cm x 576 rotations x both arms, by a random sample within the given time. The exit status
is 1 when a peak exceeds 500 MB, a command fails, or too much is undecided.

`efficiency`: parallel efficiency of two workers, on the same reach map.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from statistics import median

import psutil

MAX_MB, MAX_UNDECIDED, POLL_S = 500.0, 0.002, 0.1
LONGEST_WAIT_S = 4.0
"""Maximum time between kills."""

SHOWN = 10
"""Maximum number of differing files that are printed."""

KINDS = REACH, REDUNDANCY = "reach", "redundancy"
ENGINES = {"pool": "--jobs=2", "cluster": "--local-cluster=2"}
COARSE = ["--hopf=0", "--measure-s=0.1"]
PLANE = ["--z", "0.1", "--tool-axis", "0", "0", "-1", "--measure-s=0.1"]


class Build:
    """A running command of `planner.atlas`."""

    def __init__(self, words: Sequence[str]) -> None:
        self.words, self._output = words, tempfile.TemporaryFile()  # noqa: SIM115 - as long as it runs
        self.process = subprocess.Popen(
            [sys.executable, "-m", "planner.atlas", *words],
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
        )

    @property
    def is_running(self) -> bool:
        """Whether it is running."""
        return self.process.poll() is None

    def below(self) -> list[psutil.Process]:
        """All its descendants."""
        with suppress(psutil.NoSuchProcess):
            return psutil.Process(self.process.pid).children(recursive=True)
        return []

    def workers(self) -> list[psutil.Process]:
        """Its worker processes, without the resource tracker of multiprocessing."""
        return [each for each in self.below() if "spawn_main" in _words_of(each)]

    def kill(self) -> int:
        """Kill it and all its descendants; returns the number of processes."""
        everyone = [*self.below(), psutil.Process(self.process.pid)]
        for each in reversed(everyone):
            with suppress(psutil.NoSuchProcess):
                each.kill()
        self.said()
        return len(everyone)

    def said(self) -> str:
        """Wait for its end and return its output."""
        self.process.wait()
        with self._output as output:
            output.seek(0)
            return output.read().decode()

    def finished(self) -> None:
        """Wait for its end; exits when it has failed."""
        said = self.said()
        if self.process.returncode != 0:
            raise SystemExit(f"{' '.join(self.words)} has failed:\n{said[-3000:]}")

    def peaks_mb(self, stop_s: float | None = None) -> tuple[float, float]:
        """Peak memory of it and of any descendant until it ends, or is interrupted as by Ctrl-C."""
        began_s, client_mb, worker_mb = time.monotonic(), 0.0, 0.0
        while self.is_running:
            client_mb = max(client_mb, peak_mb(self.process.pid))
            worker_mb = max([worker_mb, *(peak_mb(each.pid) for each in self.below())])
            if stop_s is not None and time.monotonic() - began_s > stop_s:
                self.process.send_signal(signal.SIGINT)
                stop_s = None
            time.sleep(POLL_S)
        return client_mb, worker_mb


def _words_of(process: psutil.Process) -> str:
    with suppress(psutil.Error):
        return " ".join(process.cmdline())
    return ""


def peak_mb(pid: int) -> float:
    """Peak resident memory of a process; 0 when it has ended."""
    with suppress(FileNotFoundError, ProcessLookupError):
        found = re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text("utf-8"))
        return 0.0 if found is None else int(found[1]) / 1000.0
    return 0.0


def main(argv: Sequence[str] | None = None) -> int:
    """Kill or measure; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("what", nargs="?", choices=CAMPAIGNS, default="kills")
    parser.add_argument(
        "--kills", type=int, default=20, help="of workers, of each kind of map (20)"
    )
    parser.add_argument("--job-kills", type=int, default=3, help="of whole jobs, likewise (3)")
    parser.add_argument("--only", choices=KINDS, action="append", help="maps of this kind")
    parser.add_argument("--step-m", type=float, default=0.1, help="of the coarse map (0.1)")
    parser.add_argument("--seed", type=int, default=0, help="of the times (0)")
    parser.add_argument("--seconds", type=float, default=60.0, help="for each fine part (60)")
    parser.add_argument("--jobs", type=int, default=2, help="whose memory is measured (2)")
    parser.add_argument("--cells", type=int, default=2000, help="to verify (2000)")
    parser.add_argument("--repeats", type=int, default=3, help="with one worker and with two (3)")
    options = parser.parse_args(argv)
    with tempfile.TemporaryDirectory(prefix="campaign") as folder:
        return 0 if CAMPAIGNS[options.what](Path(folder), options) else 1


# Kills


def kills(folder: Path, options: argparse.Namespace) -> bool:
    """Build maps with kills and compare them; whether all are identical."""
    began_s, wrong = time.monotonic(), 0
    chance = random.Random(options.seed)
    reach = folder / "reach.zarr"
    for kind in KINDS:
        words = (
            ["build", *COARSE, f"--step-m={options.step_m}"]
            if kind == REACH
            else ["redundancy", str(reach), *PLANE]
        )
        first = folder / f"{kind}.zarr"
        if kind == REACH or kind in (options.only or KINDS):
            Build([*words, str(first), "--jobs=1"]).finished()
        if kind not in (options.only or KINDS):
            continue
        wanted = digests(first)
        print(f"{kind}: {len(wanted)} files by one process", flush=True)
        for path, how in _killed(first, words, options, chance):
            differ = differences(digests(path), wanted)
            wrong += bool(differ)
            verdict = (
                f"{len(differ)} files DIFFER: {differ[:SHOWN]}" if differ else "the same bytes"
            )
            took_s = time.monotonic() - began_s
            print(f"{took_s:6.0f} s  {kind}, {how}: {verdict}", flush=True)
            shutil.rmtree(path)
    print("all maps have the same bytes" if not wrong else f"{wrong} maps differ")
    return not wrong


def _killed(
    first: Path, words: Sequence[str], options: argparse.Namespace, chance: random.Random
) -> Iterator[tuple[Path, str]]:
    """Finished maps, each with a description of its build."""
    path = first.with_name(f"again_{first.name}")
    for name, engine in ENGINES.items():
        command = [*words, str(path), engine]
        Build(command).finished()
        yield path, f"by a {name} of two"
        left = options.kills // 2 if name == "cluster" else -(-options.kills // 2)
        while left > 0:
            build, before = Build(command), left
            while build.is_running and left > 0:
                time.sleep(chance.uniform(0.0, LONGEST_WAIT_S))
                workers = build.workers()
                if workers:
                    with suppress(psutil.NoSuchProcess):
                        chance.choice(workers).kill()
                        left -= 1
            build.finished()
            yield path, f"{before - left} workers of a {name} killed"
    if options.job_kills:
        processes = 0
        for number in range(options.job_kills):
            stored = len(list(path.rglob("c/**/*")))
            build = Build([*words, str(path), list(ENGINES.values())[number % 2]])
            while build.is_running and len(list(path.rglob("c/**/*"))) <= stored:
                time.sleep(0.02)
            time.sleep(chance.uniform(0.0, LONGEST_WAIT_S))
            if not build.is_running:
                raise SystemExit("the build was over before it was killed; take a larger map")
            processes += build.kill()
        Build([*words, str(path), ENGINES["pool"]]).finished()
        yield path, f"the job killed {options.job_kills} times, {processes} processes"


def digests(path: Path) -> dict[str, str]:
    """SHA-256 of every file of a map."""
    return {
        str(file.relative_to(path)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(path.rglob("*"))
        if file.is_file()
    }


def differences(found: Mapping[str, str], wanted: Mapping[str, str]) -> list[str]:
    """Names of files that are missing in one map or have different bytes."""
    return sorted(name for name in {*found, *wanted} if found.get(name) != wanted.get(name))


# Memory


def memory(folder: Path, options: argparse.Namespace) -> bool:
    """Print the peaks of each command; whether all are within the bounds."""
    jobs, report = f"--jobs={options.jobs}", folder / "report.json"
    map_, fine, json_ = str(folder / "coarse.zarr"), str(folder / "fine.zarr"), f"--json={report}"
    is_right = told(
        "10 cm x 72, build", ["build", map_, *COARSE, f"--step-m={options.step_m}", jobs, json_]
    )
    computed = json.loads(report.read_text("utf-8"))["computed"]
    undecided = computed["undecided"] / max(computed["cells"], 1)
    print(
        f"  {computed['cells_per_core_s']:,.0f} cells a second and core, {undecided:.4%} undecided"
    )
    is_right &= undecided <= MAX_UNDECIDED
    is_right &= told("10 cm x 72, info", ["info", map_])
    check = ["verify", map_, f"--cells={options.cells}", jobs, json_]
    is_right &= told(f"10 cm x 72, verify {options.cells} cells", check)
    found = json.loads(report.read_text("utf-8"))
    wrong, false = len(found["wrong_witnesses"]), len(found["false_proofs"])
    print(f"  {wrong} wrong witnesses, {false} false proofs, power {found['power']:.4f}")
    box = ["--box", "0.2", "-0.6", "-0.2", "1.0", "0.6", "0.6", "--yes", "--measure-s=1", jobs]
    is_right &= told("2.5 cm x 576, part", ["build", fine, *box], stop_s=options.seconds)
    is_right &= told("2.5 cm x 576, info", ["info", fine])
    is_right &= told("2.5 cm x 576, verify", ["verify", fine, "--cells=200"])
    one = ["--box", *["0.7", "0.2", "0.1"] * 2, "--step-m=0.1", "--hopf=4", "--arm=left"]
    one += ["--measure-s=0.1", jobs]
    title = "one position x 294,912 rotations, build"
    is_right &= told(title, ["build", str(folder / "rotations.zarr"), *one])
    cost = ["build", str(folder / "none.zarr"), "--measure-s"]
    for step, most in (("0.0125", "1e11"), ("0.0025", "2e12")):
        words = [*cost, "1", f"--step-m={step}", f"--most-cells={most}"]
        is_right &= told(f"cost of {most} cells at most", words, status=2)
    told("2.5 cm x 576, cost", [*cost, str(options.seconds)], status=2, shows=True)
    return is_right


def told(
    title: str,
    words: Sequence[str],
    *,
    stop_s: float | None = None,
    status: int = 0,
    shows: bool = False,
) -> bool:
    """Run a command and print its peaks; whether it succeeds within the bound."""
    build = Build(words)
    client_mb, worker_mb = build.peaks_mb(stop_s)
    said = build.said()[-3000:]
    print(f"{title}: client {client_mb:.0f} MB, workers {worker_mb:.0f} MB", flush=True)
    is_right = build.process.returncode in (status, 130 if stop_s else status)
    if shows or not is_right:
        print(f"  exit status {build.process.returncode}: {said}")
    return is_right and max(client_mb, worker_mb) <= MAX_MB


# Efficiency


def efficiency(folder: Path, options: argparse.Namespace) -> bool:
    """Build alternately with one worker and with two, and print the efficiency."""
    for name, two in ENGINES.items():
        spent: dict[int, list[tuple[float, float]]] = {1: [], 2: []}
        for _ in range(options.repeats):
            for workers, runs in spent.items():
                option = two.replace("2", str(workers))
                began_s, before_s = time.perf_counter(), _children_s()
                Build(
                    [
                        "build",
                        str(folder / "map.zarr"),
                        *COARSE,
                        f"--step-m={options.step_m}",
                        option,
                    ]
                ).finished()
                runs.append((time.perf_counter() - began_s, _children_s() - before_s))
                shutil.rmtree(folder / "map.zarr")
        (one_s, one_core_s), (two_s, two_core_s) = (
            map(median, zip(*runs, strict=True)) for runs in spent.values()
        )
        print(
            f"{name}: {one_s:.1f} s with one worker, {two_s:.1f} s with two; processor time "
            f"{one_core_s:.1f} and {two_core_s:.1f} s; efficiency {one_s / two_s / 2:.1%} by wall "
            f"time, {one_core_s / two_core_s:.1%} by processor time"
        )
    return True


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


CAMPAIGNS: dict[str, Callable[[Path, argparse.Namespace], bool]] = {
    "kills": kills,
    "memory": memory,
    "efficiency": efficiency,
}

if __name__ == "__main__":
    sys.exit(main())
