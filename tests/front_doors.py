"""The packages that users import from; what tests say of public names, they say of all of these."""

from __future__ import annotations

import baxter_kin
import baxter_kin.ik
import baxter_kin.parallel
import planner
import planner.atlas
import planner.atlas.redundancy
import planner.collision
import planner.grasping
import planner.verification
import sim
import sim.perception
import sim.recording
import sim.world

LAZY = (
    *(baxter_kin, planner, planner.collision, planner.grasping),
    *(sim, sim.perception, sim.recording, sim.world),
)
"""Those whose names are loaded when they are first used."""

FRONT_DOORS = (*LAZY, baxter_kin.ik, planner.verification)

DOCUMENTED = (*FRONT_DOORS, baxter_kin.parallel, planner.atlas, planner.atlas.redundancy)
"""These and packages for larger work: the reference has all of their names."""
