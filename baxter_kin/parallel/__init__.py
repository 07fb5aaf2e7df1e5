"""Many independent tasks: in this process, on its cores, or on a Dask cluster."""

from baxter_kin.parallel.engine import Engine, EngineError, LocalPool, Serial

__all__ = ["Engine", "EngineError", "LocalPool", "Serial"]
