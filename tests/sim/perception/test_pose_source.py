"""Pose sources: the truth, the truth as it was, and its noise: spread, dropouts, latency."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter
from planner import Body
from sim import Noise, NoisyPoses, Simulation, SimulationError, TruePoses, World
from sim.perception import Sighting
from sim.perception.pose_source import displaced
from sim.timeline import DEFAULT_TICK_S
from tests.conftest import at

EXACT = 1e-12
OBSERVATIONS = 2000

SPREAD = 0.07
"""Relative error of a standard deviation from so many samples: four of its own deviations."""


@pytest.fixture
def world(robot: Baxter, table: Body, block: Body) -> World:
    world = World(robot)
    for body in (table, block):
        world.spawn(body)
    return world


class TestTruth:
    def test_it_is_where_the_world_has_it(self, world: World) -> None:
        seen = TruePoses(world).observe("block", 3.0)
        assert seen is not None
        assert seen.time_s == 3.0
        assert seen.body.T_base_body == world.body("block").T_base_body
        assert TruePoses(world).observe("ball", 0.0) is None

    def test_an_observer_sees_what_was(self, world: World) -> None:
        truth = TruePoses(world)
        simulation = Simulation(world, [truth])
        simulation.wait(1.0)
        world.place_body("block", at(0.8, 0.2, -0.155))
        simulation.wait(1.0)
        ys = [truth.observe("block", time_s) for time_s in (0.5, 1.5, 9.0)]
        found = [round(float(seen.body.T_base_body.translation[1]), 4) for seen in ys if seen]
        assert found == [0.1265, 0.2, 0.2]


class TestNoise:
    @pytest.mark.slow
    def test_errors_have_the_requested_spread(self, world: World) -> None:
        true = world.body("block")
        noise = Noise(position_m=0.003, yaw_rad=0.05)
        source = NoisyPoses(TruePoses(world), noise, np.random.default_rng(5))
        seen = [sighting for _ in range(OBSERVATIONS) if (sighting := source.observe("block", 0.0))]
        shifts = np.array([s.body.centre_base - true.centre_base for s in seen])
        yaws = [
            np.arctan2(s.body.T_base_body.rotation[1, 0], s.body.T_base_body.rotation[0, 0])
            for s in seen
        ]
        assert len(seen) == OBSERVATIONS
        assert shifts.std(axis=0) == pytest.approx([0.003] * 3, rel=SPREAD)
        assert np.abs(shifts.mean(axis=0)).max() <= 4 * 0.003 / np.sqrt(OBSERVATIONS)
        assert np.std(yaws) == pytest.approx(0.05, rel=SPREAD)
        assert all(abs(s.body.T_base_body.rotation[2, 2] - 1.0) <= EXACT for s in seen)

    def test_observations_drop_out_as_often_as_requested(self, world: World) -> None:
        source = NoisyPoses(TruePoses(world), Noise(dropout=0.3), np.random.default_rng(6))
        missed = sum(source.observe("block", 0.0) is None for _ in range(OBSERVATIONS))
        assert missed / OBSERVATIONS == pytest.approx(0.3, rel=SPREAD)

    def test_latency_shows_the_past(self, world: World) -> None:
        truth = TruePoses(world)
        simulation = Simulation(world, [truth])
        simulation.wait(1.0)
        world.place_body("block", at(0.8, 0.2, -0.155))
        simulation.wait(0.2)
        source = NoisyPoses(truth, Noise(latency_s=0.5), np.random.default_rng(0))
        seen = source.observe("block", simulation.time_s)
        assert seen is not None
        assert seen.body.T_base_body.translation[1] == pytest.approx(0.1265)
        assert seen.time_s == pytest.approx(0.7, abs=DEFAULT_TICK_S)

    def test_dropouts_do_not_shift_the_random_numbers(self, world: World) -> None:
        seen = []
        for dropout in (0.0, 0.5):
            rng = np.random.default_rng(7)
            source = NoisyPoses(TruePoses(world), Noise(0.003, dropout=dropout), rng)
            seen.append([source.observe("block", 0.0) for _ in range(50)])
        pairs = [(one, other) for one, other in zip(*seen, strict=True) if one and other]
        assert 10 < len(pairs) < 40
        for one, other in pairs:
            assert one.body.T_base_body == other.body.T_base_body

    @given(st.floats(-3.0, 3.0))
    def test_a_turn_keeps_the_centre(self, block: Body, yaw: float) -> None:
        turned = displaced(block, np.zeros(3), yaw)
        assert turned.centre_base == pytest.approx(block.centre_base, abs=1e-9)

    @pytest.mark.parametrize("name", ["position_m", "yaw_rad", "dropout", "latency_s"])
    def test_wrong_arguments_are_refused(self, world: World, name: str) -> None:
        bad: Any
        for bad in (-1e-9, np.nan, np.inf, None, "3 mm"):
            with pytest.raises(SimulationError, match=name):
                Noise(**{name: bad})
        with pytest.raises(SimulationError, match="dropout"):
            Noise(dropout=1.1)
        bad = None
        with pytest.raises(SimulationError, match="rng"):
            NoisyPoses(TruePoses(world), Noise(), bad)
        with pytest.raises(SimulationError, match="world"):
            TruePoses(bad)
        with pytest.raises(SimulationError, match="body"):
            Sighting(bad, 0.0)
