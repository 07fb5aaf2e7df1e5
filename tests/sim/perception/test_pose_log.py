"""Pose log: what was seen is seen again, and files that hold no looks are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from baxter_kin import Baxter
from planner import Body, Scene
from planner.errors import SceneError
from sim import Noise, NoisyPoses, SimulationError, TruePoses, World
from sim.errors import RecordingError
from sim.perception import LoggedPoses, Look, ReplayedPoses, read_looks
from sim.perception.pose_log import HEADER
from tests.conftest import at

EXACT = 1e-12


@pytest.fixture
def world(robot: Baxter, table: Body, block: Body) -> World:
    world = World(robot)
    for body in (table, block):
        world.spawn(body)
    return world


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
            (f"{HEADER}\nnan,block,,,,,,,,\n", "line 2: time_s"),
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
