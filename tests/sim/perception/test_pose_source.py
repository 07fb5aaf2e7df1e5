"""Pose sources: the truth, the truth as it was, noise with the promised spread, and replays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter
from planner import Body, Scene
from planner.errors import SceneError
from sim import Noise, NoisyPoses, Simulation, SimulationError, TruePoses, World
from sim.clock import DEFAULT_TICK_S
from sim.errors import RecordingError
from sim.perception import LoggedPoses, Look, ReplayedPoses, Sighting, read_looks
from sim.perception.noisy_poses import displaced
from sim.perception.pose_log import HEADER
from tests.conftest import at

EXACT = 1e-12
LOOKS = 4000
SPREAD = 0.05
"""Relative error of a standard deviation from so many samples: four of its own deviations."""


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


class TestNoise:
    def test_errors_have_the_spread_that_was_asked_for(self, world: World) -> None:
        true = world.body("block")
        noise = Noise(position_m=0.003, yaw_rad=0.05)
        eyes = NoisyPoses(TruePoses(world), noise, np.random.default_rng(5))
        seen = [sighting for _ in range(LOOKS) if (sighting := eyes.look("block", 0.0))]
        shifts = np.array([s.body.centre_base - true.centre_base for s in seen])
        yaws = [
            np.arctan2(s.body.T_base_body.rotation[1, 0], s.body.T_base_body.rotation[0, 0])
            for s in seen
        ]
        assert len(seen) == LOOKS
        assert shifts.std(axis=0) == pytest.approx([0.003] * 3, rel=SPREAD)
        assert np.abs(shifts.mean(axis=0)).max() <= 4 * 0.003 / np.sqrt(LOOKS)
        assert np.std(yaws) == pytest.approx(0.05, rel=SPREAD)
        assert all(abs(s.body.T_base_body.rotation[2, 2] - 1.0) <= EXACT for s in seen)

    def test_looks_drop_out_as_often_as_asked_for(self, world: World) -> None:
        eyes = NoisyPoses(TruePoses(world), Noise(dropout=0.3), np.random.default_rng(6))
        missed = sum(eyes.look("block", 0.0) is None for _ in range(LOOKS))
        assert missed / LOOKS == pytest.approx(0.3, rel=SPREAD)

    def test_latency_shows_the_past(self, world: World) -> None:
        truth = TruePoses(world)
        simulation = Simulation(world, [truth])
        simulation.wait(1.0)
        world.place_body("block", at(0.8, 0.2, -0.155))
        simulation.wait(0.2)
        eyes = NoisyPoses(truth, Noise(latency_s=0.5), np.random.default_rng(0))
        seen = eyes.look("block", simulation.time_s)
        assert seen is not None
        assert seen.body.T_base_body.translation[1] == pytest.approx(0.1265)
        assert seen.time_s == pytest.approx(0.7, abs=DEFAULT_TICK_S)

    def test_dropouts_do_not_shift_the_random_numbers(self, world: World) -> None:
        seen = []
        for dropout in (0.0, 0.5):
            rng = np.random.default_rng(7)
            eyes = NoisyPoses(TruePoses(world), Noise(0.003, dropout=dropout), rng)
            seen.append([eyes.look("block", 0.0) for _ in range(50)])
        pairs = [(one, other) for one, other in zip(*seen, strict=True) if one and other]
        assert 10 < len(pairs) < 40
        for one, other in pairs:
            assert one.body.T_base_body == other.body.T_base_body

    @given(st.floats(-3.0, 3.0))
    def test_a_turn_keeps_the_centre(self, block: Body, yaw: float) -> None:
        turned = displaced(block, np.zeros(3), yaw)
        assert turned.centre_base == pytest.approx(block.centre_base, abs=1e-9)

    @pytest.mark.parametrize("name", ["position_m", "yaw_rad", "dropout", "latency_s"])
    @pytest.mark.parametrize("bad", [-1e-9, np.nan, np.inf, None, "3 mm"])
    def test_what_is_no_noise_is_refused(self, name: str, bad: Any) -> None:
        with pytest.raises(SimulationError, match=name):
            Noise(**{name: bad})

    def test_a_probability_is_at_most_one(self) -> None:
        with pytest.raises(SimulationError, match="from 0 to 1"):
            Noise(dropout=1.1)

    def test_numbers_from_no_generator_are_refused(self, world: World) -> None:
        bad: Any = 5
        with pytest.raises(SimulationError, match="rng"):
            NoisyPoses(TruePoses(world), Noise(), bad)


class TestLog:
    def test_what_was_seen_is_seen_again(self, world: World, tmp_path: Path) -> None:
        path, noise = tmp_path / "looks.csv", Noise(0.003, 0.1, dropout=0.4)
        eyes = NoisyPoses(TruePoses(world), noise, np.random.default_rng(8))
        with LoggedPoses(eyes, path) as logged:
            seen = [logged.look("block", 0.1 * k) for k in range(40)]
        again = ReplayedPoses(read_looks(path), world.scene)
        for k, first in enumerate(seen):
            second = again.look("block", 0.1 * k)
            assert (first is None) == (second is None)
            if first is not None and second is not None:
                assert first.time_s == second.time_s
                assert second.body.T_base_body.isApprox(first.body.T_base_body, EXACT)

    def test_between_looks_the_last_one_answers_and_before_the_first_none(
        self, world: World
    ) -> None:
        looks = [Look(1.0, "block", 1.0, at(0.7, 0.1, 0.0)), Look(2.0, "block")]
        eyes = ReplayedPoses(looks, world.scene)
        found = [eyes.look("block", time_s) is not None for time_s in (0.5, 1.0, 1.9, 2.0, 9.0)]
        assert found == [False, True, True, False, False]
        assert eyes.look("ball", 1.0) is None

    def test_a_half_written_line_is_left_out(self, world: World, tmp_path: Path) -> None:
        path = tmp_path / "looks.csv"
        with LoggedPoses(TruePoses(world), path) as logged:
            logged.look("block", 0.0)
            logged.look("block", 1.0)
        whole = path.read_bytes()
        for cut in range(1, 40):
            path.write_bytes(whole[:-cut])
            assert len(read_looks(path)) in (1, 2)

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("", "is no pose log"),
            ("time,name\n", "is no pose log"),
            (f"{HEADER}\n1,block\n", "line 2: has 2 fields; it must have 10"),
            (f"{HEADER}\nsoon,block,,,,,,,,\n", "line 2: could not convert"),
            (f"{HEADER}\n1,,,,,,,,,\n", "line 2: names no body"),
            (f"{HEADER}\nnan,block,,,,,,,,\n", "line 2: the time of a look"),
            (f"{HEADER}\n1,block,1,0,0,0,0,0,0,0\n", "line 2: "),
        ],
    )
    def test_what_is_no_log_is_refused_with_the_line(
        self, tmp_path: Path, text: str, words: str
    ) -> None:
        path = tmp_path / "looks.csv"
        path.write_text(text)
        with pytest.raises(RecordingError, match=words):
            read_looks(path)

    def test_a_missing_file_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(RecordingError, match="No such file"):
            read_looks(tmp_path / "none.csv")

    def test_a_name_with_a_comma_cannot_be_logged(self, world: World, tmp_path: Path) -> None:
        with (
            LoggedPoses(TruePoses(world), tmp_path / "x.csv") as logged,
            pytest.raises(RecordingError, match="no comma"),
        ):
            logged.look("a,b", 0.0)

    def test_looks_must_not_go_back_in_time(self, world: World) -> None:
        with pytest.raises(SimulationError, match="go back in time"):
            ReplayedPoses([Look(1.0, "block"), Look(0.5, "block")], world.scene)

    def test_a_look_at_an_unknown_body_is_refused(self) -> None:
        with pytest.raises(SceneError, match="no body 'block'"):
            ReplayedPoses([Look(1.0, "block")], Scene.of())


def test_a_sighting_of_nothing_is_refused() -> None:
    bad: Any = None
    with pytest.raises(SimulationError, match="body of a sighting"):
        Sighting(bad, 0.0)
