from __future__ import annotations

import numpy as np
import pytest

from planner import Manipulator, StraightMoveError, plan_path_move
from planner.approach import Approach, plan_entry, plan_transfer
from planner.lines import raised
from planner.rest_time import rest_to_rest_s
from planner.trajectory import CONTINUITY_TOLERANCE, Trajectory
from tests.conftest import overhead

PICK, PLACE = overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129)


@pytest.fixture(scope="module")
def approaches(manipulator: Manipulator) -> tuple[Approach, Approach]:
    """Down to the pick and down to the place."""
    q_pick = manipulator.ik.solve(PICK, current=manipulator.arm.start).q
    q_place = manipulator.ik.solve(PLACE, current=q_pick).q
    return (
        Approach.of(manipulator, q_pick, raised(PICK, 0.05)),
        Approach.of(manipulator, q_place, raised(PLACE, 0.05)),
    )


def joints_on(*parts: Trajectory) -> bool:
    """Whether each motion goes on with the state that the one before ended in."""
    ends = [part.sample(part.duration) for part in parts[:-1]]
    starts = [part.sample(0.0) for part in parts[1:]]
    gaps = [
        np.abs(x - y).max()
        for end, start in zip(ends, starts, strict=True)
        for x, y in zip(end, start, strict=True)
    ]
    return bool(max(gaps) <= CONTINUITY_TOLERANCE)


def test_faster_at_the_upper_end_is_sooner_down(approaches: tuple[Approach, Approach]) -> None:
    for approach in approaches:
        durations = [approach.descents[speed].duration for speed in sorted(approach.descents)]
        assert len(durations) == 2
        assert durations == sorted(durations, reverse=True)


def test_descents_begin_as_they_say_and_end_at_rest(approaches: tuple[Approach, Approach]) -> None:
    for approach in approaches:
        for speed, descent in approach.descents.items():
            expected, first = approach.state_above(speed), descent.sample(0.0)
            for x, y in zip(expected, first, strict=True):
                np.testing.assert_allclose(x, y, atol=CONTINUITY_TOLERANCE)
            assert np.abs(descent.v[-1]).max() == 0.0
            np.testing.assert_allclose(descent.q_goal, approach.q_target, atol=1e-9)


def test_short_lines_are_passed_faster_than_long_ones(manipulator: Manipulator) -> None:
    """In fractions of the line a second, times what a motion from rest to rest covers."""
    q = manipulator.ik.solve(PICK, current=manipulator.arm.start).q
    shares = []
    for rise_m in (0.05, 0.15):
        approach = Approach.of(manipulator, q, raised(PICK, rise_m))
        way = approach.q_target - approach.q_above
        mean = 1.0 / float(rest_to_rest_s(way, manipulator.limits))
        shares.append([speed / mean for speed in sorted(approach.descents)])
    np.testing.assert_allclose(shares, [[2.3, 2.9], [1.7, 2.3]])


def test_an_entry_passes_the_upper_end_and_beats_stopping_there(
    manipulator: Manipulator, approaches: tuple[Approach, Approach]
) -> None:
    pick, limits = approaches[0], manipulator.limits
    parts = plan_entry(manipulator.arm.start, pick, limits)
    assert joints_on(*parts)
    assert np.abs(parts[0].v[-1]).max() > 0.1
    stopping = Approach(pick.path, {0.0: plan_path_move(pick.path, limits)})
    stopped = plan_entry(manipulator.arm.start, stopping, limits)
    assert sum(p.duration for p in parts) < sum(p.duration for p in stopped)


def test_a_transfer_stops_at_neither_upper_end(
    manipulator: Manipulator, approaches: tuple[Approach, Approach]
) -> None:
    parts = plan_transfer(*approaches, manipulator.limits)
    assert joints_on(*parts)
    assert all(max(part.peak_ratios()) <= 1.0 + 1e-9 for part in parts)
    assert np.abs(parts[0].v[0]).max() == np.abs(parts[2].v[-1]).max() == 0.0
    assert min(np.abs(parts[0].v[-1]).max(), np.abs(parts[1].v[-1]).max()) > 0.1


def test_a_line_that_leaves_the_reach_is_refused(manipulator: Manipulator) -> None:
    q = manipulator.ik.solve(PICK, current=manipulator.arm.start).q
    with pytest.raises(StraightMoveError):
        Approach.of(manipulator, q, raised(PICK, 2.0))
