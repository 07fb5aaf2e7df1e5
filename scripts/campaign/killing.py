"""Kills workers, or a whole build, at random times."""

from __future__ import annotations

import random
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil

from campaign.builds import Build, Wanted, blocks_stored

LONGEST_WAIT_S = 4.0
"""Between kills, at most."""

Tell = Callable[[str], object]


def with_killed_workers(
    folder: Path, engine: str, kills: int, wanted: Wanted, *, chance: random.Random, tell: Tell
) -> Iterator[Path]:
    """Maps that are finished although workers are killed; as many as it takes for all kills."""
    done, number = 0, 0
    while done < kills:
        path = folder / f"{engine}_workers_killed_{number}.zarr"
        build, before = Build.begin(path, engine, 2, wanted), done
        while build.is_running and done < kills:
            time.sleep(chance.uniform(0.0, LONGEST_WAIT_S))
            workers = build.workers()
            if workers and _kill(chance.choice(workers)):
                done += 1
        build.finished()
        tell(f"{engine}: {done - before} workers killed while {path.name} was built")
        number += 1
        yield path


def with_killed_builds(
    folder: Path, kills: int, wanted: Wanted, *, chance: random.Random, tell: Tell
) -> Path:
    """A map whose build is killed with all its workers, again and again, and then finished."""
    path, engines = folder / "builds_killed.zarr", ("pool", "cluster")
    for number in range(kills):
        engine, before = engines[number % 2], blocks_stored(path, wanted.kind)
        build = Build.begin(path, engine, 2, wanted)
        while build.is_running and blocks_stored(path, wanted.kind) <= before:
            time.sleep(0.02)
        time.sleep(chance.uniform(0.0, LONGEST_WAIT_S))
        if not build.is_running:
            raise RuntimeError("the build was over before it was killed; take a larger map")
        killed = build.kill()
        stored = blocks_stored(path, wanted.kind)
        tell(f"{engine}: build killed, {killed} processes, with {stored} blocks stored")
    Build.begin(path, "pool", 2, wanted).finished()
    return path


def _kill(process: psutil.Process) -> bool:
    try:
        process.send_signal(signal.SIGKILL)
    except psutil.NoSuchProcess:
        return False
    return True
