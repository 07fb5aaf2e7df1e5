"""Options that say where the work is done: this machine's cores, or a Dask cluster."""

from __future__ import annotations

from baxter_kin.command_line import Options
from baxter_kin.parallel import engine_options
from baxter_kin.parallel.engine_options import engine_of

__all__ = ["add_engine_options", "engine_of"]


def add_engine_options(parser: Options) -> None:
    """Add `--jobs`, `--scheduler` and `--local-cluster`; `engine_of` reads them."""
    group = parser.add_argument_group("where it is computed")
    needs = "all its machines must see the map at the same path"
    engine_options.add_engine_options(group, needs=needs)
