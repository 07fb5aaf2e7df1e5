"""Kills the builds of a reach map at random and compares what they leave, byte for byte.

`python scripts/atlas_campaign.py [--kills N] [--efficiency REPEATS]`

A map of 10 cm x 72 rotations, both arms, is built by one process, by two, and by a cluster of two
workers; then while workers are killed (SIGKILL, at random times, half of them of each engine), and
while the whole job is killed, client and workers, and begun again. Every file of every map has to
have the bytes of the first. Ends with status 1 when one has not, or when a build fails.

`--efficiency` measures instead how much of a second core is put to use, on the same map.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from campaign.builds import Build, Size, differences, digests
from campaign.efficiency import measured
from campaign.killing import with_killed_builds, with_killed_workers

from baxter_kin.command_line import OneSentenceParser, number_within, whole_number

SHOWN = 10
"""Names of files that differ."""


def main(argv: Sequence[str] | None = None) -> int:
    """Build, kill, compare."""
    options = _parser().parse_args(argv)
    size = Size(options.step, options.level)
    with tempfile.TemporaryDirectory(prefix="campaign") as folder:
        if options.efficiency is not None:
            return _efficiency(Path(folder), options.efficiency, size)
        return _campaign(Path(folder), options, size)


def _campaign(folder: Path, options: argparse.Namespace, size: Size) -> int:
    begun_s, wrong = time.monotonic(), 0
    tell = partial(_tell, begun_s)
    tell(f"seed {options.seed}")
    reference = folder / "serial.zarr"
    Build.begin(reference, "serial", 1, size).finished()
    wanted = digests(reference)
    megabytes = sum(f.stat().st_size for f in reference.rglob("*") if f.is_file()) / 1e6
    tell(f"serial: {len(wanted)} files, {megabytes:.1f} MB")
    for path in _maps(folder, options, size, tell):
        differ = differences(digests(path), wanted)
        wrong += bool(differ)
        verdict = f"{len(differ)} files DIFFER: {differ[:SHOWN]}" if differ else "the same bytes"
        tell(f"{path.name}: {verdict}")
    tell("all maps have the same bytes" if not wrong else f"{wrong} maps differ")
    return 1 if wrong else 0


def _maps(
    folder: Path, options: argparse.Namespace, size: Size, tell: partial[None]
) -> Iterator[Path]:
    """Maps as they are finished."""
    chance = random.Random(options.seed)
    for engine in ("pool", "cluster"):
        path = folder / f"{engine}.zarr"
        Build.begin(path, engine, 2, size).finished()
        yield path
    of_each = options.kills // 2
    for engine, kills in (("pool", of_each), ("cluster", options.kills - of_each)):
        yield from with_killed_workers(folder, engine, kills, size, chance=chance, tell=tell)
    if options.job_kills:
        yield with_killed_builds(folder, options.job_kills, size, chance=chance, tell=tell)


def _efficiency(folder: Path, repeats: int, size: Size) -> int:
    for engine in ("pool", "cluster"):
        found = measured(folder, engine, repeats, size)
        for workers, runs in ((1, found.one), (2, found.two)):
            walls = ", ".join(f"{run.wall_s:.1f}" for run in runs)
            cores = ", ".join(f"{run.core_s:.1f}" for run in runs)
            print(f"{engine}, {workers} workers: wall {walls} s; processor time {cores} s")
        print(
            f"{engine}: efficiency of two workers {100 * found.by_wall:.1f} % by wall time, "
            f"{100 * found.by_core:.1f} % by processor time"
        )
    return 0


def _tell(begun_s: float, text: str) -> None:
    print(f"{time.monotonic() - begun_s:6.0f} s  {text}", flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(description="Maps that are killed while they are built.")
    parser.add_argument(
        "--kills", type=whole_number(0), default=20, help="of workers (default %(default)s)"
    )
    parser.add_argument(
        "--job-kills", type=whole_number(0), default=3, help="of whole jobs (default %(default)s)"
    )
    parser.add_argument(
        "--step",
        type=number_within(0.02, 0.5, "m"),
        default=0.1,
        metavar="M",
        help="between positions (default %(default)s)",
    )
    parser.add_argument(
        "--level",
        type=whole_number(0),
        default=0,
        help="of the grid of rotations: 0 has 72, 1 has 576 (default %(default)s)",
    )
    parser.add_argument("--seed", type=whole_number(0), default=0, help="(default %(default)s)")
    parser.add_argument(
        "--efficiency",
        type=whole_number(1),
        metavar="REPEATS",
        help="measure this instead, so many times with one worker and with two",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
