from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import Body, Plan
from planner.collision.robot.robot_body import RobotBody
from sim.events import EventKind
from sim.recording.recorder import planned_recording
from sim.recording.recording import Recording
from sim.view.telemetry.clearance import (
    MOST_SAMPLES,
    NO_MOTION,
    SAMPLES_PER_S,
    clearance_samples,
    recorded_clearance,
    sampled_rows,
    why_unmeasured,
)
from tests.conftest import at

PROVEN_M = 1e-6
"""What the proof of a plan and a measurement of it may differ by."""

BETWEEN_SAMPLES_M = 5e-3
"""How much nearer two get between two samples where the hand comes to rest."""


@pytest.fixture(scope="module")
def shown(plan: Plan, robot: Baxter) -> Recording:
    return planned_recording(plan, robot)


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
    )


def test_nothing_is_nearer_than_the_plan_proves(
    shown: Recording, plan: Plan, robot: Baxter
) -> None:
    proven_m = plan.proven_clearance_m
    assert proven_m is not None
    for sample in clearance_samples(shown, robot):
        assert sample.nearest.distance_m >= proven_m - PROVEN_M


def test_the_least_is_what_the_plan_says_and_of_the_same_two(
    shown: Recording, plan: Plan, robot: Baxter
) -> None:
    least = min((s.nearest for s in clearance_samples(shown, robot)), key=lambda n: n.distance_m)
    wanted = plan.clearance
    assert wanted is not None
    assert least.distance_m == pytest.approx(wanted.distance_m, abs=BETWEEN_SAMPLES_M)
    assert {least.first, least.second} == {wanted.first, wanted.second}


def test_a_held_block_counts_against_the_table(shown: Recording, robot: Baxter) -> None:
    pairs = {(s.nearest.first, s.nearest.second) for s in clearance_samples(shown, robot)}
    assert ("block", "table") in pairs


def test_what_is_carried_off_the_plan_counts(shown: Recording, robot: Baxter, table: Body) -> None:
    """A wall that nobody planned for stands in the hand's way."""
    wall = evolve(table, name="wall", T_base_body=at(1.0, 0.0, -0.83))
    track = np.tile([1.0, 0.0, -0.83, 0.0, 0.0, 0.0, 1.0], (len(shown.times_s), 1))
    walled = evolve(
        shown,
        bodies={**shown.bodies, "wall": wall},
        body_poses={**shown.body_poses, "wall": track},
    )
    assert min(s.nearest.distance_m for s in clearance_samples(walled, robot)) <= 0.0


def test_the_page_gets_flat_arrays_and_names(shown: Recording, robot: Baxter) -> None:
    told, samples = recorded_clearance(shown, robot), clearance_samples(shown, robot)
    assert told is not None
    n = len(told["times"])
    assert (len(told["distance_m"]), len(told["pairs"]), len(told["points"])) == (n, 2 * n, 6 * n)
    names = [told["names"][index] for index in told["pairs"]]
    assert names[::2] == [sample.nearest.first for sample in samples]
    assert names[1::2] == [sample.nearest.second for sample in samples]
    assert told["times"][0] == 0.0
    assert told["times"][-1] == pytest.approx(shown.duration_s)


@pytest.mark.parametrize("duration_s", [0.0, 0.004, 1.0, 13.0, 300.0])
def test_samples_are_regular_and_not_too_many(duration_s: float) -> None:
    times = np.arange(0.0, duration_s + 0.005, 0.01)
    rows = sampled_rows(times)
    assert rows[0] == 0
    assert rows[-1] == len(times) - 1
    assert (np.diff(rows) > 0).all()
    assert len(rows) <= MOST_SAMPLES
    if 1.0 <= duration_s <= 13.0:
        assert np.diff(times[rows]).max() <= 1.0 / SAMPLES_PER_S + 0.01


def test_a_recording_without_bodies_tells_of_the_robot_alone(
    shown: Recording, robot: Baxter
) -> None:
    bare = evolve(shown, bodies={}, body_poses={}, events=())
    links = RobotBody.load().links
    for sample in clearance_samples(bare, robot):
        assert {sample.nearest.first, sample.nearest.second} <= links.keys()


def test_a_file_without_events_and_moves_works(shown: Recording, robot: Baxter) -> None:
    told = clearance_samples(evolve(shown, events=(), moves=()), robot)
    assert len(told) == len(clearance_samples(shown, robot))


def test_there_is_none_where_nothing_moves(shown: Recording, robot: Baxter) -> None:
    still = evolve(shown, q=np.tile(shown.q[0], (len(shown.q), 1)), moves=())
    assert recorded_clearance(still, robot) is None
    assert why_unmeasured(still, robot) == NO_MOTION


def test_what_a_hand_held_before_the_recording_began_is_known(
    shown: Recording, robot: Baxter
) -> None:
    grasped, released = (
        next(e.time_s for e in shown.events if e.kind is kind)
        for kind in (EventKind.GRASPED, EventKind.RELEASED)
    )
    begin, end = np.searchsorted(shown.times_s, [grasped + 0.2, released - 0.2]).tolist()
    whole = {s.time_s: s.nearest.distance_m for s in clearance_samples(shown, robot)}
    for part in (cut(shown, begin, len(shown.times_s)), cut(shown, begin, end)):
        told = clearance_samples(part, robot)
        assert min(s.nearest.distance_m for s in told) > 0.0
        same = [s for s in told if s.time_s in whole]
        assert all(s.nearest.distance_m == pytest.approx(whole[s.time_s]) for s in same)
