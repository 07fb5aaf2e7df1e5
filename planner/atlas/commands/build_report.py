"""What a build has done: counted while it goes on, told at its end."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from baxter_kin.json_text import Json
from baxter_kin.value_objects import count
from planner.atlas.building import BlockReport
from planner.atlas.commands.reports import shown_bytes, shown_share
from planner.atlas.commands.requested_map import RequestedMap
from planner.atlas.cost import Cost, shown_time


@dataclass(slots=True)
class BuildReport:
    """Cells and times of one build.

    Attributes:
        cost: as it was told before.
        workers: how many there were.
        blocks: that were computed now.
        reachable: cells among them with a witness.
        unreachable: cells that are proven so.
        undecided: cells that are neither.
        core_s: processor time of the workers.
        wall_s: from begin to end.
        size_bytes: of the whole map on disk.
        is_stopped: whether by Ctrl-C.
    """

    cost: Cost
    workers: int
    blocks: int = 0
    reachable: int = 0
    unreachable: int = 0
    undecided: int = 0
    core_s: float = 0.0
    wall_s: float = 0.0
    size_bytes: int = 0
    is_stopped: bool = False
    _begun_s: float = field(default_factory=time.monotonic)

    def add(self, block: BlockReport) -> None:
        """Count one block."""
        self.blocks += 1
        self.reachable += block.reachable
        self.unreachable += block.unreachable
        self.undecided += block.undecided
        self.core_s += block.time_s

    def end(self, size_bytes: int) -> None:
        """Stop the clock."""
        self.wall_s, self.size_bytes = time.monotonic() - self._begun_s, size_bytes

    @property
    def cells(self) -> int:
        """That were computed now."""
        return self.reachable + self.unreachable + self.undecided

    @property
    def cells_per_core_s(self) -> float | None:
        """Throughput; None where nothing was computed."""
        return self.cells / self.core_s if self.core_s > 0.0 else None

    def told(self) -> str:
        """The report in three lines."""
        on_disk = f"the map takes {shown_bytes(self.size_bytes)} on disk"
        if self.cells_per_core_s is None:
            return f"nothing was computed; {on_disk}"
        return (
            f"computed {self.cells:,} cells in {shown_time(self.wall_s)} with "
            f"{count(self.workers, 'worker')}: {shown_time(self.core_s)} of one core, "
            f"{self.cells_per_core_s:,.0f} cells a second and core\n"
            f"reachable {shown_share(self.reachable, self.cells)}, "
            f"proven unreachable {shown_share(self.unreachable, self.cells)}, "
            f"undecided {shown_share(self.undecided, self.cells)}\n{on_disk}"
        )

    def as_json(self, asked: RequestedMap) -> dict[str, Json]:
        """The same as data."""
        return {
            "map": str(asked.path),
            "cells": len(asked),
            "expected": {
                "core_s": self.cost.core_s,
                "core_error_s": self.cost.core_error_s,
                "size_bytes": self.cost.size_bytes,
                "cells": self.cost.cells,
                "positions_measured": self.cost.measured,
            },
            "computed": {
                "blocks": self.blocks,
                "cells": self.cells,
                "reachable": self.reachable,
                "unreachable": self.unreachable,
                "undecided": self.undecided,
                "core_s": self.core_s,
                "wall_s": self.wall_s,
                "workers": self.workers,
                "cells_per_core_s": self.cells_per_core_s,
            },
            "size_bytes": self.size_bytes,
            "stopped_by_ctrl_c": self.is_stopped,
        }
