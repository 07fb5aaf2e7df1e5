"""What it ran on."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from baxter_kin.benchmark.threads import are_threads_limited

_PACKAGES = ("baxter-kin", "numpy", "pin", "casadi")


@dataclass(frozen=True, slots=True)
class Machine:
    """Processor, Python and the versions that matter.

    Attributes:
        cpu: its model name.
        cores: how many the system has.
        python: its version.
        packages: versions by name.
        has_limited_threads: whether numerical libraries were held to one thread.
    """

    cpu: str
    cores: int
    python: str
    packages: dict[str, str]
    has_limited_threads: bool

    @classmethod
    def this(cls) -> Machine:
        """The one this runs on."""
        return cls(
            cpu=_cpu(),
            cores=os.cpu_count() or 1,
            python=f"{platform.python_implementation()} {platform.python_version()}",
            packages={name: version_of(name) for name in _PACKAGES},
            has_limited_threads=are_threads_limited(),
        )

    def __str__(self) -> str:
        packages = ", ".join(f"{name} {number}" for name, number in self.packages.items())
        limited = "one thread a library" if self.has_limited_threads else "threads not limited"
        return f"{self.cpu}, {self.cores} cores; {self.python}, {packages}; {limited}"


def _cpu() -> str:
    """The model name as Linux tells it, else what Python knows."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return next(filter(None, names), platform.processor() or platform.machine())


def version_of(package: str) -> str:
    """The version of an installed package; "unknown" when it runs from its sources."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"
