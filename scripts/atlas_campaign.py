"""Kills the builds of maps at random and compares what they leave, byte for byte.

`python scripts/atlas_campaign.py [--kills N] [--only reach|redundancy] [--efficiency REPEATS]`

A reach map of 10 cm x 72 rotations, both arms, is built by one process, by two, and by a cluster of
two workers; then while workers are killed (SIGKILL, at random times, half of them of each engine),
and while the whole job is killed, client and workers, and begun again. Every file of every map has
to have the bytes of the first. The same is done with a redundancy map of one plane of it, the tool
pointing down. Ends with status 1 when a file differs, or when a build fails.

`--efficiency` measures instead how much of a second core is put to use, on the same reach map.
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

from campaign.builds import Build, Wanted, blocks_stored, differences, digests
from campaign.efficiency import measured
from campaign.killing import with_killed_builds, with_killed_workers

from baxter_kin.command_line import OneSentenceParser, number_within, whole_number
from baxter_kin.fields import evolve
from planner.atlas.block_map import bytes_on_disk
from planner.atlas.commands.console import shown_bytes

KINDS = REACH, REDUNDANCY = "reach", "redundancy"
"""Of maps."""

SHOWN = 10
"""Names of files that differ."""


def main(argv: Sequence[str] | None = None) -> int:
    """Build, kill, compare."""
    options = _parser().parse_args(argv)
    reach = Wanted(options.step, options.level)
    with tempfile.TemporaryDirectory(prefix="campaign") as folder:
        if options.efficiency is not None:
            return _efficiency(Path(folder), options.efficiency, reach)
        return _campaign(Path(folder), options, reach)


def _campaign(folder: Path, options: argparse.Namespace, reach: Wanted) -> int:
    tell, wrong = partial(_tell, time.monotonic()), 0
    tell(f"seed {options.seed}")
    for kind in KINDS:
        (folder / kind).mkdir()
    serial = folder / REACH / "serial.zarr"
    Build.begin(serial, "serial", 1, reach).finished()
    if options.only != REDUNDANCY:
        wrong += _differing(serial, options, reach, tell)
    if options.only != REACH:
        redundancy, freedom = evolve(reach, reach=serial), folder / REDUNDANCY / "serial.zarr"
        Build.begin(freedom, "serial", 1, redundancy).finished()
        wrong += _differing(freedom, options, redundancy, tell)
    tell("all maps have the same bytes" if not wrong else f"{wrong} maps differ")
    return 1 if wrong else 0


def _differing(
    serial: Path, options: argparse.Namespace, wanted: Wanted, tell: partial[None]
) -> int:
    """How many maps, of those that are built beside one, differ from it."""
    wrong, bytes_of_serial = 0, digests(serial)
    blocks, size = blocks_stored(serial, wanted.kind), shown_bytes(bytes_on_disk(serial))
    tell(f"{wanted.kind.KIND.name}, serial: {blocks} blocks, {len(bytes_of_serial)} files, {size}")
    for path in _maps(serial.parent, options, wanted, tell):
        differ = differences(digests(path), bytes_of_serial)
        wrong += bool(differ)
        verdict = f"{len(differ)} files DIFFER: {differ[:SHOWN]}" if differ else "the same bytes"
        tell(f"{path.name}: {verdict}")
    return wrong


def _maps(
    folder: Path, options: argparse.Namespace, wanted: Wanted, tell: partial[None]
) -> Iterator[Path]:
    """Maps as they are finished."""
    chance = random.Random(options.seed)
    for engine in ("pool", "cluster"):
        path = folder / f"{engine}.zarr"
        Build.begin(path, engine, 2, wanted).finished()
        yield path
    of_each = options.kills // 2
    for engine, kills in (("pool", of_each), ("cluster", options.kills - of_each)):
        yield from with_killed_workers(folder, engine, kills, wanted, chance=chance, tell=tell)
    if options.job_kills:
        yield with_killed_builds(folder, options.job_kills, wanted, chance=chance, tell=tell)


def _efficiency(folder: Path, repeats: int, wanted: Wanted) -> int:
    for engine in ("pool", "cluster"):
        found = measured(folder, engine, repeats, wanted)
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
        "--kills",
        type=whole_number(0),
        default=20,
        help="of workers, of each kind of map (default %(default)s)",
    )
    parser.add_argument(
        "--job-kills",
        type=whole_number(0),
        default=3,
        help="of whole jobs, likewise (default %(default)s)",
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
    parser.add_argument("--only", choices=KINDS, help="maps of this kind (default: both)")
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
