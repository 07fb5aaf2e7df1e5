"""Pose sources: the truth, and the truth as it was."""

from __future__ import annotations

from typing import Any

import pytest

from baxter_kin import Baxter
from planner import Body
from sim import Simulation, SimulationError, TruePoses, World
from sim.perception import Sighting
from tests.conftest import at


@pytest.fixture
def world(robot: Baxter, table: Body, block: Body) -> World:
    world = World(robot)
    for body in (table, block):
        world.spawn(body)
    return world


class TestTruth:
    def test_it_is_where_the_world_has_it(self, world: World) -> None:
        seen = TruePoses(world).look("block", 3.0)
        assert seen is not None
        assert seen.time_s == 3.0
        assert seen.body.T_base_body == world.body("block").T_base_body

    def test_what_is_not_there_is_not_seen(self, world: World) -> None:
        assert TruePoses(world).look("ball", 0.0) is None

    def test_an_observer_sees_what_was(self, world: World) -> None:
        truth = TruePoses(world)
        simulation = Simulation(world, [truth])
        simulation.wait(1.0)
        world.place_body("block", at(0.8, 0.2, -0.155))
        simulation.wait(1.0)
        ys = [truth.look("block", time_s) for time_s in (0.5, 1.5, 9.0)]
        found = [round(float(seen.body.T_base_body.translation[1]), 4) for seen in ys if seen]
        assert found == [0.1265, 0.2, 0.2]

    @pytest.mark.parametrize("bad", [None, "world"])
    def test_a_world_that_is_none_is_refused(self, bad: Any) -> None:
        with pytest.raises(SimulationError, match="world"):
            TruePoses(bad)


def test_a_sighting_of_nothing_is_refused() -> None:
    bad: Any = None
    with pytest.raises(SimulationError, match=r"Sighting\.body must be Body"):
        Sighting(bad, 0.0)
