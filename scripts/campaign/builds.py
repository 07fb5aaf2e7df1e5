"""Builds as processes, and the bytes of what they have made."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from planner.atlas import ReachMap
from planner.atlas.block_map import BlockMap, is_map
from planner.atlas.redundancy import RedundancyMap

SCRIPTS = Path(__file__).resolve().parents[1]


@dataclass(frozen=True, slots=True)
class Wanted:
    """The map that is built.

    Attributes:
        step_m: between positions of the reach map.
        level: of its Hopf grid of rotations.
        reach: where the reach map is, when a redundancy map of a part of it is built.
    """

    step_m: float
    level: int
    reach: Path | None = None

    @property
    def kind(self) -> type[BlockMap]:
        """Class of the map."""
        return ReachMap if self.reach is None else RedundancyMap

    @property
    def words(self) -> list[str]:
        """As `campaign.job` takes them."""
        part = [] if self.reach is None else ["--reach", str(self.reach)]
        return [str(self.step_m), str(self.level), *part]


@dataclass(slots=True)
class Build:
    """A build that runs.

    Attributes:
        path: of the map.
        process: the client.
    """

    path: Path
    process: subprocess.Popen[str]
    _log: Path = field(repr=False)

    @classmethod
    def begin(cls, path: Path, engine: str, workers: int, wanted: Wanted) -> Build:
        """Start one; what it says goes to a file beside the map."""
        words = [str(path), engine, str(workers), *wanted.words]
        log = path.with_suffix(".log")
        roots = os.pathsep.join([str(SCRIPTS), str(SCRIPTS.parent)])
        with log.open("a") as told:
            process = subprocess.Popen(
                [sys.executable, "-m", "campaign.job", *words],
                stdout=subprocess.PIPE,
                stderr=told,
                text=True,
                env={**os.environ, "PYTHONPATH": roots},
            )
        return cls(path, process, log)

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None

    def workers(self) -> list[psutil.Process]:
        """Processes that compute, as far as they live now."""
        return [each for each in self._family() if _is_worker(each)]

    def kill(self) -> int:
        """End client and workers at once; gives how many processes that were."""
        everyone = [*self._family(), psutil.Process(self.process.pid)]
        for each in reversed(everyone):
            with suppress(psutil.NoSuchProcess):
                each.kill()
        self.process.communicate()
        return len(everyone)

    def finished(self) -> dict[str, Any]:
        """What it says at its end."""
        said, _ = self.process.communicate()
        if self.process.returncode != 0:
            last = self._log.read_text().splitlines()[-30:]
            raise RuntimeError(f"the build of {self.path} has failed:\n" + "\n".join(last))
        told: dict[str, Any] = json.loads(said.splitlines()[-1])
        return told

    def _family(self) -> list[psutil.Process]:
        try:
            return psutil.Process(self.process.pid).children(recursive=True)
        except psutil.NoSuchProcess:
            return []


def blocks_stored(path: Path, kind: type[BlockMap]) -> int:
    """Number of blocks of a map that are there."""
    return len(kind(path).computed_blocks()) if is_map(path) else 0


def digests(path: Path) -> dict[str, str]:
    """SHA-256 of every file of a map."""
    return {
        str(file.relative_to(path)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(path.rglob("*"))
        if file.is_file()
    }


def differences(found: Mapping[str, str], wanted: Mapping[str, str]) -> list[str]:
    """Files that one map has and the other has not, or has with other bytes."""
    return sorted(name for name in {*found, *wanted} if found.get(name) != wanted.get(name))


def _is_worker(process: psutil.Process) -> bool:
    """Whether a process is one that multiprocessing has begun, and not its resource tracker."""
    try:
        return any("spawn_main" in word for word in process.cmdline())
    except psutil.Error:
        return False
