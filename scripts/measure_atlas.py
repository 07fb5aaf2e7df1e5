"""Measure maps of what Baxter can reach: memory, throughput, and what the finest one would take.

    python scripts/measure_atlas.py [--seconds 60] [--jobs 2] [--cells 2000] [--keep FOLDER]

The commands of `python -m planner.atlas` run as a user runs them, and the peak of the resident
memory of the client and of its workers is read from the system (`VmHWM`, Linux) while they do:

- a whole map of 10 cm and 72 rotations: build, info, verify;
- part of one of 2.5 cm and 576 rotations, where most of it is reachable, as far as a build gets in
  the time that is given;
- one position with 294,912 rotations, the most that a Hopf grid has here;
- the cost of grids of 10^10 and 10^12 cells, which are told and not built.

Then processor time, in core hours of this machine, of 2.5 cm x 576 rotations x both arms, by a
random sample of at most 1 % of the positions within the time given, with its standard
error. The exit status is 1 when a peak is above 500 MB, a command fails, or too much is undecided.
"""

from __future__ import annotations

import argparse
import json
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import psutil

from baxter_kin import Baxter
from planner.atlas import PositionGrid, ReachDefinition, RotationGrid, estimate

MOST_MB = 500.0
MOST_UNDECIDED = 0.002
POLL_S = 0.1
SAMPLE_SHARE = 0.01


class Peak(NamedTuple):
    """Of one command: exit status, and the most memory of the client and of any other process."""

    status: int
    client_mb: float
    worker_mb: float

    @property
    def is_small(self) -> bool:
        """Whether it is within the bound."""
        return max(self.client_mb, self.worker_mb) <= MOST_MB


def main() -> int:
    """Print a line for each measurement; 1 when one is out of its bound."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="for each of the fine parts")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--cells", type=int, default=2000, help="to verify")
    parser.add_argument("--keep", type=Path, help="folder for the maps; temporary when not given")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        where = folder if given.keep is None else str(given.keep)
        Path(where).mkdir(parents=True, exist_ok=True)
        is_right = coarse(where, given.jobs, given.cells)
        is_right &= fine(where, given.jobs, given.seconds)
        is_right &= extremes(where, given.jobs)
    print(whole_fine_map(given.seconds))
    return 0 if is_right else 1


def coarse(folder: str, jobs: int, cells: int) -> bool:
    """A whole map: its commands one after the other."""
    path, report, workers = f"{folder}/coarse.zarr", f"{folder}/report.json", f"--jobs={jobs}"
    grid = ["--step-m=0.1", "--hopf=0", "--measure-s=5"]
    is_right = told("10 cm x 72, build", ["build", path, *grid, workers, f"--json={report}"])
    computed = json.loads(Path(report).read_text("utf-8"))["computed"]
    if computed["cells"]:
        undecided = computed["undecided"] / computed["cells"]
        rate = computed["cells_per_core_s"]
        print(f"  {rate:,.0f} cells a second and core, {undecided:.4%} undecided")
        is_right &= undecided <= MOST_UNDECIDED
    is_right &= told("10 cm x 72, info", ["info", path])
    checked = ["verify", path, f"--cells={cells}", workers, f"--json={report}"]
    is_right &= told(f"10 cm x 72, verify {cells} cells", checked)
    check = json.loads(Path(report).read_text("utf-8"))
    wrong, false = len(check["wrong_witnesses"]), len(check["false_proofs"])
    print(f"  {wrong} wrong witnesses, {false} false proofs, power {check['power']:.4f}")
    return is_right


def fine(folder: str, jobs: int, seconds: float) -> bool:
    """Part of the finest map, in front of the robot, stopped as by Ctrl-C."""
    path = f"{folder}/fine.zarr"
    box = ["--box", "0.2", "-0.6", "-0.2", "1.0", "0.6", "0.6"]
    build = ["build", path, *box, "--yes", "--measure-s=1", f"--jobs={jobs}"]
    is_right = told("2.5 cm x 576, part of a build", build, stop_s=seconds)
    is_right &= told("2.5 cm x 576, info", ["info", path])
    return is_right & told("2.5 cm x 576, verify", ["verify", path, "--cells=200"])


def extremes(folder: str, jobs: int) -> bool:
    """As many rotations as there may be; as many cells as may be asked for."""
    one = ["--box", *["0.7", "0.2", "0.1"] * 2, "--step-m=0.1", "--hopf=4", "--arm=left"]
    build = ["build", f"{folder}/rotations.zarr", *one, "--measure-s=0.1", f"--jobs={jobs}"]
    is_right = told("one position x 294,912 rotations, build", build)
    for step, most in (("0.0125", "1e11"), ("0.0025", "2e12")):
        asked = ["build", f"{folder}/none.zarr", f"--step-m={step}", f"--most-cells={most}"]
        is_right &= told(f"cost of {most} cells at most", [*asked, "--measure-s=1"], status=2)
    return is_right


def whole_fine_map(seconds: float) -> str:
    """What it would take, by a random sample."""
    robot, rotations = Baxter.load(), RotationGrid.hopf(1)
    grid = PositionGrid.around(robot, 0.025)
    most = int(SAMPLE_SHARE * 2 * len(grid))
    definition = ReachDefinition(robot, grid, rotations)
    cost = estimate(definition, measure_s=seconds, max_positions=most)
    return (
        f"2.5 cm x 576 x 2 arms: {cost.cells:,} cells, {cost.core_hours:.3f} +- "
        f"{cost.core_error_s / 3600.0:.3f} core hours by {cost.measured:,} of "
        f"{cost.positions:,} positions, {cost.size_bytes / 1e9:.2f} GB"
    )


def told(title: str, words: list[str], *, stop_s: float | None = None, status: int = 0) -> bool:
    """Run a command, print its peaks, and say whether they are within the bound."""
    peak = measured(words, stop_s)
    print(f"{title}: client {peak.client_mb:.0f} MB, workers {peak.worker_mb:.0f} MB", flush=True)
    is_right = peak.status in (status, 130 if stop_s else status)
    if not is_right:
        print(f"  exit status {peak.status}")
    return is_right and peak.is_small


def measured(words: list[str], stop_s: float | None) -> Peak:
    """Run a command, and watch it and all that it starts."""
    with tempfile.TemporaryFile() as said:
        client = subprocess.Popen(
            [sys.executable, "-m", "planner.atlas", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=said,
        )
        client_mb, worker_mb = watched(client, stop_s)
        said.seek(0)
        if client.returncode not in (0, 2, 130):
            print(said.read().decode(), file=sys.stderr)
    return Peak(client.returncode, client_mb, worker_mb)


def watched(client: subprocess.Popen[bytes], stop_s: float | None) -> tuple[float, float]:
    """The most memory of a process and of any below it, until it ends; stopped as by Ctrl-C."""
    begun_s, client_mb, worker_mb = time.monotonic(), 0.0, 0.0
    while client.poll() is None:
        client_mb = max(client_mb, peak_mb(client.pid))
        worker_mb = max([worker_mb, *map(peak_mb, children(client.pid))])
        if stop_s is not None and time.monotonic() - begun_s > stop_s:
            client.send_signal(signal.SIGINT)
            stop_s = None
        time.sleep(POLL_S)
    return client_mb, worker_mb


def children(pid: int) -> list[int]:
    """All processes below one."""
    try:
        return [child.pid for child in psutil.Process(pid).children(recursive=True)]
    except psutil.NoSuchProcess:
        return []


def peak_mb(pid: int) -> float:
    """The most memory that a process has had; nothing when it is gone."""
    try:
        status = Path(f"/proc/{pid}/status").read_text("utf-8")
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    found = re.search(r"VmHWM:\s+(\d+) kB", status)
    return 0.0 if found is None else int(found[1]) / 1000.0


if __name__ == "__main__":
    sys.exit(main())
