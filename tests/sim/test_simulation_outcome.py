"""Dwells are times, and an outcome is a success or says why not."""

from __future__ import annotations

from sim import Dwell, Outcome
from sim.world import Contact


def test_nothing_dwells_by_default() -> None:
    assert Dwell() == Dwell(after_grasp_s=0.0, after_release_s=0.0)


def test_an_outcome_is_a_success_when_nothing_failed() -> None:
    assert Outcome(None, 6.5).is_success
    assert not Outcome("pick: close: missed", 2.0).is_success


def test_an_outcome_is_reported_in_one_line() -> None:
    assert repr(Outcome(None, 6.5)) == "Outcome(6.50 s, success)"
    assert "failed: pick: close: missed" in repr(Outcome("pick: close:\nmissed", 2.0))


def test_what_was_hit_is_reported_with_the_deepest_by_name() -> None:
    shallow, deep = (
        Contact(1.0, "l_gripper_l_finger", name, False, depth_m, False, 0.99)
        for name, depth_m in (("red", 0.001), ("box", 0.022))
    )
    outcome = Outcome(None, 2.0, hits=(shallow, deep))
    assert outcome.is_success
    assert repr(outcome) == (
        "Outcome(2.00 s, success, 2 hits: l_gripper_l_finger 22.0 mm inside box)"
    )
