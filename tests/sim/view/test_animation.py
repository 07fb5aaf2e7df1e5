from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from sim.recording.recording import Recording
from sim.view.animation import (
    FRAMES_PER_S,
    Track,
    animation_commands,
    frame_samples,
    key_samples,
    recorded_tracks,
)
from sim.view.appearance import Appearance
from sim.view.scenegraph import RobotTree
from tests.sim.conftest import APPEARS_S, DURATION_S


@pytest.fixture(scope="module")
def tree(robot: Baxter) -> RobotTree:
    return RobotTree(robot.model, Appearance.load())


@pytest.fixture(scope="module")
def tracks(recording: Recording, tree: RobotTree) -> list[Track]:
    return list(recorded_tracks(recording, tree))


def track_of(tracks: list[Track], path: str, key: str) -> Track:
    (track,) = (track for track in tracks if track.path.endswith(path) and track.key == key)
    return track


TOLERANCE = 0.05

motions = st.integers(1, 60).flatmap(
    lambda n: arrays(np.float64, (n, 2), elements=st.floats(-3.0, 3.0, width=32))
)


def test_only_moving_nodes_are_animated_after_all_are_placed(tracks: list[Track]) -> None:
    assert len({track.path for track in tracks if not track.is_constant}) == 4
    kinds = [command["type"] for command in animation_commands(tracks, DURATION_S)]
    assert kinds == ["set_property"] * len(tracks) + ["set_animation"]


def test_a_body_appears_at_its_time_where_it_then_stands(tracks: list[Track]) -> None:
    visible = track_of(tracks, "/bodies/block", "visible")
    assert visible.times_s.tolist() == [0.0, pytest.approx(APPEARS_S)]
    assert visible.values[:, 0].tolist() == [0.0, 1.0]
    assert np.isfinite(track_of(tracks, "/bodies/block", "position").values).all()


def test_a_body_that_was_never_there_stays_hidden(recording: Recording, tree: RobotTree) -> None:
    absent = np.full_like(recording.body_poses["block"], np.nan)
    poses = {**recording.body_poses, "block": absent}
    tracks = list(recorded_tracks(evolve(recording, body_poses=poses), tree))
    assert {track.key for track in tracks if track.path == "/bodies/block"} == {"visible"}


def test_keyframes_are_never_half_a_turn_apart(recording: Recording, tree: RobotTree) -> None:
    q = recording.q.copy()
    q[:, recording.joint_names.index("left_w2")] = np.linspace(-3.0, 3.0, len(q))
    tracks = list(recorded_tracks(evolve(recording, q=q), tree))
    quats = track_of(tracks, "left_w2/moves", "quaternion").values
    assert np.abs(np.einsum("ij,ij->i", quats[1:], quats[:-1])).min() > np.cos(np.pi / 4)


def test_a_quaternion_that_changes_sign_is_no_motion(recording: Recording, tree: RobotTree) -> None:
    table = recording.body_poses["table"].copy()
    table[::2, 3:] *= -1.0
    poses = {**recording.body_poses, "table": table}
    tracks = list(recorded_tracks(evolve(recording, body_poses=poses), tree))
    assert track_of(tracks, "/bodies/table", "quaternion").is_constant


def test_time_starts_at_zero_whenever_the_recording_began(
    recording: Recording, tree: RobotTree
) -> None:
    later = evolve(recording, times_s=recording.times_s + 100.0)
    tracks = list(recorded_tracks(later, tree))
    assert max(track.times_s[-1] for track in tracks) == pytest.approx(DURATION_S)
    assert {float(track.times_s[0]) for track in tracks} == {0.0}


@given(motions)
def test_interpolation_gives_the_samples_left_out(values: NDArray[np.float64]) -> None:
    times = np.linspace(0.0, 1.0, len(values)) if len(values) > 1 else np.zeros(1)
    kept = key_samples(times, values, TOLERANCE)
    assert (kept[0], kept[-1]) == (0, len(values) - 1)
    for column in values.T:
        shown = np.interp(times, times[kept], column[kept])
        assert np.abs(shown - column).max() <= TOLERANCE + 1e-12


def test_a_straight_line_needs_two_samples() -> None:
    times = np.linspace(0.0, 5.0, 501)
    assert key_samples(times, 0.3 * times[:, None], 1e-9).tolist() == [0, 500]


@pytest.mark.parametrize("rate", [10.0, 100.0])
def test_frames_are_no_more_than_promised_and_include_the_last_moment(rate: float) -> None:
    frames = frame_samples(np.arange(1001) / rate)
    assert len(frames) <= min(1001, 1000 / rate * FRAMES_PER_S + 2)
    assert (frames[0], frames[-1]) == (0, 1000)
    assert np.diff(frames).max() == max(1, int(rate / FRAMES_PER_S) + (rate > FRAMES_PER_S))
