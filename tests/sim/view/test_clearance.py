from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import Body, Plan
from planner.collision.robot.robot_body import RobotBody
from sim.events import EventKind
from sim.recording.recorder import planned_recording
from sim.recording.recording import Recording
from sim.view.clearance import (
    MAX_SAMPLES,
    NO_MOTION,
    SAMPLES_PER_S,
    recorded_clearance,
    sampled_rows,
)
from tests.conftest import at

PROVEN_M = 1e-6
"""What the proof of a plan and a measurement of it may differ by."""

SINGLE = 1e-6
"""Rounding of times in 32 bits, s."""

BETWEEN_SAMPLES_M = 5e-3
"""How much nearer two get between two samples where the hand comes to rest."""


@pytest.fixture(scope="module")
def shown(plan: Plan, robot: Baxter) -> Recording:
    return planned_recording(plan, robot)


class Sample(NamedTuple):
    """The nearest pair at a time of a recording, s from its start."""

    time_s: float
    distance_m: float
    first: str
    second: str


def samples_of(recording: Recording, robot: Baxter) -> list[Sample]:
    """What the page reads, row by row."""
    content, reason = recorded_clearance(recording, robot)
    assert content is not None
    assert reason == ""
    names = [content["names"][index] for index in content["pairs"]]
    rows = zip(
        content["times"].tolist(),
        content["distance_m"].tolist(),
        names[::2],
        names[1::2],
        strict=True,
    )
    return [Sample(*row) for row in rows]


def cut(recording: Recording, begin: int, end: int) -> Recording:
    """Some of its snapshots, with the events and moves of that time."""
    first_s, last_s = recording.times_s[[begin, end - 1]]
    return evolve(
        recording,
        times_s=recording.times_s[begin:end],
        q=recording.q[begin:end],
        gripper_percent=recording.gripper_percent[begin:end],
        body_poses={name: poses[begin:end] for name, poses in recording.body_poses.items()},
        events=tuple(e for e in recording.events if first_s <= e.time_s <= last_s),
        moves=tuple(m for m in recording.moves if m.end_s >= first_s and m.start_s <= last_s),
        start=None,
    )


def test_the_least_is_what_the_plan_says_and_of_the_same_two(
    shown: Recording, plan: Plan, robot: Baxter
) -> None:
    samples, proven_m, wanted = samples_of(shown, robot), plan.proven_clearance_m, plan.clearance
    assert proven_m is not None
    assert wanted is not None
    least = min(samples, key=lambda sample: sample.distance_m)
    assert least.distance_m >= proven_m - PROVEN_M
    assert least.distance_m == pytest.approx(wanted.distance_m, abs=BETWEEN_SAMPLES_M)
    assert {least.first, least.second} == {wanted.first, wanted.second}
    assert ("block", "table") in {(s.first, s.second) for s in samples}  # the block is held


def test_what_is_carried_off_the_plan_counts(shown: Recording, robot: Baxter, table: Body) -> None:
    """A wall that nobody planned for stands in the hand's way."""
    wall = evolve(table, name="wall", T_base_body=at(1.0, 0.0, -0.83))
    track = np.tile([1.0, 0.0, -0.83, 0.0, 0.0, 0.0, 1.0], (len(shown.times_s), 1))
    walled = evolve(
        shown,
        bodies={**shown.bodies, "wall": wall},
        body_poses={**shown.body_poses, "wall": track},
    )
    assert min(s.distance_m for s in samples_of(walled, robot)) <= 0.0


def test_arrays_have_as_many_rows_as_times(shown: Recording, robot: Baxter) -> None:
    content, _ = recorded_clearance(shown, robot)
    assert content is not None
    n = len(content["times"])
    lengths = [len(content[name]) for name in ("distance_m", "pairs", "points")]
    assert lengths == [n, 2 * n, 6 * n]
    assert content["times"][0] == 0.0
    assert content["times"][-1] == pytest.approx(shown.duration_s)


@pytest.mark.parametrize("duration_s", [0.0, 0.004, 1.0, 13.0, 300.0])
def test_samples_are_regular_and_not_too_many(duration_s: float) -> None:
    times = np.arange(0.0, duration_s + 0.005, 0.01)
    rows = sampled_rows(times)
    assert rows[0] == 0
    assert rows[-1] == len(times) - 1
    assert (np.diff(rows) > 0).all()
    assert len(rows) <= MAX_SAMPLES
    if 1.0 <= duration_s <= 13.0:
        assert np.diff(times[rows]).max() <= 1.0 / SAMPLES_PER_S + 0.01


@pytest.mark.slow
def test_a_recording_may_lack_bodies_events_and_moves(shown: Recording, robot: Baxter) -> None:
    links = RobotBody.load().links
    for sample in samples_of(evolve(shown, bodies={}, body_poses={}, events=()), robot):
        assert {sample.first, sample.second} <= links.keys()
    samples = samples_of(evolve(shown, events=(), moves=()), robot)
    assert len(samples) == len(samples_of(shown, robot))


def test_there_is_none_where_nothing_moves(shown: Recording, robot: Baxter) -> None:
    still = evolve(shown, q=np.tile(shown.q[0], (len(shown.q), 1)), moves=())
    assert recorded_clearance(still, robot) == (None, NO_MOTION)


def test_what_a_hand_held_before_the_recording_began_is_known(
    shown: Recording, robot: Baxter
) -> None:
    grasped, released = (
        next(e.time_s for e in shown.events if e.kind is kind)
        for kind in (EventKind.GRASPED, EventKind.RELEASED)
    )
    begin, end = np.searchsorted(shown.times_s, [grasped + 0.2, released - 0.2]).tolist()
    whole = samples_of(shown, robot)
    for part in (cut(shown, begin, len(shown.times_s)), cut(shown, begin, end)):
        samples, later_s = samples_of(part, robot), part.times_s[0] - shown.times_s[0]
        assert min(s.distance_m for s in samples) > 0.0
        for sample in samples:
            same = [s for s in whole if abs(s.time_s - later_s - sample.time_s) < SINGLE]
            assert all(sample.distance_m == pytest.approx(s.distance_m) for s in same)
