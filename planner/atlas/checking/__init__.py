"""Checks a map by other code: Pinocchio on the whole robot's model, and a solver of its own.

Nothing of the search that made the map is used here: no closed form, no proof, no joint chain of
ours. Of randomly chosen cells, half of them next to the boundary between reachable and unreachable,

- every witness has to reach its pose, inside the limits of the URDF and as far from them as its
  margin says;
- a solver that does not know the witness (`PoseFinder`) looks for a configuration. It must reach no
  cell that is said to be proven unreachable. How many of the reachable cells it reaches is its
  power: what a check by it is worth. A pose that is reached in spite of a proof would be like those
  that are reached next to the limits only, so that the power there is told, too.

All blocks are read, and their checksums with them.
"""

from planner.atlas.checking.cell_check import NEAR_LIMITS_RAD
from planner.atlas.checking.map_check import CELLS, MOST_CELLS, MapCheck, check_map

__all__ = ["CELLS", "MOST_CELLS", "NEAR_LIMITS_RAD", "MapCheck", "check_map"]
