"""One build as a process of its own, which may be killed: `python -m campaign.job`.

Prints one line of JSON at the end: how long the build took, and the processor time of each block in
the order in which they were done.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from baxter_kin import Baxter
from baxter_kin.parallel import Engine, LocalPool, Serial
from planner.atlas import BlockReport, PositionGrid, ReachMap, RotationGrid, build_reach_map
from planner.atlas.redundancy import Subset, build_redundancy_map

ENGINES = ("serial", "pool", "cluster")

HEIGHT_M, DOWN = 0.1, (0.0, 0.0, -1.0)
"""The plane, and where the tool points, of which a redundancy map is built."""


@contextmanager
def engine_of(name: str, workers: int) -> Iterator[Engine]:
    """An engine by its name; a cluster ends with the block."""
    if name == "serial":
        yield Serial()
    elif name == "pool":
        yield LocalPool(workers)
    else:
        from baxter_kin.parallel.dask_cluster import DaskCluster  # noqa: PLC0415 - only on demand

        with DaskCluster.local(workers) as engine:
            yield engine


def prepared(chosen: argparse.Namespace) -> Callable[..., object]:
    """What builds the map: a reach map, or a redundancy map of one."""
    if chosen.reach is not None:
        reach_map = ReachMap(chosen.reach)
        part = Subset.of(reach_map, z_m=HEIGHT_M, tool_axis=DOWN)
        return partial(build_redundancy_map, chosen.path, reach_map, part)
    robot = Baxter.load()
    grid, rotations = PositionGrid.around(robot, chosen.step_m), RotationGrid.hopf(chosen.level)
    return partial(build_reach_map, chosen.path, robot, grid, rotations)


def main() -> int:
    """Build what is missing of a map."""
    parser = argparse.ArgumentParser(description="One build of the campaign.")
    parser.add_argument("path", type=Path)
    parser.add_argument("engine", choices=ENGINES)
    parser.add_argument("workers", type=int)
    parser.add_argument("step_m", type=float)
    parser.add_argument("level", type=int)
    parser.add_argument("--reach", type=Path)
    chosen, blocks_s = parser.parse_args(), list[float]()

    def note(_done: int, _total: int, report: BlockReport) -> None:
        blocks_s.append(report.time_s)

    build = prepared(chosen)
    with engine_of(chosen.engine, chosen.workers) as engine:
        begun_s = time.perf_counter()
        build(engine=engine, progress=note)
        wall_s = time.perf_counter() - begun_s
    print(json.dumps({"wall_s": wall_s, "blocks_s": blocks_s}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
